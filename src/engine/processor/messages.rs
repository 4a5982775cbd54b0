//! Message passing (eq. 1 to 4), with the macro stage (eq. 9 to 13) where there is one.

use super::Processor;
use crate::encoder_decoder::Encoder;
use crate::grid::Grid;
use crate::kernels::{Addend, Buffer, Function, Normed, Number, Output, narrow};
use crate::order::Order;
use crate::passing::{Edges, Layer, Topology};
use crate::pool::Parts;
use crate::profile::Phase;
use crate::scale::Scale;
use crate::segment_stage::{Dispatch, SegmentStage};
use crate::tiles::{Scratch, Tile, numbers, runs, sums_of_kinds};
use crate::weights::Weights;
use m4gn_base::Result;
use m4gn_model::Model;
use m4gn_parallel::{Comm, Element};
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;

/// Message-passing layers and macro stage of a model on a graph.
pub struct Messages<T> {
    features: Features<T>,
    layers: Vec<Layer<T>>,
    layers_before: usize,
    stage: Option<SegmentStage>,
    dispatch: Option<Dispatch<T>>,
    /// What h_S contributes to the dispatch, a row a segment.
    table: Buffer<f32>,
    /// Most bytes of encoded edges that are kept.
    keep_encoded: usize,
    /// Encoded edges, where they are kept.
    encoded: Option<Buffer<T>>,
    /// e
    edges: Buffer<T>,
    /// Ws h of all local nodes, ghosts included.
    projected: Buffer<T>,
    message: Vec<T>,
}

/// Features of the edges, and their encoders.
struct Features<T> {
    /// Of each kind of edges.
    encoders: Vec<Encoder<T>>,
    scale: Scale,
    /// Normalised; empty once the edges are encoded for good.
    normed: Vec<f32>,
    /// Row of the sum that each edge adds to, where edges are of several kinds.
    sums: Vec<i32>,
}

impl<T: Number> Features<T> {
    fn new(weights: &mut Weights, model: &Model) -> Result<Self> {
        let (n, a) = (model.spec.n_edge_features(), &model.spec.architecture);
        let encoder = |name: &&str| Encoder::new(weights, name, n, a);
        Ok(Features {
            encoders: a.edge_encoders().iter().map(encoder).collect::<Result<_>>()?,
            scale: Scale::of_model(model, "edge")?,
            normed: Vec::new(),
            sums: Vec::new(),
        })
    }

    /// Takes those of a graph's edges.
    fn place(&mut self, order: &Order, physical: &[f32]) {
        let k = self.scale.channels();
        self.normed.resize(order.edge.len() * k, 0.0);
        self.scale.normalise_rows(physical, &order.edge, k, &mut self.normed);
        if self.encoders.len() > 1 {
            sums_of_kinds(order, physical, &mut self.sums);
        }
    }

    /// Row of the sum that each edge adds to.
    fn sums<'a>(&'a self, order: &'a Order) -> &'a [i32] {
        if self.encoders.len() > 1 { &self.sums } else { &order.receivers }
    }

    /// Encodes a tile's edges into `out`, its rows (eq. 1).
    fn encode(&self, tile: &Tile, order: &Order, scratch: &mut Scratch<T>, out: &mut [T]) {
        let k = self.scale.channels();
        for chunk in tile.chunks::<T>() {
            for (run, kind) in runs(chunk, &order.receivers, self.sums(order)) {
                let (encoder, first) = (&self.encoders[kind], tile.edges.start);
                let Scratch { a, b, c, .. } = &mut *scratch;
                let from = (&self.normed[run.start * k..], k);
                let rows = encoder.rest.rows(None, &run, [a, b]);
                let own = numbers(&(run.start - first..run.end - first), encoder.rest.columns);
                let out = Normed::Narrow(&mut out[own]);
                encoder.run(from, run.len(), encoder.bias(), rows, c, out);
            }
        }
    }
}

impl<T: Number + Element> Messages<T> {
    /// Of so many layers before and after the macro stage.
    pub fn new(
        weights: &mut Weights,
        model: &Model,
        graph: &Graph,
        grid: &Grid<T>,
        (before, after): (usize, usize),
        stage: Option<SegmentStage>,
        keep_encoded: usize,
    ) -> Result<Self> {
        let a = &model.spec.architecture;
        Ok(Messages {
            features: Features::new(weights, model)?,
            layers: (0..before + after).map(|l| Layer::new(weights, a, l)).collect::<Result<_>>()?,
            layers_before: before,
            dispatch: Dispatch::new(weights, a)?,
            table: Buffer::new(stage.as_ref().map_or(0, |s| s.members.count * grid.columns)),
            stage,
            keep_encoded,
            encoded: None,
            edges: Buffer::new(0),
            projected: Buffer::new(grid.n_local * grid.columns),
            message: Vec::with_capacity(graph.halo.n_sent() * grid.columns),
        })
    }

    /// f_e of eq. 1, for good.
    fn encode_edges(&mut self, grid: &mut Grid<T>) {
        let (columns, tiles, order, features) = (grid.columns, &grid.tiles, &grid.order, &self.features);
        let mut encoded = Buffer::new(self.edges.len());
        let out = Parts::new(&mut encoded);
        let task = |s: &mut Scratch<T>, i: usize| {
            // SAFETY: tiles are disjoint.
            let out = unsafe { out.rows(&tiles[i].edges, columns) };
            features.encode(&tiles[i], order, s, out);
        };
        grid.pool.run(&mut grid.scratch, tiles.len(), task, || ());
        self.features.normed = Vec::new();
        self.encoded = Some(encoded);
    }

    /// One message-passing layer (eq. 2, 3) with its halo exchange, which goes on while the nodes that do not wait
    /// for it are done.
    fn pass(&mut self, comm: &Comm, grid: &mut Grid<T>, l: usize) {
        let (columns, layer) = (grid.columns, &self.layers[l]);
        if layer.reads_senders() {
            let own = &mut self.projected[..grid.n_owned * columns];
            grid.on_nodes(own, |s, _, h, out| layer.project(s, h, out));
        }

        let edges = Parts::new(&mut self.edges);
        let encoded = self.encoded.as_deref().filter(|_| l == 0);
        let compute = l == 0 && encoded.is_none();
        let features = &self.features;
        let keep = l + 1 < self.layers.len();
        let sweep = |s: &mut Scratch<T>, tile: &Tile, order: &Order, projected: &[T], h: &mut [f32]| {
            // SAFETY: tiles are disjoint.
            let e = unsafe { edges.rows(&tile.edges, columns) };
            if compute {
                s.clock.start();
                features.encode(tile, order, s, e);
                s.clock.stop(Phase::EncodeEdges);
            }
            let before = encoded.map(|e| &e[numbers(&tile.edges, columns)]);
            let Order { senders, receivers, .. } = order;
            let graph = Topology { senders, receivers, sums: features.sums(order), projected };
            layer.sweep(&graph, tile, s, h, Edges { before, now: e, keep }, None);
        };
        match layer.reads_senders() {
            true => grid.sweep(comm, &mut self.projected, &mut self.message, sweep),
            false => grid.sweep_own(|s, tile, order, h| sweep(s, tile, order, &[], h)),
        }
    }

    /// The macro stage, and h += dispatch([h, h_S]) where the model carries on after it.
    fn segments(&mut self, comm: &Comm, grid: &mut Grid<T>) {
        let Some(stage) = &mut self.stage else { return };
        grid.scratch[0].clock.start();
        stage.run(comm, &grid.pool, &grid.nodes);
        if let Some(dispatch) = &self.dispatch {
            dispatch.table(stage.latents(), stage.members.count, &mut self.table);
        }
        grid.scratch[0].clock.stop(Phase::Segments);
        let Some(Dispatch { own: weight, .. }) = &self.dispatch else { return };
        let (isa, columns, members, table) = (grid.isa, grid.columns, &stage.members, &self.table);
        grid.sweep_own(|s, tile, _, h| {
            s.clock.start();
            let places = &tile.nodes;
            narrow(isa, h, &mut s.a[..h.len()]);
            members.add_means(isa, h, columns, table, places.clone());
            s.sums[..h.len()].copy_from_slice(h);
            let rows = Addend::Rows(&s.sums);
            let (x, out) = ((&s.a[..], columns), Output::Wide(h));
            weight.run(x, places.len(), rows, Function::Identity, out);
            s.clock.stop(Phase::Segments);
        });
    }
}

impl<T: Number + Element> Processor<T> for Messages<T> {
    fn place(&mut self, grid: &mut Grid<T>, structure: &Structure) {
        self.features.place(&grid.order, &structure.graph.edge_features);
        self.encoded = None;
        let size = grid.order.edge.len() * grid.columns;
        if self.edges.len() < size {
            self.edges = Buffer::new(size);
        }
        if self.edges.bytes() <= self.keep_encoded {
            self.encode_edges(grid);
        }
    }

    fn reorder(&mut self, before: &[u32], node: &[u32]) {
        if let Some(stage) = &mut self.stage {
            stage.reorder(before, node);
        }
    }

    fn run(&mut self, comm: &Comm, grid: &mut Grid<T>) {
        for l in 0..self.layers_before {
            self.pass(comm, grid, l);
        }
        self.segments(comm, grid);
        for l in self.layers_before..self.layers.len() {
            self.pass(comm, grid, l);
        }
    }

    fn stage(&self) -> Option<&SegmentStage> {
        self.stage.as_ref()
    }

    fn flops(&self, grid: &Grid<T>, model: &Model) -> Vec<(Phase, f64)> {
        let a = &model.spec.architecture;
        let (d, h) = (a.width as f64, a.hidden_layers as f64);
        let square = 2.0 * d * d;
        let (n, e) = (grid.n_owned as f64, grid.order.senders.len() as f64);
        let (layers, updates) = (self.layers.len() as f64, a.edge_networks() as f64);
        let mut flops = vec![
            (Phase::Project, updates * n * square),
            (Phase::Edges, updates * (e * (1.0 + h) + n) * square),
            (Phase::Nodes, layers * n * (1.0 + a.edge_kinds() as f64 + h) * square),
        ];
        if self.encoded.is_none() {
            let features = self.features.scale.channels() as f64;
            flops.push((Phase::EncodeEdges, e * (2.0 * d * features + h * square)));
        }
        if let (Some(stage), Some(spec)) = (&self.stage, a.segment_transformer()) {
            let k = stage.members.count as f64;
            let layer = 4.0 * square + 4.0 * d * spec.ffn_width as f64 + 4.0 * k * d;
            let dispatched = if self.dispatch.is_some() { n + k } else { 0.0 };
            let recurrence = if a.needs().sequences { 6.0 * square * n } else { 0.0 };
            let stage = recurrence + k * ((1.0 + h) * square + spec.layers as f64 * layer);
            flops.push((Phase::Segments, stage + dispatched * square));
        }
        flops
    }
}
