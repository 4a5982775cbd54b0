//! One message-passing layer: edge network (eq. 3, 4), sum over the edges of a node, node network (eq. 2).

use super::kernels::{
    Addend, Buffer, Function, Isa, Norm, Normed, Number, Output, Packed, layer_norm, narrow, padded, product,
    scatter_add,
};
use super::linear::{self, Tail};
use super::profile::Phase;
use super::tiles::{Scratch, Tile, WORLD};
use m4gn_base::Result;
use m4gn_model::{Model, NodeSums};

/// Weights of a layer.
pub struct Layer<T> {
    isa: Isa,
    columns: usize,
    /// Which latents of its edges a node sums.
    node_sums: NodeSums,
    /// Sums of edges.
    kinds: usize,
    /// None where nothing reads what it would make of the edges.
    edge: Option<EdgeNetwork<T>>,
    /// What messages are added to where edges have no latents: nothing.
    zeros: Option<Buffer<T>>,
    /// Of latents and sums.
    node_first: Packed<T>,
    node_bias: Vec<f32>,
    node_tail: Tail<T>,
    node_norm: Norm,
}

/// Weights of an edge network, the first one cut by input.
struct EdgeNetwork<T> {
    /// Of latents, or of features.
    edge: Packed<T>,
    sender: Packed<T>,
    receiver: Packed<T>,
    bias: Vec<f32>,
    tail: Tail<T>,
    norm: Norm,
}

impl<T: Number> EdgeNetwork<T> {
    /// Perceptron `name`, which reads so many numbers of an edge.
    fn new(isa: Isa, model: &Model, name: &str, k: usize) -> Result<Self> {
        let (d, first) = (model.spec.architecture.width, format!("{name}.0"));
        Ok(EdgeNetwork {
            edge: linear::columns(isa, model, &first, 0..k)?,
            sender: linear::columns(isa, model, &first, k..k + d)?,
            receiver: linear::columns(isa, model, &first, k + d..k + 2 * d)?,
            bias: linear::bias(model, &first)?,
            tail: Tail::new(isa, model, name)?,
            norm: linear::norm(model, &format!("{name}.norm"))?,
        })
    }
}

/// The graph as a sweep reads it.
#[derive(Clone, Copy)]
pub struct Topology<'a, T> {
    /// Sender of each edge.
    pub senders: &'a [i32],
    /// Receiver of each edge.
    pub receivers: &'a [i32],
    /// Row of the sum that each edge adds to, counted as the receivers are.
    pub sums: &'a [i32],
    /// Ws h of the local nodes; before the halo exchange is over, of the owned ones.
    pub projected: &'a [T],
}

impl<T: Number> Layer<T> {
    /// Layer `l` of the processor.
    pub fn new(isa: Isa, model: &Model, l: usize) -> Result<Self> {
        let architecture = &model.spec.architecture;
        let d = architecture.width;
        let k = if architecture.edge_latents() { d } else { model.spec.n_edge_features() };
        let (edge, node) = (format!("processor.{l}.edge"), format!("processor.{l}.node"));
        let node_first = format!("{node}.0");
        let edge = (l < architecture.edge_networks()).then(|| EdgeNetwork::new(isa, model, &edge, k));
        Ok(Layer {
            isa,
            columns: padded(d),
            node_sums: architecture.micro.node_sums,
            edge: edge.transpose()?,
            zeros: (!architecture.edge_latents()).then(|| Buffer::new(T::ROWS * padded(d))),
            node_first: linear::of_latents(isa, model, &node_first, d, 1 + architecture.edge_kinds())?,
            kinds: architecture.edge_kinds(),
            node_bias: linear::bias(model, &node_first)?,
            node_tail: Tail::new(isa, model, &node)?,
            node_norm: linear::norm(model, &format!("{node}.norm"))?,
        })
    }

    /// Whether it reads Ws h of the senders.
    pub fn reads_senders(&self) -> bool {
        self.edge.is_some()
    }

    /// Ws h, where it is read: from `h`, the rows of some nodes, to `out`, as many.
    pub fn project(&self, scratch: &mut Scratch<T>, h: &[f32], out: &mut [T]) {
        let Some(edge) = &self.edge else { return };
        scratch.clock.start();
        let (isa, columns) = (self.isa, self.columns);
        let n = h.len() / columns;
        narrow(isa, h, &mut scratch.a[..h.len()]);
        product(
            isa,
            &edge.sender,
            (&scratch.a, columns),
            n,
            Addend::Nothing,
            Function::Identity,
            Output::Narrow(out),
        );
        scratch.clock.stop(Phase::Project);
    }

    /// Updates the edges and nodes of a tile in place: `edges` and `h` are its rows. `before` gives the edges'
    /// latents of before where they do not stand in `edges`, which are written only if `keep`: not where edges have features alone.
    ///
    /// The receivers of a tile are its own nodes, and senders come in as Ws h of before, so that no tile sees
    /// another's new values.
    #[allow(clippy::too_many_arguments)]
    pub fn sweep(
        &self,
        graph: &Topology<T>,
        tile: &Tile,
        scratch: &mut Scratch<T>,
        h: &mut [f32],
        edges: &mut [T],
        before: Option<&[T]>,
        keep: bool,
    ) {
        scratch.clock.start();
        let (isa, columns, n) = (self.isa, self.columns, tile.nodes.len());
        let Scratch { x, a, b, c, receivers, sums, clock, .. } = scratch;
        let (kinds, wide) = (self.kinds, (1 + self.kinds) * columns);
        // Latents left, sums right.
        for (x, h) in x.chunks_exact_mut(wide).zip(h.chunks_exact(columns)) {
            narrow(isa, h, &mut x[..columns]);
        }
        if let Some(edge) = &self.edge {
            let (bias, out) = (Addend::Bias(&edge.bias), Output::Wide(receivers));
            product(isa, &edge.receiver, (x, wide), n, bias, Function::Identity, out);
        }
        for kind in 0..kinds {
            sums[kind * WORLD * columns..][..n * columns].fill(0.0);
        }
        for chunk in tile.chunks::<T>() {
            let m = chunk.len();
            let own = (chunk.start - tile.edges.start) * columns..(chunk.end - tile.edges.start) * columns;
            let before = before.map(|b| &b[own.clone()]);
            let edges = &mut edges[own];
            let (owner, into) = (&graph.receivers[chunk.clone()], &graph.sums[chunk.clone()]);
            let first = tile.nodes.start;
            if self.node_sums == NodeSums::Before {
                scatter_add(isa, before.unwrap_or(edges), columns, sums, into, first);
            }
            let Some(edge) = &self.edge else { continue };
            let ends = Addend::Ends {
                senders: graph.projected,
                index: &graph.senders[chunk.clone()],
                receivers,
                owner,
                first,
            };
            let from = (before.unwrap_or(edges), columns);
            let (f, out) = (edge.tail.function(), Output::Narrow(a));
            product(isa, &edge.edge, from, m, ends, f, out);
            edge.tail.run(isa, m, a, b, c);
            let before = self.zeros.as_deref().or(before);
            let out = match self.node_sums {
                NodeSums::After => Normed::Edges { before, edges, keep, sums, owner: into, first },
                NodeSums::Before => Normed::Latents { before, edges },
            };
            layer_norm(isa, &edge.norm, c, m, out);
        }
        clock.stop(Phase::Edges);

        for (i, x) in x.chunks_exact_mut(wide).enumerate().take(n) {
            for kind in 0..kinds {
                let sum = &sums[(kind * WORLD + i) * columns..][..columns];
                narrow(isa, sum, &mut x[(1 + kind) * columns..][..columns]);
            }
        }
        let bias = Addend::Bias(&self.node_bias);
        let from = (&x[..], wide);
        let (f, out) = (self.node_tail.function(), Output::Narrow(a));
        product(isa, &self.node_first, from, n, bias, f, out);
        self.node_tail.run(isa, n, a, b, c);
        layer_norm::<T>(isa, &self.node_norm, c, n, Normed::Residual(h));
        clock.stop(Phase::Nodes);
    }
}
