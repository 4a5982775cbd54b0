//! What the surrogate of a run left behind beside its fields: its own summary, and its jumps.

use crate::decisions;
use crate::user_case::{names, times};
use m4gn_base::{Error, Result, files};
use serde_json::Value;
use std::path::Path;

/// What the surrogate of a run says about itself.
#[derive(Clone, Debug)]
pub struct Surrogate {
    /// Time from which it first replaced steps, s: the last time that the solver had computed.
    pub takeover: f64,
    /// Replaced part of the simulated time after start-up, 0 to 1.
    pub replaced_fraction: Option<f64>,
    /// Its `summary.json`.
    pub summary: Value,
}

/// Reads `postProcessing/NAME/TIME/summary.json` of the function object m4gnSurrogate; none if there was none.
///
/// Of several runs into the same case, the earliest takeover counts, and the figures of the latest.
pub fn read(case: &Path) -> Result<Option<Surrogate>> {
    let mut found: Vec<(f64, Surrogate)> = Vec::new();
    let root = case.join("postProcessing");
    let mut objects = names(&root).unwrap_or_default();
    objects.sort();
    for folder in objects.iter().map(|name| root.join(name)) {
        for (time, started) in times(&folder).unwrap_or_default() {
            let path = folder.join(time).join("summary.json");
            let Ok(text) = files::read_text(&path) else {
                continue;
            };
            let summary: Value = serde_json::from_str(&text).map_err(|e| {
                Error::file(&path, format!("expected the JSON summary of m4gnSurrogate: {e}"))
            })?;
            if summary.get("replaced_time").is_none() {
                continue;
            }
            if let Some(one) = one_summary(&path, summary)? {
                found.push((started, one));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(takeover) = found.iter().map(|(_, s)| s.takeover).reduce(f64::min) else {
        return Ok(None);
    };
    Ok(found.pop().map(|(_, last)| Surrogate { takeover, ..last }))
}

fn one_summary(path: &Path, summary: Value) -> Result<Option<Surrogate>> {
    let number = |key: &str| summary.get(key).and_then(Value::as_f64);
    if number("replaced_time").is_none_or(|t| t <= 0.0) {
        return Ok(None);
    }
    let takeover = number("takeover_time").ok_or_else(|| {
        Error::file(
            path,
            "expected the number takeover_time of m4gnSurrogate, found none: run the case again",
        )
    })?;
    Ok(Some(Surrogate { takeover, replaced_fraction: number("replaced_fraction"), summary }))
}

/// Begin and end of each jump, s: times that are later than its begin, up to its end, are the surrogate's.
///
/// # Errors
/// [`Error::File`] for decisions that cannot be read.
pub fn jumps(case: &Path) -> Result<Vec<[f64; 2]>> {
    let all = decisions::of_jumps(case)?;
    let jumps = all.iter().flat_map(|(_, decisions)| decisions::jumps(decisions));
    Ok(jumps.map(|(begun, back)| [begun, back].map(|d| d["time"].as_f64().unwrap_or(f64::NAN))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    #[test]
    fn surrogate_summaries() {
        let dir = tempfile::tempdir().unwrap();
        assert!(read(dir.path()).unwrap().is_none());
        let root = dir.path().join("postProcessing/surrogate");
        let put = |name: &str, text: &str| fixtures::write(&root, &[(name, text)]);
        // Another function object's file is none of ours.
        put("0/summary.json", "{\"other\": 1}");
        assert!(read(dir.path()).unwrap().is_none());
        put("1/summary.json", r#"{"replaced_time": 2.0, "stride": 0.05}"#);
        m4gn_samples::fails(read(dir.path()), &["summary.json", "takeover_time"]);
        let one = r#"{"replaced_time": 2.0, "replaced_fraction": 0.8, "stride": 0.05, "takeover_time": 0.9}"#;
        put("1/summary.json", one);
        let two = r#"{"replaced_time": 3.0, "replaced_fraction": 0.9, "takeover_time": 4.0}"#;
        put("3.5/summary.json", two);
        let found = read(dir.path()).unwrap().unwrap();
        assert!(found.takeover == 0.9 && found.replaced_fraction == Some(0.9), "{found:?}");
        let said = |time: f64, event: &str| format!("{{\"time\":{time},\"event\":\"{event}\"}}\n");
        put(
            "decisions.jsonl",
            &(said(1.0, "jump_begun") + &said(1.2, "jump_ended") + &said(1.2, "handed_back")),
        );
        assert_eq!(jumps(dir.path()).unwrap(), [[1.0, 1.2]]);
        put("3.5/summary.json", "{");
        assert!(read(dir.path()).is_err());
    }
}
