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
    n_features: usize,
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
        let tiles = tiles::cut(&order.row, order.n_interior);
        let n_edges = order.edge.len();
        let dispatch = spec.architecture.layers_after > 0 && stage.is_some();
        let mut network = Network {
            isa,
            width: d,
            columns,
            n_owned: graph.n_owned,
            n_inputs: spec.n_field_inputs(),
            n_outputs: spec.n_outputs(),
            cells: (0..)
                .zip(&order.node)
                .map(|(p, &i)| (p, i))
                .filter(|(_, i)| (*i as usize) < graph.n_cells)
                .collect(),
            halo: graph.halo.renumbered(&order.places()),
            n_interior: tiles
                .iter()
                .take_while(|t| t.nodes.end <= order.n_interior)
                .count(),
            tiles,
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
            features: features(model, graph, &order)?,
            n_features: spec.n_edge_features(),
            encoded: None,
            edges: Buffer::new(n_edges * columns),
            nodes: Buffer::new(graph.n_owned * columns),
            projected: Buffer::new(graph.n_local * columns),
            message: Vec::with_capacity(graph.halo.n_sent() * columns),
            profile: None,
            order,
        };
        network.order.edge = Vec::new();
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

/// The edges' features in the engine's order, normalised.
fn features(model: &Model, graph: &Graph, order: &Order) -> Result<Vec<f32>> {
    let k = model.spec.n_edge_features();
    let (mean, scale) = normaliser(model, "edge")?;
    let mut features = Vec::with_capacity(order.edge.len() * k);
    for &e in &order.edge {
        let row = &graph.edge_features[e as usize * k..(e as usize + 1) * k];
        features.extend(row.iter().zip(&mean).zip(&scale).map(|((x, m), s)| (x - m) * s));
    }
    Ok(features)
}
