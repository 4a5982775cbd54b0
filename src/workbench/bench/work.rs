//! The work of a step, counted from the shapes.
//!
//! Operations are the multiplications and additions of the matrix products, after the algebraic split: the first
//! layer of an edge network is W [e, h_s, h_r] = We e + Ws h_s + Wr h_r, so that two thirds of it are done once a
//! node; node types and offsets enter as a table; the encoding of the edges does not change with time and is done once
//! where there is memory for it. Biases, activations, norms, gathers and sums are not counted: what they cost shows as time in which the
//! products' units idle.
//!
//! Bytes are those of the arrays that do not stay in a tile: each read and written once a pass, a gathered sender row
//! once an edge. A cache that holds an array spares the memory some of them.

use m4gn_engine::{Phase, Precision};
use m4gn_model::{Kind, ModelSpec};

/// Sizes of a graph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Nodes, N.
    pub nodes: usize,
    /// Of them, those that are predicted.
    pub cells: usize,
    /// Directed edges, E.
    pub edges: usize,
    /// Segments, K; 0 without a macro stage.
    pub segments: usize,
}

/// Bytes of a latent value in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Storage {
    /// Of edges.
    pub edge: usize,
    /// Of nodes.
    pub node: usize,
    /// Of the senders' part of the edge networks, Ws h.
    pub sender: usize,
}

impl Storage {
    /// What the native engine stores: nodes are sums over all layers, and stay in fp32.
    pub fn of(precision: Precision) -> Self {
        let short = match precision {
            Precision::Fp32 => 4,
            Precision::Bf16 => 2,
        };
        Storage { edge: short, node: 4, sender: short }
    }
}

/// The work of a part of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Work {
    /// Which part.
    pub phase: Phase,
    /// Multiplications and additions of the matrix products.
    pub flops: f64,
    /// Bytes read and written.
    pub bytes: f64,
}

/// All parts of a step that have work, in the order of [`Phase::ALL`]. `encoded`: the encoded edges are kept, and
/// not computed in a step.
pub fn step(spec: &ModelSpec, sizes: Sizes, storage: Storage, encoded: bool) -> Vec<Work> {
    let a = &spec.architecture;
    let [d, hidden] = [a.width, a.hidden_layers].map(|x| x as f64);
    let [nodes, cells, edges, k] = [sizes.nodes, sizes.cells, sizes.edges, sizes.segments].map(|x| x as f64);
    let [edge, node, sender] = [storage.edge, storage.node, storage.sender].map(|x| x as f64);
    let layers = match a.kind {
        // Two on each graph and one on the coarsest, each with half the nodes of the one before.
        Kind::BsmsGnn { levels } | Kind::GUNet { levels } => 4.0 - 3.0 * 0.5f64.powi(levels as i32),
        _ => a.layers() as f64,
    };
    // Of them, those that make new latents of the edges.
    let updates = layers - (a.layers() - a.edge_networks()) as f64;
    let (inputs, outputs) = (spec.n_field_inputs() as f64, spec.n_outputs() as f64);
    let features = spec.n_edge_features() as f64;
    let square = 2.0 * d * d;
    let index = 4.0;
    let work = |phase, flops, bytes| Work { phase, flops, bytes };
    let mut list = vec![work(
        Phase::EncodeNodes,
        nodes * (2.0 * inputs * d + hidden * square),
        nodes * (4.0 * inputs + node * d),
    )];
    if a.needs().edges && a.edge_latents() && !encoded {
        list.push(work(
            Phase::EncodeEdges,
            edges * (2.0 * features * d + hidden * square),
            edges * (4.0 * features + edge * d),
        ));
    }
    let passed = [
        work(Phase::Project, updates * nodes * square, updates * nodes * d * (node + sender)),
        work(
            Phase::Edges,
            updates * (edges * (1.0 + hidden) + nodes) * square,
            layers * (edges * (d * (2.0 * edge + sender) + index) + nodes * (node * d + index)),
        ),
        work(
            Phase::Nodes,
            layers * nodes * square * (1.0 + a.edge_kinds() as f64 + hidden),
            layers * nodes * 2.0 * node * d,
        ),
    ];
    // Latents are read, scaled and written; then gathered along the edges, and written anew.
    let convolved = [
        work(Phase::Project, 0.0, layers * nodes * 2.0 * node * d),
        work(Phase::Edges, 0.0, layers * (edges * (node * d + 2.0 * index) + nodes * node * d)),
        work(Phase::Nodes, layers * nodes * square, layers * nodes * node * d),
    ];
    match &a.kind {
        Kind::Gcn { .. } => list.extend(convolved),
        _ => list.extend(passed),
    }
    if let Some(m4gn) = a.m4gn() {
        let m = &m4gn.segment_transformer;
        let layer = k * (4.0 * d * d + 2.0 * d * m.ffn_width as f64) * 2.0 + 4.0 * k * k * d;
        let dispatch = if m4gn.layers_after > 0 { 1.0 } else { 0.0 };
        let recurrence = if a.needs().sequences { 6.0 * square * nodes } else { 0.0 };
        list.push(work(
            Phase::Segments,
            recurrence
                + k * (1.0 + hidden) * square
                + m.layers as f64 * layer
                + dispatch * (nodes + k) * square,
            nodes * node * d * (1.0 + 2.0 * dispatch),
        ));
    }
    // Its first layer reads h, and h_S once a segment.
    let (first, further) = (square, (hidden - 1.0) * square + 2.0 * d * outputs);
    let segments = if a.decodes_segments() { k * first } else { 0.0 };
    list.push(work(Phase::Decode, cells * (first + further) + segments, cells * (node * d + 4.0 * outputs)));
    list
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Shape;

    const FP32: Storage = Storage { edge: 4, node: 4, sender: 4 };

    fn shape(layers: usize, width: usize, hidden_layers: usize, segments: Option<usize>) -> Shape {
        Shape { dim: 2, layers, width, hidden_layers, segments }
    }

    #[test]
    fn a_network_of_width_one_on_paper() {
        // Width 1, one hidden layer, 2 layers; 3 nodes, all cells, 4 edges. A product of a row costs 2 each way.
        let sizes = Sizes { nodes: 3, cells: 3, edges: 4, segments: 0 };
        let list = step(&shape(2, 1, 1, None).spec(), sizes, FP32, false);
        let flops: Vec<f64> = list.iter().map(|w| w.flops).collect();
        // Node encoder 3 (2 x 3 + 2), edge encoder 4 (2 x 3 + 2), senders 2 x 3 x 2, edges 2 (4 x 4 + 3 x 2),
        // nodes 2 x 3 x 6, decoder 3 (2 + 6).
        assert_eq!(flops, [24.0, 32.0, 12.0, 44.0, 36.0, 24.0]);
        let bytes: Vec<f64> = list.iter().map(|w| w.bytes).collect();
        assert_eq!(bytes, [48.0, 64.0, 48.0, 176.0, 48.0, 48.0]);
        let kept = step(&shape(2, 1, 1, None).spec(), sizes, FP32, true);
        assert_eq!(kept.len() + 1, list.len());
        assert!(kept.iter().all(|w| list.contains(w) && w.phase != Phase::EncodeEdges));
    }

    #[test]
    fn seven_layers_of_128_on_the_published_size() {
        let sizes = Sizes { nodes: 1885, cells: 1885, edges: 11264, segments: 0 };
        let spec = shape(7, 128, 2, None).spec();
        let total = |encoded| step(&spec, sizes, FP32, encoded).iter().map(|w| w.flops).sum::<f64>();
        // Per layer 11264 x 3 and 1885 x 6 rows through 128 x 128; encoder and decoder two and two rows a node, and
        // 2 x 128 x 3 for the fields at both ends.
        let rows = 7.0 * (11264.0 * 3.0 + 1885.0 * 6.0) + 1885.0 * 4.0;
        assert_eq!(total(true), rows * 32768.0 + 1885.0 * 2.0 * 768.0);
        assert_eq!(total(false) - total(true), 11264.0 * (2.0 * 32768.0 + 768.0));
        assert!((total(false) - 11.3e9).abs() < 0.05e9);
    }

    #[test]
    fn the_macro_stage_is_small() {
        let sizes = Sizes { nodes: 1885, cells: 1885, edges: 11264, segments: 36 };
        let list = step(&shape(7, 128, 2, Some(36)).spec(), sizes, FP32, true);
        let stage = list.iter().find(|w| w.phase == Phase::Segments).unwrap();
        // Encoder 3 rows; per layer q, k, v, o and twice 4 rows a segment, and scores and mixtures.
        let expected = 36.0 * 32768.0 * (3.0 + 4.0 * 12.0) + 4.0 * 4.0 * 36.0 * 36.0 * 128.0;
        assert_eq!(stage.flops, expected);
    }
}
