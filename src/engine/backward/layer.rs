//! One message-passing layer (eq. 2, 3), forward with what is kept, and backward.

use super::mlp::{Mlp, MlpTape, Work, activate, fit};
use super::weights::{Dense, Gradients, Slots};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Normed, Number, Output, gather_add, narrow, padded, product, scatter_add,
};
use crate::order::Order;
use crate::tiles::Tile;
use m4gn_mesh::Result;
use m4gn_model::Architecture;

/// Weights of a layer, the first one of the edge network cut by input.
#[derive(Debug)]
pub struct Layer<T> {
    isa: Isa,
    columns: usize,
    /// Of latents, or of features.
    edge_edge: Dense<T>,
    edge_sender: Dense<T>,
    edge_receiver: Dense<T>,
    edge: Mlp<T>,
    /// What messages are added to where edges have no latents: nothing.
    zeros: Option<Buffer<T>>,
    /// Of latents and sums.
    node_first: Dense<T>,
    node: Mlp<T>,
}

/// What a layer keeps.
#[derive(Debug)]
pub struct LayerTape<T> {
    /// Edges' latents before it, or their features.
    pub edges: Buffer<T>,
    /// Nodes' latents before it, and the sums over their edges.
    nodes: Buffer<T>,
    edge: MlpTape<T>,
    node: MlpTape<T>,
}

/// The buffers that all layers share, and those of the thread.
#[derive(Debug)]
pub struct Shared<T> {
    /// Rows at a time.
    pub work: Work<T>,
    /// W_s h of all nodes.
    projected: Buffer<T>,
    /// W_r h of a tile's nodes; backward, derivatives of it.
    receivers: Buffer<f32>,
    /// Sums over the edges of a tile's nodes; backward, derivatives of these.
    sums: Buffer<f32>,
    /// Derivatives of W_s h of all nodes.
    d_projected: Buffer<f32>,
    /// Derivatives of latents and sums.
    d_both: Buffer<f32>,
    zeros: Vec<f32>,
}

impl<T: Number> Shared<T> {
    /// For rows of up to `widest` columns and latents of `columns`.
    pub fn new(widest: usize, columns: usize) -> Self {
        let rows = super::mlp::ROWS;
        Shared {
            work: Work::new(widest.max(2 * columns)),
            projected: Buffer::new(0),
            receivers: Buffer::new(rows * columns),
            sums: Buffer::new(rows * columns),
            d_projected: Buffer::new(0),
            d_both: Buffer::new(rows * 2 * columns),
            zeros: vec![0.0; widest.max(2 * columns)],
        }
    }

    /// Room for this many nodes.
    pub fn fit(&mut self, nodes: usize, columns: usize) {
        fit(&mut self.projected, nodes * columns);
        fit(&mut self.d_projected, nodes * columns);
    }

    /// Zeros, as many as the widest row.
    pub fn zeros(&self) -> &[f32] {
        &self.zeros
    }

    /// Work and zeros.
    pub fn split(&mut self) -> (&mut Work<T>, &[f32]) {
        (&mut self.work, &self.zeros)
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.work.bytes() + self.projected.bytes() + self.d_projected.bytes()
    }
}

impl<T: Number> LayerTape<T> {
    /// Empty.
    pub fn new(layer: &Layer<T>) -> Self {
        LayerTape {
            edges: Buffer::new(0),
            nodes: Buffer::new(0),
            edge: MlpTape::new(&layer.edge),
            node: MlpTape::new(&layer.node),
        }
    }

    /// Room for this many nodes and edges.
    pub fn fit(&mut self, nodes: usize, edges: usize, columns: usize) {
        fit(&mut self.edges, edges * columns);
        fit(&mut self.nodes, nodes * 2 * columns);
        self.edge.fit(edges, columns);
        self.node.fit(nodes, columns);
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.edges.bytes() + self.nodes.bytes() + self.edge.bytes() + self.node.bytes()
    }
}

impl<T: Number> Layer<T> {
    /// Layer `l` of the processor.
    pub fn new(isa: Isa, slots: &mut Slots, architecture: &Architecture, l: usize) -> Result<Self> {
        let d = architecture.width;
        let (edge, node) = (format!("processor.{l}.edge"), format!("processor.{l}.node"));
        let (edge_first, node_first) = (format!("{edge}.0"), format!("{node}.0"));
        let k = slots.layout().find(&format!("{edge_first}.weight"))?.1[1] - 2 * d;
        Ok(Layer {
            isa,
            columns: padded(d),
            edge_edge: Dense::columns(isa, slots, &edge_first, 0, k)?,
            edge_sender: Dense::columns(isa, slots, &edge_first, k, d)?,
            edge_receiver: Dense::columns(isa, slots, &edge_first, k + d, d)?,
            edge: Mlp::new(isa, slots, &edge, architecture)?,
            zeros: (!architecture.edge_latents()).then(|| Buffer::new(super::mlp::ROWS * padded(d))),
            node_first: Dense::of_two(isa, slots, &node_first, d)?,
            node: Mlp::new(isa, slots, &node, architecture)?,
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        let blocks =
            [&mut self.edge_edge, &mut self.edge_sender, &mut self.edge_receiver, &mut self.node_first];
        blocks.into_iter().for_each(|b| b.load(flat));
        self.edge.load(flat);
        self.node.load(flat);
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        let first = [&self.edge_edge, &self.edge_sender, &self.edge_receiver, &self.node_first];
        first.iter().map(|d| d.bytes()).sum::<usize>() + self.edge.bytes() + self.node.bytes()
    }

    /// Advances the nodes in place; `next` gets the edges' latents behind the layer, unless nothing reads them.
    pub fn forward(
        &self,
        order: &Order,
        tiles: &[Tile],
        tape: &mut LayerTape<T>,
        s: &mut Shared<T>,
        nodes: &mut [f32],
        mut next: Option<&mut Buffer<T>>,
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let none = Function::Identity;
        for tile in tiles {
            let n = tile.nodes.len();
            for i in tile.nodes.clone() {
                let h = &nodes[i * columns..(i + 1) * columns];
                narrow(isa, h, &mut tape.nodes[2 * i * columns..(2 * i + 1) * columns]);
            }
            let x = (&tape.nodes[2 * tile.nodes.start * columns..], 2 * columns);
            let out = &mut s.projected[tile.nodes.start * columns..tile.nodes.end * columns];
            let weight = self.edge_sender.forward();
            product(isa, weight, x, n, Addend::Nothing, none, Output::Narrow(out));
        }
        // The last layer's edges are needed for their sums alone.
        let mut unread: Buffer<T> = Buffer::new(0);
        for tile in tiles {
            let n = tile.nodes.len();
            let x = (&tape.nodes[2 * tile.nodes.start * columns..], 2 * columns);
            let bias = Addend::Bias(&self.edge.first_bias.data);
            let out = Output::Wide(&mut s.receivers[..]);
            product(isa, self.edge_receiver.forward(), x, n, bias, none, out);
            s.sums[..n * columns].fill(0.0);
            for chunk in tile.chunks::<T>() {
                let range = chunk.start * columns..chunk.end * columns;
                let (m, owner, first) = (chunk.len(), &order.receivers[chunk.clone()], tile.nodes.start);
                let ends = Addend::Ends {
                    senders: &s.projected[..],
                    index: &order.senders[chunk.clone()],
                    receivers: &s.receivers[..],
                    owner,
                    first,
                };
                let (value, slope) = tape.edge.first(&chunk, columns);
                let before = &tape.edges[range.clone()];
                let (weight, f) = (self.edge_edge.forward(), self.edge.function());
                activate(isa, weight, (before, columns), m, ends, f, &mut s.work.wide, value, slope);
                let keep = next.is_some();
                let edges = match next.as_deref_mut() {
                    Some(next) => &mut next[range],
                    None => {
                        fit(&mut unread, m * columns);
                        &mut unread[..m * columns]
                    }
                };
                let before = Some(self.zeros.as_deref().unwrap_or(before));
                let out = Normed::Edges { before, edges, keep, sums: &mut s.sums[..], owner, first };
                self.edge.forward(&mut tape.edge, &chunk, &mut s.work.wide, out);
            }
            for (i, sum) in tile.nodes.clone().zip(s.sums.chunks_exact(columns)) {
                narrow(isa, sum, &mut tape.nodes[(2 * i + 1) * columns..(2 * i + 2) * columns]);
            }
            let x = (&tape.nodes[2 * tile.nodes.start * columns..], 2 * columns);
            let bias = Addend::Bias(&self.node.first_bias.data);
            let (value, slope) = tape.node.first(&tile.nodes, columns);
            let (weight, f) = (self.node_first.forward(), self.node.function());
            activate(isa, weight, x, n, bias, f, &mut s.work.wide, value, slope);
            let own = &mut nodes[tile.nodes.start * columns..tile.nodes.end * columns];
            self.node.forward(&mut tape.node, &tile.nodes, &mut s.work.wide, Normed::Residual(own));
        }
    }

    /// From derivatives by the latents behind the layer, of nodes and edges, to those before it, in place; where edges have features
    /// alone, to those by them.
    pub fn backward(
        &self,
        order: &Order,
        tiles: &[Tile],
        tape: &LayerTape<T>,
        s: &mut Shared<T>,
        (d_nodes, d_edges): (&mut [f32], &mut [f32]),
        gradients: &mut Gradients,
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let n_nodes = order.node.len();
        s.d_projected[..n_nodes * columns].fill(0.0);
        for tile in tiles {
            let n = tile.nodes.len();
            let own = tile.nodes.start * columns..tile.nodes.end * columns;
            let x = (&tape.nodes[2 * tile.nodes.start * columns..], 2 * columns);
            s.work.wide[..n * columns].copy_from_slice(&d_nodes[own.clone()]);
            self.node.backward(&tape.node, &tile.nodes, &mut s.work, gradients);
            let dy = (&s.work.narrow[..], columns);
            self.node_first.learn(dy, x, n, gradients, &mut s.work.pairs);
            self.node_first.back(dy, n, &mut s.d_both);
            let d_own = &mut d_nodes[own.clone()];
            let rows = s.d_both.chunks_exact(2 * columns).take(n);
            for (i, both) in rows.enumerate() {
                let d = &mut d_own[i * columns..(i + 1) * columns];
                d.iter_mut().zip(&both[..columns]).for_each(|(d, x)| *d += x);
                s.sums[i * columns..(i + 1) * columns].copy_from_slice(&both[columns..]);
            }
            s.receivers[..n * columns].fill(0.0);
            for chunk in tile.chunks::<T>() {
                let m = chunk.len();
                let range = chunk.start * columns..chunk.end * columns;
                let (owner, first) = (&order.receivers[chunk.clone()], tile.nodes.start);
                let d = &mut d_edges[range.clone()];
                if self.zeros.is_some() {
                    d.fill(0.0);
                }
                gather_add(isa, d, columns, &s.sums[..n * columns], owner, first);
                s.work.wide[..d.len()].copy_from_slice(d);
                self.edge.backward(&tape.edge, &chunk, &mut s.work, gradients);
                let dy = (&s.work.narrow[..], columns);
                let before = (&tape.edges[range], columns);
                self.edge_edge.learn(dy, before, m, gradients, &mut s.work.pairs);
                match self.zeros {
                    None => self.edge_edge.back_add(dy, m, d, &s.zeros),
                    Some(_) => {
                        self.edge_edge.back(dy, m, d);
                        // From rows as wide as features to rows of latents.
                        let width = self.edge_edge.columns_back();
                        (0..m).rev().for_each(|i| d.copy_within(i * width..(i + 1) * width, i * columns));
                    }
                }
                let wide = &s.work.wide[..m * columns];
                scatter_add(isa, wide, columns, &mut s.receivers[..n * columns], owner, first);
                let senders = &order.senders[chunk];
                scatter_add(isa, wide, columns, &mut s.d_projected[..n_nodes * columns], senders, 0);
            }
            let Work { narrow: dy, pairs, .. } = &mut s.work;
            narrow(isa, &s.receivers[..n * columns], &mut dy[..n * columns]);
            let dy = (&dy[..], columns);
            self.edge_receiver.learn(dy, x, n, gradients, pairs);
            self.edge_receiver.back_add(dy, n, &mut d_nodes[own], &s.zeros);
        }
        for tile in tiles {
            let n = tile.nodes.len();
            let own = tile.nodes.start * columns..tile.nodes.end * columns;
            let x = (&tape.nodes[2 * tile.nodes.start * columns..], 2 * columns);
            let Work { narrow: dy, pairs, .. } = &mut s.work;
            narrow(isa, &s.d_projected[own.clone()], &mut dy[..n * columns]);
            let dy = (&dy[..], columns);
            self.edge_sender.learn(dy, x, n, gradients, pairs);
            self.edge_sender.back_add(dy, n, &mut d_nodes[own], &s.zeros);
        }
    }
}
