//! BSMS-GNN (Cao et al. 2023), forward with what is kept, and backward.

use super::Scales;
use super::attention::add;
use super::graph::TrainGraph;
use super::layer::{LayerTape, Links};
use super::network::Buffers;
use super::processor::Processor;
use crate::kernels::{Buffer, Number, padded};
use crate::order::Order;
use crate::passing::Layer;
use crate::tiles::{self, Tile};
use crate::weights::{Gradients, Weights};
use m4gn_base::Result;
use m4gn_model::ModelSpec;

/// The layers of a model: down, on the coarsest graph, up.
pub struct BiStride<T> {
    columns: usize,
    n_edge_features: usize,
    layers: Vec<Layer<T>>,
}

/// What they keep.
pub struct BiStrideTape<T> {
    layers: Vec<LayerTape<T>>,
    /// Of each graph: its latents; backward, derivatives by these.
    rows: Vec<Buffer<f32>>,
    /// What has come up to a graph.
    risen: Buffer<f32>,
}

impl TrainGraph {
    /// The graph itself or a coarser one: its order, tiles and features.
    fn level<T: Number>(&self, l: usize) -> (&Order, Vec<Tile>, &[f32]) {
        let (order, features) = match l.checked_sub(1) {
            None => (&self.order, &self.edge_features[..]),
            Some(l) => (&self.coarser[l].order, &self.coarser[l].edge_features[..]),
        };
        (order, tiles::cut::<T>(&order.row, order.n_interior), features)
    }
}

/// Nodes and edges of these graphs, which layers pass down and up.
pub fn twice<'a>(orders: impl Iterator<Item = &'a Order>) -> [usize; 2] {
    let sizes = orders.map(|order| [2 * order.node.len(), 2 * order.senders.len()]);
    sizes.fold([0, 0], |sum, n| [sum[0] + n[0], sum[1] + n[1]])
}

/// `out = 0`, as long as the rows of a graph.
fn cleared(out: &mut Buffer<f32>, size: usize) -> &mut [f32] {
    out.fit(size);
    out[..size].fill(0.0);
    &mut out[..size]
}

impl<T: Number> Processor<T> for BiStride<T> {
    type Tape = BiStrideTape<T>;

    fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        Ok(BiStride {
            columns: padded(a.width),
            n_edge_features: spec.n_edge_features(),
            layers: (0..a.layers()).map(|l| Layer::new(weights, a, l)).collect::<Result<_>>()?,
        })
    }

    fn tape(&self) -> BiStrideTape<T> {
        let n_graphs = self.layers.len() / 2 + 1;
        BiStrideTape {
            layers: self.layers.iter().map(LayerTape::new).collect(),
            rows: (0..n_graphs).map(|_| Buffer::default()).collect(),
            risen: Buffer::default(),
        }
    }

    fn passed(&self, graph: &TrainGraph, _: &BiStrideTape<T>) -> [usize; 2] {
        let coarser = graph.coarser.iter().map(|c| &c.order);
        twice(std::iter::once(&graph.order).chain(coarser))
    }

    fn forward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut BiStrideTape<T>,
        work: &mut Buffers<T>,
    ) {
        let columns = self.columns;
        let BiStrideTape { layers, rows, risen } = tape;
        let (depth, size) = (graph.coarser.len(), graph.n_nodes() * columns);
        let mut layer = |l: usize, number: usize, nodes: &mut [f32]| {
            let (order, tiles, of_edges) = graph.level::<T>(l);
            let kept = &mut layers[number];
            kept.fit(order.node.len(), order.senders.len(), &self.layers[number]);
            scales.edge.normalise_rows(of_edges, &order.edge, columns, &mut kept.edges);
            self.layers[number].forward(Links::of(order), &tiles, kept, &mut work.shared, nodes, None);
        };
        cleared(&mut rows[0], size).copy_from_slice(&work.latents[..size]);
        for l in 0..=depth {
            let n = graph.level::<T>(l).0.node.len();
            if let Some(above) = l.checked_sub(1) {
                let [finer, own] = pair(rows, above);
                graph.coarser[above].down.add(0..n, columns, finer, cleared(own, n * columns));
            }
            layer(l, l, &mut rows[l][..n * columns]);
        }
        for l in (0..depth).rev() {
            let n = graph.level::<T>(l).0.node.len();
            let up = cleared(risen, n * columns);
            graph.coarser[l].up.add(0..n, columns, &rows[l + 1], up);
            layer(l, 2 * depth - l, up);
            add(&mut rows[l], up);
        }
        work.latents[..size].copy_from_slice(&rows[0][..size]);
    }

    fn backward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut BiStrideTape<T>,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
        mut edges: Option<&mut [Vec<f32>]>,
    ) {
        let columns = self.columns;
        let BiStrideTape { layers, rows, risen } = tape;
        let (depth, size) = (graph.coarser.len(), graph.n_nodes() * columns);
        edges.iter_mut().flat_map(|e| e.iter_mut()).for_each(|e| e.fill(0.0));
        let Buffers { shared, d_edges, d_nodes, .. } = work;
        let mut layer = |l: usize, number: usize, d: &mut [f32]| {
            let (order, tiles, _) = graph.level::<T>(l);
            let n = order.senders.len();
            let by_edges = cleared(d_edges, n * columns);
            let links = Links::of(order);
            self.layers[number].backward(links, &tiles, &layers[number], shared, (d, by_edges), gradients);
            let Some(edges) = edges.as_deref_mut().map(|e| &mut e[l]) else { return };
            let k = self.n_edge_features;
            for (&edge, d) in order.edge.iter().zip(by_edges.chunks_exact(columns)) {
                let to = edges[edge as usize * k..(edge as usize + 1) * k].iter_mut();
                to.zip(d).zip(&scales.edge.inverse).for_each(|((to, d), inverse)| *to += d * inverse);
            }
        };
        cleared(&mut rows[0], size).copy_from_slice(&d_nodes[..size]);
        for l in 0..depth {
            let n = graph.level::<T>(l + 1).0.node.len();
            let [own, coarser] = pair(rows, l);
            let size = graph.level::<T>(l).0.node.len() * columns;
            let d = cleared(risen, size);
            d.copy_from_slice(&own[..size]);
            layer(l, 2 * depth - l, d);
            graph.coarser[l].down.add(0..n, columns, d, cleared(coarser, n * columns));
        }
        for l in (0..=depth).rev() {
            let n = graph.level::<T>(l).0.node.len();
            if l < depth {
                let [own, coarser] = pair(rows, l);
                graph.coarser[l].up.add(0..n, columns, coarser, own);
            }
            layer(l, l, &mut rows[l][..n * columns]);
        }
        d_nodes[..size].copy_from_slice(&rows[0][..size]);
    }
}

/// The rows of a graph and of the next coarser one.
fn pair(rows: &mut [Buffer<f32>], l: usize) -> [&mut Buffer<f32>; 2] {
    let (finer, coarser) = rows.split_at_mut(l + 1);
    [&mut finer[l], &mut coarser[0]]
}
