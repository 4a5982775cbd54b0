//! What stands between the encoder of the nodes and the decoder, for gradients: one implementation a kind of network.

use super::Scales;
use super::graph::TrainGraph;
use super::network::Buffers;
use crate::kernels::Number;
use crate::weights::{Gradients, Weights};
use m4gn_base::Result;
use m4gn_model::ModelSpec;

/// A part of a network with its weights, shared by threads.
pub trait Processor<T: Number>: Send + Sync + Sized + 'static {
    /// What one application keeps for its backward pass.
    type Tape: Send + Sync + 'static;

    /// Of a model's shape.
    ///
    /// # Errors
    /// [`m4gn_base::Error::Internal`] for a weight that the layout lacks.
    fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self>;

    /// Nothing kept yet.
    fn tape(&self) -> Self::Tape;

    /// Nodes and edges that the layers of the last forward pass went over, each as often as they did.
    fn passed(&self, graph: &TrainGraph, tape: &Self::Tape) -> [usize; 2];

    /// h_S of the last forward pass, rows of the padded width; none without a macro stage.
    fn segments(_: &Self::Tape) -> Option<&[f32]> {
        None
    }

    /// Advances `work.latents`.
    fn forward(&self, graph: &TrainGraph, scales: &Scales, tape: &mut Self::Tape, work: &mut Buffers<T>);

    /// From derivatives by the latents behind it (`work.d_nodes`, and `work.d_segments` by h_S) to those before it, in
    /// `work.d_nodes`; to `edges`, where asked for, those by the physical edge features of the graph and of each coarser one.
    fn backward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut Self::Tape,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
        edges: Option<&mut [Vec<f32>]>,
    );
}
