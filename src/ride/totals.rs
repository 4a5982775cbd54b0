//! What a ride has done so far, and how that is told at its end.

use crate::log::Log;
use crate::ride::Ride;
use crate::settings::Mode;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// The shortest time that a share is taken of, s.
const LEAST: f64 = 1e-300;

/// The totals of the whole run, over all its parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Totals {
    /// Time from which the surrogates might have jumped, s; none: not yet.
    pub first_time: Option<f64>,
    /// Time of the first jump, s.
    pub takeover: Option<f64>,
    /// Simulated time replaced, s.
    pub replaced: f64,
    /// Wall time of strides and of handing over, s.
    pub seconds: [f64; 2],
    pub jumps: usize,
    /// Jumps of each surrogate, and the time that it replaced, s.
    pub by: Vec<(usize, f64)>,
    /// Jumps that ended early because a prediction was not finite, or not accepted.
    pub ended_early: usize,
    /// Strides of all jumps, and of those before the last one.
    pub steps: usize,
    pub before: usize,
    /// Who jumped last.
    pub last: usize,
    /// Strides measured beside the solver, and decisions for no jump.
    pub measured: usize,
    pub refused: usize,
}

impl Totals {
    pub fn begin_jump(&mut self, surrogate: usize, surrogates: usize, time: f64) {
        if self.jumps == 0 {
            self.takeover = Some(time);
        }
        self.jumps += 1;
        self.before = self.steps;
        self.by.resize(surrogates, (0, 0.0));
        self.by[surrogate].0 += 1;
        self.last = surrogate;
    }

    /// Strides of the last jump, in all parts of the run.
    pub fn last_jump(&self) -> usize {
        self.steps.saturating_sub(self.before)
    }
}

impl Ride<'_> {
    /// Ends the ride: what there is to be said goes into the log. Gives the summary, the text of a JSON object; empty where the mode has
    /// none, or nothing could be replaced yet.
    pub fn end(&mut self) -> String {
        let digits = self.digits();
        if self.settings.mode == Mode::Observe {
            for i in 0..self.candidates.len() {
                let (who, candidate) = (self.who(i), &self.candidates[i]);
                if let Some(observer) = &candidate.observer {
                    self.log.text += &observer.summary(&who, candidate, &self.layout, digits);
                    self.decisions.tell(&self.step, "end", &observer.totals(candidate, &self.layout));
                }
            }
            return String::new();
        }
        let t = &self.totals;
        let Some(first) = t.first_time else {
            return String::new();
        };
        let candidate = &self.candidates[t.last];
        let setup = self.settings.setup_seconds;
        let total = (self.step.time.min(self.schedule.end.max(first)) - first).max(LEAST);
        let fraction = t.replaced / total;
        let Log { text, .. } = &mut self.log;
        *text += &format!(
            "m4gn: replacedFraction = {} ({} s of {} s in {} jumps, {} surrogate steps; {} jumps ended early), surrogate {} s, hand-over \
             {} s, setup {} s\n\n",
            digits.of(fraction),
            digits.of(t.replaced),
            digits.of(total),
            t.jumps,
            t.steps,
            t.ended_early,
            digits.of(t.seconds[0]),
            digits.of(t.seconds[1]),
            digits.of(setup)
        );
        if t.jumps == 0 {
            for candidate in &self.candidates {
                let name = &candidate.describe().name;
                let why = match candidate.surrogate.fits() {
                    Some(fits) => fits.why_no_jump(self.step.time),
                    None => format!(
                        "{} strides beside the solver were measured, and {} jumps were not allowed",
                        t.measured, t.refused
                    ),
                };
                *text += &format!("m4gn: no jump of {name}: {why}\n\n");
            }
        }
        let mut entries: Vec<(String, String)> = Vec::new();
        if self.candidates.len() > 1 {
            let by = t.by.iter().copied().chain(std::iter::repeat((0, 0.0)));
            for (candidate, (jumps, replaced)) in self.candidates.iter().zip(by) {
                let name = &candidate.describe().name;
                *text += &format!("m4gn: of these {jumps} jumps and {} s by {name}\n\n", digits.of(replaced));
                entries.push((format!("jumps_{name}"), jumps.to_string()));
                entries.push((format!("replaced_{name}"), digits.of(replaced)));
            }
        }
        let mut more: Vec<(&str, String)> = Vec::new();
        if self.settings.control.is_some() {
            more.extend([
                ("strides_measured", t.measured.to_string()),
                ("jumps_refused", t.refused.to_string()),
            ]);
        }
        let held = self.quantities.summary(&self.settings.quantities);
        entries.extend(held.into_iter().map(|(name, value)| (name, digits.of(value))));
        if let Some((judged, [before, after], capped)) = self.watch.summary() {
            more.extend([
                ("jumps_watched", judged.to_string()),
                ("correctors_before", digits.of(before)),
                ("correctors_after", digits.of(after)),
                ("jumps_to_the_cap", capped.to_string()),
            ]);
        }
        more.extend([
            ("replaced_time", digits.of(t.replaced)),
            ("solver_time", digits.of(total - t.replaced)),
            ("replaced_fraction", digits.of(fraction)),
            ("takeover_time", digits.of(t.takeover.unwrap_or(first))),
            ("jumps", t.jumps.to_string()),
            ("jumps_ended_early", t.ended_early.to_string()),
            ("surrogate_steps", t.steps.to_string()),
            ("stride", digits.of(candidate.stride())),
            ("surrogate_seconds", digits.of(t.seconds[0])),
            ("hand_over_seconds", digits.of(t.seconds[1])),
            ("setup_seconds", digits.of(setup)),
        ]);
        entries.extend(more.into_iter().map(|(name, value)| (name.to_string(), value)));
        let numbers = entries.iter().map(|(name, v)| (name.clone(), json!(v.parse::<f64>().ok())));
        self.decisions.tell(&self.step, "end", &Value::Object(numbers.collect()));
        let lines: Vec<String> =
            entries.iter().map(|(name, value)| format!("  \"{name}\": {value}")).collect();
        format!("{{\n{}\n}}\n", lines.join(",\n"))
    }
}
