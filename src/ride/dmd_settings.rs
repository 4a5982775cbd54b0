//! What a case sets of the dmd surrogate.

use m4gn_base::settings;
use m4gn_base::{Error, Result};
use m4gn_dmd::{FitSettings, Settle, Storage};
use m4gn_state::Array;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Most strides of a jump: more than any run has, and few enough for a number each.
const LONGEST: usize = 1_000_000;

/// States in a fit where inputs are known: what they do to a wave shows only as they differ.
const DRIVEN_WINDOW: usize = 160;

settings! {
    /// Settings of a dmd surrogate in a run.
    pub struct DmdSettings in "dmd" {
        /// Time between snapshots, the stride: a tenth to a twentieth of the flow's period.
        pub snapshot_interval: Option<f64> [s] = None, "found in the run: ten of the longest recent time steps, doubled while a period that fits show has more than 28 snapshots";
        /// Most snapshots in a fit, up to 1000.
        pub window: Option<usize> = None, "40, and 160 where boundary values are prescribed in time";
        // The first states after a jump are not yet the solver's own.
        /// Fewest snapshots without a gap that a fit needs.
        pub min_snapshots: Option<usize> = None, "`window`, where it is given, else 40";
        /// Snapshots at the end of the window that are held out, to choose `delays` and `svdRank` by.
        pub hold_out: usize = FitSettings::default().hold_out;
        /// Candidates for the number of snapshots in a delayed one (higher-order DMD).
        pub delays: Vec<usize> = FitSettings::default().delays;
        /// Candidates for the rank of the truncated singular value decomposition.
        pub svd_rank: Vec<usize> = FitSettings::default().svd_rank;
        /// Whether modes may grow; else a growth rate above 0 counts as 0.
        pub unstable_modes: Option<bool> = FitSettings::default().unstable_modes, "chosen by the held-out snapshots";
        /// Strides of the solver between two fits.
        pub refit_interval: usize = 5;
        /// Error of the held-out snapshots, over that of holding the last one before them, below which a fit is used at once; between this
        /// and `jumpTolerance` it is used if the three fits before were about as good. A stride beside the solver with an error below this, or
        /// below twice the fit's, makes the next jump longer, else shorter.
        pub fit_tolerance: f64 = 0.005;
        /// Largest error of the held-out snapshots, and of a stride beside the solver after a jump, over that of holding the last state.
        pub jump_tolerance: f64 = 0.02;
        // What is at rest, or nearly, is jumped: a share of what it still changes by would be that of rounding.
        /// Fields, each with a change (root mean square, in its unit) that counts as none (`rest { U 1e-4; }`): errors are relative to the
        /// flow's change, but at least to this.
        pub rest: BTreeMap<String, f64> = BTreeMap::new(), "a ten-thousandth of the most that a field has changed by since the first state";
        /// Whether a start-up is cut short: a wave that grows or decays is brought to its final amplitude. Until it has settled, the run
        /// differs from the plain one.
        pub cut_transient: bool = false;
        /// Number of modes of the fit that are written as fields, the largest first, with their mean.
        pub write_modes: usize = 0;
        /// Strides of the first jump of a fit.
        pub initial_jump: usize = 10;
        /// Largest ratio of a jump to the one before.
        pub jump_growth: f64 = 1.5;
        /// Most strides of a jump, up to a million.
        pub max_jump: usize = 200;
        /// Precision of stored snapshots: `double` or `single`; sums are in double.
        pub storage: Storage = Storage::default();
        /// Whether snapshots are stored on disk for restarts.
        pub keep: bool = true;
    }
    beside {
        /// Where they are kept, a file a rank; none: nowhere.
        pub file: Option<PathBuf>;
    }
}

impl DmdSettings {
    pub(crate) fn min_snapshots(&self) -> usize {
        self.min_snapshots.or(self.window).unwrap_or(FitSettings::default().window)
    }

    pub(crate) fn window(&self) -> usize {
        self.window.unwrap_or(FitSettings::default().window)
    }

    /// With the numbers that are left to us, in a case with inputs or without.
    pub(crate) fn with_inputs(self, inputs: bool) -> Self {
        let min_snapshots = self.min_snapshots();
        let window = if inputs { DRIVEN_WINDOW.max(min_snapshots) } else { self.window() };
        DmdSettings { min_snapshots: Some(min_snapshots), window: self.window.or(Some(window)), ..self }
    }

    pub(crate) fn fit(&self) -> FitSettings {
        FitSettings {
            window: self.window(),
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
        if let Some((field, change)) = self.rest.iter().find(|(_, change)| !above(**change)) {
            return bad(format!(
                "rest: {field} {change}: expected a change above 0, in the unit of the field"
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
        if self.cut_transient && self.window() < Settle::STATES {
            return bad(format!(
                "window {}: expected at least {} states with cutTransient",
                self.window(),
                Settle::STATES
            ));
        }
        self.fit().check()
    }

    /// Of each of these arrays the change that counts as none, where it is given.
    ///
    /// # Errors
    /// [`Error::Input`] for a change of what is not measured.
    pub(crate) fn rest(&self, arrays: &[Array]) -> Result<Vec<Option<f64>>> {
        let measured = arrays.iter().filter(|a| a.is_measured()).map(|a| a.name.as_str());
        let measured: Vec<&str> = measured.collect();
        match self.rest.keys().find(|name| !measured.contains(&name.as_str())) {
            Some(unknown) => Err(Error::Input(format!(
                "dmd: rest: {unknown}: expected some of the fields that are advanced and measured, {}",
                measured.join(", ")
            ))),
            None => {
                let of = |a: &Array| self.rest.get(&a.name).copied().filter(|_| a.is_measured());
                Ok(arrays.iter().map(of).collect())
            }
        }
    }

    /// Those of a fit with inputs: its errors are those of what the inputs do by chance, so that waiting betters nothing, and what adds up over
    /// a jump does not show in the stride after it.
    pub(crate) fn driven(self) -> Self {
        DmdSettings { fit_tolerance: self.jump_tolerance, max_jump: self.initial_jump, ..self }
    }
}

#[cfg(test)]
mod tests {
    use crate::RideSettings;
    use m4gn_samples::fails;

    #[test]
    fn settings_that_cannot_be_are_named() {
        for (dmd, words) in [
            (r#"{"snapshotInterval": 0}"#, "snapshotInterval"),
            (r#"{"jumpTolerance": -1}"#, "jumpTolerance"),
            (r#"{"jumpGrowth": 0.5}"#, "jumpGrowth"),
            (r#"{"maxJump": 3}"#, "maxJump"),
            (r#"{"maxJump": 2147483647}"#, "maxJump"),
            (r#"{"holdOut": 18446744073709551615}"#, "minSnapshots"),
            (r#"{"minSnapshots": 3}"#, "minSnapshots"),
            (r#"{"windo": 3}"#, "window"),
            (r#"{"rest": {"U": 0}}"#, "rest: U 0"),
        ] {
            let text = format!(r#"{{"mode": "replace", "surrogates": ["dmd"], "dmd": {dmd}}}"#);
            fails(RideSettings::parse(&text), &[words]);
        }
        let small = r#"{"mode": "replace", "surrogates": ["dmd"], "dmd": {"window": 24}}"#;
        RideSettings::parse(small).expect("a smaller window needs no other entry");
        for (text, words) in [
            (r#"{"mode": "replace", "surrogates": ["dmd", "dmd"]}"#, "each once"),
            (r#"{"mode": "replace", "solverSteps": 1, "surrogateSteps": 1, "dmd": {}}"#, "does not name it"),
            (r#"{"mode": "replace", "surrogates": ["quadratic"]}"#, "dmd"),
        ] {
            fails(RideSettings::parse(text), &[words]);
        }
    }
}
