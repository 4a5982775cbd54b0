//! The forward pass of M4GN on libtorch: the same function as the engine of the core crate, differentiable.
//!
//! The first linear layer of each edge and node MLP acts on a concatenation; here its weight is cut into one
//! block an operand, so that node blocks are multiplied once a node and gathered after, not once an edge.

use crate::processor;
use crate::shared::Shared;
use crate::weights::Weights;
use m4gn_model::{Activation, Architecture, MacroSpec, NodeSums};
use tch::{Device, Kind, Tensor};

/// One or more graphs as index and feature tensors; graphs are a disjoint union.
///
/// Nodes: the cells of all graphs, then the boundary nodes of all graphs. Segments: K a graph.
#[derive(Clone)]
pub struct Topology {
    /// Graphs in the union.
    pub graphs: i64,
    /// Nodes N.
    pub nodes: i64,
    /// Cells C, the first nodes.
    pub cells: i64,
    /// Segments of one graph, K: the most that any has; what a graph has fewer is behind its own.
    pub segments: i64,
    /// Minus infinity for segments that a graph does not have, 0 for others, `[graphs x 1 x 1 x K]`; none where each has all.
    pub absent: Option<Shared>,
    /// Sender of each edge, `[E]`.
    pub senders: Shared,
    /// Receiver of each edge, `[E]`.
    pub receivers: Shared,
    /// Physical edge features `[E x (dim + 1)]`, then those of the coarser graphs; of bodies at points the senders' positions from the receivers' at rest
    /// `[E x 3]`, from which features are made for each displacement ([`crate::contact`]).
    pub edges: Shared,
    /// 1 for world edges, 0 for the mesh's, `[E x 1]`; of bodies at points only.
    pub is_world: Option<Shared>,
    /// Node features that do not change with time `[N x n_static_features]`.
    pub fixed: Shared,
    /// Node of each (node, segment) membership, `[M]`; none where each node has exactly one segment, its own row.
    pub member_node: Option<Shared>,
    /// Segment of each membership, `[M]`.
    pub member_segment: Shared,
    /// 1 / members of each segment, `[graphs K x 1]`.
    pub segment_weight: Shared,
    /// 1 / segments of each node, `[N x 1]`; used where a node can have several.
    pub node_weight: Shared,
    /// Nodes in the order in which a recurrence reads a segment, for networks that have one.
    pub sequence: Option<Sequence>,
    /// Positional encoding `[graphs K x n_position_features]`.
    pub position: Option<Shared>,
    /// Coarser graphs, the finest first.
    pub levels: Vec<Level>,
    /// Graph of each node, and its number there in the order of places.
    pub choice: Vec<[u32; 2]>,
    /// Positional encoding of the nodes `[N x node_rwse_steps]`.
    pub walk: Option<Shared>,
}

/// What a recurrence reads of each segment.
#[derive(Clone)]
pub struct Sequence {
    /// Nodes, the first again where there are no more `[graphs K x longest]`.
    pub nodes: Shared,
    /// The last step that counts `[graphs K x 1]`.
    pub last: Shared,
}

/// A coarser graph, and the way between it and the next finer one: the sums of rows `finer` times `share` are rows `coarse`, and
/// the transpose.
#[derive(Clone)]
pub struct Level {
    /// Nodes.
    pub nodes: i64,
    /// Sender of each edge.
    pub senders: Shared,
    /// Receiver of each edge.
    pub receivers: Shared,
    /// Row of the finer graph of each term.
    pub finer: Shared,
    /// Row of this graph of each term.
    pub coarse: Shared,
    /// Factor of each term `[terms x 1]`.
    pub share: Shared,
}

/// Who hears whom.
#[derive(Clone, Copy)]
pub(crate) struct Links<'a> {
    pub nodes: i64,
    pub senders: &'a Tensor,
    pub receivers: &'a Tensor,
    /// As of [`Topology`], where world edges are summed apart.
    pub is_world: Option<&'a Tensor>,
}

impl Topology {
    pub(crate) fn links(&self) -> Links<'_> {
        Links { nodes: self.nodes, senders: &self.senders, receivers: &self.receivers, is_world: None }
    }
}

impl Level {
    pub(crate) fn links(&self) -> Links<'_> {
        Links { nodes: self.nodes, senders: &self.senders, receivers: &self.receivers, is_world: None }
    }
}

/// Rows picked from and summed into tensors by expanded indices, the fast path of libtorch's CPU kernels.
pub(crate) fn pick(values: &Tensor, index: &Tensor) -> Tensor {
    values.gather(0, &index.unsqueeze(1).expand([-1, values.size()[1]], false), false)
}

pub(crate) fn sum_into(rows: i64, values: &Tensor, index: &Tensor) -> Tensor {
    let width = values.size()[1];
    Tensor::zeros([rows, width], (values.kind(), values.device())).scatter_add(
        0,
        &index.unsqueeze(1).expand([-1, width], false),
        values,
    )
}

/// Latent rows: fp32, and in the products' arithmetic (the same tensor where that is fp32).
pub struct Rows {
    pub(crate) full: Tensor,
    pub(crate) operand: Tensor,
}

impl Rows {
    fn share(&self) -> Self {
        Rows { full: self.full.shallow_clone(), operand: self.operand.shallow_clone() }
    }
}

/// The network with its weights, for as many forward passes as the weights live.
pub struct Network<'a> {
    architecture: &'a Architecture,
    weights: &'a Weights,
}

impl<'a> Network<'a> {
    /// Puts an architecture and weights together.
    pub fn new(architecture: &'a Architecture, weights: &'a Weights) -> Self {
        Network { architecture, weights }
    }

    /// What it is.
    pub(crate) fn architecture(&self) -> &Architecture {
        self.architecture
    }

    /// Normalised node fields `[N x inputs]` and edge features, those of coarser graphs included, to normalised outputs `[C x outputs]`.
    pub fn forward(&self, graph: &Topology, fields: &Tensor, edges: &Tensor) -> Tensor {
        let mut features = Tensor::cat(&[fields, &graph.fixed], 1);
        if let Some(walk) = &graph.walk {
            features += float(&self.mlp("encoder.position", walk));
        }
        let h = self.encode("encoder.node", &features);
        let rows = processor::run(self, graph, h, edges);
        float(&self.mlp("decoder", &rows))
    }

    /// h + dispatch([h, h_S]).
    pub(crate) fn dispatch(&self, h: &Rows, context: &Tensor) -> Rows {
        let both = Tensor::cat(&[&h.full, context], 1);
        self.rows(&h.full + float(&self.linear("segment.dispatch", &both)))
    }

    /// Scores of the nodes at a level of a graph U-net `[N x 1]`.
    pub(crate) fn scores(&self, level: usize, h: &Rows) -> Tensor {
        let p = self.weights.full(&format!("processor.{level}.score.weight"));
        h.full.matmul(&(p / p.norm()).tr())
    }

    /// f(W a + b) of a graph convolution.
    pub(crate) fn convolution(&self, layer: usize, sums: &Tensor) -> Tensor {
        float(&self.activate(&self.linear(&format!("processor.{layer}.convolution"), sums)))
    }

    /// The first layer is in fp32 in either precision, as in the engine: physical features differ in more digits than
    /// bfloat16 has.
    pub(crate) fn encode(&self, name: &str, x: &Tensor) -> Rows {
        let full = |part: &str| self.weights.full(&format!("{name}.0.{part}"));
        let first = float(x).linear(full("weight"), Some(full("bias")));
        let x = self.hidden(name, self.activate(&first));
        self.add_normed(name, None, &x)
    }

    /// Eq. 2 to 4: new edges from edges and their ends, new nodes from nodes and the sum of their edges.
    pub(crate) fn message_passing(&self, layer: usize, graph: &Topology, h: &mut Rows, e: &mut Rows) {
        let is_world = self.apart(graph);
        *e = self.pass(layer, Links { is_world, ..graph.links() }, h, &e.operand, Some(e));
    }

    /// Eq. 1 of the edges.
    pub(crate) fn encode_edges(&self, graph: &Topology, features: &Tensor) -> Rows {
        let own = self.encode("encoder.edge", features);
        match self.apart(graph) {
            Some(is_world) => {
                let other = self.encode("encoder.world_edge", features).full;
                self.rows(own.full * (1.0 - is_world) + other * is_world)
            }
            None => own,
        }
    }

    /// Which edges are world edges, where these have weights of their own.
    fn apart<'g>(&self, graph: &'g Topology) -> Option<&'g Tensor> {
        graph.is_world.as_deref().filter(|_| self.architecture.edge_kinds() > 1)
    }

    /// Messages of the edges' features, where edges have no latents.
    pub(crate) fn feature_passing(&self, layer: usize, links: Links, h: &mut Rows, features: &Tensor) {
        self.pass(layer, links, h, &self.operand(features), None);
    }

    /// New nodes, and what edges of what they read (`own`) and of the latents before have become.
    fn pass(&self, layer: usize, links: Links, h: &mut Rows, own: &Tensor, before: Option<&Rows>) -> Rows {
        let (edge, node) = (format!("processor.{layer}.edge"), format!("processor.{layer}.node"));
        let d = self.architecture.width as i64;
        let none = None::<&Tensor>;
        let edges = match (layer < self.architecture.edge_networks(), before) {
            (false, Some(before)) => before.share(),
            _ => {
                let first = self.weights.product(&format!("{edge}.0.weight"));
                let blocks = first.split_with_sizes([own.size()[1], d, d], 1);
                let own = own.linear(&blocks[0], Some(self.weights.product(&format!("{edge}.0.bias"))));
                let senders = pick(&h.operand.linear(&blocks[1], none), links.senders);
                let receivers = pick(&h.operand.linear(&blocks[2], none), links.receivers);
                let first = self.activate(&(own + senders + receivers));
                self.add_normed(&edge, before, &self.hidden(&edge, first))
            }
        };
        let summed = match (self.architecture.micro.node_sums, before) {
            (NodeSums::Before, Some(before)) => before,
            _ => &edges,
        };
        let blocks = self.weights.product(&format!("{node}.0.weight")).split(d, 1);
        let own = h.operand.linear(&blocks[0], Some(self.weights.product(&format!("{node}.0.bias"))));
        let summed = match links.is_world {
            Some(is_world) => vec![&summed.full * (1.0 - is_world), &summed.full * is_world],
            None => vec![summed.full.shallow_clone()],
        };
        let first = summed.iter().zip(&blocks[1..]).fold(own, |first, (rows, block)| {
            first.addmm(&self.operand(&sum_into(links.nodes, rows, links.receivers)), &block.tr())
        });
        *h = self.add_normed(&node, Some(h), &self.hidden(&node, self.activate(&first)));
        edges
    }

    /// `residual + layer_norm(x)`.
    fn add_normed(&self, name: &str, residual: Option<&Rows>, x: &Tensor) -> Rows {
        let normed = self.layer_norm(&format!("{name}.norm"), x);
        self.rows(match residual {
            Some(residual) => &residual.full + normed,
            None => float(&normed),
        })
    }

    pub(crate) fn rows(&self, full: Tensor) -> Rows {
        Rows { operand: self.operand(&full), full }
    }

    /// Eq. 9 to 13: segments as means of their nodes, then pre-norm self-attention; `[graphs K x d]`.
    pub(crate) fn segment_transformer(&self, spec: &MacroSpec, graph: &Topology, h: &Tensor) -> Tensor {
        // Sums here are new tensors: the backward pass needs the old ones.
        let (d, heads) = (self.architecture.width as i64, spec.heads as i64);
        let sum = |h: &Tensor| sum_into(graph.graphs * graph.segments, h, &graph.member_segment);
        let pooled = match (&graph.sequence, &graph.member_node) {
            (Some(sequence), _) => self.recurrence(sequence, h),
            (None, Some(index)) => sum(&pick(h, index)) * &*graph.segment_weight,
            (None, None) => sum(h) * &*graph.segment_weight,
        };
        let mut s = self.encode("segment.encoder", &pooled).full;
        if let Some(position) = &graph.position {
            s = &s + float(&self.mlp("segment.position", position));
        }
        let (b, k) = (graph.graphs, graph.segments);
        let scale = 1.0 / ((d / heads) as f64).sqrt();
        for l in 0..spec.layers {
            let name = |part: &str| format!("segment.transformer.{l}.{part}");
            let w = |part: &str| self.weights.full(&name(part));
            let x = self.layer_norm(&name("norm1"), &s);
            let split = |part: &str| {
                x.linear(w(part), None::<&Tensor>).view([b, k, heads, d / heads]).transpose(1, 2)
            };
            let scores = split("q.weight").matmul(&split("k.weight").transpose(-1, -2)) * scale;
            let scores = match &graph.absent {
                Some(absent) => scores + &**absent,
                None => scores,
            };
            let mixed = scores
                .softmax(-1, Kind::Float)
                .matmul(&split("v.weight"))
                .transpose(1, 2)
                .reshape([b * k, d]);
            s = &s + mixed.linear(w("o.weight"), Some(w("o.bias")));
            let x = self.layer_norm(&name("norm2"), &s).linear(w("ffn.0.weight"), Some(w("ffn.0.bias")));
            s = &s + self.activate(&x).linear(w("ffn.1.weight"), Some(w("ffn.1.bias")));
        }
        s
    }

    /// The last states of libtorch's gated recurrent unit over the nodes of each segment.
    fn recurrence(&self, sequence: &Sequence, h: &Tensor) -> Tensor {
        let (d, rows) = (h.size()[1], sequence.nodes.size()[0]);
        let weights = ["input.weight", "hidden.weight", "input.bias", "hidden.bias"];
        let weights = weights.map(|part| self.weights.full(&format!("segment.recurrence.{part}")));
        let x = pick(h, &sequence.nodes.view([-1])).view([rows, -1, d]);
        let start = Tensor::zeros([1, rows, d], (Kind::Float, h.device()));
        // Of one layer, in one direction. "train" keeps what cuDNN needs for derivatives.
        let (states, _) = x.gru(&start, &weights, true, 1, 0.0, true, false, true);
        states.gather(1, &sequence.last.unsqueeze(2).expand([-1, 1, d], false), false).squeeze_dim(1)
    }

    /// Each node's segment row, or the mean over its segments.
    pub(crate) fn to_nodes(&self, graph: &Topology, segments: &Tensor) -> Tensor {
        let rows = pick(segments, &graph.member_segment);
        match &graph.member_node {
            Some(index) => sum_into(graph.nodes, &rows, index) * &*graph.node_weight,
            None => rows,
        }
    }

    /// A whole MLP, without a layer norm.
    fn mlp(&self, name: &str, x: &Tensor) -> Tensor {
        self.hidden(name, self.activate(&self.linear(&format!("{name}.0"), x)))
    }

    /// An MLP behind its first linear layer and activation.
    fn hidden(&self, name: &str, first: Tensor) -> Tensor {
        let mut x = self.linear(&format!("{name}.1"), &first);
        for i in 2..=self.architecture.hidden_layers {
            x = self.linear(&format!("{name}.{i}"), &self.activate(&x));
        }
        x
    }

    fn linear(&self, name: &str, x: &Tensor) -> Tensor {
        let weight = self.weights.product(&format!("{name}.weight"));
        self.operand(x).linear(weight, Some(self.weights.product(&format!("{name}.bias"))))
    }

    fn activate(&self, x: &Tensor) -> Tensor {
        match self.architecture.activation {
            Activation::Relu => x.relu(),
            Activation::Silu => x.silu(),
        }
    }

    /// The operand of a large product in the products' arithmetic.
    fn operand(&self, x: &Tensor) -> Tensor {
        if self.weights.is_half() { x.to_kind(Kind::BFloat16) } else { x.shallow_clone() }
    }

    fn layer_norm(&self, name: &str, x: &Tensor) -> Tensor {
        let weight = self.weights.full(&format!("{name}.weight"));
        // The CPU kernel takes bfloat16 rows with fp32 scales; the CUDA kernel wants one kind.
        let x = if x.device() == Device::Cpu { x.shallow_clone() } else { float(x) };
        let bias = self.weights.full(&format!("{name}.bias"));
        x.layer_norm([self.architecture.width as i64], Some(weight), Some(bias), 1e-5, true)
    }
}

fn float(x: &Tensor) -> Tensor {
    x.to_kind(Kind::Float)
}
