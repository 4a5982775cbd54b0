//! Checks of trained models against recorded data.
//!
//! Errors are the paper's (Table 1): root mean squares over cells and solved components of the velocity, over the
//! steps up to a horizon, averaged over trajectories. Boundary values are prescribed and do not count.
//!
//! - RMSE-1: one step of the model's stride, from every frame that is a multiple of the stride.
//! - RMSE-50: the rollout from the first frame, over the steps within its first 50 frames, or a time given
//!   (0.5 s is 50 frames of 0.01 s).
//! - RMSE-all: the same over the whole trajectory.
//!
//! Beside the model stand two that know nothing: persistence holds the recorded frame one stride before each, hold
//! first the first frame (for RMSE-1, where the start is the first frame, the two are the same).
//!
//! That is of flows at cells; [`bodies`] does the same for deforming bodies at points.

pub mod bodies;
mod html;
pub mod pace;
pub mod rmse;
pub mod trajectory;

pub use html::report;
pub use pace::Pace;
pub use trajectory::Errors;

use crate::{
    dataset::Split,
    report::{Table, number},
};
use rmse::{SquaredError, cumulative};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Frames of the middle horizon, where no time is given.
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
    /// Field that is compared, and its unit.
    pub field: (String, String),
    /// Errors step by step.
    pub errors: Errors,
}

/// RMSE at the three horizons, in the unit of the field; infinite where a rollout became non-finite before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// RMSE-1.
    pub rmse_1: f64,
    /// RMSE-50.
    pub rmse_50: f64,
    /// RMSE-all.
    pub rmse_all: f64,
}

impl Figures {
    fn of(single: &[SquaredError], rollout: &[SquaredError], pace: Pace, horizon: f64) -> Self {
        let over = cumulative(rollout);
        let at = |steps: usize| match steps.min(pace.steps) {
            n if n <= over.len() => over[n - 1],
            _ => f64::INFINITY,
        };
        Figures {
            rmse_1: cumulative(single).last().copied().unwrap_or(f64::INFINITY),
            rmse_50: at(pace.steps_within(horizon)),
            rmse_all: at(pace.steps),
        }
    }

    fn mean(all: &[Figures]) -> Self {
        let mean = |of: fn(&Figures) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        Figures {
            rmse_1: mean(|f| f.rmse_1),
            rmse_50: mean(|f| f.rmse_50),
            rmse_all: mean(|f| f.rmse_all),
        }
    }

    /// As JSON; null where not finite.
    fn json(self) -> Value {
        json!({ "rmse_1": self.rmse_1, "rmse_50": self.rmse_50, "rmse_all": self.rmse_all })
    }

    fn row(&self, name: &str) -> Vec<String> {
        let text = |v: f64| {
            if v.is_finite() {
                number(v, 3)
            } else {
                "not finite".into()
            }
        };
        vec![
            name.into(),
            text(self.rmse_1),
            text(self.rmse_50),
            text(self.rmse_all),
        ]
    }
}

impl Case {
    fn figures(&self, single: &[SquaredError], rollout: &[SquaredError]) -> Figures {
        Figures::of(single, rollout, self.pace, self.horizon)
    }

    /// The model's errors.
    pub fn model(&self) -> Figures {
        self.figures(&self.errors.single, &self.errors.rollout)
    }

    /// Those of the frame one stride before.
    pub fn persistence(&self) -> Figures {
        self.figures(&self.errors.persistence, &self.errors.persistence)
    }

    /// Those of the first frame; for RMSE-1, of each step's start.
    pub fn hold_first(&self) -> Figures {
        self.figures(&self.errors.persistence, &self.errors.hold_first)
    }
}

/// The figures of the trajectories of one split, or of all.
#[derive(Clone, Debug)]
pub struct Summary {
    /// `test`, `valid`, `train` or `all`.
    pub name: &'static str,
    /// Number of trajectories.
    pub count: usize,
    /// The model.
    pub model: Figures,
    /// Holding the frame one stride before.
    pub persistence: Figures,
    /// Holding the first frame.
    pub hold_first: Figures,
    /// Largest speed of any rollout over the largest recorded speed of its trajectory.
    pub speed_ratio: f64,
    /// Rollouts that became non-finite.
    pub diverged: usize,
    /// Mean wall time of a step, ms.
    pub step_ms: f64,
    /// Unit of the errors.
    pub unit: String,
}

impl Summary {
    fn of(name: &'static str, cases: &[&Case]) -> Option<Self> {
        if cases.is_empty() {
            return None;
        }
        let mean = |of: fn(&Case) -> Figures| Figures::mean(&cases.iter().map(|c| of(c)).collect::<Vec<_>>());
        let sum = |of: fn(&Case) -> f64| cases.iter().map(|c| of(c)).sum::<f64>();
        Some(Summary {
            name,
            count: cases.len(),
            unit: cases[0].field.1.clone(),
            model: mean(Case::model),
            persistence: mean(Case::persistence),
            hold_first: mean(Case::hold_first),
            speed_ratio: cases.iter().map(|c| c.errors.speed_ratio).fold(0.0, f64::max),
            diverged: cases.iter().filter(|c| c.errors.diverged.is_some()).count(),
            step_ms: 1e3 * sum(|c| c.errors.seconds.0) / sum(|c| c.errors.seconds.1 as f64).max(1.0),
        })
    }

    /// The rows that people compare.
    pub fn table(&self) -> Table {
        let unit = &self.unit;
        let mut table = Table::new([
            self.name.to_string(),
            format!("RMSE-1 [{unit}]"),
            format!("RMSE-50 [{unit}]"),
            format!("RMSE-all [{unit}]"),
        ]);
        table.row(self.model.row("model"));
        table.row(self.persistence.row("persistence"));
        table.row(self.hold_first.row("hold first"));
        table
    }

    fn json(&self) -> Value {
        json!({
            "trajectories": self.count,
            "model": self.model.json(),
            "persistence": self.persistence.json(),
            "hold_first": self.hold_first.json(),
            "max_speed_ratio": self.speed_ratio,
            "diverged": self.diverged,
            "ms_per_step": self.step_ms,
        })
    }
}

/// The cases of each split that has any: test, valid, train.
fn by_split<C>(cases: &[C], split: impl Fn(&C) -> Split) -> Vec<(&'static str, Vec<&C>)> {
    let of = |s: Split| {
        (
            s.name(),
            cases.iter().filter(|c| split(c) == s).collect::<Vec<_>>(),
        )
    };
    let all = [Split::Test, Split::Valid, Split::Train].map(of);
    all.into_iter().filter(|(_, cases)| !cases.is_empty()).collect()
}

/// The cases that count: those of the test split where there are any, else all.
fn that_count<C>(cases: &[C], split: impl Fn(&C) -> Split) -> (&'static str, Vec<&C>) {
    let test = by_split(cases, split).into_iter().next();
    test.filter(|(name, _)| *name == Split::Test.name())
        .unwrap_or(("all", cases.iter().collect()))
}

/// One summary a split that has trajectories: test, valid, train.
pub fn summaries(cases: &[Case]) -> Vec<Summary> {
    let splits = by_split(cases, |c| c.split).into_iter();
    splits
        .filter_map(|(name, cases)| Summary::of(name, &cases))
        .collect()
}

/// The figures that count: those of the test split where there is one, else of all trajectories.
pub fn headline(cases: &[Case]) -> Option<Summary> {
    let (name, cases) = that_count(cases, |c| c.split);
    Summary::of(name, &cases)
}

/// The figures file: those of [`headline`] at the top, all splits and trajectories below.
pub fn json(cases: &[Case]) -> Value {
    let mut figures = headline(cases).map_or(json!({}), |s| {
        let mut object = s.json();
        object["split"] = json!(s.name);
        object
    });
    let splits: serde_json::Map<String, Value> = summaries(cases)
        .iter()
        .map(|s| (s.name.to_string(), s.json()))
        .collect();
    figures["splits"] = Value::Object(splits);
    let one = |c: &Case| {
        json!({
            "path": c.path,
            "split": c.split.name(),
            "horizon": c.horizon,
            "model": c.model().json(),
            "persistence": c.persistence().json(),
            "hold_first": c.hold_first().json(),
            "max_speed_ratio": c.errors.speed_ratio,
            "diverged": c.errors.diverged,
        })
    };
    figures["cases"] = cases.iter().map(one).collect();
    figures
}

#[cfg(test)]
mod tests;
