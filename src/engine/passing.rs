//! One message-passing layer: edge network (eq. 3), sum over the edges of a node, node network (eq. 2).

use super::Isa;
use super::kernels;
use super::linear::{Norm, Tail, Weight};
use super::rows;
use super::tiles::Part;
use crate::Result;
use crate::model::Model;

/// Weights of a layer, the first ones cut by input.
#[derive(Debug)]
pub struct Layer {
    edge_edge: Weight,
    edge_sender: Weight,
    edge_receiver: Weight,
    edge_tail: Tail,
    edge_norm: Norm,
    node_node: Weight,
    node_sum: Weight,
    node_tail: Tail,
    node_norm: Norm,
}

/// The graph as a sweep reads it.
pub struct Topology<'a> {
    /// Edges of owned node i: `row[i]..row[i + 1]`.
    pub row: &'a [u32],
    /// Sender of each edge, a local node.
    pub senders: &'a [i32],
    /// Receiver of each edge.
    pub receivers: &'a [i32],
    /// Ws h of all local nodes.
    pub senders_part: &'a [f32],
}

impl Layer {
    /// Layer `l` of the processor.
    pub fn new(model: &Model, l: usize) -> Result<Self> {
        let d = model.spec.architecture.width;
        let (edge, node) = (format!("processor.{l}.edge"), format!("processor.{l}.node"));
        let (edge_first, node_first) = (format!("{edge}.0"), format!("{node}.0"));
        Ok(Layer {
            edge_edge: Weight::columns(model, &edge_first, 0..d)?,
            edge_sender: Weight::columns(model, &edge_first, d..2 * d)?,
            edge_receiver: Weight::columns(model, &edge_first, 2 * d..3 * d)?,
            edge_tail: Tail::new(model, &edge)?,
            edge_norm: Norm::new(model, &format!("{edge}.norm"))?,
            node_node: Weight::columns(model, &node_first, 0..d)?,
            node_sum: Weight::columns(model, &node_first, d..2 * d)?,
            node_tail: Tail::new(model, &node)?,
            node_norm: Norm::new(model, &format!("{node}.norm"))?,
        })
    }

    /// Ws h for n nodes.
    pub fn project_senders(&self, out: &mut [f32], h: &[f32], n: usize) {
        self.edge_sender.apply(out, h, n);
    }

    /// Updates the edges and nodes of a part, tile by tile, in place. The receivers of a tile are its own nodes,
    /// and senders come in as Ws h of before, so that no tile sees another's new values.
    pub fn sweep(
        &self,
        isa: Isa,
        d: usize,
        graph: &Topology,
        part: &mut Part,
        nodes: &mut [f32],
        edges: &mut [f32],
    ) {
        for tile in &part.tiles {
            let (n, n_edges) = (tile.nodes.len(), tile.edges.len());
            let h = &mut nodes[rows(&tile.nodes, part.nodes.start, d)];
            let e = &mut edges[rows(&tile.edges, part.edges.start, d)];
            let c = &mut part.c[..n * d];

            let (tail, norm) = (&self.edge_tail, &self.edge_norm);
            self.edge_receiver.apply(c, h, n);
            kernels::bias_activate(isa, c, &tail.first_bias, kernels::Function::Identity);
            self.edge_edge.apply(&mut part.a, e, n_edges);
            kernels::gather_activate(
                isa,
                &mut part.a[..n_edges * d],
                d,
                graph.senders_part,
                &graph.senders[tile.edges.clone()],
                c,
                &graph.receivers[tile.edges.clone()],
                tile.nodes.start,
                tail.first_function,
            );
            let x = tail.run(isa, n_edges, &mut part.a, &mut part.b);
            kernels::layer_norm_residual(isa, x, &tail.last_bias, &norm.gain, &norm.shift, e);

            let (tail, norm) = (&self.node_tail, &self.node_norm);
            kernels::sum_edges(isa, e, d, &graph.row[tile.nodes.start..=tile.nodes.end], c);
            self.node_node.apply(&mut part.a, h, n);
            self.node_sum.apply_add(&mut part.a, c, n);
            kernels::bias_activate(isa, &mut part.a[..n * d], &tail.first_bias, tail.first_function);
            let x = tail.run(isa, n, &mut part.a, &mut part.b);
            kernels::layer_norm_residual(isa, x, &tail.last_bias, &norm.gain, &norm.shift, h);
        }
    }
}
