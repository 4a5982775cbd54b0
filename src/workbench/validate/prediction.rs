//! What comes of one way to predict.

use m4gn_domain::body::quality::Quality;
use m4gn_train::errors::SquaredError;
use std::collections::BTreeMap;

/// Parts of a rollout after which errors are told segment by segment.
const SHOWN: [f64; 3] = [0.1, 0.4, 1.0];

/// Which states of a rollout are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// None.
    Nothing,
    /// Those after these parts.
    Shown,
    /// All.
    All,
}

impl Keep {
    /// Whether the state at the end of `step`, numbered from 1, is kept.
    pub(super) fn takes(self, step: usize, steps: usize) -> bool {
        let shown = |part: &f64| ((part * steps as f64).ceil() as usize).max(1) == step;
        self == Keep::All || self == Keep::Shown && SHOWN.iter().any(shown)
    }
}

/// Errors of one field, step by step. Step i ends at frame `(i + 1) stride`.
#[derive(Clone, Debug, Default)]
pub struct FieldErrors {
    /// Of one step from the recorded frame before it.
    pub single: Vec<SquaredError>,
    /// Of the rollout from the first frame; shorter where it became non-finite.
    pub rollout: Vec<SquaredError>,
}

/// One way to predict, and what came of it.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// Name in figures files.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Errors of each predicted field, the headline first.
    pub fields: Vec<FieldErrors>,
    /// Mesh metrics of the rollout's steps; of a domain with elements.
    pub quality: Option<Vec<Quality>>,
    /// Smallest gap to the obstacle at the rollout's steps, mean edges; empty where nothing may touch.
    pub gap: Vec<f64>,
    /// Error of the headline field at the rollout's end, but for a shift in time: its distance from the cycle that the recorded frames end
    /// in, at whatever phase. None where they end in none; infinite where the rollout became non-finite.
    pub phase_free: Option<f64>,
    /// Largest value of the headline field (of a vector: length) in the rollout over the largest recorded one; infinite
    /// where it became non-finite. Of models.
    pub largest: Option<f64>,
    /// The headline field at the ends of the steps that are kept, numbered from 1; a row of x, y, z each node of a vector.
    pub states: BTreeMap<usize, Vec<f64>>,
    /// RMSE of the headline field over the nodes of each segment at the ends of some steps, numbered from 1; of networks that have segments.
    pub over_segments: BTreeMap<usize, Vec<f64>>,
    /// Why the rollout ended early.
    pub diverged: Option<String>,
    /// Wall seconds of all steps, and their number.
    pub seconds: (f64, usize),
}
