//! The network in one precision: weights, latents, and the passes of a step.

mod passes;
mod report;

use super::ends::{Decoder, Encoder, Fixed, normaliser};
use super::kernels::{Buffer, Isa, Number, Packed, padded};
use super::linear;
use super::order::Order;
use super::passing::Layer;
use super::pool::Pool;
use super::profile::Profile;
use super::segment_stage::SegmentStage;
use super::tiles::{self, Scratch, Tile};
use super::{EngineOptions, SegmentView};
use crate::graph::Graph;
use crate::model::Model;
use crate::parallel::{Comm, Element, Halo};
use crate::{Error, Result};
use std::time::Instant;

/// Encoded edges are kept beside the latents up to this size; beyond it they are computed anew in each step, which
/// takes about a tenth more time and half the memory.
pub const KEEP_ENCODED: usize = 256 << 20;

/// A model on a graph. Rows of latents have the padded width.
#[derive(Debug)]
pub struct Network<T> {
    isa: Isa,
    width: usize,
    columns: usize,
    n_owned: usize,
    n_inputs: usize,
    n_outputs: usize,
    order: Order,
    /// Place and number of each cell, by place.
    cells: Vec<(u32, u32)>,
    halo: Halo,
    tiles: Vec<Tile>,
    /// Tiles before this one do not wait for other ranks.
    n_interior: usize,
    pool: Pool,
    scratch: Vec<Scratch<T>>,

    encoder: Encoder<T>,
    fixed: Fixed,
    input_mean: Vec<f32>,
    input_scale: Vec<f32>,
    edge_encoder: Encoder<T>,
    edge_bias: Vec<f32>,
    layers: Vec<Layer<T>>,
    layers_before: usize,
    stage: Option<SegmentStage>,
    dispatch: Option<Packed<T>>,
    decoder: Decoder<T>,
    /// What h_S contributes to the decoder's first layer, a row a segment.
    table: Buffer<f32>,

    /// Edge features, normalised; empty once the edges are encoded for good.
    features: Vec<f32>,
    /// Mean, and one over the deviation, of each edge feature.
    edge_scale: (Vec<f32>, Vec<f32>),
    /// Encoded edges, where they are kept.
    encoded: Option<Buffer<T>>,
    /// e
    edges: Buffer<T>,
    /// h
    nodes: Buffer<f32>,
    /// Ws h of all local nodes, ghosts included.
    projected: Buffer<T>,
    message: Vec<T>,

    profile: Option<Profile>,
}

impl<T: Number + Element> Network<T> {
    /// Prepares a model for this graph.
    pub fn new(
        model: &Model,
        graph: &Graph,
        segments: Option<&SegmentView>,
        options: &EngineOptions,
        keep_encoded: usize,
    ) -> Result<Self> {
        let spec = &model.spec;
        let d = spec.architecture.width;
        let columns = padded(d);
        let isa = options.isa.unwrap_or_else(Isa::detect);
        let order = Order::new(graph);
        let pool = Pool::new(options.n_threads);
        let stage = match (&spec.architecture.segment_transformer, segments) {
            (Some(_), Some(view)) => Some(SegmentStage::new(
                isa,
                model,
                view,
                &order.node,
                pool.n_threads(),
            )?),
            (Some(_), None) => return Err(Error::Model("the model needs segments, none were given".into())),
            (None, _) => None,
        };
        let n_layers = spec.architecture.layers_before + spec.architecture.layers_after;
        let (input_mean, input_scale) = normaliser(model, "node")?;
        let decoder = Decoder::new(isa, model)?;
        let raw = spec.n_field_inputs().max(spec.n_outputs());
        let dispatch = spec.architecture.layers_after > 0 && stage.is_some();
        let mut network = Network {
            isa,
            width: d,
            columns,
            n_owned: graph.n_owned,
            n_inputs: spec.n_field_inputs(),
            n_outputs: spec.n_outputs(),
            cells: Vec::new(),
            halo: Halo::empty(),
            n_interior: 0,
            tiles: Vec::new(),
            scratch: (0..pool.n_threads())
                .map(|_| Scratch::new(d.max(spec.n_outputs()), raw, options.profile))
                .collect(),
            pool,
            encoder: Encoder::new(isa, model, "encoder.node", spec.n_field_inputs())?,
            fixed: Fixed::new(model, graph, segments.map_or(&[], |s| s.offsets))?,
            input_mean,
            input_scale,
            edge_encoder: Encoder::new(isa, model, "encoder.edge", spec.n_edge_features())?,
            edge_bias: linear::bias(model, "encoder.edge.0")?,
            layers: (0..n_layers)
                .map(|l| Layer::new(isa, model, l))
                .collect::<Result<_>>()?,
            layers_before: spec.architecture.layers_before,
            dispatch: dispatch
                .then(|| linear::columns(isa, model, "segment.dispatch", 0..d))
                .transpose()?,
            table: Buffer::new(stage.as_ref().map_or(0, |s| s.count()) * decoder.columns()),
            stage,
            decoder,
            edge_scale: normaliser(model, "edge")?,
            features: Vec::new(),
            encoded: None,
            edges: Buffer::new(0),
            nodes: Buffer::new(graph.n_owned * columns),
            projected: Buffer::new(graph.n_local * columns),
            message: Vec::with_capacity(graph.halo.n_sent() * columns),
            profile: None,
            order,
        };
        network.place_nodes(graph);
        network.place_edges(graph);
        if spec.contact.is_none() {
            network.order.search = Vec::new();
        }
        if network.edges.bytes() <= keep_encoded {
            network.encode_edges();
        }
        if options.profile {
            network.profile = Some(Profile {
                flops: network.flops(model),
                ..Profile::default()
            });
        }
        Ok(network)
    }

    /// Takes other edges between the same nodes: those of a graph that changes with time.
    ///
    /// # Errors
    /// [`Error::Internal`] for other nodes, or features of another kind.
    pub fn set_edges(&mut self, graph: &Graph) -> Result<()> {
        let k = self.edge_scale.0.len();
        let nodes = (self.n_owned, self.projected.len());
        if nodes != (graph.n_owned, graph.n_local * self.columns)
            || graph.edge_features.len() != graph.senders.len() * k
            || self.order.search.len() != graph.n_owned
        {
            return Err(Error::Internal(
                "edges of another graph, or of one that was not to change".into(),
            ));
        }
        let order = Order::of(graph, &self.order.search);
        if order.node != self.order.node {
            if let Some(stage) = &mut self.stage {
                stage.reorder(&self.order.places(), &order.node);
            }
            self.order = order;
            self.place_nodes(graph);
        } else {
            self.order = order;
        }
        self.place_edges(graph);
        Ok(())
    }

    /// What follows from the order of the nodes.
    fn place_nodes(&mut self, graph: &Graph) {
        let numbered = (0..).zip(&self.order.node).map(|(p, &i)| (p, i));
        self.cells = numbered.filter(|(_, i)| (*i as usize) < graph.n_cells).collect();
        self.halo = graph.halo.renumbered(&self.order.places());
    }

    /// What follows from the edges: tiles, features in the engine's order, room for latents.
    fn place_edges(&mut self, graph: &Graph) {
        let order = &mut self.order;
        self.tiles = tiles::cut(&order.row, order.n_interior);
        let interior = |t: &&Tile| t.nodes.end <= order.n_interior;
        self.n_interior = self.tiles.iter().take_while(interior).count();
        let (mean, scale) = &self.edge_scale;
        let k = mean.len();
        self.features.clear();
        self.features.reserve_exact(order.edge.len() * k);
        for &e in &order.edge {
            let row = &graph.edge_features[e as usize * k..(e as usize + 1) * k];
            let normed = row.iter().zip(mean).zip(scale).map(|((x, m), s)| (x - m) * s);
            self.features.extend(normed);
        }
        self.encoded = None;
        let size = order.edge.len() * self.columns;
        if self.edges.len() < size {
            self.edges = Buffer::new(size);
        }
        order.edge = Vec::new();
    }

    /// One step, with slices of the right lengths. Collective.
    pub fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) {
        let start = self.profile.as_ref().map(|_| Instant::now());
        self.encode_nodes(inputs);
        for l in 0..self.layers_before {
            self.pass(comm, l);
        }
        self.segments(comm);
        for l in self.layers_before..self.layers.len() {
            self.pass(comm, l);
        }
        self.decode(outputs);
        if let (Some(start), Some(profile)) = (start, &mut self.profile) {
            profile.steps += 1;
            profile.seconds += start.elapsed().as_secs_f64();
        }
    }

    /// Lengths of a step's inputs and outputs.
    pub fn lengths(&self) -> (usize, usize) {
        (self.n_owned * self.n_inputs, self.cells.len() * self.n_outputs)
    }
}
