//! Runs that end where they know the figures that are asked for, against those of the full run.

use super::score::Score;
use crate::compare::surrogate;
use crate::generate::family::{Answers, Draw};
use crate::user_case::averages;
use m4gn_base::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of our m4gnAverages.
const NAME: &str = "answers";

/// The function objects of a run; `stop`: it ends where it knows.
pub(super) fn entries(answers: &Answers, draw: &Draw, stop: bool) -> String {
    let stop = if stop { "yes" } else { "no" };
    format!(
        "{}\n{NAME}\n{{\n    type            m4gnAverages;\n    libs            (m4gnAverages);\n    stop            {stop};\n    minTime         \
         {};\n    quantities\n    {{\n{}\n    }}\n}}\n",
        draw.text(&answers.functions),
        answers.min_time,
        answers.quantities
    )
}

/// What a run says at its end.
struct Answer {
    ended: f64,
    /// Value and half-width of each figure.
    figures: BTreeMap<String, [f64; 2]>,
}

impl Answer {
    /// Of a run of this program.
    fn read(case: &Path, solver: &str) -> Result<Self> {
        let (path, all) = averages(case, NAME, &case.join(format!("log.{solver}")))?;
        let number = |value: &Value, key: &str| {
            let number = value[key].as_f64().filter(|v| v.is_finite());
            let none =
                || Error::file(&path, format!("has no number {key}: expected figures of m4gnAverages"));
            number.ok_or_else(none)
        };
        let mut figures = BTreeMap::new();
        for (name, figure) in all.as_object().into_iter().flatten().filter(|(_, f)| f.is_object()) {
            let [value, half_width] = match figure["statistic"] == "rms" {
                true => ["rms", "rms_half_width"],
                false => ["mean", "half_width"],
            };
            let half_width = figure[half_width].as_f64().unwrap_or(f64::INFINITY);
            figures.insert(name.clone(), [number(figure, value)?, half_width]);
        }
        Ok(Answer { ended: number(&all, "time")?, figures })
    }
}

/// The figures of a run of this program against those of the full one.
///
/// # Errors
/// [`Error::File`] where one of the two has none.
pub(super) fn score(full: &Path, case: &Path, solver: &str) -> Result<Score> {
    let (truth, own) = (Answer::read(full, solver)?, Answer::read(case, solver)?);
    let (mut largest, mut outside) = (0.0_f64, 0);
    for (name, [right, sure]) in &truth.figures {
        let Some([value, half_width]) = own.figures.get(name) else {
            return Err(Error::file(case, format!("has no figure {name}, which the full run has")));
        };
        let error = (value - right).abs();
        largest = largest.max(error / right.abs().max(f64::MIN_POSITIVE));
        outside += usize::from(error > half_width + sure);
    }
    let replaced = surrogate::read(case)?.and_then(|s| s.replaced_fraction);
    Ok(Score {
        answer: Some(largest),
        outside: Some(outside as f64 / truth.figures.len().max(1) as f64),
        ended: Some(own.ended),
        replaced,
        ..Score::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    fn case(folder: &Path, name: &str, json: &str) -> std::path::PathBuf {
        let case = folder.join(name);
        crate::fixtures::write(&case, &[("postProcessing/answers/0/averages.json", json)]);
        case
    }

    #[test]
    fn figures_are_compared_with_the_full_runs() {
        let dir = tempfile::tempdir().unwrap();
        let text = |time: f64, drag: f64, lift: f64| {
            format!(
                r#"{{"time": {time}, "Cd": {{"statistic": "mean", "mean": {drag}, "half_width": 0.01, "rms": 9, "rms_half_width": 9}},
                "Cl": {{"statistic": "rms", "mean": 0, "half_width": 9, "rms": {lift}, "rms_half_width": 0.001}}}}"#
            )
        };
        let full = case(dir.path(), "full", &text(30.0, 2.0, 0.5));
        let own = case(dir.path(), "own", &text(5.0, 2.01, 0.45));
        let found = score(&full, &own, "icoFoam").unwrap();
        assert_eq!((found.ended, found.outside), (Some(5.0), Some(0.5)));
        assert!((found.answer.unwrap() - 0.1).abs() < 1e-12, "{found:?}");
        let none = case(dir.path(), "none", r#"{"time": 5}"#);
        fails(score(&full, &none, "icoFoam"), &["has no figure Cd"]);
        fails(score(&full, &dir.path().join("nowhere"), "icoFoam"), &["expected figures of m4gnAverages"]);
    }
}
