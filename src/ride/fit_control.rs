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
use crate::surrogate::{Cut, FitReport, Wave};
use crate::tables::Digits;
use m4gn_base::Result;
use m4gn_dmd::Mode;
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
    jumped_by_others: f64,
    /// Whether it was said what a snapshot costs.
    #[serde(skip)]
    timed: bool,
    /// The modes of the fit that was used last, where they were not taken yet.
    #[serde(skip)]
    modes: Vec<Mode>,
}

impl FitControl {
    pub fn new(rules: &DmdSettings) -> Self {
        FitControl { length: rules.initial_jump as f64, best: f64::MAX, ..FitControl::default() }
    }

    /// Strides that the fit may jump, `most` at most.
    pub fn allows(&self, fits: &DmdSurrogate, most: usize) -> usize {
        match fits.has_fit() {
            true => most.min(self.length as usize),
            false => 0,
        }
    }

    /// Whether the solver is to go on where another surrogate would jump: that one has jumped as far as a window is long, and a window of the
    /// solver's own states must come before a fit can hold.
    pub fn wants_solver(&self, fits: &DmdSurrogate) -> bool {
        !fits.has_fit() && self.jumped_by_others >= fits.rules().window() as f64
    }

    /// Takes the modes of a fit that is used from here on; none: there is no new one.
    pub fn take_modes(&mut self) -> Vec<Mode> {
        std::mem::take(&mut self.modes)
    }

    /// Another surrogate has jumped so many strides.
    pub fn others_jumped(&mut self, strides: f64) {
        self.jumped_by_others += strides;
    }

    /// Takes the state after a step of the solver; `cuts`: a stride may begin here that cuts the start-up short. Says what came of it, and
    /// whether what was measured of the fit is void. Collective.
    pub fn observe(
        &mut self,
        fits: &mut DmdSurrogate,
        step: &Step,
        (state, cuts): (&[&[f64]], bool),
        decisions: &mut Decisions,
    ) -> Result<(String, bool)> {
        let seen = fits.observe(step, state, cuts)?;
        let mut text = String::new();
        let void = seen.interval.is_some() || seen.between.is_some();
        if let Some(error) = seen.between {
            self.errors.clear();
            let decided =
                json!({ "error": error, "after_jump": false, "between": true, "decision": "dropped" });
            decisions.tell(step, "fit_stride", &decided);
            let advice = if seen.interval.is_some() { "" } else { "; expected a smaller snapshotInterval" };
            text = format!(
                "m4gn: time {}: between its states the fit had an error of {error:.3} of holding, as they miss faster waves; the fit is \
                 dropped{advice}\n\n",
                step.name
            );
        }
        if let Some(interval) = seen.interval {
            (self.tried, self.length) = (0, fits.rules().initial_jump as f64);
            self.errors.clear();
            let why = match seen.period {
                _ if seen.between.is_some() => "the fit was dropped".into(),
                Some(period) => format!("fits show a period of {period:.3e} s"),
                None => format!("the solver's step is {:.3e} s", step.delta_t),
            };
            text += &format!(
                "m4gn: time {}: {why}: states are kept {interval:.3e} s apart from here on\n\n",
                step.name
            );
        }
        if seen.snapshots == 0 {
            return Ok((text, void));
        }
        if let Some((error, jumped)) = seen.error {
            text += &self.compare(fits, step, (error, jumped), decisions);
        }
        if let Some(wave) = &seen.wave {
            text += &of_the_wave(wave, step, decisions);
        }
        if fits.cuts() {
            // The window begins anew.
            (self.tried, self.contiguous) = (0, 0);
            self.errors.clear();
            return Ok((text, void));
        }
        self.tried += seen.snapshots;
        self.contiguous = seen.contiguous;
        let (least, every) = (fits.rules().min_snapshots(), fits.rules().refit_interval);
        if seen.contiguous >= least && (self.tried >= every || seen.contiguous == least) {
            text += &self.fit(fits, step, decisions);
        }
        Ok((text, void))
    }

    /// Tries a fit. Says what came of it.
    fn fit(&mut self, fits: &mut DmdSurrogate, step: &Step, decisions: &mut Decisions) -> String {
        self.tried = 0;
        let Some(report) = fits.fit() else {
            self.jumped_by_others = 0.0;
            return String::new();
        };
        let rules = fits.rules().clone();
        let error = report.error;
        let trend = trend(&self.errors, error);
        let settled = error < rules.fit_tolerance || trend == Trend::Alike;
        (self.tries, self.best) = (self.tries + 1, self.best.min(error));
        let surplus = (self.errors.len() + 1).saturating_sub(WAITED);
        self.errors.drain(..surplus);
        // JSON, which the state is kept in, has no infinity; it is one where the last states are all the same.
        self.errors.push(error.min(f64::MAX));
        let holds = error < rules.jump_tolerance && settled;
        if !holds {
            fits.drop_fit();
        }
        // Where a fit holds, or will, what another surrogate makes would only begin the window anew.
        self.jumped_by_others = if error < PROMISING { rules.window() as f64 } else { 0.0 };
        self.length = rules.initial_jump as f64;
        let verdict = match trend {
            _ if holds && report.inputs > 0 => "it is used, with what is prescribed from here on".into(),
            _ if holds => format!("it is used: {}", leading(&report.modes)),
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
        let mut text = described(&report, step, &verdict);
        let mut decided = as_data(&report, &rules);
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
        if holds && !std::mem::replace(&mut self.timed, true) {
            let seconds = fits.seconds_a_snapshot();
            decided["seconds_a_state"] = json!(seconds);
            let _ = write!(
                text,
                "m4gn: each state of the window adds {seconds:.1e} s to a stride of the fit\n\n"
            );
        }
        if holds {
            decided["modes"] = report.modes.iter().map(mode_as_data).collect();
            self.modes = report.modes;
        }
        decisions.tell(step, "fit", &decided);
        text
    }

    /// Why there was no jump, for people.
    pub fn why_no_jump(&self, rules: &DmdSettings, stride: f64, time: f64) -> String {
        let missing = rules.min_snapshots().saturating_sub(self.contiguous);
        match self.tries {
            0 => format!(
                "no fit: it takes {} states {stride:.3e} s apart without a gap (minSnapshots), and at the end there were {}; a first one comes \
                 at {} s at the earliest",
                rules.min_snapshots(),
                self.contiguous,
                Digits(6).of(time + missing as f64 * stride)
            ),
            n => format!(
                "{n} fits, the best with an error of {:.3} of holding (jumpTolerance {}, fitTolerance {})",
                self.best, rules.jump_tolerance, rules.fit_tolerance
            ),
        }
    }

    /// Error of a stride beside the solver up to which the present fit is as good as when it was first used: twice what it was used with.
    fn limit(&self, rules: &DmdSettings) -> f64 {
        let used = self.errors.last().map_or(0.0, |e| 2.0 * e);
        used.max(rules.fit_tolerance).min(rules.jump_tolerance)
    }

    /// Takes up the error of a stride that the fit predicted. Says what came of it.
    fn compare(
        &mut self,
        fits: &mut DmdSurrogate,
        step: &Step,
        (error, jumped): (f64, bool),
        decisions: &mut Decisions,
    ) -> String {
        let rules = fits.rules();
        let mut text = format!(
            "m4gn: time {}: a stride of the fit beside the solver had an error of {error:.3} of holding",
            step.name
        );
        let limit = self.limit(rules);
        let good = error < limit;
        let mut decision = "kept";
        if jumped && error < rules.jump_tolerance {
            let growth = if good { rules.jump_growth } else { 1.0 / rules.jump_growth };
            let (first, longest) = (rules.initial_jump as f64, rules.max_jump as f64);
            self.length = (self.length * growth).clamp(first, longest);
            decision = if good { "longer" } else { "shorter" };
            let _ = write!(text, "; the next jump may have {} strides", self.length as usize);
        } else if !good {
            let (name, limit) = match jumped || limit == rules.jump_tolerance {
                true => ("jumpTolerance", rules.jump_tolerance),
                false => ("fitTolerance, or twice the error of the fit,", limit),
            };
            let _ = write!(text, ", above {name} {limit:.3}; the fit is dropped");
            self.errors.clear();
            fits.drop_fit();
            decision = "dropped";
        }
        let decided = json!({
            "error": error, "after_jump": jumped, "limit": limit, "decision": decision, "next_jump": self.length as usize,
        });
        decisions.tell(step, "fit_stride", &decided);
        text + "\n\n"
    }
}

/// Tells what is done about the wave of the start-up. Says it, for people.
fn of_the_wave(wave: &Wave, step: &Step, decisions: &mut Decisions) -> String {
    let digits = Digits(3);
    let (decision, factor) = match (wave.cut, wave.kept) {
        (Cut::Changed(factor), _) => ("changed", Some(factor)),
        (Cut::Undone(_), _) => ("undone", None),
        (Cut::Settled, _) => ("settled", None),
        (Cut::None, Some(_)) => ("kept", None),
        (Cut::None, None) => ("seen", None),
    };
    let [frequency, growth, amplitude] = wave.figures.map_or([None; 3], |f| f.map(Some));
    let decided = json!({
        "decision": decision, "kept": wave.kept, "frequency": frequency, "growth_rate": growth, "amplitude": amplitude, "factor": factor,
    });
    decisions.tell(step, "start_up", &decided);
    let figures = match wave.figures {
        Some([frequency, growth, amplitude]) => format!(
            "a wave of period {} s, growth {} 1/s, amplitude {}",
            digits.of(1.0 / frequency),
            digits.of(growth),
            digits.of(amplitude)
        ),
        None => "no wave is clear".into(),
    };
    let kept = if wave.kept == Some(true) { ": the last change is kept" } else { "" };
    let done = match wave.cut {
        Cut::Changed(factor) => format!(
            ": its amplitude is brought to {}, {} times as much",
            digits.of(factor * amplitude.unwrap_or(0.0)),
            digits.of(factor)
        ),
        Cut::Undone(last) => {
            let more = if last { ", and it is left alone from here on" } else { "" };
            format!(": the last change has not bettered it; the state before is taken up again{more}")
        }
        Cut::Settled => ": it stays as it is, and no more is changed".into(),
        // A wave that is only seen is data, and no line
        Cut::None if wave.kept.is_none() => return String::new(),
        Cut::None => String::new(),
    };
    format!("m4gn: time {}: start-up: {figures}{kept}{done}\n\n", step.name)
}

fn as_data(report: &FitReport, rules: &DmdSettings) -> Value {
    let fields: Map<String, Value> = report.errors.iter().map(|(name, e)| (name.clone(), json!(e))).collect();
    json!({
        "states": report.snapshots, "delays": report.delays, "rank": report.rank, "inputs": report.inputs, "growth_kept": report.unstable,
        "held_back": report.held_back, "error": report.error, "fit_tolerance": rules.fit_tolerance,
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

fn described(report: &FitReport, step: &Step, verdict: &str) -> String {
    let fields: Vec<String> =
        report.errors.iter().map(|(name, error)| format!("{name} {error:.2e}")).collect();
    format!(
        "m4gn: time {}: fit of {} states, {} delays, rank {}, {}: its last {} states, held back, have an error of {:.3} of \
         holding (of the variation: {}); {verdict}\n\n",
        step.name,
        report.snapshots,
        report.delays,
        report.rank,
        report.kind(),
        report.held_back,
        report.error,
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
