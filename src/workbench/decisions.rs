//! What a hybrid run has decided, as the function object m4gnSurrogate writes it (docs/reference/run-files.md): `postProcessing/NAME/decisions.jsonl`.

use crate::user_case::names;
use m4gn_base::{Error, Result, files};
use serde_json::Value;
use std::path::Path;

/// A line of the file: an object with `time`, `event` and what belongs to it.
pub type Decision = Value;

/// The decisions of the function object of this name; none where the case has no such file.
///
/// # Errors
/// [`Error::File`] naming the line that is no decision.
pub fn read(case: &Path, name: &str) -> Result<Vec<Decision>> {
    let path = case.join("postProcessing").join(name).join("decisions.jsonl");
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = files::read_text(&path).map_err(Error::cannot("read", &path))?;
    // A run that was killed may have left half a line
    let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
    let lines = whole.lines().enumerate().map(|(i, line)| match serde_json::from_str::<Value>(line) {
        Ok(decision) if decision["time"].is_number() && decision["event"].is_string() => Ok(decision),
        _ => Err(Error::file(
            &path,
            format!("line {}: expected a JSON object with time and event, found {line}", i + 1),
        )),
    });
    lines.collect()
}

/// The last decision of this kind.
pub fn last<'a>(decisions: &'a [Decision], event: &str) -> Option<&'a Decision> {
    decisions.iter().rfind(|d| d["event"] == event)
}

/// Names and decisions of the function objects that have jumped.
///
/// # Errors
/// As [`read`].
pub fn of_jumps(case: &Path) -> Result<Vec<(String, Vec<Decision>)>> {
    let mut found = Vec::new();
    for name in names(&case.join("postProcessing")).unwrap_or_default() {
        let decisions = read(case, &name)?;
        if last(&decisions, "handed_back").is_some() {
            found.push((name, decisions));
        }
    }
    Ok(found)
}

/// What began each jump, at the time of the solver's last state before it, and what was said when the surrogate's last one was handed back.
pub fn jumps(decisions: &[Decision]) -> impl Iterator<Item = (&Decision, &Decision)> {
    let mut begun = None;
    decisions.iter().filter_map(move |decision| match decision["event"].as_str() {
        Some("jump_begun") => {
            begun = Some(decision);
            None
        }
        Some("handed_back") => Some((begun.take()?, decision)),
        _ => None,
    })
}

/// Names of times have so many digits that they tell them apart: times that differ by less, over their size, are the same.
const SAME: f64 = 5e-6;

/// Whether a time is later than another one, and not the same with other digits.
pub fn later(time: f64, than: f64) -> bool {
    time > than + SAME * than.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_decisions() {
        let dir = tempfile::tempdir().unwrap();
        assert!(read(dir.path(), "test").unwrap().is_empty());
        let file = "postProcessing/test/decisions.jsonl";
        let put = |text: &str| crate::fixtures::write(dir.path(), &[(file, text)]);
        put("{\"time\":1,\"event\":\"fit\",\"error\":0.5}\n{\"time\":2,\"event\":\"fit\",\"error\":0.1}\n");
        let found = read(dir.path(), "test").unwrap();
        assert_eq!(last(&found, "fit").unwrap()["error"], 0.1);
        assert!(last(&found, "end").is_none());
        put("{\"time\":1,\"event\":\"fit\"}\n{\"time\":2,");
        assert_eq!(read(dir.path(), "test").unwrap().len(), 1, "half a line of a run that was killed");
        put("{\"time\":1,\"event\":\"fit\"}\n{\"time\":2,\n");
        assert!(read(dir.path(), "test").unwrap_err().to_string().contains("line 2: expected"));
    }
}
