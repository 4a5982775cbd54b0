//! Message passing (eq. 1 to 3), with the macro stage (eq. 9 to 13) where there is one.

use super::Scales;
use super::encoder_decoder::EncoderTape;
use super::graph::TrainGraph;
use super::layer::{LayerTape, Links};
use super::network::Buffers;
use super::processor::Processor;
use super::stage::StageTape;
use crate::encoder_decoder::Encoder;
use crate::kernels::{Buffer, Isa, Normed, Number, padded};
use crate::order::Order;
use crate::passing::Layer;
use crate::segment_stage::{Dispatch, Stage};
use crate::tiles::{blocks, numbers, runs, sums_of_kinds};
use crate::weights::{Gradients, Weights};
use m4gn_base::Result;
use m4gn_model::ModelSpec;

/// The layers and the macro stage of a model.
pub struct Messages<T> {
    pub(super) isa: Isa,
    pub(super) columns: usize,
    n_edge_features: usize,
    /// Of each kind of edges.
    edges: Vec<Encoder<T>>,
    layers: Vec<Layer<T>>,
    layers_before: usize,
    pub(super) stage: Option<Stage>,
    pub(super) dispatch: Option<Dispatch<T>>,
}

/// What they keep.
pub struct MessagesTape<T> {
    edges: EncoderTape<T>,
    /// Row of the sum that each edge adds to, where edges are of several kinds.
    sums: Vec<i32>,
    layers: Vec<LayerTape<T>>,
    pub(super) stage: Option<StageTape>,
    /// Latents before the dispatch.
    pub(super) dispatched: Buffer<T>,
}

impl<T: Number> Messages<T> {
    /// The edges of a graph, of several kinds with these sums.
    fn links<'a>(&self, order: &'a Order, sums: &'a [i32]) -> Links<'a> {
        if self.edges.len() > 1 { Links { order, sums } } else { Links::of(order) }
    }
}

impl<T: Number> Processor<T> for Messages<T> {
    type Tape = MessagesTape<T>;

    fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        Ok(Messages {
            isa: weights.isa,
            columns: padded(a.width),
            n_edge_features: spec.n_edge_features(),
            edges: a
                .edge_encoders()
                .iter()
                .map(|name| Encoder::new(weights, name, spec.n_edge_features(), a))
                .collect::<Result<_>>()?,
            layers: (0..a.layers()).map(|l| Layer::new(weights, a, l)).collect::<Result<_>>()?,
            layers_before: a.m4gn().map_or(a.layers(), |m| m.layers_before),
            stage: Stage::new(weights, spec)?,
            dispatch: Dispatch::new(weights, a)?,
        })
    }

    fn tape(&self) -> MessagesTape<T> {
        MessagesTape {
            edges: EncoderTape::new(&self.edges[0]),
            sums: Vec::new(),
            layers: self.layers.iter().map(LayerTape::new).collect(),
            stage: self.stage.as_ref().map(StageTape::new),
            dispatched: Buffer::default(),
        }
    }

    fn passed(&self, graph: &TrainGraph, _: &MessagesTape<T>) -> [usize; 2] {
        // The encoder of edges keeps as much as a layer.
        [self.layers.len() * graph.n_nodes(), (1 + self.layers.len()) * graph.n_edges()]
    }

    fn segments(tape: &MessagesTape<T>) -> Option<&[f32]> {
        tape.stage.as_ref().map(|s| &s.latents[..])
    }

    fn forward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut MessagesTape<T>,
        work: &mut Buffers<T>,
    ) {
        let (columns, n_nodes, n_edges) = (self.columns, graph.n_nodes(), graph.n_edges());
        tape.edges.fit(n_edges, &self.edges[0]);
        tape.layers.iter_mut().zip(&self.layers).for_each(|(t, l)| t.fit(n_nodes, n_edges, l));
        if self.edges.len() > 1 {
            sums_of_kinds(&graph.order, &graph.edge_features, &mut tape.sums);
        }
        let (stride, of_edges) = (self.edges[0].stride, &graph.edge_features);
        scales.edge.normalise_rows(of_edges, &graph.order.edge, stride, &mut tape.edges.features);
        let MessagesTape { edges, sums, layers, .. } = tape;
        if let Some(first) = layers.first_mut() {
            let links = self.links(&graph.order, sums);
            let wide = &mut work.shared.work.wide;
            for rows in blocks::<T>(n_edges) {
                for (run, kind) in runs(rows, &links.order.receivers, links.sums) {
                    let out = &mut first.edges[numbers(&run, columns)];
                    self.edges[kind].forward(edges, &run, wide, Normed::Narrow(out));
                }
            }
        }
        let tiles = graph.tiles::<T>();
        for (l, layer) in self.layers.iter().enumerate() {
            if l == self.layers_before {
                self.macro_stage(graph, tape, work);
            }
            let (done, rest) = tape.layers.split_at_mut(l + 1);
            let next = rest.first_mut().map(|t| &mut t.edges);
            let nodes = &mut work.latents[..n_nodes * columns];
            let links = self.links(&graph.order, &tape.sums);
            layer.forward(links, &tiles, &mut done[l], &mut work.shared, nodes, next);
        }
        if self.layers_before == self.layers.len() {
            self.macro_stage(graph, tape, work);
        }
    }

    fn backward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut MessagesTape<T>,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
        edges: Option<&mut [Vec<f32>]>,
    ) {
        let (columns, n_nodes, n_edges) = (self.columns, graph.n_nodes(), graph.n_edges());
        work.d_edges.fit(n_edges * columns);
        work.d_edges[..n_edges * columns].fill(0.0);
        let tiles = graph.tiles::<T>();
        for (l, layer) in self.layers.iter().enumerate().rev() {
            if l + 1 == self.layers_before {
                self.stage_backward(graph, tape, work, gradients);
            }
            let d = (&mut work.d_nodes[..n_nodes * columns], &mut work.d_edges[..n_edges * columns]);
            let links = self.links(&graph.order, &tape.sums);
            layer.backward(links, &tiles, &tape.layers[l], &mut work.shared, d, gradients);
        }
        if self.layers_before == 0 {
            self.stage_backward(graph, tape, work, gradients);
        }
        let mut edges = edges.and_then(|e| e.first_mut());
        if self.layers.is_empty() {
            edges.into_iter().for_each(|e| e.fill(0.0));
            return;
        }
        let Buffers { shared, fp32, d_edges, d_features, .. } = work;
        let links = self.links(&graph.order, &tape.sums);
        let of_kinds = |rows| runs(rows, &links.order.receivers, links.sums);
        for (rows, kind) in blocks::<T>(n_edges).flat_map(of_kinds) {
            let n = rows.len();
            shared.work.wide[..n * columns].copy_from_slice(&d_edges[numbers(&rows, columns)]);
            let wanted = edges.is_some().then_some(&mut d_features[..]);
            let work = &mut shared.work;
            self.edges[kind].backward(&tape.edges, &rows, work, fp32, gradients, wanted);
            if let Some(to) = edges.as_deref_mut() {
                let k = self.n_edge_features;
                let numbers = graph.order.edge[rows].iter();
                for (&edge, d) in numbers.zip(d_features.chunks_exact(self.edges[0].stride)) {
                    scales.edge.derivative(d, &mut to[edge as usize * k..(edge as usize + 1) * k]);
                }
            }
        }
    }
}
