//! The network in one precision: weights, latents, and the passes of a step.

use super::ends::{Decoder, Encoder, Fixed, normaliser};
use super::kernels::{
    Addend, Buffer, Function, Isa, Normed, Number, Output, Packed, add_means, narrow, padded, product,
};
use super::linear;
use super::order::Order;
use super::passing::{Layer, Topology};
use super::pool::{Parts, Pool};
use super::profile::{Phase, Profile};
use super::segment_stage::SegmentStage;
use super::tiles::{self, Scratch, Tile, block, blocks};
use super::{EngineOptions, SegmentView};
use crate::graph::Graph;
use crate::model::Model;
use crate::parallel::{Comm, Element, Halo};
use crate::{Error, Result};
use std::ops::Range;
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

    /// f_e of eq. 1, for good.
    fn encode_edges(&mut self) {
        let (columns, tiles) = (self.columns, &self.tiles);
        let (encoder, bias) = (&self.edge_encoder, &self.edge_bias[..]);
        let (features, k) = (&self.features[..], self.n_features);
        let mut encoded = Buffer::new(self.edges.len());
        let out = Parts::new(&mut encoded);
        let task = |s: &mut Scratch<T>, i: usize| {
            // SAFETY: tiles are disjoint.
            let out = unsafe { out.rows(&tiles[i].edges, columns) };
            encode_tile(encoder, bias, (features, k), &tiles[i], s, out);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
        self.features = Vec::new();
        self.encoded = Some(encoded);
    }

    /// f_n of eq. 1.
    fn encode_nodes(&mut self, inputs: &[f32]) {
        let (columns, k) = (self.columns, self.n_inputs);
        let (tiles, node) = (&self.tiles, &self.order.node);
        let (encoder, fixed) = (&self.encoder, &self.fixed);
        let (mean, scale) = (&self.input_mean, &self.input_scale);
        let nodes = Parts::new(&mut self.nodes);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let places = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let out = unsafe { nodes.rows(places, columns) };
            for (row, &node) in node[places.clone()].iter().enumerate() {
                let raw = &inputs[node as usize * k..(node as usize + 1) * k];
                let x = s.raw[row * k..].iter_mut();
                for (((x, raw), m), scale) in x.zip(raw).zip(mean).zip(scale) {
                    *x = (raw - m) * scale;
                }
                let fixed = &fixed.rows[fixed.row[node as usize] as usize * columns..][..columns];
                s.sums[row * columns..(row + 1) * columns].copy_from_slice(fixed);
            }
            let buffers = (&mut s.a[..], &mut s.b[..], &mut s.c[..]);
            let addend = Addend::Rows(&s.sums);
            encoder.run((&s.raw, k), places.len(), addend, buffers, Normed::Wide(out));
            s.clock.stop(Phase::EncodeNodes);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// One message-passing layer (eq. 2, 3) with its halo exchange, which goes on while the nodes that do not wait
    /// for it are done.
    fn pass(&mut self, comm: &Comm, l: usize) {
        let (columns, tiles, layer) = (self.columns, &self.tiles, &self.layers[l]);
        let (pool, scratch) = (&self.pool, &mut self.scratch);
        let nodes = &self.nodes;
        let out = Parts::new(&mut self.projected[..self.n_owned * columns]);
        let project = |s: &mut Scratch<T>, i: usize| {
            let rows = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let out = unsafe { out.rows(rows, columns) };
            layer.project(s, &nodes[rows.start * columns..rows.end * columns], out);
        };
        pool.run(scratch, tiles.len(), project, || ());

        let nodes = Parts::new(&mut self.nodes);
        let edges = Parts::new(&mut self.edges);
        let encoded = self.encoded.as_deref().filter(|_| l == 0);
        let compute = l == 0 && encoded.is_none();
        let (encoder, bias) = (&self.edge_encoder, &self.edge_bias[..]);
        let features = (&self.features[..], self.n_features);
        let keep = l + 1 < self.layers.len();
        let (senders, receivers) = (&self.order.senders[..], &self.order.receivers[..]);
        let sweep = |projected: &[T], tile: &Tile, s: &mut Scratch<T>| {
            // SAFETY: tiles are disjoint.
            let (h, e) = unsafe { (nodes.rows(&tile.nodes, columns), edges.rows(&tile.edges, columns)) };
            if compute {
                s.clock.start();
                encode_tile(encoder, bias, features, tile, s, e);
                s.clock.stop(Phase::EncodeEdges);
            }
            let before = encoded.map(|e| &e[tile.edges.start * columns..tile.edges.end * columns]);
            let graph = Topology {
                senders,
                receivers,
                projected,
            };
            layer.sweep(&graph, tile, s, h, e, before, keep);
        };
        let (interior, rest) = tiles.split_at(self.n_interior);
        let start = self.profile.as_ref().map(|_| Instant::now());
        let mut busy = 0.0;
        let message = &mut self.message;
        self.halo.exchange_during(
            comm,
            &mut self.projected,
            columns,
            message,
            |projected, progress| {
                let start = start.map(|_| Instant::now());
                pool.run(
                    scratch,
                    interior.len(),
                    |s, i| sweep(projected, &interior[i], s),
                    progress,
                );
                busy = start.map_or(0.0, |s| s.elapsed().as_secs_f64());
            },
        );
        if let (Some(start), Some(own)) = (start, scratch.first_mut()) {
            own.clock.phases[Phase::Halo as usize] += start.elapsed().as_secs_f64() - busy;
        }
        let projected = &self.projected;
        pool.run(scratch, rest.len(), |s, i| sweep(projected, &rest[i], s), || ());
    }

    /// The macro stage, and h += dispatch([h, h_S]) where the model carries on after it.
    fn segments(&mut self, comm: &Comm) {
        let Some(stage) = &mut self.stage else { return };
        self.scratch[0].clock.start();
        stage.run(comm, &self.pool, &self.nodes);
        self.scratch[0].clock.stop(Phase::Segments);
        let (Some(weight), Some(table)) = (&self.dispatch, stage.dispatched()) else {
            return;
        };
        let (isa, columns, tiles) = (self.isa, self.columns, &self.tiles);
        let (row, member) = (&stage.member_row, &stage.member);
        let nodes = Parts::new(&mut self.nodes);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let places = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let h = unsafe { nodes.rows(places, columns) };
            narrow(isa, h, &mut s.a[..h.len()]);
            add_means(isa, h, columns, table, &row[places.start..=places.end], member);
            s.sums[..h.len()].copy_from_slice(h);
            let rows = Addend::Rows(&s.sums);
            let identity = Function::Identity;
            product(
                isa,
                weight,
                (&s.a, columns),
                places.len(),
                rows,
                identity,
                Output::Wide(h),
            );
            s.clock.stop(Phase::Segments);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// The decoder, on cells.
    fn decode(&mut self, outputs: &mut [f32]) {
        let (isa, columns, m) = (self.isa, self.columns, self.n_outputs);
        let decoder = &self.decoder;
        if let (Some(weight), Some(stage)) = (&decoder.segment, &self.stage) {
            let x = (stage.latents(), columns);
            let out = Output::Wide(&mut self.table[..]);
            product(
                isa,
                weight,
                x,
                stage.count(),
                Addend::Nothing,
                Function::Identity,
                out,
            );
        }
        let (cells, nodes, table, stage) = (&self.cells, &self.nodes, &self.table[..], &self.stage);
        let width = decoder.columns();
        let outputs = Parts::new(outputs);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let cells = &cells[block(i, cells.len())];
            for (row, &(place, _)) in cells.iter().enumerate() {
                let place = place as usize;
                s.c[row * columns..(row + 1) * columns]
                    .copy_from_slice(&nodes[place * columns..(place + 1) * columns]);
                let sum = &mut s.sums[row * width..(row + 1) * width];
                sum.copy_from_slice(&decoder.bias);
                if let Some(stage) = stage {
                    let row = &stage.member_row[place..=place + 1];
                    add_means(isa, sum, width, table, row, &stage.member);
                }
            }
            let stride = decoder.run(s, cells.len());
            for (&(_, cell), row) in cells.iter().zip(s.raw.chunks_exact(stride)) {
                let cell = cell as usize;
                // SAFETY: every cell stands in one block, once.
                unsafe { outputs.rows(&(cell..cell + 1), m) }.copy_from_slice(&row[..m]);
            }
            s.clock.stop(Phase::Decode);
        };
        self.pool
            .run(&mut self.scratch, blocks(cells.len()).len(), task, || ());
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

    /// See [`Engine::profile`](super::Engine::profile).
    pub fn profile(&self) -> Option<Profile> {
        let mut profile = self.profile.clone()?;
        for scratch in &self.scratch {
            for (sum, seconds) in profile.phases.iter_mut().zip(scratch.clock.phases) {
                *sum += seconds;
            }
        }
        Some(profile)
    }

    /// See [`Engine::memory`](super::Engine::memory).
    pub fn memory(&self) -> Vec<(&'static str, usize)> {
        let (stage_weights, stage) = self.stage.as_ref().map_or((0, 0), |s| s.bytes());
        let layers: usize = self.layers.iter().map(|l| l.bytes()).sum();
        let ends = self.encoder.bytes() + self.edge_encoder.bytes() + self.decoder.bytes();
        let dispatch = self.dispatch.as_ref().map_or(0, |w| w.bytes());
        let order = &self.order;
        let lists = order.node.len() + order.row.len() + order.senders.len() + order.receivers.len();
        let scratch: usize = self.scratch.iter().map(|s| s.bytes()).sum();
        vec![
            ("edge latents", self.edges.bytes()),
            ("encoded edges", self.encoded.as_ref().map_or(0, |e| e.bytes())),
            ("edge features", 4 * self.features.capacity()),
            ("node latents", self.nodes.bytes()),
            ("projected senders", self.projected.bytes()),
            (
                "graph",
                4 * lists + 8 * self.cells.capacity() + self.fixed.bytes(),
            ),
            ("halo", self.message.capacity() * size_of::<T>()),
            ("segments", stage + self.table.bytes()),
            ("weights", layers + ends + dispatch + stage_weights),
            ("buffers", scratch),
        ]
    }

    /// Operations of the products of a step, by phase.
    fn flops(&self, model: &Model) -> [f64; 8] {
        let a = &model.spec.architecture;
        let (d, h) = (self.width as f64, a.hidden_layers as f64);
        let square = 2.0 * d * d;
        let (n, e) = (self.n_owned as f64, self.order.senders.len() as f64);
        let (cells, layers) = (self.cells.len() as f64, self.layers.len() as f64);
        let mut flops = [0.0; 8];
        let mut set = |phase: Phase, value: f64| flops[phase as usize] = value;
        set(
            Phase::EncodeNodes,
            n * (2.0 * d * self.n_inputs as f64 + h * square),
        );
        if self.encoded.is_none() {
            set(
                Phase::EncodeEdges,
                e * (2.0 * d * self.n_features as f64 + h * square),
            );
        }
        set(Phase::Project, layers * n * square);
        set(Phase::Edges, layers * (e * (1.0 + h) + n) * square);
        set(Phase::Nodes, layers * n * (2.0 + h) * square);
        set(
            Phase::Decode,
            cells * (h * square + 2.0 * d * self.n_outputs as f64),
        );
        if let (Some(stage), Some(spec)) = (&self.stage, &a.segment_transformer) {
            let k = stage.count() as f64;
            let layer = 4.0 * square + 4.0 * d * spec.ffn_width as f64 + 4.0 * k * d;
            let dispatched = if self.dispatch.is_some() { n + k } else { 0.0 };
            set(
                Phase::Segments,
                k * ((1.0 + h) * square + spec.layers as f64 * layer) + dispatched * square,
            );
        }
        flops
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

/// Encodes a tile's edges into `out`, its rows.
fn encode_tile<T: Number>(
    encoder: &Encoder<T>,
    bias: &[f32],
    (features, k): (&[f32], usize),
    tile: &Tile,
    scratch: &mut Scratch<T>,
    out: &mut [T],
) {
    let columns = bias.len();
    let own = |chunk: &Range<usize>| {
        (chunk.start - tile.edges.start) * columns..(chunk.end - tile.edges.start) * columns
    };
    for chunk in tile.chunks() {
        let Scratch { a, b, c, .. } = &mut *scratch;
        let from = (&features[chunk.start * k..], k);
        let bias = Addend::Bias(bias);
        encoder.run(
            from,
            chunk.len(),
            bias,
            (a, b, c),
            Normed::Narrow(&mut out[own(&chunk)]),
        );
    }
}
