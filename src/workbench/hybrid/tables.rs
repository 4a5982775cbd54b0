//! Tables: a row a run, then medians and worst of each variant, over all cases and by the order of the cases.

use super::score::Score;
use super::{Cost, DrawResult, RunRecord};
use crate::signal::median;
use m4gn_report::{Table, figure, number};
use serde_json::{Value, json};

/// Cases from which on three bands are shown.
const BANDS_FROM: usize = 6;
/// Lift over drag above which a wake that is steady in the full run sheds vortices.
const SHEDS: f64 = 0.01;

/// What tables show of a run: heading, name in the figures, and value.
type Figure = (&'static str, &'static str, fn(&DrawResult, &RunRecord) -> Option<f64>);

fn score(run: &RunRecord) -> Option<&Score> {
    run.score.as_ref()
}

const FIGURES: [Figure; 23] = [
    ("whole %", "whole", |d, r| percent(whole_time(d, r, |c| c.processor))),
    ("whole wall %", "whole_wall", |d, r| percent(whole_time(d, r, |c| c.wall))),
    ("ended s", "ended", |_, r| score(r)?.ended),
    ("answer %", "answer", |_, r| percent(score(r)?.answer)),
    ("outside %", "outside", |_, r| percent(score(r)?.outside)),
    ("first stride", "first", |_, r| score(r)?.first),
    ("first jump", "jump", |_, r| score(r)?.jump),
    ("end", "end", |_, r| score(r)?.end),
    ("phase-free", "phase_free", |_, r| score(r)?.phase_free),
    ("D %", "displacement", |_, r| percent(score(r)?.displacement)),
    ("stress %", "stress", |_, r| percent(score(r)?.stress)),
    ("D/range %", "range", |_, r| percent(score(r)?.range)),
    ("cell %", "cell", |_, r| percent(score(r)?.cell)),
    ("drag %", "drag", |_, r| percent(score(r)?.drag)),
    ("lift rms %", "lift", |_, r| percent(score(r)?.lift)),
    ("frequency %", "frequency", |_, r| percent(score(r)?.frequency)),
    ("force %", "reaction", |_, r| percent(score(r)?.reaction)),
    ("solver's %", "reaction_of_solver", |_, r| percent(score(r)?.reaction_of_solver)),
    ("force max %", "reaction_max", |_, r| percent(score(r)?.reaction_max)),
    ("force/range %", "reaction_of_range", |_, r| percent(score(r)?.reaction_of_range)),
    ("surrogate's %", OF_SURROGATE, |_, r| percent(score(r)?.reaction_of_range_of_surrogate)),
    ("times as fast", TIMES_AS_FAST, |d, r| times_as_fast(d, r)),
    ("stretch %", "time", |d, r| percent(relative_time(d, r))),
];

/// The figure of which more is better.
const TIMES_AS_FAST: &str = "times_as_fast";
/// The error of a patch's force at the surrogate's times.
const OF_SURROGATE: &str = "reaction_of_range_of_surrogate";
/// Figures of the stress and of a patch's force, a dash where it is not known.
const OF_STRESSES: [&str; 6] =
    ["stress", "reaction", "reaction_of_solver", "reaction_max", "reaction_of_range", OF_SURROGATE];

fn percent(value: Option<f64>) -> Option<f64> {
    value.map(|v| 100.0 * v)
}

/// Time of the whole run, with start-up and loading, over the full run's by the same clock.
pub(super) fn whole_time(draw: &DrawResult, run: &RunRecord, clock: fn(&Cost) -> f64) -> Option<f64> {
    let full = clock(&draw.full.as_ref()?.cost);
    (full > 0.0).then(|| clock(&run.cost) / full)
}

/// Processor time after the takeover over the full run's.
pub(super) fn relative_time(draw: &DrawResult, run: &RunRecord) -> Option<f64> {
    let full = draw.full.as_ref()?.cost.after_takeover;
    (full > 0.0).then(|| run.cost.after_takeover / full)
}

/// Wall time of the full run for what the surrogate replaced, over the wall time that the surrogate worked for it. The full run's
/// wall time behind this run's takeover is the share of the whole that its processor time has.
fn times_as_fast(draw: &DrawResult, run: &RunRecord) -> Option<f64> {
    let (full, score) = (&draw.full.as_ref()?.cost, score(run)?);
    (full.processor > 0.0).then_some(score.solver_pace? * full.wall / full.processor / score.pace?)
}

/// The figures that some run has or could have: flows have no displacement, solids no drag.
fn figures_present(results: &[DrawResult]) -> Vec<&'static Figure> {
    let could = |figure: &Figure, s: &Score| {
        (figure.1 == "lift" && s.unsteadiness.is_some())
            || (OF_STRESSES.contains(&figure.1) && s.reaction_left_out.is_some())
    };
    let has = |figure: &Figure| {
        results.iter().any(|d| {
            let mut runs = d.runs.values();
            runs.any(|r| figure.2(d, r).is_some() || score(r).is_some_and(|s| could(figure, s)))
        })
    };
    FIGURES.iter().filter(|figure| has(figure)).collect()
}

/// An empty table of runs.
fn heading(order: &str, figures: &[&Figure]) -> Table {
    let mut headers = vec!["case".to_string(), order.to_string(), "run".into()];
    headers.extend(figures.iter().map(|f| f.0.to_string()));
    headers.extend(["replaced %".into(), "cells".into(), "processor s".into(), "wall s".into()]);
    Table::new(headers)
}

/// A row a run, the cases in their order; errors are over those of holding the last field, times over the full run's
/// after the takeover.
pub fn case_table(results: &[DrawResult], variants: &[String], order: &str) -> Table {
    let figures = figures_present(results);
    let mut table = heading(order, &figures);
    for draw in sorted(results) {
        let first = [format!("{:04}", draw.index), number(draw.order, 4)];
        if let Some(full) = &draw.full {
            let mut row = first.to_vec();
            row.push("full".into());
            row.extend(vec!["-".to_string(); figures.len() + 2]);
            row.extend(cost(full));
            table.row(row);
        }
        for name in variants {
            let Some(run) = draw.runs.get(name) else { continue };
            let mut row = first.to_vec();
            row.push(name.clone());
            row.extend(figures.iter().map(|(_, key, value)| match (*key, score(run)) {
                ("lift", Some(Score { unsteadiness: Some(u), .. })) if *u > SHEDS => "sheds".into(),
                ("lift", Some(Score { unsteadiness: Some(_), .. })) => "steady".into(),
                _ => figure(value(draw, run), 3),
            }));
            row.push(figure(percent(score(run).and_then(|s| s.replaced)), 3));
            row.push(score(run).filter(|s| s.cells > 0).map_or("-".into(), |s| s.cells.to_string()));
            row.extend(cost(run));
            table.row(row);
        }
    }
    table
}

/// What the tables do not say of a run: a line a run of which a force was left out at some time.
pub fn remarks(results: &[DrawResult]) -> Vec<String> {
    let of = |draw: &DrawResult| {
        let (index, runs) = (draw.index, draw.runs.iter());
        let told = runs.filter_map(|(name, r)| Some((name, score(r)?.reaction_left_out.as_ref()?)));
        told.map(|(name, text)| format!("{index:04} {name}: {text}")).collect::<Vec<_>>()
    };
    results.iter().flat_map(of).collect()
}

/// A line a run that failed.
pub fn failures(results: &[DrawResult]) -> Vec<String> {
    let of = |d: &DrawResult| -> Vec<String> {
        d.failed.iter().map(|(name, message)| format!("{:04} {name}: {message}", d.index)).collect()
    };
    results.iter().flat_map(of).collect()
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
    band.iter().filter_map(|d| Some(figure.2(d, d.runs.get(variant)?)?.abs())).collect()
}

/// The largest, or the smallest of what is the better the larger it is.
fn worst(key: &str, values: &[f64]) -> Option<f64> {
    let all = values.iter().copied();
    match key == TIMES_AS_FAST {
        true => all.reduce(f64::min),
        false => all.reduce(f64::max),
    }
}

fn range(band: &[&DrawResult]) -> [f64; 2] {
    let of = |d: Option<&&DrawResult>| d.map_or(f64::NAN, |d| d.order);
    [of(band.first()), of(band.last())]
}

/// Median and worst of each variant: one table for all cases, and one a band.
pub fn summary_tables(results: &[DrawResult], variants: &[String], order: &str) -> Vec<(String, Table)> {
    let figures = figures_present(results);
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
                match (median(all.iter().copied()), worst(figure.1, &all)) {
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
                    "median": median(all.iter().copied()), "worst": worst(figure.1, &all), "cases": all.len(),
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
#[path = "tables_tests.rs"]
mod tests;
