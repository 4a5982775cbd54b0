//! Checkpoints: everything a training needs to go on exactly, in one safetensors file, replaced atomically.

use super::log::Validation;
use m4gn_base::{Error, Result, files};
use m4gn_learn::normaliser::{Moments, Normaliser};
use m4gn_model::ModelSpec;
use m4gn_model::tensor_file::{Arrays, TensorFile};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of a checkpoint's schema.
pub const VERSION: u32 = 3;

/// What a checkpoint says about itself and the run; the `m4gn_checkpoint` entry of the header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Version of this schema: [`VERSION`].
    pub version: u32,
    /// Steps made.
    pub step: u64,
    /// Updates of the weights made.
    pub updates: u64,
    /// Graphs seen times unrolled steps.
    pub samples: u64,
    /// Seconds of training by the first rank's clock, from which the next step has its place in the schedule.
    pub seconds: f64,
    /// Seed of the run.
    pub seed: u64,
    /// The configuration, as JSON.
    pub config: serde_json::Value,
    /// Names, lengths and ranges of the trajectories.
    pub data: Vec<String>,
    /// Step and validation of the best weights.
    pub best: Option<(u64, Validation)>,
    /// Sums over the unfinished interval of the log: rows, loss, gradient norm, losses of the fields.
    pub interval: (u64, f64, f64, Vec<f64>),
    /// Model that the training started from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// Name of [`Progress`] in the header.
const ENTRY: &str = "m4gn_checkpoint";

fn unusable(path: &Path, why: &str) -> Error {
    Error::file(path, format!("not a usable checkpoint ({why}); delete it to start the training anew"))
}

/// A checkpoint in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Counters and descriptions.
    pub progress: Progress,
    /// Weights.
    pub weights: Vec<f32>,
    /// Adam's first moment.
    pub first: Vec<f32>,
    /// Adam's second moment.
    pub second: Vec<f32>,
    /// Running average of the weights, if kept.
    pub average: Option<Vec<f32>>,
    /// Best weights so far, if there was a validation.
    pub best: Option<Vec<f32>>,
    /// Normalisers.
    pub normaliser: Normaliser,
    /// Normalisers of the best weights, if there was a validation.
    pub best_normaliser: Option<Normaliser>,
}

impl Checkpoint {
    /// Whether the tensors are those of a training of this model: lengths, and no number that is not finite.
    ///
    /// # Errors
    /// [`Error::File`] naming the first that is not.
    pub fn check(&self, spec: &ModelSpec, weights: usize, path: &Path) -> Result<()> {
        let damaged = |what: String| unusable(path, &what);
        for (name, values) in self.tensors() {
            if values.len() != weights {
                let n = values.len();
                return Err(damaged(format!("tensor `{name}`: {n} numbers, expected {weights}")));
            }
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(damaged(format!("tensor `{name}`: number {i} is {}", values[i])));
            }
        }
        if let Some(i) = self.second.iter().position(|v| *v < 0.0) {
            return Err(damaged(format!("tensor `second`: number {i} is negative")));
        }
        if self.best.is_some() != self.best_normaliser.is_some()
            || self.best.is_some() != self.progress.best.is_some()
        {
            return Err(damaged("the best weights are not complete".into()));
        }
        for (_, normaliser) in self.normalisers() {
            normaliser.check(spec).map_err(|e| damaged(e.to_string()))?;
        }
        Ok(())
    }

    fn tensors(&self) -> impl Iterator<Item = (&'static str, &Vec<f32>)> {
        let kept = [("weights", &self.weights), ("first", &self.first), ("second", &self.second)];
        let average = self.average.as_ref().map(|a| ("average", a));
        kept.into_iter().chain(average).chain(self.best.as_ref().map(|b| ("best", b)))
    }

    fn normalisers(&self) -> impl Iterator<Item = (&'static str, &Normaliser)> {
        std::iter::once(("", &self.normaliser)).chain(self.best_normaliser.as_ref().map(|n| ("best.", n)))
    }

    /// Writes a temporary file and puts it in the place of the old one.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut arrays = Arrays::default();
        self.tensors().for_each(|(name, values)| arrays.floats(name, values));
        for (prefix, normaliser) in self.normalisers() {
            for (name, m) in normaliser.named() {
                arrays.doubles(&format!("{prefix}{name}.count"), &m.count);
                arrays.doubles(&format!("{prefix}{name}.sum"), &m.sum);
                arrays.doubles(&format!("{prefix}{name}.square"), &m.square);
            }
        }
        arrays.write(path, "checkpoint", ENTRY, &self.progress)
    }

    /// Reads a checkpoint back.
    pub fn read(path: &Path) -> Result<Self> {
        let fail = |e: String| unusable(path, &e);
        let bytes = files::read(path).map_err(|e| fail(e.to_string()))?;
        let (progress, file): (Progress, _) = TensorFile::parse(&bytes, ENTRY).map_err(&fail)?;
        if progress.version != VERSION {
            return Err(fail(format!("schema version {}, this program reads {VERSION}", progress.version)));
        }
        let moments = |name: &str| -> Option<Moments> {
            Some(Moments {
                count: file.doubles(&format!("{name}.count"))?,
                sum: file.doubles(&format!("{name}.sum"))?,
                square: file.doubles(&format!("{name}.square"))?,
            })
        };
        let normaliser = |prefix: &str| -> Option<Normaliser> {
            Some(Normaliser {
                node: moments(&format!("{prefix}norm.node"))?,
                edge: moments(&format!("{prefix}norm.edge"))?,
                output: moments(&format!("{prefix}norm.output"))?,
            })
        };
        let need = |name: &str| file.floats(name).ok_or_else(|| fail(format!("no tensor `{name}`")));
        Ok(Checkpoint {
            weights: need("weights")?,
            first: need("first")?,
            second: need("second")?,
            average: file.floats("average"),
            best: file.floats("best"),
            normaliser: normaliser("").ok_or_else(|| fail("no normalisers".into()))?,
            best_normaliser: normaliser("best."),
            progress,
        })
    }
}
