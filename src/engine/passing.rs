//! One message-passing layer: edge network (eq. 3), sum over the edges of a node, node network (eq. 2).

use super::kernels::{
    Addend, Buffer, Function, Isa, Norm, Normed, Number, Output, Packed, layer_norm, narrow, padded, product,
};
use super::linear::{self, Tail};
use super::profile::Phase;
use super::tiles::{Scratch, Tile};
use m4gn_mesh::Result;
use m4gn_model::Model;

/// Weights of a layer, the first one of the edge network cut by input.
#[derive(Debug)]
pub struct Layer<T> {
    isa: Isa,
    columns: usize,
    /// Of latents, or of features.
    edge_edge: Packed<T>,
    edge_sender: Packed<T>,
    edge_receiver: Packed<T>,
    edge_bias: Vec<f32>,
    edge_tail: Tail<T>,
    edge_norm: Norm,
    /// What messages are added to where edges have no latents: nothing.
    zeros: Option<Buffer<T>>,
    /// Of latents and sums.
    node_first: Packed<T>,
    node_bias: Vec<f32>,
    node_tail: Tail<T>,
    node_norm: Norm,
}

/// The graph as a sweep reads it.
#[derive(Clone, Copy)]
pub struct Topology<'a, T> {
    /// Sender of each edge.
    pub senders: &'a [i32],
    /// Receiver of each edge.
    pub receivers: &'a [i32],
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
        let (edge_first, node_first) = (format!("{edge}.0"), format!("{node}.0"));
        Ok(Layer {
            isa,
            columns: padded(d),
            edge_edge: linear::columns(isa, model, &edge_first, 0..k)?,
            edge_sender: linear::columns(isa, model, &edge_first, k..k + d)?,
            edge_receiver: linear::columns(isa, model, &edge_first, k + d..k + 2 * d)?,
            edge_bias: linear::bias(model, &edge_first)?,
            edge_tail: Tail::new(isa, model, &edge)?,
            edge_norm: linear::norm(model, &format!("{edge}.norm"))?,
            zeros: (!architecture.edge_latents()).then(|| Buffer::new(T::ROWS * padded(d))),
            node_first: linear::of_two(isa, model, &node_first, d)?,
            node_bias: linear::bias(model, &node_first)?,
            node_tail: Tail::new(isa, model, &node)?,
            node_norm: linear::norm(model, &format!("{node}.norm"))?,
        })
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        let parts = [&self.edge_edge, &self.edge_sender, &self.edge_receiver, &self.node_first];
        parts.map(|p| p.bytes()).iter().sum::<usize>() + self.edge_tail.bytes() + self.node_tail.bytes()
    }

    /// Ws h: from `h`, the rows of some nodes, to `out`, as many.
    pub fn project(&self, scratch: &mut Scratch<T>, h: &[f32], out: &mut [T]) {
        scratch.clock.start();
        let (isa, columns) = (self.isa, self.columns);
        let n = h.len() / columns;
        narrow(isa, h, &mut scratch.a[..h.len()]);
        product(
            isa,
            &self.edge_sender,
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
        // Latents left, sums right.
        for (x, h) in x.chunks_exact_mut(2 * columns).zip(h.chunks_exact(columns)) {
            narrow(isa, h, &mut x[..columns]);
        }
        product(
            isa,
            &self.edge_receiver,
            (x, 2 * columns),
            n,
            Addend::Bias(&self.edge_bias),
            Function::Identity,
            Output::Wide(receivers),
        );
        sums[..n * columns].fill(0.0);
        for chunk in tile.chunks::<T>() {
            let m = chunk.len();
            let own = (chunk.start - tile.edges.start) * columns..(chunk.end - tile.edges.start) * columns;
            let before = before.map(|b| &b[own.clone()]);
            let edges = &mut edges[own];
            let owner = &graph.receivers[chunk.clone()];
            let first = tile.nodes.start;
            let ends = Addend::Ends {
                senders: graph.projected,
                index: &graph.senders[chunk.clone()],
                receivers,
                owner,
                first,
            };
            let from = (before.unwrap_or(edges), columns);
            let (f, out) = (self.edge_tail.function(), Output::Narrow(a));
            product(isa, &self.edge_edge, from, m, ends, f, out);
            self.edge_tail.run(isa, m, a, b, c);
            let before = self.zeros.as_deref().or(before);
            let out = Normed::Edges { before, edges, keep, sums, owner, first };
            layer_norm(isa, &self.edge_norm, c, m, out);
        }
        clock.stop(Phase::Edges);

        for (x, sum) in x.chunks_exact_mut(2 * columns).zip(sums.chunks_exact(columns)).take(n) {
            narrow(isa, sum, &mut x[columns..]);
        }
        let bias = Addend::Bias(&self.node_bias);
        let from = (&x[..], 2 * columns);
        let (f, out) = (self.node_tail.function(), Output::Narrow(a));
        product(isa, &self.node_first, from, n, bias, f, out);
        self.node_tail.run(isa, n, a, b, c);
        layer_norm::<T>(isa, &self.node_norm, c, n, Normed::Residual(h));
        clock.stop(Phase::Nodes);
    }
}
