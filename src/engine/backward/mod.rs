//! Gradients of the network on the processor, for training: the engine's forward passes with what is kept, and their
//! derivatives.
//!
//! A graph is one thread's work, so that nothing within it is shared and its gradient does not depend on the number of
//! threads. For a linear layer y = x W^T the backward pass is dx = dy W and dW = dy^T x. Activations are kept, not
//! computed again: writing and reading a row of d numbers costs less than the 2 d^2 operations that made it. With N
//! nodes, E edges, L layers, h hidden layers, padded width d and s bytes a number (4 in fp32, 2 in bf16), the tape of one
//! application holds `s d L ((h + 2) E + (h + 3) N)` bytes, and as much again for h E + h N of them with SiLU.
//!
//! In bf16 products read operands rounded to bf16 and add up in fp32; master weights, norms, sums, derivatives between
//! layers and the macro stage are in fp32.

mod attention;
mod bi_stride;
mod convolution;
mod dispatch;
mod encoder_decoder;
mod graph;
mod graph_u_net;
mod layer;
mod messages;
mod mlp;
mod muon;
mod network;
mod optimiser;
mod perceptron;
mod processor;
mod recurrence;
mod stage;
#[cfg(test)]
mod tests;

pub use crate::layout::{Layout, normal};
pub use crate::scale::Scale;
pub use graph::TrainGraph;
pub use optimiser::{Optimiser, UpdateRule, norm};

use super::kernels::{Bf16, Number};
use super::{Isa, Precision};
use bi_stride::BiStride;
use convolution::Convolutions;
use graph_u_net::GraphUNet;
use m4gn_base::Result;
use m4gn_model::{Kind, Model, ModelSpec};
use messages::Messages;
use network::Network;
use std::any::Any;

/// The normalisers of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Of node inputs.
    pub node: Scale,
    /// Of edge features.
    pub edge: Scale,
    /// Of outputs.
    pub output: Scale,
}

impl Scales {
    /// Those of a model.
    ///
    /// # Errors
    /// [`m4gn_base::Error::Model`] for one that is missing.
    pub fn of_model(model: &Model) -> Result<Self> {
        let scale = |name: &str| Scale::of_model(model, name);
        Ok(Scales { node: scale("node")?, edge: scale("edge")?, output: scale("output")? })
    }
}

/// Derivatives by what goes into the network, physical, in the graph's order.
#[derive(Clone, Debug, Default)]
pub struct InputGradient {
    /// `[nodes x n_field_inputs]`
    pub nodes: Vec<f32>,
    /// Of the graph, then of each coarser one, `[edges x n_edge_features]`, where edges depend on the state.
    pub edges: Option<Vec<Vec<f32>>>,
}

/// One thread's buffers: what applications of the network keep, and sums of gradients.
pub struct Worker(Box<dyn Any + Send + Sync>);

/// The network with its weights, for gradients, of any kind and precision; shared by threads.
pub trait Trainable: Send + Sync {
    /// The order of the flat vector of weights.
    fn layout(&self) -> &Layout;

    /// Takes the weights of the flat vector, which is as long as the layout.
    ///
    /// # Errors
    /// As [`trainable`].
    fn load(&mut self, flat: &[f32]) -> Result<()>;

    /// Buffers of another thread.
    fn worker(&self) -> Worker;

    /// From physical node inputs `[nodes x n_field_inputs]` to normalised outputs `[cells x n_outputs]`; what
    /// [`Trainable::backward`] needs is kept in tape `at` of the worker.
    fn forward(
        &self,
        worker: &mut Worker,
        at: usize,
        graph: &TrainGraph,
        scales: &Scales,
        inputs: &[f32],
        outputs: &mut [f32],
    );

    /// From dL/d normalised outputs of the application kept in tape `at`, which is spoilt: adds to the worker's gradient, and
    /// writes dL/d physical inputs where asked for.
    fn backward(
        &self,
        worker: &mut Worker,
        at: usize,
        graph: &TrainGraph,
        scales: &Scales,
        d_outputs: &[f32],
        inputs: Option<&mut InputGradient>,
    );

    /// Adds the worker's gradient to a flat one and clears it.
    fn flush(&self, worker: &mut Worker, flat: &mut [f32]);

    /// About how many bytes tape `at` has, of an application to this graph.
    fn tape_bytes(&self, worker: &mut Worker, at: usize, graph: &TrainGraph) -> usize;
}

/// The network of a model's shape, with all weights zero until [`Trainable::load`].
///
/// # Errors
/// [`m4gn_base::Error::Model`] for a shape beyond a model's limits.
pub fn trainable(spec: &ModelSpec, precision: Precision, isa: Option<Isa>) -> Result<Box<dyn Trainable>> {
    let isa = isa.unwrap_or_else(Isa::detect);
    super::check_precision(spec, precision)?;
    match precision {
        Precision::Fp32 => of_kind::<f32>(spec, isa),
        Precision::Bf16 => of_kind::<Bf16>(spec, isa),
    }
}

/// The network of a model's kind. One that only libtorch can train has an error here, which says to use
/// `--backend torch`.
fn of_kind<T: Number>(spec: &ModelSpec, isa: Isa) -> Result<Box<dyn Trainable>> {
    let zeros = vec![0.0; Layout::new(spec).len()];
    Ok(match spec.architecture.kind {
        Kind::M4gn(_) | Kind::Eagle(_) | Kind::MeshGraphNet { .. } => {
            Box::new(Network::<T, Messages<T>>::new(spec, isa, &zeros)?)
        }
        Kind::Gcn { .. } => Box::new(Network::<T, Convolutions<T>>::new(spec, isa, &zeros)?),
        Kind::BsmsGnn { .. } => Box::new(Network::<T, BiStride<T>>::new(spec, isa, &zeros)?),
        Kind::GUNet { .. } => Box::new(Network::<T, GraphUNet<T>>::new(spec, isa, &zeros)?),
    })
}
