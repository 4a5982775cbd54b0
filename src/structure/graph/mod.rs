//! The mesh graph: owned nodes, ghosts, directed edges that live with their receiver, halo exchange.
//!
//! Nodes are this rank's cells, then its boundary faces, then ghosts (cells of other ranks across a coupled
//! face). Edges are sorted by receiver, so that aggregation is a sweep.

mod build;

use m4gn_parallel::Halo;
use serde::{Deserialize, Serialize};

/// This rank's part of the mesh graph.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Graph {
    /// Cells, the first owned nodes.
    pub n_cells: usize,
    /// Owned nodes: cells and boundary faces.
    pub n_owned: usize,
    /// Owned nodes and ghosts.
    pub n_local: usize,
    /// Node type codes of all local nodes.
    pub node_types: Vec<i32>,
    /// Edges of owned node i: `row[i]..row[i + 1]`; length n_owned + 1.
    pub row: Vec<u32>,
    /// Sender (local node, may be a ghost) of each edge.
    pub senders: Vec<i32>,
    /// Receiver (owned node) of each edge, ascending.
    pub receivers: Vec<i32>,
    /// Edge features `[edges x (dim + 1)]`: displacement receiver -> sender in the solved directions, length, m.
    pub edge_features: Vec<f32>,
    /// Which owned values go to which rank, and where ghosts come from; no part of what is written of a graph.
    #[serde(skip)]
    pub halo: Halo,
}
