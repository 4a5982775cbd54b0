//! One message-passing layer: edge network (eq. 3, 4), sum over the edges of a node, node network (eq. 2).

use super::kernels::{Addend, Buffer, Function, Isa, Normed, Number, Output, narrow, padded, scatter_add};
use super::mlp::{Mlp, MlpTape};
use super::profile::Phase;
use super::tiles::{Scratch, Tile, WORLD};
use super::weights::{Dense, Weights};
use m4gn_base::Result;
use m4gn_model::{Architecture, NodeSums};

/// Weights of a layer.
pub struct Layer<T> {
    pub isa: Isa,
    pub columns: usize,
    /// Which latents of its edges a node sums.
    pub node_sums: NodeSums,
    /// Columns of latents and sums.
    pub wide: usize,
    /// None where nothing reads what it would make of the edges.
    pub edge: Option<EdgeNetwork<T>>,
    /// What messages are added to where edges have no latents: nothing.
    pub zeros: Option<Buffer<T>>,
    /// Of latents and sums.
    pub node_first: Dense<T>,
    pub node: Mlp<T>,
}

/// Weights of an edge network, the first one cut by input.
pub struct EdgeNetwork<T> {
    /// Of latents, or of features.
    pub edge: Dense<T>,
    pub sender: Dense<T>,
    pub receiver: Dense<T>,
    pub rest: Mlp<T>,
}

impl<T: Number> EdgeNetwork<T> {
    /// Perceptron `name`.
    fn new(weights: &mut Weights, name: &str, architecture: &Architecture) -> Result<Self> {
        let (d, first) = (architecture.width, format!("{name}.0"));
        let k = weights.layout.find(&format!("{first}.weight"))?.1[1] - 2 * d;
        Ok(EdgeNetwork {
            edge: Dense::part(weights, &first, 0, k)?,
            sender: Dense::part(weights, &first, k, d)?,
            receiver: Dense::part(weights, &first, k + d, d)?,
            rest: Mlp::new(weights, name, architecture)?,
        })
    }
}

/// What sweeps keep for their derivative, a row a node or an edge.
pub struct SweepTape<T> {
    /// Nodes' latents before it, and the sums over their edges.
    pub nodes: Buffer<T>,
    pub edge: Option<MlpTape<T>>,
    pub node: MlpTape<T>,
}

impl<T: Number> SweepTape<T> {
    pub fn new(layer: &Layer<T>) -> Self {
        SweepTape {
            nodes: Buffer::default(),
            edge: layer.edge.as_ref().map(|e| MlpTape::new(&e.rest)),
            node: MlpTape::new(&layer.node),
        }
    }

    /// Room for this many nodes and edges.
    pub fn fit(&mut self, nodes: usize, edges: usize, layer: &Layer<T>) {
        let columns = layer.columns;
        self.nodes.fit(nodes * layer.wide);
        self.edge.iter_mut().for_each(|e| e.fit(edges, columns));
        self.node.fit(nodes, columns);
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

/// Latents of a tile's edges, or their features.
pub struct Edges<'a, T> {
    /// Where they do not stand in `now`.
    pub before: Option<&'a [T]>,
    /// Those behind the layer, if they are kept.
    pub now: &'a mut [T],
    pub keep: bool,
}

impl<T: Number> Layer<T> {
    /// Layer `l` of the processor.
    pub fn new(weights: &mut Weights, architecture: &Architecture, l: usize) -> Result<Self> {
        let d = architecture.width;
        let (edge, node) = (format!("processor.{l}.edge"), format!("processor.{l}.node"));
        let kinds = architecture.edge_kinds();
        Ok(Layer {
            isa: weights.isa,
            columns: padded(d),
            node_sums: architecture.micro.node_sums,
            edge: match l < architecture.edge_networks() {
                true => Some(EdgeNetwork::new(weights, &edge, architecture)?),
                false => None,
            },
            zeros: (!architecture.edge_latents()).then(|| Buffer::new(T::ROWS * padded(d))),
            node_first: Dense::of_latents(weights, &format!("{node}.0"), d, 1 + kinds)?,
            wide: (1 + kinds) * padded(d),
            node: Mlp::new(weights, &node, architecture)?,
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
        narrow(self.isa, h, &mut scratch.a[..h.len()]);
        let (x, n) = ((&scratch.a[..], self.columns), h.len() / self.columns);
        edge.sender.run(x, n, Addend::Nothing, Function::Identity, Output::Narrow(out));
        scratch.clock.stop(Phase::Project);
    }

    /// Updates the nodes and edges of a tile: `h` and `edges` are its rows.
    ///
    /// The receivers of a tile are its own nodes, and senders come in as Ws h of before, so that no tile sees
    /// another's new values.
    pub fn sweep(
        &self,
        graph: &Topology<T>,
        tile: &Tile,
        scratch: &mut Scratch<T>,
        h: &mut [f32],
        edges: Edges<T>,
        tape: Option<&mut SweepTape<T>>,
    ) {
        scratch.clock.start();
        let (isa, columns, wide, n) = (self.isa, self.columns, self.wide, tile.nodes.len());
        let Scratch { x, a, b, c, receivers, sums, clock, .. } = scratch;
        // Up to the end of where they stand: tiles of AMX read sixteen rows where there are fewer.
        let (x, mut edge_tape, node_tape) = match tape {
            None => (&mut x[..], None, None),
            Some(t) => (&mut t.nodes[tile.nodes.start * wide..], t.edge.as_mut(), Some(&mut t.node)),
        };
        let Edges { before: all_before, now, keep } = edges;
        // Latents left, sums right.
        for (x, h) in x.chunks_exact_mut(wide).zip(h.chunks_exact(columns)) {
            narrow(isa, h, &mut x[..columns]);
        }
        if let Some(edge) = &self.edge {
            let (bias, out) = (Addend::Bias(&edge.rest.first_bias.data), Output::Wide(&mut receivers[..]));
            edge.receiver.run((x, wide), n, bias, Function::Identity, out);
        }
        for kind in 0..wide / columns - 1 {
            sums[kind * WORLD * columns..][..n * columns].fill(0.0);
        }
        for chunk in tile.chunks::<T>() {
            let m = chunk.len();
            let own = (chunk.start - tile.edges.start) * columns..(chunk.end - tile.edges.start) * columns;
            let before = all_before.map(|b| &b[own.clone()]);
            let edges = &mut now[own];
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
            let mut rows = edge.rest.rows(edge_tape.as_deref_mut(), &chunk, [a, b]);
            let (_, place) = rows.activations.of(0, columns);
            place.fill(&edge.edge, (before.unwrap_or(edges), columns), m, ends, c);
            let before = self.zeros.as_deref().or(before);
            let out = match self.node_sums {
                NodeSums::After => Normed::Edges { before, edges, keep, sums, owner: into, first },
                NodeSums::Before => Normed::Latents { before, edges },
            };
            edge.rest.forward(m, rows, c, out);
        }
        clock.stop(Phase::Edges);

        for (i, x) in x.chunks_exact_mut(wide).take(n).enumerate() {
            for (kind, x) in x.chunks_exact_mut(columns).skip(1).enumerate() {
                narrow(isa, &sums[(kind * WORLD + i) * columns..][..columns], x);
            }
        }
        let bias = Addend::Bias(&self.node.first_bias.data);
        let mut rows = self.node.rows(node_tape, &tile.nodes, [a, b]);
        let (_, place) = rows.activations.of(0, columns);
        place.fill(&self.node_first, (x, wide), n, bias, c);
        self.node.forward(n, rows, c, Normed::Residual(h));
        clock.stop(Phase::Nodes);
    }
}
