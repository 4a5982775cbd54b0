//! The network in one precision on a graph: encoder of nodes, processor, decoder.

mod passes;
mod report;

use super::EngineOptions;
use super::encoder_decoder::{Decoder, Encoder, Fixed};
use super::grid::Grid;
use super::kernels::{Buffer, Isa, Number, padded};
use super::layout::Layout;
use super::order::Order;
use super::pool::Pool;
use super::processor::{self, Processor};
use super::profile::Profile;
use super::scale::Scale;
use super::tiles::Scratch;
use super::weights::Weights;
use m4gn_base::{Error, Result};
use m4gn_model::Model;
use m4gn_parallel::{Comm, Element};
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;
use std::time::Instant;

/// A model on a graph. Rows of latents have the padded width.
pub struct Network<T> {
    n_inputs: usize,
    n_outputs: usize,
    /// Features of an edge.
    n_edge_features: usize,
    /// Place and number of each cell, by place.
    cells: Vec<(u32, u32)>,
    grid: Grid<T>,

    encoder: Encoder<T>,
    fixed: Fixed,
    /// Of the inputs.
    scale: Scale,
    processor: Box<dyn Processor<T>>,
    decoder: Decoder<T>,
    /// Of the outputs.
    scale_out: Scale,
    /// What h_S contributes to the decoder's first layer, a row a segment.
    table: Buffer<f32>,

    profile: Option<Profile>,
}

impl<T: Number + Element> Network<T> {
    /// Prepares a model for this structure.
    pub fn new(
        model: &Model,
        structure: &Structure,
        options: &EngineOptions,
        keep_encoded: usize,
    ) -> Result<Self> {
        let (spec, graph) = (&model.spec, &structure.graph);
        let d = spec.architecture.width;
        let columns = padded(d);
        let isa = options.isa.unwrap_or_else(Isa::detect);
        let pool = Pool::new(options.n_threads, isa);
        let raw = spec.n_field_inputs().max(spec.n_outputs());
        let (widest, kinds) = (d.max(spec.n_outputs()), spec.architecture.edge_kinds());
        let scratch = (0..pool.n_threads()).map(|_| Scratch::new(widest, kinds, raw, options.profile));
        let scratch = scratch.collect();
        let grid = Grid::new(graph, columns, pool, scratch, options.profile);
        let layout = Layout::new(spec);
        let flat = layout.flatten(model)?;
        let weights = &mut Weights::new(isa, &layout, &flat);
        let decoder = Decoder::new(weights, spec)?;
        let processor = processor::new(weights, model, structure, &grid, keep_encoded)?;
        let n_segments = processor.stage().map_or(0, |s| s.members.count);
        let mut network = Network {
            n_inputs: spec.n_field_inputs(),
            n_outputs: spec.n_outputs(),
            n_edge_features: spec.n_edge_features(),
            cells: Vec::new(),
            encoder: Encoder::new(weights, "encoder.node", spec.n_field_inputs(), &spec.architecture)?,
            fixed: Fixed::new(weights, model, structure)?,
            scale: Scale::of_model(model, "node")?,
            table: Buffer::new(n_segments * columns),
            scale_out: Scale::of_model(model, "output")?,
            processor,
            decoder,
            grid,
            profile: None,
        };
        network.place_nodes(graph);
        network.place_edges(structure);
        if !options.edges_move {
            network.grid.order.search = Vec::new();
        }
        if options.profile {
            network.profile = Some(Profile { flops: network.flops(model), ..Profile::default() });
        }
        Ok(network)
    }

    /// Takes other edges between the same nodes: those of a graph that changes with time.
    ///
    /// # Errors
    /// [`Error::Internal`] for other nodes, or features of another kind.
    pub fn set_edges(&mut self, structure: &Structure) -> Result<()> {
        let (grid, graph) = (&mut self.grid, &structure.graph);
        if (grid.n_owned, grid.n_local) != (graph.n_owned, graph.n_local)
            || graph.edge_features.len() != graph.senders.len() * self.n_edge_features
            || grid.order.search.len() != graph.n_owned
        {
            return Err(Error::Internal("edges of another graph, or of one that was not to change".into()));
        }
        let order = Order::of(graph, &grid.order.search);
        let moved = order.node != grid.order.node;
        if moved {
            self.processor.reorder(&grid.order.places(), &order.node);
        }
        grid.order = order;
        if moved {
            grid.halo = graph.halo.renumbered(&grid.order.places());
            self.place_nodes(graph);
        }
        self.grid.cut();
        self.place_edges(structure);
        Ok(())
    }

    /// What follows from the order of the nodes.
    fn place_nodes(&mut self, graph: &Graph) {
        let numbered = (0..).zip(&self.grid.order.node).map(|(p, &i)| (p, i));
        self.cells = numbered.filter(|(_, i)| (*i as usize) < graph.n_cells).collect();
    }

    /// What follows from the edges: features in the engine's order, room for latents.
    fn place_edges(&mut self, structure: &Structure) {
        self.processor.place(&mut self.grid, structure);
        self.grid.order.edge = Vec::new();
    }

    /// One step, with slices of the right lengths. Collective.
    pub fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) {
        let start = self.profile.as_ref().map(|_| Instant::now());
        self.encode_nodes(inputs);
        self.processor.run(comm, &mut self.grid);
        self.decode(outputs);
        if let (Some(start), Some(profile)) = (start, &mut self.profile) {
            profile.steps += 1;
            profile.seconds += start.elapsed().as_secs_f64();
        }
    }

    /// Lengths of a step's inputs and outputs.
    pub fn lengths(&self) -> (usize, usize) {
        (self.grid.n_owned * self.n_inputs, self.cells.len() * self.n_outputs)
    }
}
