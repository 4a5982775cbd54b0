//! What a case sets of a ride: one JSON object, with one check.

use crate::control::ControlSettings;
use crate::dmd_settings::DmdSettings;
use crate::quantities::QuantitySettings;
use m4gn_mesh::{Error, Result};
use m4gn_model::settings;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;

/// Strides of a rollout where nothing else is said.
const ROLLOUT: usize = 50;

/// Tolerance of control where a surrogate needs it and nothing is said.
const TOLERANCE: f64 = 0.05;

/// Significant digits where nothing else is said.
const PRECISION: usize = 6;

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

/// Settings of a ride; of mode observe, `mode` suffices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RideSettings {
    /// What the surrogates do.
    pub mode: Mode,
    /// Which surrogates there are; none: a network.
    #[serde(default = "network")]
    pub surrogates: Vec<Kind>,
    /// Settings of the dmd one.
    #[serde(default)]
    pub dmd: Option<DmdSettings>,
    /// Name of the ride in messages.
    #[serde(default)]
    pub name: String,
    /// Steps of the solver before each jump (replace).
    #[serde(default)]
    pub solver_steps: Option<usize>,
    /// Strides of a jump, with control at most (replace).
    #[serde(default)]
    pub surrogate_steps: Option<usize>,
    /// Strides after which a rollout begins anew (observe).
    #[serde(default = "rollout")]
    pub rollout_steps: usize,
    /// Whether errors are told for each segment, and kept for each cell (observe).
    #[serde(default)]
    pub write_errors: bool,
    /// The solver is alone before, s; none: from the start.
    #[serde(default)]
    pub time_start: Option<f64>,
    /// And after, s; none: to the end.
    #[serde(default)]
    pub time_end: Option<f64>,
    /// How far jumps may go; none: as far as `surrogate_steps` says.
    #[serde(default)]
    pub control: Option<ControlSettings>,
    /// What other parts of the run report, and how far off it may be at the end of a jump (replace).
    #[serde(default)]
    pub quantities: Vec<QuantitySettings>,
    /// How the surrogates learn from the solver's steps: their own settings, with `start` and `write_model`; none: they do not.
    #[serde(default)]
    pub adapt: Option<Value>,
    /// Significant digits of tables and messages.
    #[serde(default = "precision")]
    pub write_precision: usize,
    /// Where the model is from, in messages and tables.
    #[serde(default)]
    pub model: String,
    /// What the host keeps in the state for itself, any text ([`crate::host_of`]).
    #[serde(default)]
    pub host: String,
    /// Wall time that making the surrogates took, s: for the summary.
    #[serde(default)]
    pub setup_seconds: f64,
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

fn network() -> Vec<Kind> {
    vec![Kind::Network]
}

fn rollout() -> usize {
    ROLLOUT
}

fn precision() -> usize {
    PRECISION
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
