//! One message-passing layer (eq. 2 to 4) over a whole graph, with what is kept, and backward.

use super::mlp::Work;
use crate::kernels::{Buffer, Number, gather_add, narrow, scatter_add};
use crate::order::Order;
use crate::passing::{Edges, Layer, SweepTape, Topology};
use crate::tiles::{Scratch, Tile, WORLD, numbers};
use crate::weights::Gradients;
use m4gn_model::NodeSums;

/// The edges of a graph in its order.
#[derive(Clone, Copy)]
pub struct Links<'a> {
    pub order: &'a Order,
    /// Row of the sum that each edge adds to, counted as the receivers are.
    pub sums: &'a [i32],
}

impl<'a> Links<'a> {
    /// Of edges of one kind.
    pub fn of(order: &'a Order) -> Self {
        Links { order, sums: &order.receivers }
    }
}

/// What a layer keeps.
pub struct LayerTape<T> {
    /// Edges' latents before it, or their features.
    pub edges: Buffer<T>,
    swept: SweepTape<T>,
}

/// The buffers that all layers share, and those of the thread.
pub struct Shared<T> {
    /// Of the forward pass; backward, derivatives of what it has of receivers and sums.
    pub scratch: Scratch<T>,
    /// Rows at a time.
    pub work: Work<T>,
    /// W_s h of all nodes.
    projected: Buffer<T>,
    /// Derivatives of W_s h of all nodes.
    d_projected: Buffer<f32>,
    /// Derivatives of latents and sums.
    d_both: Buffer<f32>,
    zeros: Vec<f32>,
}

impl<T: Number> Shared<T> {
    /// For rows of up to `widest` columns, latents of `columns`, so many sums of edges and so many outputs.
    pub fn new(widest: usize, columns: usize, kinds: usize, outputs: usize) -> Self {
        let widest = widest.max((1 + kinds) * columns);
        Shared {
            scratch: Scratch::new(columns, kinds, outputs, false),
            work: Work::new(widest),
            projected: Buffer::default(),
            d_projected: Buffer::default(),
            d_both: Buffer::new(super::mlp::ROWS * (1 + kinds) * columns),
            zeros: vec![0.0; widest],
        }
    }

    /// Room for this many nodes.
    pub fn fit(&mut self, nodes: usize, columns: usize) {
        self.projected.fit(nodes * columns);
        self.d_projected.fit(nodes * columns);
    }

    /// Zeros, as many as the widest row.
    pub fn zeros(&self) -> &[f32] {
        &self.zeros
    }

    /// Work and zeros.
    pub fn split(&mut self) -> (&mut Work<T>, &[f32]) {
        (&mut self.work, &self.zeros)
    }
}

impl<T: Number> LayerTape<T> {
    pub fn new(layer: &Layer<T>) -> Self {
        LayerTape { edges: Buffer::default(), swept: SweepTape::new(layer) }
    }

    /// Room for this many nodes and edges.
    pub fn fit(&mut self, nodes: usize, edges: usize, layer: &Layer<T>) {
        self.edges.fit(edges * layer.columns);
        self.swept.fit(nodes, edges, layer);
    }
}

impl<T: Number> Layer<T> {
    /// Advances the nodes in place; `next` gets the edges' latents behind the layer, unless nothing reads them.
    pub fn forward(
        &self,
        Links { order, sums }: Links,
        tiles: &[Tile],
        tape: &mut LayerTape<T>,
        s: &mut Shared<T>,
        nodes: &mut [f32],
        mut next: Option<&mut Buffer<T>>,
    ) {
        let columns = self.columns;
        for tile in tiles {
            let own = numbers(&tile.nodes, columns);
            self.project(&mut s.scratch, &nodes[own.clone()], &mut s.projected[own]);
        }
        let Order { senders, receivers, .. } = order;
        let graph = Topology { senders, receivers, sums, projected: &s.projected[..] };
        // The last layer's edges are needed for their sums alone.
        let mut unread: Buffer<T> = Buffer::default();
        for tile in tiles {
            let rows = numbers(&tile.edges, columns);
            let (before, keep) = (Some(&tape.edges[rows.clone()]), next.is_some());
            let now = match next.as_deref_mut() {
                Some(next) => &mut next[rows],
                None => {
                    unread.fit(rows.len());
                    &mut unread[..]
                }
            };
            let own = &mut nodes[numbers(&tile.nodes, columns)];
            let edges = Edges { before, now, keep };
            self.sweep(&graph, tile, &mut s.scratch, own, edges, Some(&mut tape.swept));
        }
    }

    /// From derivatives by the latents behind the layer, of nodes and edges, to those before it, in place; where edges have features
    /// alone, to those by them.
    pub fn backward(
        &self,
        Links { order, sums }: Links,
        tiles: &[Tile],
        tape: &LayerTape<T>,
        s: &mut Shared<T>,
        (d_nodes, d_edges): (&mut [f32], &mut [f32]),
        gradients: &mut Gradients,
    ) {
        let (isa, columns, wide) = (self.isa, self.columns, self.wide);
        let LayerTape { edges, swept: tape } = tape;
        let n_nodes = order.node.len();
        s.d_projected[..n_nodes * columns].fill(0.0);
        for tile in tiles {
            let n = tile.nodes.len();
            let own = numbers(&tile.nodes, columns);
            let x = (&tape.nodes[tile.nodes.start * wide..], wide);
            s.work.wide[..n * columns].copy_from_slice(&d_nodes[own.clone()]);
            self.node.backward(&tape.node, &tile.nodes, &mut s.work, gradients);
            let dy = (&s.work.narrow[..], columns);
            self.node_first.learn(dy, x, n, gradients, &mut s.work.pairs);
            self.node_first.back(dy, n, &mut s.d_both);
            let d_own = &mut d_nodes[own.clone()];
            for (i, both) in s.d_both.chunks_exact(wide).take(n).enumerate() {
                let d = &mut d_own[i * columns..(i + 1) * columns];
                d.iter_mut().zip(&both[..columns]).for_each(|(d, x)| *d += x);
                for (kind, d) in both[columns..].chunks_exact(columns).enumerate() {
                    s.scratch.sums[(kind * WORLD + i) * columns..][..columns].copy_from_slice(d);
                }
            }
            s.scratch.receivers[..n * columns].fill(0.0);
            for chunk in tile.chunks::<T>() {
                let m = chunk.len();
                let range = numbers(&chunk, columns);
                let (owner, first) = (&order.receivers[chunk.clone()], tile.nodes.start);
                let into = &sums[chunk.clone()];
                let d = &mut d_edges[range.clone()];
                if self.zeros.is_some() {
                    d.fill(0.0);
                }
                if self.node_sums == NodeSums::After {
                    gather_add(isa, d, columns, &s.scratch.sums, into, first);
                }
                s.work.wide[..d.len()].copy_from_slice(d);
                if self.node_sums == NodeSums::Before {
                    gather_add(isa, d, columns, &s.scratch.sums, into, first);
                }
                let (Some(edge), Some(kept)) = (&self.edge, &tape.edge) else { continue };
                edge.rest.backward(kept, &chunk, &mut s.work, gradients);
                let dy = (&s.work.narrow[..], columns);
                let before = (&edges[range], columns);
                edge.edge.learn(dy, before, m, gradients, &mut s.work.pairs);
                match self.zeros {
                    None => edge.edge.back_add(dy, m, d, &s.zeros),
                    Some(_) => {
                        edge.edge.back(dy, m, d);
                        // From rows as wide as features to rows of latents.
                        let width = edge.edge.columns_back();
                        (0..m).rev().for_each(|i| d.copy_within(i * width..(i + 1) * width, i * columns));
                    }
                }
                let wide = &s.work.wide[..m * columns];
                scatter_add(isa, wide, columns, &mut s.scratch.receivers[..n * columns], owner, first);
                let senders = &order.senders[chunk];
                scatter_add(isa, wide, columns, &mut s.d_projected[..n_nodes * columns], senders, 0);
            }
            let Some(edge) = &self.edge else { continue };
            let Work { narrow: dy, pairs, .. } = &mut s.work;
            narrow(isa, &s.scratch.receivers[..n * columns], &mut dy[..n * columns]);
            let dy = (&dy[..], columns);
            edge.receiver.learn(dy, x, n, gradients, pairs);
            edge.receiver.back_add(dy, n, &mut d_nodes[own], &s.zeros);
        }
        let Some(edge) = &self.edge else { return };
        for tile in tiles {
            let n = tile.nodes.len();
            let own = numbers(&tile.nodes, columns);
            let x = (&tape.nodes[tile.nodes.start * wide..], wide);
            let Work { narrow: dy, pairs, .. } = &mut s.work;
            narrow(isa, &s.d_projected[own.clone()], &mut dy[..n * columns]);
            let dy = (&dy[..], columns);
            edge.sender.learn(dy, x, n, gradients, pairs);
            edge.sender.back_add(dy, n, &mut d_nodes[own], &s.zeros);
        }
    }
}
