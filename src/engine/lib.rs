//! The forward step of the network on this rank's part of the graph, on the processor, in fp32 or bf16.
//!
//! Latents are rows of width d: h `[n_owned x d]` for nodes, e `[n_edges x d]` for edges, padded to whole vectors. A
//! message-passing layer (eq. 2, 3) is one sweep over tiles of receivers and their edges, small enough to stay in
//! cache. The first layer of the edge network is linear in its three inputs, so that W [e, h_s, h_r] = We e + Ws h_s +
//! Wr h_r: Ws h is computed once a node and exchanged with the neighbouring ranks (the one exchange of a layer), then
//! gathered while the product is still in registers. Edge features do not change with time: their encoding is
//! computed once, unless that would take too much memory.
//!
//! Within the engine nodes stand in an order of its own (see [`order`]); inputs and outputs are in the graph's.
//! Nothing is allocated and nothing locked in a step, unless graphs change with the state: the coarser ones of g-U-Net, and those of
//! bodies. The result does not depend on the number of threads.
#![allow(unsafe_code)]

mod activations;
pub mod backward;
mod encoder_decoder;
mod grid;
mod kernels;
mod layout;
mod members;
mod mlp;
mod network;
mod options;
mod order;
mod passing;
mod peak;
mod perceptron;
pub mod plain;
mod pool;
mod processor;
mod profile;
mod recurrence;
mod scale;
mod segment_stage;
mod tiles;
pub mod torch;
mod transformer;
mod weights;

pub use kernels::Isa;
pub use m4gn_model::Precision;
pub use options::{EngineOptions, PrecisionChoice};
pub use peak::{Peak, peak};
pub use profile::{Phase, Profile};

use kernels::Bf16;
use m4gn_base::{Error, Result, refuse};
use m4gn_model::{Model, ModelSpec};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;
use network::Network;

/// What advances the graph by one step: the native engine or another backend.
pub trait Forward {
    /// From `inputs [n_owned x n_field_inputs]`, physical, to `outputs [n_cells x n_outputs]`, physical, changes not
    /// yet added. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for slices of other lengths; what a backend may fail with.
    fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()>;

    /// Takes other edges between the same nodes, and other features of the edges of coarser graphs, for graphs that change with time. The
    /// next step uses them.
    ///
    /// # Errors
    /// [`Error::Internal`] for a graph of other nodes, or what was made for edges that stay.
    fn set_edges(&mut self, structure: &Structure) -> Result<()>;
}

/// The native engine.
pub struct Engine(Inner);

enum Inner {
    Fp32(Box<Network<f32>>),
    Bf16(Box<Network<Bf16>>),
}

/// Runs an expression on the network of either precision.
macro_rules! either {
    ($engine:expr, $network:ident => $what:expr) => {
        match $engine {
            Inner::Fp32($network) => $what,
            Inner::Bf16($network) => $what,
        }
    };
}

impl Engine {
    /// Prepares a model for this structure.
    ///
    /// # Errors
    /// [`Error::Model`] when the model does not fit the structure (dimension, node types, what it needs);
    /// [`Error::Input`] for a segmentation of another graph.
    pub fn new(model: &Model, structure: &Structure, options: &EngineOptions) -> Result<Self> {
        let keep = match options.edges_move {
            true => 0,
            false => processor::KEEP_ENCODED,
        };
        Self::with_limit(model, structure, options, keep)
    }

    /// As [`Engine::new`]; encoded edges are kept up to `keep_encoded` bytes.
    fn with_limit(
        model: &Model,
        structure: &Structure,
        options: &EngineOptions,
        keep_encoded: usize,
    ) -> Result<Self> {
        check(model, &structure.graph)?;
        check_precision(&model.spec, options.precision)?;
        Ok(Engine(match options.precision {
            Precision::Fp32 => Inner::Fp32(Box::new(Network::new(model, structure, options, keep_encoded)?)),
            Precision::Bf16 => Inner::Bf16(Box::new(Network::new(model, structure, options, keep_encoded)?)),
        }))
    }

    /// What the steps so far took; none unless [`EngineOptions::profile`] was set.
    pub fn profile(&self) -> Option<Profile> {
        either!(&self.0, network => network.profile())
    }
}

impl Forward for Engine {
    fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        check_lengths(either!(&self.0, network => network.lengths()), inputs, outputs)?;
        either!(&mut self.0, network => network.forward(comm, inputs, outputs));
        Ok(())
    }

    fn set_edges(&mut self, structure: &Structure) -> Result<()> {
        check_edges(&structure.graph)?;
        either!(&mut self.0, network => network.set_edges(structure))
    }
}

// SAFETY: a Bf16 is a u16 by its representation.
unsafe impl mpi::datatype::traits::Equivalence for Bf16 {
    type Out = mpi::datatype::DatatypeRef<'static>;

    fn equivalent_datatype() -> Self::Out {
        u16::equivalent_datatype()
    }
}
impl m4gn_parallel::Element for Bf16 {}

/// Whether a step's inputs and outputs are as long as expected.
fn check_lengths((n, m): (usize, usize), inputs: &[f32], outputs: &[f32]) -> Result<()> {
    let found = (inputs.len(), outputs.len());
    refuse(found != (n, m), Error::Input, || {
        format!("forward step: expected {n} inputs and {m} outputs, found {} and {}", found.0, found.1)
    })
}

/// Whether model and graph have the same number of dimensions, and the graph is one.
fn check(model: &Model, graph: &Graph) -> Result<()> {
    let n_edges = graph.senders.len();
    if graph.edge_features.len() != n_edges * model.spec.n_edge_features() {
        let found = graph.edge_features.len() as f64 / n_edges.max(1) as f64;
        return Err(Error::Model(format!(
            "the model reads {} features of an edge, in {} dimensions; the graph has {found}: another number of solved directions, or \
             another kind of domain",
            model.spec.n_edge_features(),
            model.spec.dim
        )));
    }
    check_edges(graph)
}

/// Whether a network can be computed in this precision.
fn check_precision(spec: &ModelSpec, precision: Precision) -> Result<()> {
    ModelSpec { precision, ..spec.clone() }.check()
}

/// Whether the graph's edges join its nodes.
fn check_edges(graph: &Graph) -> Result<()> {
    let n_edges = graph.senders.len();
    let whole = graph.n_cells <= graph.n_owned
        && graph.n_owned <= graph.n_local
        && graph.node_types.len() >= graph.n_owned
        && graph.row.len() == graph.n_owned + 1
        && graph.row.windows(2).all(|w| w[0] <= w[1])
        && (graph.row[0], graph.row[graph.n_owned] as usize) == (0, n_edges)
        && graph.senders.iter().all(|&s| usize::try_from(s).is_ok_and(|s| s < graph.n_local));
    refuse(!whole, Error::Internal, || "the graph's edges do not fit its nodes")
}

#[cfg(test)]
mod tests;
