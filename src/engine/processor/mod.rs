//! What advances the nodes' latents between encoder and decoder: one implementation a kind of network.

mod bi_stride;
mod convolution;
mod graph_u_net;
mod messages;

use super::grid::Grid;
use super::kernels::Number;
use super::profile::Phase;
use super::segment_stage::{SegmentStage, Stage};
use super::weights::Weights;
use bi_stride::BiStride;
use convolution::Convolutions;
pub use convolution::{scale_rows, scales, sum_neighbours};
use graph_u_net::GraphUNet;
pub use graph_u_net::{PoolGraph, above, scores, unit};
use m4gn_base::Result;
use m4gn_model::{Kind, Model};
use m4gn_parallel::{Comm, Element};
use m4gn_structure::Structure;
use messages::Messages;

/// Encoded edges are kept beside the latents up to this size; beyond it they are computed anew in each step, which
/// takes about a tenth more time and half the memory.
pub const KEEP_ENCODED: usize = 256 << 20;

/// The network between its encoder and its decoder, on a graph.
pub trait Processor<T>: Send + Sync {
    /// Takes the edges of a structure, whose order `grid` has; again where they have become others.
    fn place(&mut self, grid: &mut Grid<T>, structure: &Structure);

    /// Moves what it knows of the nodes to another order: `before` is each node's place until now, `node` the node at each
    /// place from now on. Nothing to do for one that knows nothing of them.
    fn reorder(&mut self, _before: &[u32], _node: &[u32]) {}

    /// Advances the latents of the nodes. Collective.
    fn run(&mut self, comm: &Comm, grid: &mut Grid<T>);

    /// The macro stage, whose latents the decoder may read as well; none without one.
    fn stage(&self) -> Option<&SegmentStage> {
        None
    }

    /// Operations of the products of a step.
    fn flops(&self, grid: &Grid<T>, model: &Model) -> Vec<(Phase, f64)>;
}

/// Operations of layers of message passing on k features of edges, by all their nodes and edges.
fn flops_of_features(model: &Model, k: usize, (n, e): (f64, f64)) -> Vec<(Phase, f64)> {
    let a = &model.spec.architecture;
    let (d, h) = (a.width as f64, a.hidden_layers as f64);
    let square = 2.0 * d * d;
    vec![
        (Phase::Project, n * square),
        (Phase::Edges, e * (2.0 * d * k as f64 + h * square) + n * square),
        (Phase::Nodes, n * (2.0 + h) * square),
    ]
}

/// The processor of a model, for a structure whose order `grid` has. A kind of network that only libtorch knows has an error
/// here, which says to use `backend torch`.
///
/// # Errors
/// [`Error::Model`] when segments or coarser graphs are needed and not given; [`Error::Input`] for segments of another graph.
pub fn new<T: Number + Element>(
    weights: &mut Weights,
    model: &Model,
    structure: &Structure,
    grid: &Grid<T>,
    keep_encoded: usize,
) -> Result<Box<dyn Processor<T>>> {
    let (architecture, graph) = (&model.spec.architecture, &structure.graph);
    let stage = match (Stage::new(weights, &model.spec)?, structure.segments_for(architecture.needs())?) {
        (Some(stage), Some(segments)) => {
            let (node, threads) = (&grid.order.node, grid.pool.n_threads());
            Some(SegmentStage::new(stage, &model.spec, structure, segments, node, threads)?)
        }
        _ => None,
    };
    Ok(match &architecture.kind {
        Kind::M4gn(m) | Kind::Eagle(m) => {
            let layers = (m.layers_before, m.layers_after);
            Box::new(Messages::new(weights, model, graph, grid, layers, stage, keep_encoded)?)
        }
        Kind::MeshGraphNet { layers } => {
            Box::new(Messages::new(weights, model, graph, grid, (*layers, 0), None, keep_encoded)?)
        }
        Kind::Gcn { layers } => Box::new(Convolutions::new(weights, model, graph, grid, *layers)?),
        Kind::BsmsGnn { .. } => Box::new(BiStride::new(weights, model, structure, grid)?),
        Kind::GUNet { levels } => Box::new(GraphUNet::new(weights, model, grid, *levels)?),
    })
}
