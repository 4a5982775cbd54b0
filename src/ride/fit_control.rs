//! When a fit of the run's own states is made, used and dropped, and how far it may jump.
//!
//! A fit is used if it predicts the held-back end of its window to a share of the error of holding the last state, and waiting
//! would not better it. Its first jump has `initial_jump` strides. A stride beside the solver after a jump that agrees to twice that share
//! lets the next one be longer; one that agrees to the tolerance lets it be shorter; else the solver goes on until a new fit holds.

use crate::decisions::Decisions;
use crate::dmd::DmdSurrogate;
use crate::dmd_settings::DmdSettings;
use crate::interval::LEAST_ENERGY;
use crate::schedule::Step;
use crate::tables::Digits;
use m4gn_base::Result;
use m4gn_dmd::{Fit, Mode, relative};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// Tries before a fit that must have been as good, for it to be taken as what can be had.
const WAITED: usize = 3;

/// Errors fall where a try's is below this times an earlier one's, and rise where it is the other way round.
const FALLS: f64 = 0.7;

/// Error below which later fits are likely to hold.
const PROMISING: f64 = 0.2;

/// What decides over one fit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FitControl {
    /// Strides that the next jump may have.
    length: f64,
    /// Snapshots since the last try.
    tried: usize,
    /// Errors of the last tries since a fit was dropped; last, of the fit in use.
    errors: Vec<f64>,
    /// Tries in all, the least of their errors, and the snapshots without a gap up to now.
    tries: usize,
    best: f64,
    contiguous: usize,
    /// Strides that another surrogate has jumped since a fit was far off.
    pub jumped_by_others: f64,
    /// Whether it was said what a snapshot costs.
    #[serde(skip)]
    timed: bool,
    /// The modes of the fit that was used last, where they were not taken yet.
    #[serde(skip)]
    pub modes: Vec<Mode>,
}

impl FitControl {
    pub fn new(rules: &DmdSettings) -> Self {
        FitControl { length: rules.initial_jump as f64, best: f64::MAX, ..FitControl::default() }
    }

    /// Error of a stride beside the solver up to which the present fit is as good as when it was first used: twice what it was used with.
    fn limit(&self, rules: &DmdSettings) -> f64 {
        let used = self.errors.last().map_or(0.0, |e| 2.0 * e);
        used.max(rules.fit_tolerance).min(rules.jump_tolerance)
    }
}

impl DmdSurrogate {
    /// Strides that the fit may jump, `most` at most.
    pub(crate) fn allows(&self, most: usize) -> usize {
        match self.has_fit() {
            true => most.min(self.control.length as usize),
            false => 0,
        }
    }

    /// Whether the solver is to go on where another surrogate would jump: that one has jumped as far as a window is long, and a window of the
    /// solver's own states must come before a fit can hold.
    pub(crate) fn wants_solver(&self) -> bool {
        !self.has_fit() && self.control.jumped_by_others >= self.rules().window() as f64
    }

    /// Takes the state after a step of the solver; `cuts`: a stride may begin here that cuts the start-up short. Says what came of it, and
    /// whether what was measured of the fit is void. [`Error::Input`](m4gn_base::Error::Input) for a state that does not fit. Collective.
    pub(crate) fn observe(
        &mut self,
        step: &Step,
        state: &[&[f64]],
        cuts: bool,
        decisions: &mut Decisions,
    ) -> Result<(String, bool)> {
        let arrays: Vec<&[f64]> = self.places.iter().map(|&i| state[i]).collect();
        let between = self.online.wrong_between(step.time, step.delta_t, &arrays);
        if between.is_some() {
            self.online.forget();
            self.now.interval.missed(self.description.stride);
        }
        let interval = self.other_interval(step.delta_t);
        if let Some(interval) = interval {
            self.begin_anew(interval, step.time);
        }
        let outlook = self.online.outlook();
        let snapshots = self.online.offer(step.time, step.delta_t, &arrays)?;
        let (mut text, void) = (String::new(), interval.is_some() || between.is_some());
        if void {
            self.control.errors.clear();
        }
        if let Some(error) = between {
            let decided =
                json!({ "error": error, "after_jump": false, "between": true, "decision": "dropped" });
            decisions.tell(step, "fit_stride", &decided);
            let advice = if interval.is_some() { "" } else { "; expected a smaller snapshotInterval" };
            text = format!(
                "m4gn: time {}: between its states the fit had an error of {error:.3} of holding, as they miss faster waves; the fit is \
                 dropped{advice}\n\n",
                step.name
            );
        }
        if let Some(interval) = interval {
            (self.control.tried, self.control.length) = (0, self.settings.initial_jump as f64);
            let why = match self.now.interval.period() {
                _ if between.is_some() => "the fit was dropped".into(),
                Some(period) => format!("fits show a period of {period:.3e} s"),
                None => format!("the solver's step is {:.3e} s", step.delta_t),
            };
            text += &format!(
                "m4gn: time {}: {why}: states are kept {interval:.3e} s apart from here on\n\n",
                step.name
            );
        }
        if snapshots == 0 {
            return Ok((text, void));
        }
        self.now.begin = step.time;
        self.now.offset = self.online.since(step.time).unwrap_or(0.0).max(0.0);
        let jumped = std::mem::take(&mut self.now.jumped);
        if let Some(outlook) = outlook {
            let trial = self.online.later(&outlook, snapshots as f64);
            let errors = trial.ok().and_then(|trial| self.online.errors(&trial, snapshots));
            let error = errors.map_or(f64::INFINITY, |e| relative(&e));
            text += &self.compare(step, (error, jumped), decisions);
        }
        if cuts && self.settings.cut_transient {
            text += &self.look(step, decisions);
        }
        if self.cuts() {
            // The window begins anew.
            (self.control.tried, self.control.contiguous) = (0, 0);
            self.control.errors.clear();
            return Ok((text, void));
        }
        let contiguous = self.online.usable();
        (self.control.tried, self.control.contiguous) = (self.control.tried + snapshots, contiguous);
        let (least, every) = (self.settings.min_snapshots(), self.settings.refit_interval);
        if contiguous >= least && (self.control.tried >= every || contiguous == least) {
            text += &self.try_fit(step, decisions);
        }
        Ok((text, void))
    }

    /// Tries a fit. Says what came of it.
    fn try_fit(&mut self, step: &Step, decisions: &mut Decisions) -> String {
        self.control.tried = 0;
        let modes = self.fit();
        let rules = self.rules().clone();
        let (Some(modes), Some(fit)) = (modes, self.online.fitted()) else {
            self.control.jumped_by_others = 0.0;
            return String::new();
        };
        let (control, error) = (&mut self.control, fit.tail_error());
        let trend = trend(&control.errors, error);
        let settled = error < rules.fit_tolerance || trend == Trend::Alike;
        (control.tries, control.best) = (control.tries + 1, control.best.min(error));
        let surplus = (control.errors.len() + 1).saturating_sub(WAITED);
        control.errors.drain(..surplus);
        // JSON, which the state is kept in, has no infinity; it is one where the last states are all the same.
        control.errors.push(error.min(f64::MAX));
        let holds = error < rules.jump_tolerance && settled;
        // Where a fit holds, or will, what another surrogate makes would only begin the window anew.
        control.jumped_by_others = if error < PROMISING { rules.window() as f64 } else { 0.0 };
        control.length = rules.initial_jump as f64;
        let verdict = match trend {
            _ if holds && fit.model.inputs() > 0 => "it is used, with what is prescribed from here on".into(),
            _ if holds => format!("it is used: {}", leading(&modes)),
            _ if error >= rules.jump_tolerance => {
                format!("above jumpTolerance {}: the solver goes on", rules.jump_tolerance)
            }
            Trend::Falls => "the solver goes on while it gets better".into(),
            Trend::Rises => "the solver goes on while it gets worse".into(),
            _ => format!(
                "above fitTolerance {}, and {WAITED} tries before must have been as good: the solver goes on",
                rules.fit_tolerance
            ),
        };
        let mut text = described(fit, step, &verdict);
        let mut decided = as_data(fit, &rules);
        decided["decision"] = json!(if holds { "used" } else { "dropped" });
        // Which bound it has met, or missed
        decided["why"] = json!(match trend {
            _ if error < rules.fit_tolerance.min(rules.jump_tolerance) => "fitTolerance",
            _ if error >= rules.jump_tolerance => "jumpTolerance",
            Trend::Alike => "settled",
            Trend::Falls => "improves",
            Trend::Rises => "worsens",
            Trend::Open => "waits",
        });
        if holds && !std::mem::replace(&mut control.timed, true) {
            let seconds = self.online.seconds_a_state();
            decided["seconds_a_state"] = json!(seconds);
            let _ = write!(
                text,
                "m4gn: each state of the window adds {seconds:.1e} s to a stride of the fit\n\n"
            );
        }
        match holds {
            true => {
                decided["modes"] = modes.iter().map(mode_as_data).collect();
                control.modes = modes;
            }
            false => self.online.forget(),
        }
        decisions.tell(step, "fit", &decided);
        text
    }

    /// Why there was no jump up to this time, s, for people.
    pub(crate) fn why_no_jump(&self, time: f64) -> String {
        let (rules, stride, FitControl { tries, best, contiguous, .. }) =
            (self.rules(), self.description.stride, &self.control);
        let missing = rules.min_snapshots().saturating_sub(*contiguous);
        match tries {
            0 => format!(
                "no fit: it takes {} states {stride:.3e} s apart without a gap (minSnapshots), and at the end there were {contiguous}; a first \
                 one comes at {} s at the earliest",
                rules.min_snapshots(),
                Digits(6).of(time + missing as f64 * stride)
            ),
            n => format!(
                "{n} fits, the best with an error of {best:.3} of holding (jumpTolerance {}, fitTolerance {})",
                rules.jump_tolerance, rules.fit_tolerance
            ),
        }
    }

    /// Takes up the error of a stride that the fit predicted, and whether that follows a jump. Says what came of it.
    fn compare(&mut self, step: &Step, (error, jumped): (f64, bool), decisions: &mut Decisions) -> String {
        let rules = self.rules().clone();
        let control = &mut self.control;
        let mut text = format!(
            "m4gn: time {}: a stride of the fit beside the solver had an error of {error:.3} of holding",
            step.name
        );
        let limit = control.limit(&rules);
        let good = error < limit;
        let mut decision = "kept";
        if jumped && error < rules.jump_tolerance {
            let growth = if good { rules.jump_growth } else { 1.0 / rules.jump_growth };
            let (first, longest) = (rules.initial_jump as f64, rules.max_jump as f64);
            control.length = (control.length * growth).clamp(first, longest);
            decision = if good { "longer" } else { "shorter" };
            let _ = write!(text, "; the next jump may have {} strides", control.length as usize);
        } else if !good {
            let (name, limit) = match jumped || limit == rules.jump_tolerance {
                true => ("jumpTolerance", rules.jump_tolerance),
                false => ("fitTolerance, or twice the error of the fit,", limit),
            };
            let _ = write!(text, ", above {name} {limit:.3}; the fit is dropped");
            control.errors.clear();
            self.online.forget();
            decision = "dropped";
        }
        let decided = json!({
            "error": error, "after_jump": jumped, "limit": limit, "decision": decision, "next_jump": control.length as usize,
        });
        decisions.tell(step, "fit_stride", &decided);
        text + "\n\n"
    }
}

fn as_data(fit: &Fit, rules: &DmdSettings) -> Value {
    let fields: Map<String, Value> = fit.tail.iter().map(|e| (e.name.clone(), json!(e.error))).collect();
    let model = &fit.model;
    json!({
        "states": fit.numbers.len(), "delays": model.delays(), "rank": model.rank(), "inputs": model.inputs(), "growth_kept": model.growing(),
        "held_back": fit.held_back, "error": fit.tail_error(), "fit_tolerance": rules.fit_tolerance,
        "jump_tolerance": rules.jump_tolerance, "errors": fields,
    })
}

fn mode_as_data(mode: &Mode) -> Value {
    json!({
        "frequency": mode.frequency, "growth_rate": mode.growth_rate, "amplitude": mode.amplitude, "energy": mode.energy,
    })
}

/// The wave with the largest share of the energy, for people.
fn leading(modes: &[Mode]) -> String {
    let digits = Digits(3);
    // The mean and drifts have shares of their own.
    let Some(mode) = modes.iter().find(|m| m.frequency > 0.0 && m.energy >= LEAST_ENERGY) else {
        return "no wave in it".into();
    };
    format!("period {} s, growth {} 1/s", digits.of(1.0 / mode.frequency), digits.of(mode.growth_rate))
}

fn described(fit: &Fit, step: &Step, verdict: &str) -> String {
    let fields: Vec<String> = fit.tail.iter().map(|e| format!("{} {:.2e}", e.name, e.error)).collect();
    let kind = match (fit.model.inputs(), fit.model.growing()) {
        (0, true) => "growth kept".into(),
        (0, false) => "growth clipped".into(),
        (1, _) => "1 input".into(),
        (n, _) => format!("{n} inputs"),
    };
    format!(
        "m4gn: time {}: fit of {} states, {} delays, rank {}, {kind}: its last {} states, held back, have an error of {:.3} of \
         holding (of the variation: {}); {verdict}\n\n",
        step.name,
        fit.numbers.len(),
        fit.model.delays(),
        fit.model.rank(),
        fit.held_back,
        fit.tail_error(),
        fields.join(", ")
    )
}

/// How the errors of the tries of a fit go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trend {
    /// Too few tries to tell.
    Open,
    Falls,
    Rises,
    /// A fit need not wait for a better one. A wake that settles gives better fits with every period, and a flow that changes gives worse
    /// ones, while noise is the same in all.
    Alike,
}

fn trend(tries: &[f64], error: f64) -> Trend {
    let Some(last) = tries.len().checked_sub(WAITED).map(|from| &tries[from..]) else {
        return Trend::Open;
    };
    match (last.iter().any(|e| FALLS * error >= *e), last.iter().any(|e| error <= FALLS * e)) {
        (true, _) => Trend::Rises,
        (_, true) => Trend::Falls,
        _ => Trend::Alike,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_waits_while_fits_get_better_or_worse() {
        assert_eq!([trend(&[], 0.01), trend(&[0.01, 0.01], 0.01)], [Trend::Open; 2]);
        assert_eq!(trend(&[0.04, 0.02, 0.012], 0.01), Trend::Falls);
        assert_eq!(trend(&[0.014, 0.014, 0.008], 0.018), Trend::Rises, "not better is not good");
        assert_eq!(trend(&[0.011, 0.009, 0.013], 0.01), Trend::Alike, "noise");
        assert_eq!(
            trend(&[0.9, 0.011, 0.009, 0.013], 0.01),
            Trend::Alike,
            "what was long before does not count"
        );
    }
}
