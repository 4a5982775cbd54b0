//! The jumps of a run, as it has told them, and what of each can be recomputed.

use crate::decisions::{self, Decision, later};
use m4gn_base::{Error, Result};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

/// A jump.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Jump {
    /// dmd, network.
    pub surrogate: String,
    /// Time of the solver's state that it began from, s.
    pub begun: f64,
    /// Time of the state that it handed back, s.
    pub ended: f64,
    /// Fields that it has advanced.
    pub fields: Vec<String>,
    /// Those that the tolerance holds for.
    pub held: Vec<String>,
    /// Largest error that it was to have; none: the run has no error control.
    pub tolerance: Option<f64>,
    /// Error that the run expected of it.
    pub estimate: Option<f64>,
}

/// Times of a run, by number: one that a jump is recomputed from, and the later ones that are compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// The last that is written up to its begin.
    pub from: usize,
    /// All that are written in it, the last one at its end or before; at least one.
    pub to: Vec<usize>,
}

/// Name and decisions of the function object that has jumped in a run.
///
/// # Errors
/// [`Error::File`] where there is none, or there are several.
pub fn decisions(case: &Path) -> Result<(String, Vec<Decision>)> {
    let (root, mut found) = (case.join("postProcessing"), decisions::of_jumps(case)?);
    match (found.pop(), found.pop()) {
        (Some(one), None) => Ok(one),
        (None, _) => Err(Error::file(
            &root,
            "no function object has left a decisions.jsonl with a jump: expected a finished run of m4gnSurrogate in mode replace that has \
             jumped (writeToFile yes)",
        )),
        (Some((a, _)), Some((b, _))) => Err(Error::file(
            &root,
            format!("both {a} and {b} have jumps of their own: remove the one of the run before"),
        )),
    }
}

/// The jumps in time, in their order. What cuts a start-up short is none.
///
/// # Errors
/// [`Error::Input`] for a run that does not say what its jumps have advanced.
pub fn jumps(decisions: &[Decision]) -> Result<Vec<Jump>> {
    let mut jumps = Vec::new();
    for (begun, back) in decisions::jumps(decisions).filter(|(b, _)| b["limited_by"] != "start_up") {
        let texts = |value: &Value| -> Vec<String> {
            value.as_array().into_iter().flatten().filter_map(|v| Some(v.as_str()?.to_string())).collect()
        };
        let jump = Jump {
            surrogate: begun["surrogate"].as_str().unwrap_or_default().to_string(),
            begun: begun["time"].as_f64().unwrap_or(f64::NAN),
            ended: back["time"].as_f64().unwrap_or(f64::NAN),
            fields: texts(&begun["fields"]),
            held: texts(&begun["held"]),
            tolerance: begun["tolerance"].as_f64(),
            estimate: begun["estimate"].as_f64(),
        };
        if jump.fields.is_empty() {
            return Err(Error::Input(format!(
                "decisions.jsonl: the jump at {} s does not say which fields it has advanced: expected a run of this version of m4gn; run it again",
                jump.begun
            )));
        }
        jumps.push(jump);
    }
    Ok(jumps)
}

/// Most correctors of a time step, where the solver usually made so many before a jump.
pub fn capped(decisions: &[Decision]) -> Option<u64> {
    let capped = decisions.iter().find(|d| d["event"] == "correctors" && d["before"] == d["cap"]);
    capped.and_then(|d| d["cap"].as_u64())
}

impl Jump {
    /// What of it can be recomputed of a run that has written these times, s, ascending; none: nothing is written in it.
    pub fn stretch(&self, times: &[f64]) -> Option<Stretch> {
        let from = times.iter().rposition(|t| !later(*t, self.begun))?;
        let to: Vec<usize> = (from + 1..times.len()).filter(|i| !later(times[*i], self.ended)).collect();
        (!to.is_empty()).then_some(Stretch { from, to })
    }

    /// Whether a stretch from this time on, s, has a part of it.
    pub fn is_behind(&self, from: f64) -> bool {
        later(self.ended, from)
    }
}

/// The number of the time that is this one with other digits.
pub fn number_of(time: f64, times: &[f64]) -> Option<usize> {
    times.iter().position(|t| !later(*t, time) && !later(time, *t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn example() -> Vec<Decision> {
        let begun = |time: f64, limited: &str| {
            json!({
                "time": time, "event": "jump_begun", "surrogate": "dmd", "limited_by": limited, "fields": ["U", "p"], "held": ["U"],
                "tolerance": 0.05, "estimate": 0.001,
            })
        };
        let back = |time: f64| json!({ "time": time, "event": "handed_back" });
        vec![
            begun(1.0, "fit"),
            begun(1.1, "start_up"),
            back(1.2),
            back(1.3),
            begun(2.0, "fit"),
            json!({ "time": 2.5, "event": "jump_ended" }),
            back(2.500_000_1),
        ]
    }

    #[test]
    fn a_jump_is_what_was_begun_and_handed_back() {
        let found = jumps(&example()).unwrap();
        assert_eq!(found.len(), 1, "neither one that did not begin nor one of a start-up: {found:?}");
        assert_eq!((found[0].begun, found[0].ended, found[0].tolerance), (2.0, 2.500_000_1, Some(0.05)));
        assert_eq!((found[0].fields.len(), found[0].held.len()), (2, 1));
        let old = [json!({ "time": 1, "event": "jump_begun" }), json!({ "time": 2, "event": "handed_back" })];
        assert!(jumps(&old).unwrap_err().to_string().contains("run it again"));
    }

    #[test]
    fn steps_that_end_at_the_cap_are_told() {
        let steps = |before: u64| json!({ "time": 1.2, "event": "correctors", "before": before, "after": [20], "cap": 20 });
        assert_eq!(capped(&example()), None);
        assert_eq!(capped(&[steps(7)]), None, "after a jump alone");
        assert_eq!(capped(&[steps(7), steps(20)]), Some(20));
    }

    #[test]
    fn times_that_are_written_say_what_is_recomputed() {
        let jump = &jumps(&example()).unwrap()[0];
        let stretch = |times: &[f64]| jump.stretch(times).map(|s| (s.from, s.to));
        assert_eq!(stretch(&[0.0, 2.000_001, 2.25, 2.5, 3.0]), Some((1, vec![2, 3])), "begin and end");
        assert_eq!(stretch(&[0.0, 1.9, 2.25, 2.6]), Some((1, vec![2])), "before, and within");
        assert_eq!(stretch(&[0.0, 1.9, 2.6]), None);
        assert_eq!(stretch(&[2.1, 2.2]), None);
        assert!(jump.is_behind(2.25) && !jump.is_behind(2.5));
        assert_eq!(number_of(2.5, &[0.0, 2.500_001]), Some(1));
    }

    #[test]
    fn a_run_has_one_function_object_that_jumps() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str| {
            let file = format!("postProcessing/{name}/decisions.jsonl");
            crate::fixtures::write(dir.path(), &[(&file, "{\"time\":1,\"event\":\"handed_back\"}\n")]);
        };
        let said = || decisions(dir.path()).map_err(|e| e.to_string());
        assert!(said().unwrap_err().contains("in mode replace"));
        put("a");
        assert_eq!(said().unwrap().0, "a");
        put("b");
        assert!(said().unwrap_err().contains("jumps of their own"));
    }
}
