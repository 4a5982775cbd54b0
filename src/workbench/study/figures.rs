//! Figures of validations, of single trajectories and over seeds.

use crate::signal::median;
use m4gn_report::number;
use serde_json::Value;
use std::path::Path;

/// RMSE-all of the trajectories: in the middle, and the largest.
pub(super) const TRAJECTORIES: [(&str, &str); 2] = [("median", "median"), ("worst", "worst")];

/// Whether the figures are of trajectories of this split.
pub(super) fn counts(figures: &Value, split: &str) -> bool {
    figures["split"].as_str().is_none_or(|own| own == "all" || own == split)
}

/// A figure of a row, over all trajectories or of these.
pub(super) fn figure(figures: &Value, row: &str, key: &str) -> Option<f64> {
    if !TRAJECTORIES.iter().any(|t| t.0 == key) {
        return figures[row][key].as_f64();
    }
    let of_case =
        |case: &Value| case[row].is_object().then(|| case[row]["rmse_all"].as_f64().unwrap_or(f64::INFINITY));
    let cases = figures["cases"].as_array()?.iter();
    let cases = cases.filter(|case| counts(figures, case["split"].as_str().unwrap_or_default()));
    let all = cases.filter_map(of_case);
    match key {
        "worst" => all.max_by(f64::total_cmp),
        _ => median(all),
    }
}

/// Mean and standard deviation over seeds; none of one seed, and infinite where a figure is not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    pub mean: f64,
    pub deviation: f64,
}

impl Spread {
    pub fn of(values: &[Option<f64>]) -> Option<Self> {
        let n = values.len() as f64;
        let values: Vec<f64> = values.iter().map(|v| v.unwrap_or(f64::INFINITY)).collect();
        let mean = values.iter().sum::<f64>() / n;
        let square = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>();
        (n > 0.0)
            .then(|| Spread { mean, deviation: if n > 1.0 { (square / (n - 1.0)).sqrt() } else { f64::NAN } })
    }

    pub fn text(self) -> String {
        match (self.mean.is_finite(), self.deviation.is_finite()) {
            (false, _) => "not finite".into(),
            (_, false) => number(self.mean, 3),
            _ => format!("{} ± {}", number(self.mean, 3), number(self.deviation, 2)),
        }
    }
}

/// The logarithm of RMSE-all of each trajectory, by the name of its file: a test is one folder, which may have been moved since it was validated on.
pub(super) fn logarithms(figures: &Value) -> impl Iterator<Item = (&str, f64)> {
    let cases = figures["cases"].as_array().into_iter().flatten();
    let cases = cases.filter(|case| counts(figures, case["split"].as_str().unwrap_or_default()));
    cases.filter_map(|case| {
        let name = Path::new(case["path"].as_str()?).file_name()?.to_str()?;
        Some((name, case["model"]["rmse_all"].as_f64()?.ln()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_is_the_same_wherever_its_folder_lies() {
        let figures =
            |path: &str| serde_json::json!({ "cases": [{ "path": path, "model": { "rmse_all": 1.0 } }] });
        for path in ["/data/test/a.h5", "moved/a.h5"] {
            assert_eq!(logarithms(&figures(path)).collect::<Vec<_>>(), [("a.h5", 0.0)]);
        }
    }
}
