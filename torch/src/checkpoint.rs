//! Checkpoints: everything a training needs to go on exactly, in one safetensors file, replaced atomically.

use crate::journal::Validation;
use crate::normaliser::{Moments, Normaliser};
use m4gn::{Error, Result};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

/// What a checkpoint says about itself and the run; the `m4gn_checkpoint` entry of the header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Version of this schema: 1.
    pub version: u32,
    /// Steps made.
    pub step: u64,
    /// Updates of the weights made.
    pub updates: u64,
    /// Graphs seen times unrolled steps.
    pub samples: u64,
    /// Seconds of training.
    pub seconds: f64,
    /// Seed of the run.
    pub seed: u64,
    /// The configuration, as JSON.
    pub config: serde_json::Value,
    /// Names and lengths of the trajectories.
    pub data: Vec<String>,
    /// Step and validation of the best weights.
    pub best: Option<(u64, Validation)>,
    /// Sums over the unfinished interval of the log: rows, loss, gradient norm, losses of the fields.
    pub interval: (u64, f64, f64, Vec<f64>),
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

const ENTRY: &str = "m4gn_checkpoint";

impl Checkpoint {
    /// Writes a temporary file and puts it in the place of the old one.
    pub fn write(&self, path: &Path) -> Result<()> {
        let fail = |e: String| Error::file(path, format!("cannot write the checkpoint: {e}"));
        let mut tensors: Vec<(String, Dtype, Vec<u8>)> = Vec::new();
        let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let doubles = |v: &[f64]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        for (name, values) in [
            ("weights", Some(&self.weights)),
            ("first", Some(&self.first)),
            ("second", Some(&self.second)),
            ("average", self.average.as_ref()),
            ("best", self.best.as_ref()),
        ] {
            if let Some(values) = values {
                tensors.push((name.into(), Dtype::F32, floats(values)));
            }
        }
        for (prefix, normaliser) in [
            ("", Some(&self.normaliser)),
            ("best.", self.best_normaliser.as_ref()),
        ] {
            for (name, m) in normaliser.iter().flat_map(|n| n.named()) {
                tensors.push((format!("{prefix}{name}.count"), Dtype::F64, doubles(&[m.count])));
                tensors.push((format!("{prefix}{name}.sum"), Dtype::F64, doubles(&m.sum)));
                tensors.push((format!("{prefix}{name}.square"), Dtype::F64, doubles(&m.square)));
            }
        }
        let views = tensors
            .iter()
            .map(|(name, kind, bytes)| {
                let count = bytes.len() / if *kind == Dtype::F32 { 4 } else { 8 };
                TensorView::new(*kind, vec![count], bytes).map(|view| (name.as_str(), view))
            })
            .collect::<std::result::Result<Vec<_>, _>>()
            .map_err(|e| fail(e.to_string()))?;
        let progress = serde_json::to_string(&self.progress).map_err(|e| fail(e.to_string()))?;
        let header = HashMap::from([(ENTRY.to_string(), progress)]);
        let bytes = safetensors::serialize(views, Some(header)).map_err(|e| fail(e.to_string()))?;
        write_atomically(path, &bytes)
    }

    /// Reads a checkpoint back.
    pub fn read(path: &Path) -> Result<Self> {
        let fail = |e: String| {
            Error::file(
                path,
                format!("not a usable checkpoint ({e}); delete it to start the training anew"),
            )
        };
        let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| fail(e.to_string()))?;
        let entry = header.metadata().as_ref().and_then(|m| m.get(ENTRY).cloned());
        let entry = entry.ok_or_else(|| fail(format!("no `{ENTRY}` entry in its header")))?;
        let progress: Progress = serde_json::from_str(&entry).map_err(|e| fail(e.to_string()))?;
        if progress.version != 1 {
            return Err(fail(format!(
                "schema version {}, this program reads 1",
                progress.version
            )));
        }
        let file = SafeTensors::deserialize(&bytes).map_err(|e| fail(e.to_string()))?;
        let floats = |name: &str| -> Option<Vec<f32>> {
            let view = file.tensor(name).ok().filter(|v| v.dtype() == Dtype::F32)?;
            Some(
                view.data()
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|b| f32::from_le_bytes(*b))
                    .collect(),
            )
        };
        let doubles = |name: String| -> Option<Vec<f64>> {
            let view = file.tensor(&name).ok().filter(|v| v.dtype() == Dtype::F64)?;
            Some(
                view.data()
                    .as_chunks::<8>()
                    .0
                    .iter()
                    .map(|b| f64::from_le_bytes(*b))
                    .collect(),
            )
        };
        let moments = |name: &str| -> Option<Moments> {
            Some(Moments {
                count: *doubles(format!("{name}.count"))?.first()?,
                sum: doubles(format!("{name}.sum"))?,
                square: doubles(format!("{name}.square"))?,
            })
        };
        let normaliser = |prefix: &str| -> Option<Normaliser> {
            Some(Normaliser {
                node: moments(&format!("{prefix}norm.node"))?,
                edge: moments(&format!("{prefix}norm.edge"))?,
                output: moments(&format!("{prefix}norm.output"))?,
            })
        };
        let need = |name: &str| floats(name).ok_or_else(|| fail(format!("no tensor `{name}`")));
        Ok(Checkpoint {
            weights: need("weights")?,
            first: need("first")?,
            second: need("second")?,
            average: floats("average"),
            best: floats("best"),
            normaliser: normaliser("").ok_or_else(|| fail("no normalisers".into()))?,
            best_normaliser: normaliser("best."),
            progress,
        })
    }
}

/// Writes beside the file, syncs, renames.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail = |e: std::io::Error| Error::file(path, format!("cannot be written: {e}"));
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(fail)?;
    file.write_all(bytes).map_err(fail)?;
    file.as_file().sync_all().map_err(fail)?;
    file.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}
