//! What a case sets of a ride: one JSON object, with one check.

use crate::control::ControlSettings;
use crate::dmd_settings::DmdSettings;
use crate::quantities::QuantitySettings;
use crate::registry::{KINDS, NETWORK, find};
use m4gn_base::settings;
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Tolerance of control where a surrogate needs it and nothing is said.
const TOLERANCE: f64 = 0.05;

/// Most of them: more tell nothing.
const MOST_DIGITS: usize = 20;

/// What the surrogates do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// They are compared with the solver, which runs as without them.
    Observe,
    /// They replace it for some of the time.
    Replace,
}

settings! {
    /// Settings of a ride; of mode observe, `mode` suffices.
    pub struct RideSettings in "ride" {
        /// `replace`: surrogates take over stretches of time steps; `observe`: they run beside the solver, and their errors are reported.
        pub mode: Mode;
        /// `network`, a trained model; `dmd`, which is fitted to the run's own states and needs no model; or both: the network jumps until
        /// a fit holds, then the fit.
        pub surrogates: Vec<String> = vec![NETWORK.to_string()], "network";
        /// Settings of the dmd surrogate (dictionary).
        pub dmd: Option<DmdSettings> = None, "its defaults";
        /// replace: time steps of the solver before each jump.
        pub solver_steps: Option<usize> = None, "required in mode replace; with dmd 1";
        /// replace: strides of each jump; with `control`, the most.
        pub surrogate_steps: Option<usize> = None, "required in mode replace; with dmd `maxJump`";
        /// observe: strides after which a rollout begins anew.
        pub rollout_steps: usize = 50;
        /// observe: writes the errors of rollouts at each cell and in each segment.
        pub write_errors: bool = false;
        /// Time before which the solver runs alone.
        pub time_start: Option<f64> [s] = None, "start of the run";
        /// Time after which the solver runs alone.
        pub time_end: Option<f64> [s] = None, "end of the run";
        /// Error control of jumps (dictionary); observe: what it would have allowed.
        pub control: Option<ControlSettings> = None, "all jumps have `surrogateSteps` strides; with dmd in mode replace `tolerance` 0.05";
        /// replace: results of other function objects whose errors at the ends of jumps are limited (list of dictionaries).
        pub quantities: Vec<QuantitySettings> = Vec::new(), "none";
        /// Significant digits of tables and messages.
        pub write_precision: usize = 6;
        /// File of the decisions, lines of JSON.
        pub decisions: Option<PathBuf> = None, "nowhere";
        /// Where the dmd surrogate keeps its states, a file a rank.
        pub states: Option<PathBuf> = None, "nowhere";
        /// Name of the ride in messages.
        pub name: String = String::new();
        /// Where the model is from, in messages and tables.
        pub model: String = String::new();
        /// Any text that the host keeps in the state for itself, of the first rank.
        pub host: String = String::new();
        /// Wall time that making the surrogates took, for the summary.
        pub setup_seconds: f64 [s] = 0.0;
    }
}

impl RideSettings {
    /// Parses and checks a JSON object.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn parse(text: &str) -> Result<Self> {
        let mut read: Self = settings::parse("ride", text, &["rest"])?;
        if read.has("dmd") {
            let dmd = read.dmd.get_or_insert_default();
            // How far each goes it says itself, once it is measured beside the solver.
            if read.mode == Mode::Replace {
                read.control.get_or_insert_with(|| ControlSettings::of(TOLERANCE));
                read.solver_steps.get_or_insert(1);
                read.surrogate_steps.get_or_insert(dmd.max_jump);
            }
            dmd.file = read.states.clone().filter(|_| dmd.keep);
        }
        read.check()?;
        Ok(read)
    }

    /// Whether there is a surrogate of this kind.
    pub fn has(&self, kind: &str) -> bool {
        self.surrogates.iter().any(|s| s == kind)
    }

    fn check(&self) -> Result<()> {
        let bad = |what: String| Err(Error::Input(format!("ride: {what}")));
        let twice = |kind: &String| self.surrogates.iter().filter(|k| *k == kind).count() > 1;
        let unknown = |kind: &String| kind != NETWORK && find(kind).is_none();
        if self.surrogates.is_empty() || self.surrogates.iter().any(|kind| twice(kind) || unknown(kind)) {
            let known: Vec<&str> =
                std::iter::once(NETWORK).chain(KINDS.iter().map(|(name, _)| *name)).collect();
            return bad(format!(
                "surrogates: expected some of {}, each once, found ({})",
                known.join(", "),
                self.surrogates.join(" ")
            ));
        }
        if self.dmd.is_some() && !self.has("dmd") {
            return bad("dmd: its settings are given, and surrogates does not name it".into());
        }
        self.dmd.as_ref().map_or(Ok(()), DmdSettings::check)?;
        let counts = [("solverSteps", self.solver_steps), ("surrogateSteps", self.surrogate_steps)];
        for (name, count) in counts {
            match (self.mode, count) {
                (Mode::Replace, None) => {
                    return bad(format!("{name}: expected a number of steps, as mode replace needs it"));
                }
                (_, Some(n)) if n == 0 || n > i32::MAX as usize => {
                    return bad(format!("{name}: expected at least 1 and at most {}, found {n}", i32::MAX));
                }
                _ => {}
            }
        }
        if self.rollout_steps == 0 || self.rollout_steps > i32::MAX as usize {
            return bad(format!("rolloutSteps: expected at least 1, found {}", self.rollout_steps));
        }
        for (name, time) in [("timeStart", self.time_start), ("timeEnd", self.time_end)] {
            if time.is_some_and(|time| !time.is_finite()) {
                return bad(format!("{name}: expected a time"));
            }
        }
        if !(1..=MOST_DIGITS).contains(&self.write_precision) {
            return bad(format!(
                "writePrecision: expected 1 to {MOST_DIGITS}, found {}",
                self.write_precision
            ));
        }
        self.control.as_ref().map_or(Ok(()), ControlSettings::check)?;
        self.quantities.iter().try_for_each(QuantitySettings::check)?;
        if self.mode == Mode::Observe && !self.quantities.is_empty() {
            return bad("quantities: they are held at the ends of jumps, and mode observe has none; expected mode replace".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        for (text, words) in [
            ("{}", "mode"),
            (r#"{"mode": "accelerate"}"#, "observe"),
            (r#"{"mode": "replace"}"#, "solverSteps"),
            (r#"{"mode": "replace", "solverSteps": 5}"#, "surrogateSteps"),
            (r#"{"mode": "replace", "solverSteps": 0, "surrogateSteps": 5}"#, "at least 1"),
            (r#"{"mode": "replace", "solverSteps": -5, "surrogateSteps": 5}"#, "solverSteps"),
            (r#"{"mode": "observe", "rolloutSteps": 0}"#, "rolloutSteps"),
            (r#"{"mode": "observe", "writePrecision": 90}"#, "writePrecision"),
            (r#"{"mode": "observe", "timeStrat": 1}"#, "is timeStart meant"),
            (
                r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 5, "quantities": [{"object": "f", "result": "Cd", "tolerance": 0}]}"#,
                "tolerance 0",
            ),
            (
                r#"{"mode": "observe", "quantities": [{"object": "f", "result": "Cd", "tolerance": 0.1}]}"#,
                "expected mode replace",
            ),
            (r#"{"mode": "observe", "control": {"tolerance": 0}}"#, "tolerance 0"),
            (r#"{"mode": "observe", "control": {}}"#, "tolerance"),
        ] {
            m4gn_samples::fails(RideSettings::parse(text), &[words]);
        }
    }
}
