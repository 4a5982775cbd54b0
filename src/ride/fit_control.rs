//! When a fit of the run's own states is made, used and dropped, and how far it may jump.
//!
//! A fit is used if it predicts the held-back end of its window to a share of what holding the last state would be off by, and waiting
//! would not better it. Its first jump has `initial_jump` strides. A stride beside the solver after a jump that agrees to twice that share
//! lets the next one be longer; one that agrees to the tolerance lets it be shorter; else the solver goes on until a new fit holds.

use crate::schedule::Step;
use crate::surrogate::{FitReport, Fits};
use m4gn_base::Result;
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Tries before a fit that must not have been much worse, for it to be taken as what can be had.
const WAITED: usize = 3;

/// Errors fall where a try's is below this times an earlier one's.
const FALLS: f64 = 0.7;

/// Error below which later fits are likely to hold.
const PROMISING: f64 = 0.2;

/// The rules of one kind of fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRules {
    /// Error of the held-back snapshots below which a fit is used at once.
    pub fit_tolerance: f64,
    /// Largest error of the held-back snapshots, and of a stride after a jump.
    pub jump_tolerance: f64,
    /// Strides of the first jump of a fit.
    pub initial_jump: usize,
    /// How much longer the next may be.
    pub jump_growth: f64,
    /// Strides of a jump at most.
    pub max_jump: usize,
    /// Strides of the solver between tries of a fit.
    pub refit_interval: usize,
    /// Snapshots without a gap that a fit needs.
    pub min_snapshots: usize,
    /// Snapshots in a fit at most.
    pub window: usize,
    /// Snapshots that are held back.
    pub hold_out: usize,
}

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
    /// Strides that another surrogate has jumped since a fit was far off.
    jumped_by_others: f64,
    /// Whether it was said what a snapshot costs.
    #[serde(skip)]
    timed: bool,
}

impl FitControl {
    pub fn new(rules: &FitRules) -> Self {
        FitControl { length: rules.initial_jump as f64, ..FitControl::default() }
    }

    /// Strides that the fit may jump, `most` at most.
    pub fn allows(&self, fits: &dyn Fits, most: usize) -> usize {
        match fits.has_fit() {
            true => most.min(self.length as usize),
            false => 0,
        }
    }

    /// Whether the solver is to go on where another surrogate would jump: that one has jumped as far as a window is long, and a window of the
    /// solver's own states must come before a fit can hold.
    pub fn wants_solver(&self, fits: &dyn Fits) -> bool {
        !fits.has_fit() && self.jumped_by_others >= fits.rules().window as f64
    }

    /// Another surrogate has jumped so many strides.
    pub fn others_jumped(&mut self, strides: f64) {
        self.jumped_by_others += strides;
    }

    /// Takes the state after a step of the solver. Says what came of it. Collective.
    pub fn observe(&mut self, fits: &mut dyn Fits, step: &Step, state: &[&[f64]]) -> Result<String> {
        let seen = fits.observe(step, state)?;
        let mut said = String::new();
        if seen.snapshots == 0 {
            return Ok(said);
        }
        if let Some((error, jumped)) = seen.error {
            said += &self.compare(fits, step, error, jumped);
        }
        self.tried += seen.snapshots;
        let (least, every) = (fits.rules().min_snapshots, fits.rules().refit_interval);
        if seen.contiguous >= least && (self.tried >= every || seen.contiguous == least) {
            said += &self.fit(fits, step);
        }
        Ok(said)
    }

    /// Tries a fit. Says what came of it.
    fn fit(&mut self, fits: &mut dyn Fits, step: &Step) -> String {
        self.tried = 0;
        let rules = fits.rules().clone();
        let Some(report) = fits.fit() else {
            self.jumped_by_others = 0.0;
            return String::new();
        };
        let error = report.error;
        let settled = error < rules.fit_tolerance || settled(&self.errors, error);
        let surplus = (self.errors.len() + 1).saturating_sub(WAITED);
        self.errors.drain(..surplus);
        // JSON, which the state is kept in, has no infinity; it is one where the last states are all the same.
        self.errors.push(error.min(f64::MAX));
        let holds = error < rules.jump_tolerance && settled;
        if !holds {
            fits.drop_fit();
        }
        // Where a fit holds, or will, what another surrogate makes would only begin the window anew.
        self.jumped_by_others = if error < PROMISING { rules.window as f64 } else { 0.0 };
        self.length = rules.initial_jump as f64;
        let verdict = match (holds, settled) {
            (true, _) => "it is used",
            (_, true) => "the solver goes on",
            _ => "the solver goes on while it gets better",
        };
        let mut said = described(&report, &rules, step, verdict);
        if holds && !std::mem::replace(&mut self.timed, true) {
            let seconds = fits.seconds_a_snapshot();
            let _ = write!(
                said,
                "m4gn: each state of the window adds {seconds:.1e} s to a stride of the fit\n\n"
            );
        }
        said
    }

    /// Error of a stride beside the solver up to which the present fit is as good as when it was first used: twice what it was used with.
    fn limit(&self, rules: &FitRules) -> f64 {
        let used = self.errors.last().map_or(0.0, |e| 2.0 * e);
        used.max(rules.fit_tolerance).min(rules.jump_tolerance)
    }

    /// Takes up the error of a stride that the fit predicted. Says what came of it.
    fn compare(&mut self, fits: &mut dyn Fits, step: &Step, error: f64, jumped: bool) -> String {
        let rules = fits.rules();
        let mut said = format!(
            "m4gn: time {}: a stride of the fit beside the solver was off by {error:.3} of what holding would be",
            step.name
        );
        let good = error < self.limit(rules);
        if jumped && error < rules.jump_tolerance {
            let growth = if good { rules.jump_growth } else { 1.0 / rules.jump_growth };
            let (first, longest) = (rules.initial_jump as f64, rules.max_jump as f64);
            self.length = (self.length * growth).clamp(first, longest);
            let _ = write!(said, "; the next jump may have {} strides", self.length as usize);
        } else if !good {
            self.errors.clear();
            fits.drop_fit();
            said += "; the fit is dropped";
        }
        said + "\n\n"
    }
}

fn described(report: &FitReport, rules: &FitRules, step: &Step, verdict: &str) -> String {
    let modes = if report.unstable { "kept" } else { "clipped" };
    let fields: Vec<String> =
        report.errors.iter().map(|(name, error)| format!("{name} {error:.2e}")).collect();
    format!(
        "m4gn: time {}: fit of {} states, {} delays, rank {}, growth {modes}: its last {} states, held back, are off by {:.3} of what \
         holding would be (of the variation: {}); {verdict}\n\n",
        step.name,
        report.snapshots,
        report.delays,
        report.rank,
        rules.hold_out,
        report.error,
        fields.join(", ")
    )
}

/// Whether a fit with this error need not wait for a better one: the last tries were hardly worse. A wake that settles gives better fits
/// with every period, while noise is the same in all.
pub(crate) fn settled(tries: &[f64], error: f64) -> bool {
    let last = tries.len().checked_sub(WAITED).map(|from| &tries[from..]);
    last.is_some_and(|last| last.iter().all(|e| error > FALLS * e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_waits_while_fits_get_better() {
        assert!(!settled(&[], 0.01) && !settled(&[0.01, 0.01], 0.01), "too few tries to tell");
        assert!(!settled(&[0.04, 0.02, 0.012], 0.01), "it still falls");
        assert!(settled(&[0.011, 0.009, 0.013], 0.01), "noise");
        assert!(settled(&[0.9, 0.011, 0.009, 0.013], 0.01), "what was long before does not count");
    }
}
