//! A chart of what a tolerance of error control gives (docs/control.md): in how many jumps the error was within it, how much of the
//! time was replaced, and what the run cost.
//!
//!     bench/coverage.py run/twelve --model MODEL --json coverage.json
//!     m4gn hybrid --model MODEL --count 12 --seed 4321 --plain none --variant small=FILE --variant large=FILE ... --json sweep.json
//!     coverage_chart coverage.json sweep.json coverage.svg
//!
//! FILE has `surrogateSteps 20; control { tolerance 0.05; }` or another tolerance.

use m4gn_mesh::files::write_whole;
use m4gn_mesh::{Error, Result};
use m4gn_report::chart::{Axis, BLUE, Chart, GREEN, ORANGE, Series};
use serde_json::Value;
use std::path::Path;

fn read(path: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::file(path, e.to_string()))?;
    serde_json::from_str(&text).map_err(|e| Error::file(path, e.to_string()))
}

/// The rows of a coverage table: tolerance and one of its columns in percent.
fn column(coverage: &Value, name: &str) -> Vec<(f64, f64)> {
    let rows = coverage["tolerances"].as_array().into_iter().flatten();
    rows.filter_map(|r| Some((r["tolerance"].as_f64()?, 100.0 * r[name].as_f64()?))).collect()
}

/// The tolerance in a variant's entries, such as `control { tolerance 0.05; }`.
fn tolerance(entries: &str) -> Option<f64> {
    let (_, rest) = entries.split_once("tolerance")?;
    rest.split(';').next()?.trim().parse().ok()
}

/// The medians of the processor time over all cases, of the variants that have a tolerance.
fn times(sweep: &Value) -> Vec<(f64, f64)> {
    let variants = sweep["variants"].as_array().into_iter().flatten();
    let mut times: Vec<(f64, f64)> = variants
        .filter_map(|variant| {
            let run = &sweep["summary"][0]["runs"][variant["name"].as_str()?];
            Some((tolerance(variant["entries"].as_str()?)?, run["time"]["median"].as_f64()?))
        })
        .collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    times
}

fn main() -> Result<()> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [coverage, sweep, out] = arguments.as_slice() else {
        return Err(Error::Input("usage: coverage_chart COVERAGE.json SWEEP.json OUT.svg".into()));
    };
    let (coverage, sweep) = (read(Path::new(coverage))?, read(Path::new(sweep))?);
    let curve = |name: &str, points: Vec<(f64, f64)>, colour| {
        let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
        Series::new(name, &x, &y, colour)
    };
    let chart = Chart {
        x_label: "tolerance of a jump".into(),
        y_label: "%".into(),
        series: vec![
            curve("within tolerance", column(&coverage, "within"), BLUE),
            curve("time replaced", column(&coverage, "replaced"), GREEN),
            curve("processor time", times(&sweep), ORANGE),
        ],
        axis: Axis::FromZero,
    };
    write_whole(Path::new(out), chart.svg()?.as_bytes())
}
