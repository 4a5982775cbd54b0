//! What a case sets of a ride: one JSON object, with one check.

use crate::control::ControlSettings;
use crate::dmd_settings::DmdSettings;
use crate::quantities::QuantitySettings;
use m4gn_mesh::{Error, Result};
use m4gn_model::settings;
use serde::{Deserialize, Serialize};
use serde_json::Value;
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
        /// What takes the solver's place: `network`, a trained model; `dmd`, which is fitted to the run's own states and needs no model;
        /// or both, of which the nearer one to the solver jumps.
        pub surrogates: Vec<Kind> = vec![Kind::Network];
        /// How the dmd surrogate is fitted (dictionary).
        pub dmd: Option<DmdSettings> = None, "its defaults";
        /// replace: time steps of the solver before each jump.
        pub solver_steps: Option<usize> = None, "required in mode replace; with dmd 1";
        /// replace: strides of a jump, with `control` at most.
        pub surrogate_steps: Option<usize> = None, "required in mode replace; with dmd `maxJump`";
        /// observe: strides after which a rollout begins anew.
        pub rollout_steps: usize = 50;
        /// observe: where rollouts are off, at each cell and in each segment.
        pub write_errors: bool = false;
        /// The solver is alone before.
        pub time_start: Option<f64> [s] = None, "start of the run";
        /// The solver is alone after.
        pub time_end: Option<f64> [s] = None, "end of the run";
        /// How far a jump may go (dictionary); observe: what it would have done.
        pub control: Option<ControlSettings> = None, "`surrogateSteps`, always; with dmd in mode replace `tolerance` 0.05";
        /// replace: list of results of other parts of the run that are held at the ends of jumps (dictionaries).
        pub quantities: Vec<QuantitySettings> = Vec::new(), "none";
        /// The model learns the case from the solver's steps (dictionary).
        pub adapt: Option<Value> = None, "it does not";
        /// Significant digits of tables and messages.
        pub write_precision: usize = 6;
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

/// A kind of surrogate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A trained network.
    Network,
    /// One that is fitted to the run's own states.
    Dmd,
}

/// The entries of `adapt` that are the ride's own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdaptEntries {
    /// Whether anything is to be learned.
    pub wanted: bool,
    /// Time from which steps of the solver are frames, s; none: a third of the time before `time_start`.
    pub start: Option<f64>,
    /// Where the adapted model goes; none: nowhere.
    pub write_model: Option<PathBuf>,
    /// The rest: settings of the learning, the text of a JSON object.
    pub learning: String,
    /// Whether there is learning after jumps too.
    pub during: bool,
}

impl RideSettings {
    /// Parses and checks a JSON object.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn parse(text: &str) -> Result<Self> {
        let mut read: Self = settings::parse("ride", text, &["adapt"])?;
        if read.has(Kind::Dmd) {
            let dmd = read.dmd.get_or_insert_default();
            // How far each goes it says itself, once it is measured beside the solver.
            if read.mode == Mode::Replace {
                read.control.get_or_insert_with(|| ControlSettings::of(TOLERANCE));
                read.solver_steps.get_or_insert(1);
                read.surrogate_steps.get_or_insert(dmd.max_jump);
            }
            if !dmd.keep {
                dmd.file = None;
            }
        }
        read.check()?;
        Ok(read)
    }

    /// Whether there is a surrogate of this kind.
    pub fn has(&self, kind: Kind) -> bool {
        self.surrogates.contains(&kind)
    }

    fn check(&self) -> Result<()> {
        let bad = |what: String| Err(Error::Input(format!("ride: {what}")));
        let twice = |kind: &Kind| self.surrogates.iter().filter(|k| *k == kind).count() > 1;
        if self.surrogates.is_empty() || self.surrogates.iter().any(twice) {
            return bad("surrogates: expected network, dmd, or both, each once".into());
        }
        if self.dmd.is_some() && !self.has(Kind::Dmd) {
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
        self.adapt_entries().map(|_| ())
    }

    /// What `adapt` says.
    ///
    /// # Errors
    /// [`Error::Input`] for entries of another kind than they should be.
    pub fn adapt_entries(&self) -> Result<AdaptEntries> {
        let bad = |what: &str| Err(Error::Input(format!("adapt: {what}")));
        let Some(adapt) = &self.adapt else {
            return Ok(AdaptEntries::default());
        };
        let Value::Object(mut entries) = adapt.clone() else {
            return bad("expected an object with settings");
        };
        let start = match entries.remove("start") {
            None => None,
            Some(value) => match value.as_f64() {
                Some(start) => Some(start),
                None => return bad("start: expected a time"),
            },
        };
        let write_model = match entries.remove("writeModel") {
            None | Some(Value::Bool(false) | Value::Null) => None,
            Some(Value::String(path)) => Some(PathBuf::from(path)),
            Some(_) => return bad("writeModel: expected the path of a file, or false"),
        };
        let mode = entries.get("mode").and_then(Value::as_str).unwrap_or("before");
        let (wanted, during) = (mode != "off", mode == "during");
        if self.mode == Mode::Observe && during {
            return bad(
                "mode: found during, which adapts after jumps, and mode observe has none; expected before",
            );
        }
        Ok(AdaptEntries { wanted, start, write_model, learning: Value::Object(entries).to_string(), during })
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
            (r#"{"mode": "observe", "timeStrat": 1}"#, "is time_start meant"),
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
            (r#"{"mode": "observe", "adapt": {"start": "now"}}"#, "start"),
            (r#"{"mode": "observe", "adapt": {"writeModel": true}}"#, "writeModel"),
            (r#"{"mode": "observe", "adapt": {"mode": "during"}}"#, "during"),
            (r#"{"mode": "observe", "adapt": 3}"#, "an object"),
        ] {
            let error = RideSettings::parse(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn the_entries_of_adapt_are_told_apart() {
        let of = |text: &str| RideSettings::parse(text).unwrap().adapt_entries().unwrap();
        assert_eq!(of(r#"{"mode": "observe"}"#), AdaptEntries::default());
        let entries = of(r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 4,
                "adapt": {"start": 2, "writeModel": "a.safetensors", "mode": "during", "maxFrames": 9}}"#);
        assert!(entries.wanted && entries.during);
        assert_eq!((entries.start, entries.write_model), (Some(2.0), Some("a.safetensors".into())));
        assert_eq!(entries.learning, r#"{"maxFrames":9,"mode":"during"}"#);
        assert!(!of(r#"{"mode": "observe", "adapt": {"mode": "off"}}"#).wanted);
        let observed = of(r#"{"mode": "observe", "adapt": {"steps": 7}}"#);
        assert_eq!(observed.learning, r#"{"steps":7}"#);
    }
}
