//! What the surrogate of a run left behind beside its fields: its own summary and table.

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
    /// Its jumps: the ends of their first and last steps, s. What is stored in between is the surrogate's.
    pub jumps: Vec<[f64; 2]>,
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
            let time = folder.join(time);
            let path = time.join("summary.json");
            let Ok(text) = files::read_text(&path) else {
                continue;
            };
            let summary: Value = serde_json::from_str(&text).map_err(|e| {
                Error::file(&path, format!("expected the JSON summary of m4gnSurrogate: {e}"))
            })?;
            if summary.get("replaced_time").is_none() {
                continue;
            }
            if let Some(one) = one_summary(&time, summary)? {
                found.push((started, one));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(takeover) = found.iter().map(|(_, s)| s.takeover).reduce(f64::min) else {
        return Ok(None);
    };
    let jumps = found.iter().flat_map(|(_, s)| s.jumps.clone()).collect();
    Ok(found.pop().map(|(_, last)| Surrogate { takeover, jumps, ..last }))
}

fn one_summary(folder: &Path, summary: Value) -> Result<Option<Surrogate>> {
    let number = |key: &str| summary.get(key).and_then(Value::as_f64);
    if number("replaced_time").is_none_or(|t| t <= 0.0) {
        return Ok(None);
    }
    let takeover = number("takeover_time").ok_or_else(|| {
        Error::file(
            folder.join("summary.json"),
            "expected the number takeover_time of m4gnSurrogate, found none: run the case again",
        )
    })?;
    let jumps = jumps(folder, number("stride"));
    Ok(Some(Surrogate { takeover, replaced_fraction: number("replaced_fraction"), jumps, summary }))
}

/// The ends of the first and the last step of each jump: a row of the table beside the summary holds the time at a jump's
/// end and the number of its steps.
fn jumps(folder: &Path, stride: Option<f64>) -> Vec<[f64; 2]> {
    let tables = names(folder).unwrap_or_default().into_iter().filter(|name| name.ends_with(".dat"));
    let of_row = |row: &str| {
        let mut numbers = row.split_whitespace().map(|w| w.parse::<f64>().ok());
        let (end, steps) = (numbers.next()??, numbers.next()??);
        let first = end - (steps - 1.0) * stride?;
        first.is_finite().then_some([first, end])
    };
    let of_table = |name| {
        let text = files::read_text(folder.join(name)).unwrap_or_default();
        text.lines().filter_map(of_row).collect::<Vec<_>>()
    };
    tables.flat_map(of_table).collect()
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
        // A surrogate of longer strides than those of the last jump began
        let one = r#"{"replaced_time": 2.0, "replaced_fraction": 0.8, "stride": 0.05, "takeover_time": 0.9}"#;
        put("1/summary.json", one);
        let table = "# Jumps\n# Time\tsteps\tsurrogate(s)\n1.2\t3\t0.1\n1.45\t4\t0.1\n";
        put("1/surrogate.dat", table);
        let two = r#"{"replaced_time": 3.0, "replaced_fraction": 0.9, "takeover_time": 4.0}"#;
        put("3.5/summary.json", two);
        let found = read(dir.path()).unwrap().unwrap();
        assert!(found.takeover == 0.9 && found.replaced_fraction == Some(0.9), "{found:?}");
        // Of three steps and of four
        let expected = [[1.1, 1.2], [1.3, 1.45]];
        let near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs() < 1e-12 && a[1] == b[1];
        assert!(found.jumps.len() == 2 && found.jumps.iter().zip(&expected).all(near), "{found:?}");
        put("3.5/summary.json", "{");
        assert!(read(dir.path()).is_err());
    }
}
