//! What a run left behind beside its fields: the surrogate's own summary and the solver's log.

use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

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
pub fn surrogate(case: &Path) -> Result<Option<Surrogate>> {
    let mut found: Vec<(f64, Surrogate)> = Vec::new();
    let root = case.join("postProcessing");
    for name in folders(&root) {
        for time in folders(&name) {
            let path = time.join("summary.json");
            let Ok(text) = std::fs::read_to_string(&path) else {
                continue;
            };
            let summary: Value = serde_json::from_str(&text).map_err(|e| {
                Error::file(&path, format!("expected the JSON summary of m4gnSurrogate: {e}"))
            })?;
            if summary.get("replaced_time").is_none() {
                continue;
            }
            if let Some(one) = one_summary(&time, summary)? {
                found.push((started(&time), one));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(takeover) = found.iter().map(|(_, s)| s.takeover).reduce(f64::min) else {
        return Ok(None);
    };
    Ok(found.pop().map(|(_, last)| Surrogate { takeover, ..last }))
}

fn one_summary(folder: &Path, summary: Value) -> Result<Option<Surrogate>> {
    let number = |key: &str| summary.get(key).and_then(Value::as_f64);
    if number("replaced_time").is_none_or(|t| t <= 0.0) {
        return Ok(None);
    }
    let takeover = match number("takeover_time") {
        Some(t) => t,
        None => first_row(&folder.join("surrogate.dat"))?,
    };
    Ok(Some(Surrogate {
        takeover,
        replaced_fraction: number("replaced_fraction"),
        summary,
    }))
}

/// Time of the first row of a table of OpenFOAM's: comments start with #, time is the first column.
fn first_row(path: &Path) -> Result<f64> {
    let text =
        std::fs::read_to_string(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    let rows = text.lines().filter(|l| !l.trim_start().starts_with('#'));
    let time = rows
        .filter_map(|l| l.split_whitespace().next()?.parse::<f64>().ok())
        .find(|t| t.is_finite());
    time.ok_or_else(|| Error::file(path, "expected a row that starts with a time, found none"))
}

fn started(folder: &Path) -> f64 {
    folder
        .file_name()
        .and_then(|n| n.to_str())
        .and_then(|n| n.parse().ok())
        .unwrap_or(f64::NEG_INFINITY)
}

fn folders(of: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(of).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| p.is_dir()).collect();
    found.sort();
    found
}

/// Wall seconds of a solver run, from the last `ExecutionTime = .. s  ClockTime = .. s` of `log.APPLICATION`.
///
/// ClockTime is the wall time in whole seconds, ExecutionTime the processor time of the first rank in hundredths.
/// Where the two agree to the second the finer one is taken, otherwise the wall time. None without such a log.
pub fn wall_seconds(case: &Path, application: &str) -> Option<f64> {
    if application.is_empty() {
        return None;
    }
    let text = std::fs::read(case.join(format!("log.{application}"))).ok()?;
    let text = String::from_utf8_lossy(&text);
    let line = text
        .lines()
        .rev()
        .find(|l| l.trim_start().starts_with("ExecutionTime ="))?;
    let seconds = |key: &str| {
        let rest = line[line.find(key)? + key.len()..]
            .trim_start()
            .strip_prefix('=')?;
        rest.split_whitespace().next()?.parse::<f64>().ok()
    };
    let processor = seconds("ExecutionTime")?;
    match seconds("ClockTime") {
        // Truncated to whole seconds at both ends.
        Some(wall) if (wall - processor).abs() > 1.0 => Some(wall),
        _ => Some(processor),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn wall_time_of_a_log() {
        let dir = tempfile::tempdir().unwrap();
        let write = |text: &str| fs::write(dir.path().join("log.icoFoam"), text).unwrap();
        assert_eq!(wall_seconds(dir.path(), "icoFoam"), None);
        write(
            "Time = 1\nExecutionTime = 0.5 s  ClockTime = 0 s\n\nTime = 2\nExecutionTime = 1.86 s  ClockTime = 2 s\n\nEnd\n",
        );
        assert_eq!(wall_seconds(dir.path(), "icoFoam"), Some(1.86));
        write("ExecutionTime = 1.86 s  ClockTime = 4 s\n");
        assert_eq!(wall_seconds(dir.path(), "icoFoam"), Some(4.0));
        write("no times\n");
        assert_eq!(wall_seconds(dir.path(), "icoFoam"), None);
        assert_eq!(wall_seconds(dir.path(), ""), None);
    }

    #[test]
    fn surrogate_summaries() {
        let dir = tempfile::tempdir().unwrap();
        assert!(surrogate(dir.path()).unwrap().is_none());
        let folder = |time: &str| {
            let folder = dir.path().join("postProcessing/surrogate").join(time);
            fs::create_dir_all(&folder).unwrap();
            folder
        };
        // Another function object's file is none of ours.
        fs::write(folder("0").join("summary.json"), "{\"other\": 1}").unwrap();
        assert!(surrogate(dir.path()).unwrap().is_none());
        fs::write(
            folder("1").join("summary.json"),
            r#"{"replaced_time": 2.0, "replaced_fraction": 0.8}"#,
        )
        .unwrap();
        assert!(
            surrogate(dir.path())
                .unwrap_err()
                .to_string()
                .contains("surrogate.dat")
        );
        fs::write(
            folder("1").join("surrogate.dat"),
            "# Surrogate\n# Time\tseconds\n1.05\t0.1\n1.10\t0.1\n",
        )
        .unwrap();
        let text = r#"{"replaced_time": 3.0, "replaced_fraction": 0.9, "takeover_time": 4.0}"#;
        fs::write(folder("3.5").join("summary.json"), text).unwrap();
        let found = surrogate(dir.path()).unwrap().unwrap();
        assert_eq!((found.takeover, found.replaced_fraction), (1.05, Some(0.9)));
        fs::write(folder("3.5").join("summary.json"), "{").unwrap();
        assert!(surrogate(dir.path()).is_err());
    }
}
