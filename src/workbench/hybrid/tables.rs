//! Tables: a row a run, then medians and worst of each variant, over all cases and by the order of the cases.

use super::score::{Score, median};
use super::{DrawResult, RunRecord};
use m4gn_report::{Table, number};
use serde_json::{Value, json};

/// Cases from which on three bands are shown.
const BANDS_FROM: usize = 6;
/// Lift over drag above which a wake that is steady in the full run sheds vortices.
const SHEDS: f64 = 0.01;

/// What tables show of a run: heading, name in the figures, and value.
type Figure = (
    &'static str,
    &'static str,
    fn(&DrawResult, &RunRecord) -> Option<f64>,
);

fn score(run: &RunRecord) -> Option<&Score> {
    run.score.as_ref()
}

const FIGURES: [Figure; 9] = [
    ("first stride", "first", |_, r| score(r)?.first),
    ("first jump", "jump", |_, r| score(r)?.jump),
    ("end", "end", |_, r| score(r)?.end),
    ("D %", "displacement", |_, r| percent(score(r)?.displacement)),
    ("cell %", "cell", |_, r| percent(score(r)?.cell)),
    ("drag %", "drag", |_, r| percent(score(r)?.drag)),
    ("lift rms %", "lift", |_, r| percent(score(r)?.lift)),
    ("frequency %", "frequency", |_, r| percent(score(r)?.frequency)),
    ("time %", "time", |d, r| percent(relative_time(d, r))),
];

fn percent(value: Option<f64>) -> Option<f64> {
    value.map(|v| 100.0 * v)
}

/// Processor time after the takeover over the full run's.
pub(super) fn relative_time(draw: &DrawResult, run: &RunRecord) -> Option<f64> {
    let full = draw.full.as_ref()?.cost.after_takeover;
    (full > 0.0).then(|| run.cost.after_takeover / full)
}

fn text(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| number(v, 3))
}

/// The figures that some run has: flows have no displacement, solids no drag.
fn shown(results: &[DrawResult]) -> Vec<&'static Figure> {
    let steady = |r: &RunRecord| score(r).is_some_and(|s| s.unsteadiness.is_some());
    let has = |figure: &Figure| {
        results.iter().any(|d| {
            let mut runs = d.runs.values();
            runs.any(|r| figure.2(d, r).is_some() || (figure.1 == "lift" && steady(r)))
        })
    };
    FIGURES.iter().filter(|figure| has(figure)).collect()
}

/// An empty table of runs.
fn heading(order: &str, figures: &[&Figure]) -> Table {
    let mut headers = vec!["case".to_string(), order.to_string(), "run".into()];
    headers.extend(figures.iter().map(|f| f.0.to_string()));
    headers.extend([
        "replaced %".into(),
        "cells".into(),
        "processor s".into(),
        "wall s".into(),
    ]);
    Table::new(headers)
}

/// A row a run, the cases in their order; errors are over those of holding the last field, times over the full run's
/// after the takeover.
pub fn case_table(results: &[DrawResult], variants: &[String], order: &str) -> Table {
    let figures = shown(results);
    let mut table = heading(order, &figures);
    for draw in sorted(results) {
        let first = [format!("{:04}", draw.index), number(draw.order, 4)];
        if let Some(full) = &draw.full {
            let mut row = first.to_vec();
            row.push("full".into());
            row.extend(figures.iter().map(|_| "-".to_string()));
            row.extend(["-".into(), "-".into()]);
            row.extend(cost(full));
            table.row(row);
        }
        for name in variants {
            let Some(run) = draw.runs.get(name) else { continue };
            let mut row = first.to_vec();
            row.push(name.clone());
            row.extend(figures.iter().map(|(_, key, value)| match (*key, score(run)) {
                (
                    "lift",
                    Some(Score {
                        unsteadiness: Some(u),
                        ..
                    }),
                ) if *u > SHEDS => "sheds".into(),
                (
                    "lift",
                    Some(Score {
                        unsteadiness: Some(_),
                        ..
                    }),
                ) => "steady".into(),
                _ => text(value(draw, run)),
            }));
            row.push(text(percent(score(run).and_then(|s| s.replaced))));
            row.push(score(run).map_or("-".into(), |s| s.cells.to_string()));
            row.extend(cost(run));
            table.row(row);
        }
    }
    table
}

fn cost(run: &RunRecord) -> [String; 2] {
    [run.cost.after_takeover, run.cost.wall].map(|v| number(v, 3))
}

fn sorted(results: &[DrawResult]) -> Vec<&DrawResult> {
    let mut all: Vec<&DrawResult> = results.iter().collect();
    all.sort_by(|a, b| a.order.total_cmp(&b.order));
    all
}

/// All cases, and from six on the lower, middle and upper third of them.
fn bands(results: &[DrawResult]) -> Vec<Vec<&DrawResult>> {
    let all = sorted(results);
    let mut bands = vec![all.clone()];
    if all.len() >= BANDS_FROM {
        let n = all.len();
        bands.extend((0..3).map(|k| all[k * n / 3..(k + 1) * n / 3].to_vec()));
    }
    bands
}

/// Values of a figure of a variant in some cases; of what has a sign, the size.
fn values(band: &[&DrawResult], variant: &str, figure: &Figure) -> Vec<f64> {
    band.iter()
        .filter_map(|d| Some(figure.2(d, d.runs.get(variant)?)?.abs()))
        .collect()
}

fn worst(values: &[f64]) -> Option<f64> {
    values.iter().copied().reduce(f64::max)
}

fn range(band: &[&DrawResult]) -> [f64; 2] {
    let of = |d: Option<&&DrawResult>| d.map_or(f64::NAN, |d| d.order);
    [of(band.first()), of(band.last())]
}

/// Median and worst of each variant: one table for all cases, and one a band.
pub fn summary_tables(results: &[DrawResult], variants: &[String], order: &str) -> Vec<(String, Table)> {
    let figures = shown(results);
    let table = |band: &Vec<&DrawResult>| {
        let [low, high] = range(band);
        let title = format!(
            "{} cases, {order} {} to {}: median (worst)",
            band.len(),
            number(low, 4),
            number(high, 4)
        );
        let mut headers = vec!["run".to_string()];
        headers.extend(figures.iter().map(|f| f.0.to_string()));
        headers.push("cases".into());
        let mut table = Table::new(headers);
        for name in variants {
            let ran = band.iter().filter(|d| d.runs.contains_key(name)).count();
            let mut row = vec![name.clone()];
            row.extend(figures.iter().map(|figure| {
                let all = values(band, name, figure);
                match (median(all.iter().copied()), worst(&all)) {
                    (Some(m), Some(w)) => format!("{} ({})", number(m, 3), number(w, 3)),
                    _ => "-".into(),
                }
            }));
            row.push(ran.to_string());
            table.row(row);
        }
        (title, table)
    };
    bands(results).iter().map(table).collect()
}

/// The same as figures.
pub fn summary(results: &[DrawResult], variants: &[String]) -> Value {
    let one = |band: &Vec<&DrawResult>| {
        let of = |name: &String| {
            let figures = FIGURES.iter().map(|figure| {
                let all = values(band, name, figure);
                let entry = json!({
                    "median": median(all.iter().copied()), "worst": worst(&all), "cases": all.len(),
                });
                (figure.1.to_string(), entry)
            });
            (name.clone(), Value::Object(figures.collect()))
        };
        json!({
            "cases": band.len(), "order": range(band),
            "runs": Value::Object(variants.iter().map(of).collect()),
        })
    };
    Value::Array(bands(results).iter().map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hybrid::Cost;

    fn record(time: f64, end: Option<f64>) -> RunRecord {
        let cost = Cost {
            wall: time,
            processor: time,
            after_takeover: time,
        };
        let score = end.map(|end| Score {
            first: Some(0.1),
            jump: None,
            end: Some(end),
            horizons: [0.1, 0.2, 0.3],
            errors: [0.0; 3],
            hold_last: [1.0; 3],
            drag: Some(-0.02),
            unsteadiness: Some(0.5),
            replaced: Some(0.9),
            cells: 10,
            ..Score::default()
        });
        RunRecord {
            made_with: String::new(),
            cost,
            score,
            comparison: None,
        }
    }

    fn draws(n: u64) -> Vec<DrawResult> {
        (0..n)
            .map(|index| DrawResult {
                index,
                quantities: Default::default(),
                order: 100.0 - index as f64,
                full: Some(record(4.0, None)),
                runs: [("hybrid".to_string(), record(1.0, Some(index as f64)))].into(),
                failed: Vec::new(),
            })
            .collect()
    }

    #[test]
    fn medians_and_worst_on_paper() {
        let all = draws(7);
        let names = ["hybrid".to_string()];
        let found = summary(&all, &names);
        let whole = &found[0]["runs"]["hybrid"];
        assert_eq!(
            (whole["end"]["median"].as_f64(), whole["end"]["worst"].as_f64()),
            (Some(3.0), Some(6.0))
        );
        assert_eq!(whole["drag"]["worst"], 2.0);
        assert_eq!(whole["time"]["median"], 25.0);
        assert!(whole["jump"]["median"].is_null());
        // Three bands in the order of 94 to 100, of two, two and three cases
        assert_eq!(found.as_array().unwrap().len(), 4);
        assert_eq!(found[1]["order"], json!([94.0, 95.0]));
        assert_eq!(found[3]["cases"], 3);
        assert_eq!(summary(&draws(5), &names).as_array().unwrap().len(), 1);
        let (title, table) = &summary_tables(&all, &names, "Re")[0];
        assert!(title.contains("7 cases, Re 94"), "{title}");
        assert!(table.to_string().contains("3.00 (6.00)"), "{table}");
        let table = case_table(&all, &names, "Re").to_string();
        assert!(table.contains("sheds") && table.contains("-2.00"), "{table}");
        // Of flows there is no displacement to show.
        assert!(!table.contains("D %") && table.contains("drag %"), "{table}");
    }
}
