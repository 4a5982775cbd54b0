//! What a case sets of the dmd surrogate.

use m4gn_linear::{FitSettings, Storage};
use m4gn_mesh::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Most strides of a jump: more than any run has, and few enough for a number each.
const LONGEST: usize = 1_000_000;

/// Settings of a dmd surrogate in a run. All have defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DmdSettings {
    /// Time between snapshots, s; none: 25 of the solver's steps at the start.
    pub snapshot_interval: Option<f64>,
    /// Largest error of the held-back tail, and of a stride after a jump, over what holding would be off by.
    pub jump_tolerance: f64,
    /// Error below which a fit is used at once; above it, within the tolerance, only once waiting does not better it.
    pub fit_tolerance: f64,
    /// Strides of the first jump of a fit.
    pub initial_jump: usize,
    /// How much longer the next jump may be.
    pub jump_growth: f64,
    /// Strides of a jump at most.
    pub max_jump: usize,
    /// Strides of the solver between tries of a fit.
    pub refit_interval: usize,
    /// Snapshots in a fit at most.
    pub window: usize,
    /// Snapshots without a gap that a fit needs; none: the window, since the first states after a jump are not yet the solver's own.
    pub min_snapshots: Option<usize>,
    /// Snapshots that are held back.
    pub hold_out: usize,
    /// Delays to choose from.
    pub delays: Vec<usize>,
    /// Ranks to choose from.
    pub svd_rank: Vec<usize>,
    /// Whether modes may grow; none: the tail says.
    pub unstable_modes: Option<bool>,
    /// How snapshots are kept: double or single.
    pub storage: Storage,
    /// Where the snapshots are kept for a run that is carried on, a file a rank; none: they are not.
    pub file: Option<PathBuf>,
}

impl Default for DmdSettings {
    fn default() -> Self {
        let fit = FitSettings::default();
        DmdSettings {
            snapshot_interval: None,
            jump_tolerance: 0.02,
            fit_tolerance: 0.005,
            initial_jump: 10,
            jump_growth: 1.5,
            max_jump: 200,
            refit_interval: 5,
            window: fit.window,
            min_snapshots: None,
            hold_out: fit.hold_out,
            delays: fit.delays,
            svd_rank: fit.svd_rank,
            unstable_modes: fit.unstable_modes,
            storage: Storage::default(),
            file: None,
        }
    }
}

impl DmdSettings {
    pub(crate) fn min_snapshots(&self) -> usize {
        self.min_snapshots.unwrap_or(self.window)
    }

    pub(crate) fn fit(&self) -> FitSettings {
        FitSettings {
            window: self.window,
            min_snapshots: self.min_snapshots(),
            hold_out: self.hold_out,
            delays: self.delays.clone(),
            svd_rank: self.svd_rank.clone(),
            unstable_modes: self.unstable_modes,
        }
    }

    pub(crate) fn check(&self) -> Result<()> {
        let bad = |text: String| Err(Error::Input(format!("dmd: {text}")));
        let above = |v: f64| v.is_finite() && v > 0.0;
        if let Some(interval) = self.snapshot_interval.filter(|v| !above(*v)) {
            return bad(format!("snapshotInterval {interval}: expected a time above 0, s"));
        }
        if !above(self.jump_tolerance) {
            return bad(format!(
                "jumpTolerance {}: expected an error above 0, such as 0.02",
                self.jump_tolerance
            ));
        }
        if !above(self.fit_tolerance) {
            return bad(format!(
                "fitTolerance {}: expected an error above 0, such as 0.005",
                self.fit_tolerance
            ));
        }
        if !(self.jump_growth.is_finite() && self.jump_growth >= 1.0) {
            return bad(format!("jumpGrowth {}: expected at least 1", self.jump_growth));
        }
        if self.initial_jump == 0
            || self.refit_interval == 0
            || !(self.initial_jump..=LONGEST).contains(&self.max_jump)
        {
            return bad(format!(
                "initialJump {}, maxJump {}, refitInterval {}: expected at least 1 stride each, and maxJump from initialJump to {LONGEST}",
                self.initial_jump, self.max_jump, self.refit_interval
            ));
        }
        self.fit().check()
    }
}
