//! g-U-Net (Gao and Ji 2019), forward with what is kept, and backward. Which nodes are kept has no derivative.

use super::attention::add;
use super::bi_stride::twice;
use super::graph::TrainGraph;
use super::layer::{LayerTape, Links};
use super::network::Buffers;
use super::processor::Processor;
use super::{Scale, Scales};
use crate::kernels::{Buffer, Number, padded};
use crate::order::Order;
use crate::passing::Layer;
use crate::processor::{PoolGraph, above, scores, unit};
use crate::tiles;
use crate::weights::{Gradients, Vector, Weights};
use m4gn_base::Result;
use m4gn_model::ModelSpec;
use m4gn_structure::Transfer;

/// The layers of a model: down, on the coarsest graph, up; and the vectors of the scores.
pub struct GraphUNet<T> {
    columns: usize,
    layers: Vec<Layer<T>>,
    scores: Vec<Vector>,
}

/// What they keep.
pub struct GraphUNetTape<T> {
    layers: Vec<LayerTape<T>>,
    /// The coarser graphs of the last forward pass.
    below: Vec<Below>,
    /// Of each graph: its latents; backward, derivatives by these.
    rows: Vec<Buffer<f32>>,
    /// Of each graph: derivatives by the features of its edges, by number.
    by_edges: Vec<Vec<f32>>,
}

/// A coarser graph.
struct Below {
    order: Order,
    /// Its features are normalised, by number.
    links: PoolGraph,
    edges: Transfer,
    /// Where each place stands in the finer graph, and its gate.
    above: Vec<(usize, f32)>,
    /// Latents before the gate.
    latents: Vec<f32>,
}

impl<T: Number> Processor<T> for GraphUNet<T> {
    type Tape = GraphUNetTape<T>;

    fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        let score = |weights: &mut Weights, l| Vector::new(weights, &format!("processor.{l}.score.weight"));
        Ok(GraphUNet {
            columns: padded(a.width),
            layers: (0..a.layers()).map(|l| Layer::new(weights, a, l)).collect::<Result<_>>()?,
            scores: (0..a.layers() / 2).map(|l| score(weights, l)).collect::<Result<_>>()?,
        })
    }

    fn tape(&self) -> GraphUNetTape<T> {
        GraphUNetTape {
            layers: self.layers.iter().map(LayerTape::new).collect(),
            below: Vec::new(),
            rows: (0..=self.scores.len()).map(|_| Buffer::default()).collect(),
            by_edges: vec![Vec::new(); self.scores.len() + 1],
        }
    }

    fn passed(&self, graph: &TrainGraph, tape: &GraphUNetTape<T>) -> [usize; 2] {
        twice(std::iter::once(&graph.order).chain(tape.below.iter().map(|b| &b.order)))
    }

    fn forward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut GraphUNetTape<T>,
        work: &mut Buffers<T>,
    ) {
        let columns = self.columns;
        let k = scales.edge.channels();
        let (depth, size) = (self.scores.len(), graph.n_nodes() * columns);
        let GraphUNetTape { layers, below, rows, .. } = tape;
        let by_number: Vec<u32> = (0..graph.n_edges() as u32).collect();
        let mut features = vec![0f32; graph.n_edges() * k];
        scales.edge.normalise_rows(&graph.edge_features, &by_number, k, &mut features);
        let (senders, receivers) = graph.ends();
        let finest = PoolGraph { nodes: graph.choice.clone(), senders, receivers, features };
        let as_they_are = Scale::unit(k);
        below.clear();
        rows[0].fit(size);
        rows[0][..size].copy_from_slice(&work.latents[..size]);
        let mut layer = |number: usize, order: &Order, of_edges: &[f32], nodes: &mut [f32]| {
            let kept = &mut layers[number];
            kept.fit(order.node.len(), order.senders.len(), &self.layers[number]);
            as_they_are.normalise_rows(of_edges, &order.edge, columns, &mut kept.edges);
            let tiles = tiles::cut::<T>(&order.row, order.n_interior);
            self.layers[number].forward(Links::of(order), &tiles, kept, &mut work.shared, nodes, None);
        };
        for l in 0..=depth {
            let (order, links) = below.last().map_or((&graph.order, &finest), |b| (&b.order, &b.links));
            let n = order.node.len();
            layer(l, order, &links.features, &mut rows[l][..n * columns]);
            let Some(p) = self.scores.get(l) else { break };
            let (own, next) = rows.split_at_mut(l + 1);
            let h = &own[l][..n * columns];
            let score = scores(h, &unit(&p.data[..columns]), &order.node);
            let (pooled, links) = links.pooled(&score);
            let coarse = Order::new(&pooled.graph);
            let above = above(&pooled, &coarse, order, &score);
            next[0].fit(above.len() * columns);
            let mut latents = Vec::with_capacity(above.len() * columns);
            for (&(at, gate), to) in above.iter().zip(next[0].chunks_exact_mut(columns)) {
                let h = &h[at * columns..(at + 1) * columns];
                latents.extend_from_slice(h);
                to.iter_mut().zip(h).for_each(|(to, h)| *to = gate * h);
            }
            below.push(Below { order: coarse, links, edges: pooled.edges, above, latents });
        }
        for l in (0..depth).rev() {
            let (own, next) = rows.split_at_mut(l + 1);
            for (&(at, _), h) in below[l].above.iter().zip(next[0].chunks_exact(columns)) {
                add(&mut own[l][at * columns..(at + 1) * columns], h);
            }
            let (order, of_edges) = match l.checked_sub(1) {
                None => (&graph.order, &finest.features),
                Some(l) => (&below[l].order, &below[l].links.features),
            };
            layer(2 * depth - l, order, of_edges, &mut own[l][..order.node.len() * columns]);
        }
        work.latents[..size].copy_from_slice(&rows[0][..size]);
    }

    fn backward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        tape: &mut GraphUNetTape<T>,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
        edges: Option<&mut [Vec<f32>]>,
    ) {
        let columns = self.columns;
        let k = scales.edge.channels();
        let (depth, size) = (self.scores.len(), graph.n_nodes() * columns);
        let GraphUNetTape { layers, below, rows, by_edges } = tape;
        let Buffers { shared, d_edges, d_nodes, .. } = work;
        rows[0][..size].copy_from_slice(&d_nodes[..size]);
        let order = |l: usize| l.checked_sub(1).map_or(&graph.order, |l| &below[l].order);
        for (l, d) in by_edges.iter_mut().enumerate() {
            d.clear();
            d.resize(order(l).senders.len() * k, 0.0);
        }
        let mut layer = |l: usize, number: usize, d: &mut [f32], gradients: &mut Gradients| {
            let order = order(l);
            let tiles = tiles::cut::<T>(&order.row, order.n_interior);
            d_edges.fit(order.senders.len() * columns);
            let of_edges = &mut d_edges[..order.senders.len() * columns];
            let kept = &layers[number];
            let (links, d) = (Links::of(order), (d, &mut *of_edges));
            self.layers[number].backward(links, &tiles, kept, shared, d, gradients);
            for (&edge, d) in order.edge.iter().zip(of_edges.chunks_exact(columns)) {
                add(&mut by_edges[l][edge as usize * k..(edge as usize + 1) * k], d);
            }
        };
        for l in 0..depth {
            let n = order(l).node.len() * columns;
            layer(l, 2 * depth - l, &mut rows[l][..n], gradients);
            let (own, next) = rows.split_at_mut(l + 1);
            for (&(at, _), to) in below[l].above.iter().zip(next[0].chunks_exact_mut(columns)) {
                to.copy_from_slice(&own[l][at * columns..(at + 1) * columns]);
            }
        }
        for l in (0..=depth).rev() {
            let n = order(l).node.len() * columns;
            layer(l, l, &mut rows[l][..n], gradients);
            let Some(finer) = l.checked_sub(1) else { break };
            let (above, own) = rows.split_at_mut(l);
            let p = &self.scores[finer].data[..columns];
            let unit = unit(p);
            let mut d_unit = vec![0.0; columns];
            let parts = below[finer].latents.chunks_exact(columns).zip(own[0].chunks_exact(columns));
            for (&(at, gate), (h, d)) in below[finer].above.iter().zip(parts) {
                let d_score = dot(d, h) * (1.0 - gate * gate);
                let to = &mut above[finer][at * columns..(at + 1) * columns];
                to.iter_mut().zip(d).zip(&unit).for_each(|((to, d), p)| *to += gate * d + d_score * p);
                d_unit.iter_mut().zip(h).for_each(|(to, h)| *to += d_score * h);
            }
            let (along, length) = (dot(&d_unit, &unit), dot(p, p).sqrt());
            let sum = gradients.block(self.scores[finer].slot).iter_mut();
            sum.zip(d_unit.iter().zip(&unit)).for_each(|(sum, (d, p))| *sum += (d - along * p) / length);
        }
        d_nodes[..size].copy_from_slice(&rows[0][..size]);
        let Some(edges) = edges.and_then(|e| e.first_mut()) else { return };
        for l in (0..depth).rev() {
            let (finer, own) = by_edges.split_at_mut(l + 1);
            let transposed = below[l].edges.transposed(finer[l].len() / k);
            transposed.add(0..finer[l].len() / k, k, &own[0], &mut finer[l]);
        }
        for (to, d) in edges.chunks_exact_mut(k).zip(by_edges[0].chunks_exact(k)) {
            scales.edge.derivative(d, to);
        }
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
