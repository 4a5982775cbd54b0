//! Checks of models of deforming bodies against recorded trajectories at points.
//!
//! Errors are those of the displacement, over free points, components and steps up to a horizon, averaged over
//! trajectories; the obstacle's motion is prescribed and held points do not count.
//!
//! - RMSE-1: one step of the model's stride, from every frame that is a multiple of the stride.
//! - RMSE-50: the rollout from the first frame, over its first 50 steps, or a time given.
//! - RMSE-all: the same over the whole trajectory.
//!
//! Beside the model stand persistence (the recorded frame one stride before each), the line through the two recorded
//! frames before, and the first frame, held; for RMSE-1, where each step starts anew, the last two rows are the line and
//! persistence. Mesh metrics ([`crate::solids::quality`]) are means over the steps of the rollout, gaps the smallest of all
//! steps in mean edges. With contact projection there is a rollout of its own, in which each step starts from the
//! projected state.

mod html;
pub mod rollout;
mod series;
#[cfg(test)]
mod tests;

pub use html::report;
pub use rollout::{Errors, Plan, Track};
pub use series::write as write_series;

use super::{Figures, Pace, by_split, rmse::SquaredError, that_count};
use crate::dataset::Split;
use crate::report::{Table, number};
use crate::solids::quality::Quality;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Steps of the middle horizon, where no time is given.
pub const HORIZON: usize = 50;

/// What a trajectory gave.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its file.
    pub path: PathBuf,
    /// What it is for.
    pub split: Split,
    /// Its frames and the model's stride.
    pub pace: Pace,
    /// Middle horizon, s from the first frame.
    pub horizon: f64,
    /// Errors step by step.
    pub errors: Errors,
    /// Processor time of the solver that made the data, s a frame, where it was recorded.
    pub solver: Option<f64>,
}

/// A way to predict, and what it scores.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name in figures files.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Errors of the displacement, m.
    pub figures: Figures,
    /// Mesh metrics of the rollout.
    pub quality: Option<Quality>,
    /// Smallest gap of the rollout, mean edges.
    pub gap: Option<f64>,
}

impl Row {
    fn json(&self) -> Value {
        let Figures {
            rmse_1,
            rmse_50,
            rmse_all,
        } = self.figures;
        let mut row = json!({ "rmse_1": rmse_1, "rmse_50": rmse_50, "rmse_all": rmse_all });
        if let Some(q) = self.quality {
            for (key, value) in [
                ("gf_h", q.gf_h),
                ("gf_c", q.gf_c),
                ("mc", q.mc),
                ("ar", q.ar),
                ("inverted", q.inverted),
            ] {
                row[key] = json!(value);
            }
        }
        if let Some(gap) = self.gap {
            row["worst_gap"] = json!(gap);
        }
        row
    }
}

impl Case {
    /// All ways to predict.
    pub fn rows(&self) -> Vec<Row> {
        let e = &self.errors;
        let row = |key, name, single: &[SquaredError], rollout: &[SquaredError]| Row {
            key,
            name,
            figures: Figures::of(single, rollout, self.pace, self.horizon),
            quality: None,
            gap: None,
        };
        let of = |key, name, track: &Track| Row {
            quality: Some(match track.diverged {
                None => Quality::mean(&track.quality),
                Some(_) => Quality {
                    gf_h: f64::INFINITY,
                    gf_c: f64::INFINITY,
                    mc: f64::INFINITY,
                    ar: f64::INFINITY,
                    inverted: f64::INFINITY,
                },
            }),
            gap: smallest(&track.gap),
            ..row(key, name, &track.single, &track.rollout)
        };
        let mut rows = Vec::new();
        rows.extend(e.model.as_ref().map(|t| of("model", "model", t)));
        rows.extend(
            e.projected
                .as_ref()
                .map(|t| of("projected", "model, projected", t)),
        );
        rows.push(row("persistence", "persistence", &e.persistence, &e.persistence));
        rows.push(row(
            "extrapolation",
            "extrapolation",
            &e.extrapolation,
            &e.extrapolation,
        ));
        rows.push(Row {
            quality: Some(Quality::mean(&e.hold_first_quality)),
            ..row("hold_first", "hold first", &e.persistence, &e.hold_first)
        });
        rows
    }

    /// The rollouts that there are.
    pub fn tracks(&self) -> impl Iterator<Item = &Track> {
        self.errors.model.iter().chain(&self.errors.projected)
    }

    /// Why a rollout ended early.
    pub fn diverged(&self) -> Option<&str> {
        self.tracks().find_map(|t| t.diverged.as_deref())
    }
}

/// The figures of the trajectories of one split, or of all.
#[derive(Clone, Debug)]
pub struct Summary {
    /// `test`, `valid`, `train` or `all`.
    pub name: &'static str,
    /// Number of trajectories.
    pub count: usize,
    /// Ways to predict.
    pub rows: Vec<Row>,
    /// Smallest gap of the data.
    pub data_gap: Option<f64>,
    /// Trajectories with a rollout that became non-finite.
    pub diverged: usize,
    /// Mean wall time of a step without projection, ms.
    pub step_ms: f64,
    /// Mean wall time of a projection, ms.
    pub projection_ms: Option<f64>,
    /// Mean processor time of the data's solver over one stride, ms.
    pub solver_ms: Option<f64>,
}

impl Summary {
    fn of(name: &'static str, cases: &[&Case]) -> Option<Self> {
        if cases.is_empty() {
            return None;
        }
        let tables: Vec<Vec<Row>> = cases.iter().map(|c| c.rows()).collect();
        let merged = |i: usize| {
            let column = || tables.iter().map(|t| &t[i]);
            let quality: Option<Vec<Quality>> = column().map(|r| r.quality).collect();
            Row {
                figures: Figures::mean(&column().map(|r| r.figures).collect::<Vec<_>>()),
                quality: quality.map(|q| Quality::mean(&q)),
                gap: column().filter_map(|r| r.gap).reduce(f64::min),
                ..tables[0][i].clone()
            }
        };
        let mean_ms = |of: fn(&Errors) -> (f64, usize)| {
            let (seconds, count) = cases.iter().fold((0.0, 0), |(s, n), c| {
                let (seconds, count) = of(&c.errors);
                (s + seconds, n + count)
            });
            (count > 0).then(|| 1e3 * seconds / count as f64)
        };
        let solver: Option<Vec<f64>> = cases
            .iter()
            .map(|c| Some(1e3 * c.solver? * c.pace.frames as f64))
            .collect();
        Some(Summary {
            name,
            count: cases.len(),
            rows: (0..tables[0].len()).map(merged).collect(),
            data_gap: cases
                .iter()
                .filter_map(|c| smallest(&c.errors.gap))
                .reduce(f64::min),
            diverged: cases.iter().filter(|c| c.diverged().is_some()).count(),
            step_ms: mean_ms(|e| e.seconds).unwrap_or(0.0),
            projection_ms: mean_ms(|e| e.projecting),
            solver_ms: solver.map(|s| s.iter().sum::<f64>() / s.len() as f64),
        })
    }

    fn row(&self, key: &str) -> Option<&Row> {
        self.rows.iter().find(|r| r.key == key)
    }

    /// The rows that people compare.
    pub fn table(&self) -> Table {
        let mut table = Table::new([
            self.name,
            "RMSE-1 [m]",
            "RMSE-50 [m]",
            "RMSE-all [m]",
            "GFh [m]",
            "GFc [m2]",
            "MC",
            "AR",
            "worst gap [cells]",
        ]);
        for row in &self.rows {
            let mut cells = row.figures.row(row.name);
            cells.extend(match row.quality {
                Some(q) => [q.gf_h, q.gf_c, q.mc, q.ar].map(|v| number(v, 3)),
                None => [const { String::new() }; 4],
            });
            cells.push(row.gap.map_or(String::new(), |g| format!("{g:+.4}")));
            table.row(cells);
        }
        table
    }

    /// Times, and the gap of the data, in a sentence or two.
    pub fn line(&self) -> String {
        let mut text = format!(
            "{} trajectories, {} ms a step",
            self.count,
            number(self.step_ms, 3)
        );
        if let Some(ms) = self.projection_ms {
            text += &format!(" and {} ms a projection", number(ms, 3));
        }
        if let (Some(ms), Some(ratio)) = (self.solver_ms, self.ratio()) {
            text += &format!(
                "; the data's solver took {} ms for as much, {} times as long",
                number(ms, 3),
                number(ratio, 3)
            );
        }
        if let Some(gap) = self.data_gap {
            text += &format!(". Worst gap of the data {gap:+.4} cells");
        }
        text
    }

    /// Solver's time over the surrogate's, its projection counted where there is one.
    fn ratio(&self) -> Option<f64> {
        let own = self.step_ms + self.projection_ms.unwrap_or(0.0);
        self.solver_ms.filter(|_| own > 0.0).map(|s| s / own)
    }

    fn json(&self) -> Value {
        let mut figures = json!({ "trajectories": self.count });
        for row in &self.rows {
            figures[row.key] = row.json();
        }
        let first = self.rows.first().and_then(|r| r.quality).unwrap_or_default();
        for (key, value) in [
            ("gf_h", first.gf_h),
            ("gf_c", first.gf_c),
            ("mc", first.mc),
            ("ar", first.ar),
        ] {
            figures[key] = json!(value);
        }
        figures["worst_gap"] = json!(self.row("model").and_then(|r| r.gap));
        figures["worst_gap_projected"] = json!(self.row("projected").and_then(|r| r.gap));
        figures["worst_gap_data"] = json!(self.data_gap);
        figures["diverged"] = json!(self.diverged);
        figures["ms_per_step"] = json!(self.step_ms);
        figures["ms_per_projection"] = json!(self.projection_ms);
        figures["solver_ms_per_step"] = json!(self.solver_ms);
        figures["solver_ratio"] = json!(self.ratio());
        figures
    }
}

fn smallest(gaps: &[f64]) -> Option<f64> {
    gaps.iter().copied().reduce(f64::min)
}

/// One summary a split that has trajectories: test, valid, train.
pub fn summaries(cases: &[Case]) -> Vec<Summary> {
    let splits = by_split(cases, |c| c.split).into_iter();
    splits
        .filter_map(|(name, cases)| Summary::of(name, &cases))
        .collect()
}

/// The figures file: those of the test split, or else of all, at the top; all splits and trajectories below.
pub fn json(cases: &[Case]) -> Value {
    let (name, counting) = that_count(cases, |c| c.split);
    let mut figures = Summary::of(name, &counting).map_or(json!({}), |s| s.json());
    figures["split"] = json!(name);
    let splits: serde_json::Map<String, Value> = summaries(cases)
        .iter()
        .map(|s| (s.name.to_string(), s.json()))
        .collect();
    figures["splits"] = Value::Object(splits);
    let one = |c: &Case| {
        let mut case = json!({
            "path": c.path,
            "split": c.split.name(),
            "horizon": c.horizon,
            "diverged": c.diverged(),
        });
        for row in c.rows() {
            case[row.key] = row.json();
        }
        case
    };
    figures["cases"] = cases.iter().map(one).collect();
    figures
}
