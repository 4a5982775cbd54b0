//! What a case may set differently from the model.

use crate::engine::{EngineOptions, Precision};
use crate::model::{ModalOperator, SegmentMethod, SegmentSpec};
use crate::modes::ModalOptions;
use crate::{Error, Result};
use std::path::PathBuf;

/// Most threads a rank may be given: a larger number is a slip of the pen.
const MAX_THREADS: usize = 1024;

/// What runs the network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// This library's own engine.
    #[default]
    Native,
    /// libtorch on this device ("cpu", "cuda:0"), or on one of its choice.
    Torch(Option<String>),
}

impl Backend {
    /// From a dictionary's word: `native`, `torch`, `torch:cpu`, `torch:cuda:0`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other word.
    pub fn parse(word: &str) -> Result<Self> {
        match word.split_once(':') {
            None if word == "native" => Ok(Backend::Native),
            None if word == "torch" => Ok(Backend::Torch(None)),
            Some(("torch", device)) if !device.is_empty() => Ok(Backend::Torch(Some(device.into()))),
            _ => Err(Error::Input(format!(
                "backend '{word}': expected native, torch or torch:DEVICE"
            ))),
        }
    }
}

/// What a case may set differently from the model; the default changes nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionOptions {
    /// What runs the network.
    pub backend: Backend,
    /// Threads of this rank; 0: 1.
    pub n_threads: usize,
    /// Of the native engine's products; libtorch computes in fp32.
    pub precision: Precision,
    /// Number of segments K.
    pub segments: Option<usize>,
    /// Number of modes m.
    pub modes: Option<usize>,
    /// Overlap delta, layers.
    pub overlap: Option<usize>,
    /// Largest number of SLIC sweeps.
    pub slic_iterations: Option<usize>,
    /// Compactness tau.
    pub tau: Option<f64>,
    /// Average cluster size S, m.
    pub segment_size: Option<f64>,
    /// METIS alone or a variant of SLIC.
    pub segment_method: Option<SegmentMethod>,
    /// Share of the energy that chooses the number of modes; `modes` is then the most.
    pub energy: Option<f64>,
    /// Whether every segment is made connected.
    pub connected: Option<bool>,
    /// Length over which the distance to the obstacle is taken, m; 0: off.
    pub distance_scale: Option<f64>,
    /// Patches that are the obstacle.
    pub obstacles: Option<Vec<String>>,
    /// Whose modes the segments are made of.
    pub operator: Option<ModalOperator>,
    /// The way to the modes; their number is that of `modes` and `energy`.
    pub modal: ModalOptions,
    /// Segment of each cell, computed before.
    pub cell_segment: Option<Vec<i32>>,
    /// File that the model came from; the torch backend reads it.
    pub model_path: Option<PathBuf>,
}

impl SessionOptions {
    /// What the native engine is made with.
    pub(super) fn engine(&self) -> EngineOptions {
        EngineOptions {
            n_threads: self.n_threads.max(1),
            precision: self.precision,
            ..EngineOptions::default()
        }
    }

    /// The model's segmentation with what the case sets differently.
    ///
    /// # Errors
    /// [`Error::Input`] for a value out of range.
    pub(super) fn segment_spec(&self, model: &SegmentSpec) -> Result<SegmentSpec> {
        if self.n_threads > MAX_THREADS {
            return Err(Error::Input(format!(
                "n_threads: expected 1 to {MAX_THREADS}, found {}",
                self.n_threads
            )));
        }
        let spec = SegmentSpec {
            method: self.segment_method.unwrap_or(model.method),
            count: self.segments.unwrap_or(model.count),
            modes: self.modes.unwrap_or(model.modes),
            operator: self.operator.or(model.operator),
            energy: self.energy.or(model.energy),
            tau: self.tau.unwrap_or(model.tau),
            size: self.segment_size.or(model.size),
            iterations: self.slic_iterations.unwrap_or(model.iterations),
            connected: self.connected.unwrap_or(model.connected),
            distance_scale: self.distance_scale.or(model.distance_scale),
            obstacles: self.obstacles.clone().unwrap_or_else(|| model.obstacles.clone()),
            overlap: self.overlap.unwrap_or(model.overlap),
        };
        spec.check()?;
        Ok(spec)
    }
}
