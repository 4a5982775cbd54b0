//! The work of a step, counted from the shapes.
//!
//! Operations are the multiplications and additions of the matrix products, after the algebraic split: the first
//! layer of an edge network is W [e, h_s, h_r] = We e + Ws h_s + Wr h_r, so that two thirds of it are done once a
//! node; node types and offsets enter as a table; the encoding of the edges does not change with time and is not part
//! of a step. Biases, activations, norms, gathers and sums are not counted: what they cost shows as time in which the
//! products' units idle.
//!
//! Bytes are those of the arrays that do not stay in a tile: each read and written once a pass, a gathered sender row
//! once an edge. A cache that holds an array spares the memory some of them.

use crate::model::ModelSpec;

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

/// A part of a step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Phase {
    /// What it is.
    pub name: &'static str,
    /// Multiplications and additions of the matrix products.
    pub flops: f64,
    /// Bytes read and written.
    pub bytes: f64,
}

/// Products of one edge in one layer: We e and the further layers of the network.
pub fn edge_flops(spec: &ModelSpec) -> f64 {
    let a = &spec.architecture;
    square(a.width) * (1 + a.hidden_layers) as f64
}

/// All parts of a step, in their order.
pub fn phases(spec: &ModelSpec, sizes: Sizes, storage: Storage) -> Vec<Phase> {
    let a = &spec.architecture;
    let [d, hidden] = [a.width, a.hidden_layers].map(|x| x as f64);
    let [nodes, cells, edges, k] = [sizes.nodes, sizes.cells, sizes.edges, sizes.segments].map(|x| x as f64);
    let [edge, node, sender] = [storage.edge, storage.node, storage.sender].map(|x| x as f64);
    let layers = (a.layers_before + a.layers_after) as f64;
    let (inputs, outputs) = (spec.n_field_inputs() as f64, spec.n_outputs() as f64);
    let square = square(a.width);
    let index = 4.0;
    let mut list = vec![
        Phase {
            name: "node encoder",
            flops: nodes * (2.0 * inputs * d + hidden * square),
            bytes: nodes * (4.0 * inputs + node * d),
        },
        Phase {
            name: "edge networks, nodes' parts",
            flops: layers * nodes * 2.0 * square,
            bytes: layers * nodes * d * (2.0 * node + sender),
        },
        Phase {
            name: "edge networks, edges",
            flops: layers * edges * edge_flops(spec),
            bytes: layers * edges * (d * (2.0 * edge + sender) + 2.0 * index),
        },
        Phase {
            name: "node networks",
            flops: layers * nodes * square * (2.0 + hidden),
            bytes: layers * nodes * (2.0 * node * d + index),
        },
    ];
    if let Some(m) = &a.segment_transformer {
        let ffn = m.ffn_width as f64;
        let layer = k * (4.0 * square + 4.0 * d * ffn) + 4.0 * k * k * d;
        list.push(Phase {
            name: "segment transformer",
            flops: k * (1.0 + hidden) * square + m.layers as f64 * layer,
            bytes: nodes * node * d,
        });
        if a.layers_after > 0 {
            list.push(Phase {
                name: "dispatch to nodes",
                flops: (nodes + k) * square,
                bytes: nodes * 2.0 * node * d,
            });
        }
    }
    // Its first layer reads h, and h_S once a segment; without hidden layers that layer is the last.
    let (first, further) = match a.hidden_layers {
        0 => (2.0 * d * outputs, 0.0),
        _ => (square, (hidden - 1.0) * square + 2.0 * d * outputs),
    };
    list.push(Phase {
        name: "decoder",
        flops: cells * (first + further) + k * first,
        bytes: cells * (node * d + 4.0 * outputs),
    });
    list
}

/// Operations of one row through a layer of this width.
fn square(width: usize) -> f64 {
    (2 * width * width) as f64
}

/// Bytes that the engine keeps for a graph beside the mesh: latents and encodings of nodes and edges, features,
/// and connectivity. Tiles, halos and weights are small beside them.
pub fn kept_bytes(spec: &ModelSpec, sizes: Sizes, storage: Storage, encoded_edges: bool) -> f64 {
    let d = spec.architecture.width as f64;
    let (nodes, edges) = (sizes.nodes as f64, sizes.edges as f64);
    let encoded = if encoded_edges { storage.edge as f64 } else { 0.0 };
    edges * (d * (storage.edge as f64 + encoded) + 8.0)
        + nodes * (d * (storage.node + storage.sender) as f64 + 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Shape;

    const FP32: Storage = Storage {
        edge: 4,
        node: 4,
        sender: 4,
    };

    fn shape(layers: usize, width: usize, hidden_layers: usize, segments: Option<usize>) -> Shape {
        Shape {
            dim: 2,
            layers,
            width,
            hidden_layers,
            segments,
        }
    }

    #[test]
    fn a_network_of_width_one_on_paper() {
        // Width 1, one hidden layer, 2 layers; 3 nodes, all cells, 4 edges. A product of a row costs 2 each way.
        let sizes = Sizes {
            nodes: 3,
            cells: 3,
            edges: 4,
            segments: 0,
        };
        let list = phases(&shape(2, 1, 1, None).spec(), sizes, FP32);
        let flops: Vec<f64> = list.iter().map(|p| p.flops).collect();
        // Encoder 3 (2 x 3 + 2), senders and receivers 2 x 3 x 4, edges 2 x 4 x 4, nodes 2 x 3 x 6,
        // decoder 3 (2 + 6).
        assert_eq!(flops, [24.0, 24.0, 32.0, 36.0, 24.0]);
        let bytes: Vec<f64> = list.iter().map(|p| p.bytes).collect();
        assert_eq!(bytes, [48.0, 72.0, 160.0, 72.0, 48.0]);
    }

    #[test]
    fn seven_layers_of_128_on_the_published_size() {
        let sizes = Sizes {
            nodes: 1885,
            cells: 1885,
            edges: 11264,
            segments: 0,
        };
        let spec = shape(7, 128, 2, None).spec();
        let total: f64 = phases(&spec, sizes, FP32).iter().map(|p| p.flops).sum();
        // Per layer 11264 x 3 and 1885 x 6 rows through 128 x 128; encoder and decoder two and two rows a node, and
        // 2 x 128 x 3 for the fields at both ends.
        let rows = 7.0 * (11264.0 * 3.0 + 1885.0 * 6.0) + 1885.0 * 4.0;
        assert_eq!(total, rows * 32768.0 + 1885.0 * 2.0 * 768.0);
        // 11.3 GFLOP with the encoding of the edges, which is done once.
        assert!((total + 11264.0 * 2.0 * 32768.0 - 11.3e9).abs() < 0.05e9);
    }

    #[test]
    fn the_macro_stage_is_small() {
        let sizes = Sizes {
            nodes: 1885,
            cells: 1885,
            edges: 11264,
            segments: 36,
        };
        let list = phases(&shape(7, 128, 2, Some(36)).spec(), sizes, FP32);
        let stage = list.iter().find(|p| p.name == "segment transformer").unwrap();
        // Encoder 3 rows; per layer q, k, v, o and twice 4 rows a segment, and scores and mixtures.
        let expected = 36.0 * 32768.0 * (3.0 + 4.0 * 12.0) + 4.0 * 4.0 * 36.0 * 36.0 * 128.0;
        assert_eq!(stage.flops, expected);
    }

    #[test]
    fn a_million_cells_in_half_precision() {
        // 100^3 cells and 6 x 100^2 boundary nodes; faces and boundary faces both ways.
        let sizes = Sizes {
            nodes: 1_060_000,
            cells: 1_000_000,
            edges: 2 * (3 * 99 * 100 * 100) + 2 * 60_000,
            segments: 0,
        };
        let storage = Storage {
            edge: 2,
            node: 4,
            sender: 2,
        };
        let mut s = shape(7, 128, 2, None);
        s.dim = 3;
        let gib = kept_bytes(&s.spec(), sizes, storage, false) / (1u64 << 30) as f64;
        assert!((gib - 2.25).abs() < 0.1, "{gib}");
    }
}
