//! What the micro stage of a network leaves open: message passing and the nodes' features.

use serde::{Deserialize, Serialize};

/// What message passing and the nodes' features leave open (sections 3.2 and 3.4.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MicroSpec {
    /// Which latents of its edges a node sums.
    pub node_sums: NodeSums,
    /// What world edges have of their own.
    pub world_edges: WorldEdges,
    /// Random-walk steps of the nodes' positional encoding, which joins all their features (section 3.4.1); 0: none.
    pub node_rwse_steps: usize,
}

/// What the world edges of bodies that are touched have of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WorldEdges {
    /// Nothing: a feature says which edges they are.
    #[default]
    Together,
    /// An encoder (eq. 1) and sums that go into the nodes (eq. 2): the paper's.
    Apart,
}

/// Which latents of its edges a node sums (eq. 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NodeSums {
    /// Those that the same layer has just made, as MeshGraphNets do (Pfaff et al. 2020).
    #[default]
    After,
    /// Those of before the layer: the paper's. Nothing reads what the last layer would make of the edges, so that it has no edge
    /// network.
    Before,
}
