//! A step of training to measure: a batch of one graph with random fields, forward, backward and update.

use super::Source;
use m4gn_base::{Error, Result, refuse};
use m4gn_domain::Components;
use m4gn_domain::cells::Cells;
use m4gn_engine::Precision;
use m4gn_engine::backward::{Layout, Optimiser, norm};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::samples::Sample;
use m4gn_learn::{Backend, Batch, Example, TrainingConfig, Workload};
use m4gn_model::{Model, ModelSpec};
use m4gn_parallel::Comm;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// What is measured; both backends make the same from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Nodes of the made graph.
    pub nodes: usize,
    /// A cube of hexahedra in place of an O-mesh.
    pub hex: bool,
    /// Message-passing layers.
    pub layers: usize,
    /// Latent width.
    pub width: usize,
    /// Hidden layers of each perceptron.
    pub hidden: usize,
    /// Segments of the paper's transformer.
    pub segments: Option<usize>,
    /// Graphs in a batch.
    pub batch: usize,
    /// Model steps in the loss.
    pub unroll: usize,
    /// Threads.
    pub threads: usize,
    /// Products in bf16.
    pub bf16: bool,
}

/// Everything that a step needs but a backend.
#[derive(Debug)]
pub struct Prepared {
    /// Settings of such a training.
    pub training: TrainingConfig,
    /// The network.
    pub spec: ModelSpec,
    /// The graph as a data set.
    pub work: Workload,
    /// Normalisers of random fields.
    pub normaliser: Normaliser,
    examples: Vec<Example>,
    unroll: usize,
}

impl Trial {
    /// Graph, network, fields.
    ///
    /// # Errors
    /// [`Error::Input`] for sizes out of range; what makes graph and network.
    pub fn prepare(&self) -> Result<Prepared> {
        refuse(!(1..=4096).contains(&self.batch) || !(1..=64).contains(&self.unroll), Error::Input, || {
            format!("--batch {}, --unroll {}: expected 1 to 4096 and 1 to 64", self.batch, self.unroll)
        })?;
        let source = Source::made(self.nodes, self.hex)?;
        let model = Model::random(self.spec(source.dim()), 1)?;
        let network = super::Workload { model, source, comm: Comm::serial() };
        let structure = network.structure()?;
        let (normaliser, spec) = (Normaliser::of_model(&network.model)?, network.model.spec);
        let graph = &structure.graph;
        let width = Components::new(&spec).count;
        let n_frames = self.unroll + 1;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let frames = (0..n_frames * graph.n_owned * width).map(|_| rng.random_range(-1.7f32..1.7));
        let (cells, boundary) = (graph.n_cells, graph.n_owned - graph.n_cells);
        let sample = Sample {
            frames: frames.collect(),
            source: None,
            extent: None,
            n_frames,
            cell_size: 0.0,
            coarse: None,
            width,
            domain: Box::new(Cells::prescribed(cells, boundary, &spec)),
            structure,
        };
        let training = TrainingConfig {
            batch_size: self.batch,
            precision: self.precision(),
            noise: [("U".to_string(), 0.02)].into(),
            ..TrainingConfig::default()
        };
        let example =
            |seed: usize| Example { sample: 0, frame: 0, mirror: false, seed: seed as u64, weight: 1.0 };
        Ok(Prepared {
            training,
            spec,
            work: Workload {
                train: vec![sample.into()],
                valid: Vec::new(),
                frames_a_step: 1,
                names: Vec::new(),
            },
            normaliser,
            examples: (0..self.batch).map(example).collect(),
            unroll: self.unroll,
        })
    }

    /// Precision of the products.
    pub fn precision(&self) -> Precision {
        if self.bf16 { Precision::Bf16 } else { Precision::Fp32 }
    }
}

impl Prepared {
    /// Random first weights.
    pub fn optimiser(&self) -> Optimiser {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let weights = Layout::new(&self.spec).initial(&self.spec, &mut rng);
        Optimiser::new(weights, [0.9, 0.999], false)
    }

    /// One step of training; returns the loss.
    ///
    /// # Errors
    /// What the backend may fail with; [`Error::Numerical`] for a loss that is not finite.
    pub fn step(&self, backend: &mut dyn Backend, optimiser: &mut Optimiser) -> Result<f64> {
        let batch = Batch {
            examples: &self.examples,
            micro: 1,
            total: self.examples.len(),
            unroll: self.unroll,
            accumulate: false,
            learn: true,
        };
        let learned = backend.learn(&optimiser.weights, &self.normaliser, &batch)?;
        let loss: f64 = learned.losses.iter().sum();
        if let Some(gradient) = learned.gradient {
            optimiser.update(&gradient, norm(&gradient), 1e-5, 1.0, 0.0);
        }
        match loss.is_finite() {
            true => Ok(loss),
            false => Err(Error::Numerical(format!("the loss of the measured step is {loss}"))),
        }
    }
}
