//! One message-passing layer (eq. 2 to 4), forward with what is kept, and backward.

use super::mlp::{Mlp, MlpTape, Work, fit, numbers};
use super::weights::{Dense, Gradients, Slots};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Normed, Number, Output, gather_add, narrow, padded, product, scatter_add,
};
use crate::order::Order;
use crate::tiles::{Tile, WORLD};
use m4gn_base::Result;
use m4gn_model::{Architecture, NodeSums};

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

/// Weights of a layer.
pub struct Layer<T> {
    isa: Isa,
    columns: usize,
    /// Columns of latents and sums.
    wide: usize,
    /// Which latents of its edges a node sums.
    node_sums: NodeSums,
    /// None where nothing reads what it would make of the edges.
    edge: Option<EdgeNetwork<T>>,
    /// What messages are added to where edges have no latents: nothing.
    zeros: Option<Buffer<T>>,
    /// Of latents and sums.
    node_first: Dense<T>,
    node: Mlp<T>,
}

/// Weights of an edge network, the first one cut by input.
struct EdgeNetwork<T> {
    /// Of latents, or of features.
    edge: Dense<T>,
    sender: Dense<T>,
    receiver: Dense<T>,
    rest: Mlp<T>,
}

impl<T: Number> EdgeNetwork<T> {
    /// Perceptron `name`.
    fn new(isa: Isa, slots: &mut Slots, name: &str, architecture: &Architecture) -> Result<Self> {
        let (d, first) = (architecture.width, format!("{name}.0"));
        let k = slots.layout.find(&format!("{first}.weight"))?.1[1] - 2 * d;
        Ok(EdgeNetwork {
            edge: Dense::columns(isa, slots, &first, 0, k)?,
            sender: Dense::columns(isa, slots, &first, k, d)?,
            receiver: Dense::columns(isa, slots, &first, k + d, d)?,
            rest: Mlp::new(isa, slots, name, architecture)?,
        })
    }
}

/// What a layer keeps.
pub struct LayerTape<T> {
    /// Edges' latents before it, or their features.
    pub edges: Buffer<T>,
    /// Nodes' latents before it, and the sums over their edges.
    nodes: Buffer<T>,
    edge: Option<MlpTape<T>>,
    node: MlpTape<T>,
}

/// The buffers that all layers share, and those of the thread.
pub struct Shared<T> {
    /// Rows at a time.
    pub work: Work<T>,
    /// W_s h of all nodes.
    projected: Buffer<T>,
    /// W_r h of a tile's nodes; backward, derivatives of it.
    receivers: Buffer<f32>,
    /// Sums over the edges of a tile's nodes, those of world edges from row [`WORLD`] on; backward, derivatives of these.
    sums: Buffer<f32>,
    /// Derivatives of W_s h of all nodes.
    d_projected: Buffer<f32>,
    /// Derivatives of latents and sums.
    d_both: Buffer<f32>,
    zeros: Vec<f32>,
}

impl<T: Number> Shared<T> {
    /// For rows of up to `widest` columns, latents of `columns` and so many sums of edges.
    pub fn new(widest: usize, columns: usize, kinds: usize) -> Self {
        let rows = super::mlp::ROWS;
        let widest = widest.max((1 + kinds) * columns);
        Shared {
            work: Work::new(widest),
            projected: Buffer::default(),
            receivers: Buffer::new(rows * columns),
            sums: Buffer::new((rows + (kinds - 1) * WORLD) * columns),
            d_projected: Buffer::default(),
            d_both: Buffer::new(rows * (1 + kinds) * columns),
            zeros: vec![0.0; widest],
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
}

impl<T: Number> LayerTape<T> {
    pub fn new(layer: &Layer<T>) -> Self {
        LayerTape {
            edges: Buffer::default(),
            nodes: Buffer::default(),
            edge: layer.edge.as_ref().map(|e| MlpTape::new(&e.rest)),
            node: MlpTape::new(&layer.node),
        }
    }

    /// Room for this many nodes and edges.
    pub fn fit(&mut self, nodes: usize, edges: usize, layer: &Layer<T>) {
        let columns = layer.columns;
        fit(&mut self.edges, edges * columns);
        fit(&mut self.nodes, nodes * layer.wide);
        self.edge.iter_mut().for_each(|e| e.fit(edges, columns));
        self.node.fit(nodes, columns);
    }

    pub fn bytes(&self) -> usize {
        let edge = self.edge.as_ref().map_or(0, |e| e.bytes());
        self.edges.bytes() + self.nodes.bytes() + edge + self.node.bytes()
    }
}

impl<T: Number> Layer<T> {
    /// Layer `l` of the processor.
    pub fn new(isa: Isa, slots: &mut Slots, architecture: &Architecture, l: usize) -> Result<Self> {
        let d = architecture.width;
        let (edge, node) = (format!("processor.{l}.edge"), format!("processor.{l}.node"));
        let node_first = format!("{node}.0");
        Ok(Layer {
            isa,
            columns: padded(d),
            node_sums: architecture.micro.node_sums,
            edge: match l < architecture.edge_networks() {
                true => Some(EdgeNetwork::new(isa, slots, &edge, architecture)?),
                false => None,
            },
            zeros: (!architecture.edge_latents()).then(|| Buffer::new(super::mlp::ROWS * padded(d))),
            node_first: Dense::of_latents(isa, slots, &node_first, d, 1 + architecture.edge_kinds())?,
            wide: (1 + architecture.edge_kinds()) * padded(d),
            node: Mlp::new(isa, slots, &node, architecture)?,
        })
    }

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
        let (isa, columns, wide) = (self.isa, self.columns, self.wide);
        let none = Function::Identity;
        for tile in tiles {
            let n = tile.nodes.len();
            for i in tile.nodes.clone() {
                let h = &nodes[i * columns..(i + 1) * columns];
                narrow(isa, h, &mut tape.nodes[i * wide..][..columns]);
            }
            let x = (&tape.nodes[tile.nodes.start * wide..], wide);
            let out = &mut s.projected[numbers(&tile.nodes, columns)];
            if let Some(edge) = &self.edge {
                product(isa, &edge.sender.forward, x, n, Addend::Nothing, none, Output::Narrow(out));
            }
        }
        // The last layer's edges are needed for their sums alone.
        let mut unread: Buffer<T> = Buffer::default();
        for tile in tiles {
            let n = tile.nodes.len();
            let x = (&tape.nodes[tile.nodes.start * wide..], wide);
            if let Some(edge) = &self.edge {
                let bias = Addend::Bias(&edge.rest.first_bias.data);
                product(isa, &edge.receiver.forward, x, n, bias, none, Output::Wide(&mut s.receivers[..]));
            }
            for kind in (0..s.sums.len()).step_by(WORLD * columns) {
                s.sums[kind..][..n * columns].fill(0.0);
            }
            for chunk in tile.chunks::<T>() {
                let range = numbers(&chunk, columns);
                let (m, owner, first) = (chunk.len(), &order.receivers[chunk.clone()], tile.nodes.start);
                let into = &sums[chunk.clone()];
                let before = &tape.edges[range.clone()];
                if self.node_sums == NodeSums::Before {
                    scatter_add(isa, before, columns, &mut s.sums, into, first);
                }
                let (Some(edge), Some(kept)) = (&self.edge, &mut tape.edge) else { continue };
                let ends = Addend::Ends {
                    senders: &s.projected[..],
                    index: &order.senders[chunk.clone()],
                    receivers: &s.receivers[..],
                    owner,
                    first,
                };
                let (weight, x) = (&edge.edge.forward, (before, columns));
                kept.first().fill(isa, weight, x, &chunk, ends, &mut s.work.wide);
                let keep = next.is_some();
                let edges = match next.as_deref_mut() {
                    Some(next) => &mut next[range],
                    None => {
                        fit(&mut unread, m * columns);
                        &mut unread[..m * columns]
                    }
                };
                let before = Some(self.zeros.as_deref().unwrap_or(before));
                let out = match self.node_sums {
                    NodeSums::After => {
                        Normed::Edges { before, edges, keep, sums: &mut s.sums[..], owner: into, first }
                    }
                    NodeSums::Before => Normed::Latents { before, edges },
                };
                edge.rest.forward(kept, &chunk, &mut s.work.wide, out);
            }
            for (row, i) in tile.nodes.clone().enumerate() {
                let both = tape.nodes[i * wide..(i + 1) * wide].chunks_exact_mut(columns).skip(1);
                for (kind, to) in both.enumerate() {
                    narrow(isa, &s.sums[(kind * WORLD + row) * columns..][..columns], to);
                }
            }
            let x = (&tape.nodes[tile.nodes.start * wide..], wide);
            let bias = Addend::Bias(&self.node.first_bias.data);
            let weight = &self.node_first.forward;
            tape.node.first().fill(isa, weight, x, &tile.nodes, bias, &mut s.work.wide);
            let own = &mut nodes[numbers(&tile.nodes, columns)];
            self.node.forward(&mut tape.node, &tile.nodes, &mut s.work.wide, Normed::Residual(own));
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
                    s.sums[(kind * WORLD + i) * columns..][..columns].copy_from_slice(d);
                }
            }
            s.receivers[..n * columns].fill(0.0);
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
                    gather_add(isa, d, columns, &s.sums, into, first);
                }
                s.work.wide[..d.len()].copy_from_slice(d);
                if self.node_sums == NodeSums::Before {
                    gather_add(isa, d, columns, &s.sums, into, first);
                }
                let (Some(edge), Some(kept)) = (&self.edge, &tape.edge) else { continue };
                edge.rest.backward(kept, &chunk, &mut s.work, gradients);
                let dy = (&s.work.narrow[..], columns);
                let before = (&tape.edges[range], columns);
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
                scatter_add(isa, wide, columns, &mut s.receivers[..n * columns], owner, first);
                let senders = &order.senders[chunk];
                scatter_add(isa, wide, columns, &mut s.d_projected[..n_nodes * columns], senders, 0);
            }
            let Some(edge) = &self.edge else { continue };
            let Work { narrow: dy, pairs, .. } = &mut s.work;
            narrow(isa, &s.receivers[..n * columns], &mut dy[..n * columns]);
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
