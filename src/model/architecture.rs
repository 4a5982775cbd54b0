//! The network's shape: its kind, and what each kind needs.
//!
//! Every network has an encoder of nodes and a decoder at cells (multi-layer perceptrons, eq. 1 and section 3.4.3). Its
//! [`Kind`] says what advances the nodes' latents between the two.

use super::{MicroSpec, NodeSums, WorldEdges};
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// Macro stage: transformer over segments (section 3.4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MacroSpec {
    /// Self-attention layers.
    pub layers: usize,
    /// Heads; must divide the width.
    pub heads: usize,
    /// Hidden width of the point-wise feed-forward network.
    pub ffn_width: usize,
    /// Random-walk steps of the segment positional encoding (RWSE of the eq. 10 graph); 0: none.
    pub rwse_steps: usize,
    /// Whether the segments' centroids, from the domain's centre, join the positional encoding. The random walk
    /// tells how segments touch, not which lies upstream.
    pub centroids: bool,
    /// Whether each node's displacement from its segment's centroid joins the node features, so that what is
    /// dispatched to a segment can vary within it.
    pub offsets: bool,
}

/// Activation of all multi-layer perceptrons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// max(0, x), the paper's.
    Relu,
    /// x * sigmoid(x).
    Silu,
}

/// Message passing with a segment transformer.
///
/// Order of a forward step: encoders (eq. 1), `layers_before` message-passing layers (eq. 2, 3), macro stage
/// (eq. 9 to 13), and, when `layers_after` > 0, `h <- h + dispatch([h, h_S])` and that many more layers; the
/// decoder reads `[h, h_S]` (section 3.4.3). The paper has `layers_after = 0`.
#[derive(Clone, Debug, PartialEq)]
pub struct M4gn {
    /// Message-passing layers before the macro stage.
    pub layers_before: usize,
    /// Message-passing layers after it.
    pub layers_after: usize,
    /// Macro stage.
    pub segment_transformer: MacroSpec,
}

/// What advances the nodes' latents between encoder and decoder.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// The paper's network.
    M4gn(M4gn),
    /// Message passing alone (eq. 2, 3): MeshGraphNets of Pfaff et al. 2020.
    MeshGraphNet {
        /// Message-passing layers.
        layers: usize,
    },
    /// Graph convolutions (Kipf & Welling 2016): `h <- f(W sum_s h_s / sqrt((1 + n_s) (1 + n_r)) + b)` over a node's
    /// neighbours and itself, n being the number of edges that a node receives. The paper's baseline of appendix B.2: no
    /// edge features.
    Gcn {
        /// Convolutions.
        layers: usize,
    },
    /// Message passing down and up coarser graphs (BSMS-GNN, Cao et al. 2023), one layer a graph each way and one on the coarsest: layer
    /// l and layer `2 levels - l` are those of graph l. A message is `f(x_rs, h_s, h_r)` of the edge's features: edges have no latents.
    BsmsGnn {
        /// Coarser graphs, by bi-stride pooling.
        levels: usize,
    },
    /// g-U-Net (Gao and Ji 2019) of the layers of [`Kind::BsmsGnn`]: the nodes of a coarser graph are the half with the largest scores, a
    /// learned projection of their latents, of which tanh is their gate.
    GUNet {
        /// Coarser graphs.
        levels: usize,
    },
    /// EAGLE (Janny et al. 2023): as [`Kind::M4gn`], with a gated recurrent unit over the nodes of a segment in place of their mean, and a
    /// decoder that reads the nodes' latents alone.
    Eagle(M4gn),
}

/// What a network needs of the structure that it lives on, beside the nodes and who hears whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Features of the edges.
    pub edges: bool,
    /// Segments of the nodes, and what a network reads of them.
    pub segments: bool,
    /// The order of the nodes within their segments.
    pub sequences: bool,
    /// Coarser graphs.
    pub levels: usize,
    /// All nodes on one rank.
    pub whole: bool,
    /// Random-walk steps of the nodes' positional encoding.
    pub walk: usize,
}

/// Names of the kinds, in configurations and model files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KindName {
    /// [`Kind::M4gn`]
    M4gn,
    /// [`Kind::MeshGraphNet`]
    MeshGraphNet,
    /// [`Kind::Gcn`]
    Gcn,
    /// [`Kind::BsmsGnn`]
    BsmsGnn,
    /// [`Kind::GUNet`]
    GUNet,
    /// [`Kind::Eagle`]
    Eagle,
}

/// The network's shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ArchitectureKeys", into = "ArchitectureKeys")]
pub struct Architecture {
    /// Latent width d.
    pub width: usize,
    /// Hidden layers of each MLP; an MLP has one more linear layer (the paper's 3-layer MLP: 2).
    pub hidden_layers: usize,
    /// Activation between linear layers.
    pub activation: Activation,
    /// Of its message passing.
    pub micro: MicroSpec,
    /// What stands between encoder and decoder.
    pub kind: Kind,
}

impl Architecture {
    /// The kind's name.
    pub fn name(&self) -> KindName {
        match self.kind {
            Kind::M4gn(_) => KindName::M4gn,
            Kind::MeshGraphNet { .. } => KindName::MeshGraphNet,
            Kind::Gcn { .. } => KindName::Gcn,
            Kind::BsmsGnn { .. } => KindName::BsmsGnn,
            Kind::GUNet { .. } => KindName::GUNet,
            Kind::Eagle(_) => KindName::Eagle,
        }
    }

    /// Layers around a macro stage; none of a kind that has no such stage.
    pub fn m4gn(&self) -> Option<&M4gn> {
        match &self.kind {
            Kind::M4gn(m) | Kind::Eagle(m) => Some(m),
            _ => None,
        }
    }

    /// Whether the decoder reads the latents of a node's segments beside its own.
    pub fn decodes_segments(&self) -> bool {
        matches!(self.kind, Kind::M4gn(_))
    }

    /// The same, to change it.
    pub fn m4gn_mut(&mut self) -> Option<&mut M4gn> {
        match &mut self.kind {
            Kind::M4gn(m) | Kind::Eagle(m) => Some(m),
            _ => None,
        }
    }

    /// The macro stage; none where the network needs no segments.
    pub fn segment_transformer(&self) -> Option<&MacroSpec> {
        self.m4gn().map(|m| &m.segment_transformer)
    }

    /// Layers that exchange latents between neighbouring nodes.
    pub fn layers(&self) -> usize {
        match &self.kind {
            Kind::M4gn(m) | Kind::Eagle(m) => m.layers_before + m.layers_after,
            Kind::MeshGraphNet { layers } | Kind::Gcn { layers } => *layers,
            Kind::BsmsGnn { levels } | Kind::GUNet { levels } => 2 * levels + 1,
        }
    }

    /// Whether the layers are those of eq. 2 to 4, of one graph.
    pub fn passes_messages(&self) -> bool {
        matches!(self.kind, Kind::M4gn(_) | Kind::Eagle(_) | Kind::MeshGraphNet { .. })
    }

    /// Kinds of edges that have an encoder, and sums that go into the nodes, each.
    pub fn edge_kinds(&self) -> usize {
        match self.micro.world_edges {
            WorldEdges::Together => 1,
            WorldEdges::Apart => 2,
        }
    }

    /// Their encoders: of the edges, or of the mesh's and of world edges.
    pub fn edge_encoders(&self) -> &'static [&'static str] {
        &["encoder.edge", "encoder.world_edge"][..self.edge_kinds()]
    }

    /// Layers that make new messages or latents of the edges: the first ones.
    pub fn edge_networks(&self) -> usize {
        match self.micro.node_sums {
            NodeSums::After => self.layers(),
            NodeSums::Before => self.layers().saturating_sub(1),
        }
    }

    /// Whether edges have latents, which a layer passes on to the next one; else its messages are made of the edges' features.
    pub fn edge_latents(&self) -> bool {
        !matches!(self.kind, Kind::BsmsGnn { .. } | Kind::GUNet { .. })
    }

    /// What the network needs of the structure that it lives on.
    pub fn needs(&self) -> Needs {
        Needs {
            edges: !matches!(self.kind, Kind::Gcn { .. }),
            segments: self.segment_transformer().is_some(),
            sequences: matches!(self.kind, Kind::Eagle(_)),
            levels: match self.kind {
                Kind::BsmsGnn { levels } => levels,
                _ => 0,
            },
            whole: matches!(self.kind, Kind::GUNet { .. }),
            walk: self.micro.node_rwse_steps,
        }
    }
}

/// A network's shape as it is written down: all keys of all kinds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArchitectureKeys {
    /// Which network.
    pub kind: KindName,
    /// As [`Architecture::width`].
    pub width: usize,
    /// As [`Architecture::hidden_layers`].
    pub hidden_layers: usize,
    /// As [`Architecture::activation`].
    pub activation: Activation,
    /// As [`MicroSpec::node_sums`].
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub node_sums: NodeSums,
    /// As [`MicroSpec::world_edges`].
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub world_edges: WorldEdges,
    /// As [`MicroSpec::node_rwse_steps`].
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub node_rwse_steps: usize,
    /// Of a network without a macro stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers: Option<usize>,
    /// As [`Kind::BsmsGnn::levels`], or [`Kind::GUNet::levels`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub levels: Option<usize>,
    /// As [`M4gn::layers_before`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers_before: Option<usize>,
    /// As [`M4gn::layers_after`]; 0 where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers_after: Option<usize>,
    /// As [`M4gn::segment_transformer`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment_transformer: Option<MacroSpec>,
}

impl TryFrom<ArchitectureKeys> for Architecture {
    type Error = Error;

    fn try_from(keys: ArchitectureKeys) -> Result<Self> {
        let bad = |message: String| Err(Error::Model(message));
        let name = keys.kind.name();
        let kind = match (keys.kind, keys.segment_transformer) {
            (kind @ (KindName::M4gn | KindName::Eagle), Some(segment_transformer)) => {
                if keys.layers.or(keys.levels).is_some() {
                    return bad(format!("layers, levels: kind {name} has layers_before and layers_after"));
                }
                let Some(layers_before) = keys.layers_before else {
                    return bad("layers_before: missing; the layers before the macro stage".into());
                };
                let layers_after = keys.layers_after.unwrap_or(0);
                let stage = M4gn { layers_before, layers_after, segment_transformer };
                if kind == KindName::M4gn { Kind::M4gn(stage) } else { Kind::Eagle(stage) }
            }
            (KindName::M4gn | KindName::Eagle, None) => {
                return bad(format!(
                    "kind {name}: the macro stage ([macro] of a configuration) is missing; without one, kind \
                     \"mesh-graph-net\""
                ));
            }
            (_, Some(_)) => {
                return bad(format!(
                    "kind {name}: it has no macro stage ([macro] of a configuration); with one, kind \"m4gn\""
                ));
            }
            (kind, None) => {
                if keys.layers_after.is_some_and(|n| n > 0) {
                    return bad(format!(
                        "layers_after: kind {name} has no macro stage that layers could come after"
                    ));
                }
                let (key, own, other) = match kind {
                    KindName::BsmsGnn | KindName::GUNet => ("levels", keys.levels, ("layers", keys.layers)),
                    _ => ("layers", keys.layers, ("levels", keys.levels)),
                };
                for (another, found) in [("layers_before", keys.layers_before), other] {
                    if found.is_some() {
                        return bad(format!("{another}: kind {name} has {key}"));
                    }
                }
                let Some(count) = own else {
                    return bad(format!("{key}: missing; the {key} of kind {name}"));
                };
                match kind {
                    KindName::Gcn => Kind::Gcn { layers: count },
                    KindName::BsmsGnn => Kind::BsmsGnn { levels: count },
                    KindName::GUNet => Kind::GUNet { levels: count },
                    _ => Kind::MeshGraphNet { layers: count },
                }
            }
        };
        Ok(Architecture {
            width: keys.width,
            hidden_layers: keys.hidden_layers,
            activation: keys.activation,
            micro: MicroSpec {
                node_sums: keys.node_sums,
                world_edges: keys.world_edges,
                node_rwse_steps: keys.node_rwse_steps,
            },
            kind,
        })
    }
}

impl From<Architecture> for ArchitectureKeys {
    fn from(a: Architecture) -> Self {
        let mut keys = ArchitectureKeys {
            kind: a.name(),
            width: a.width,
            hidden_layers: a.hidden_layers,
            activation: a.activation,
            node_sums: a.micro.node_sums,
            world_edges: a.micro.world_edges,
            node_rwse_steps: a.micro.node_rwse_steps,
            layers: None,
            levels: None,
            layers_before: None,
            layers_after: None,
            segment_transformer: None,
        };
        match a.kind {
            Kind::M4gn(m) | Kind::Eagle(m) => {
                keys.layers_before = Some(m.layers_before);
                keys.layers_after = Some(m.layers_after);
                keys.segment_transformer = Some(m.segment_transformer);
            }
            Kind::MeshGraphNet { layers } | Kind::Gcn { layers } => keys.layers = Some(layers),
            Kind::BsmsGnn { levels } | Kind::GUNet { levels } => keys.levels = Some(levels),
        }
        keys
    }
}

m4gn_base::names! {
    KindName: M4gn "m4gn", MeshGraphNet "mesh-graph-net", Gcn "gcn", BsmsGnn "bsms-gnn", GUNet "g-u-net", Eagle "eagle"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::spec;

    fn read(text: &str) -> std::result::Result<Architecture, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn kinds_survive_json() {
        let mut a = spec().architecture;
        let others = [
            Kind::MeshGraphNet { layers: 3 },
            Kind::Gcn { layers: 2 },
            Kind::BsmsGnn { levels: 4 },
            Kind::GUNet { levels: 2 },
            Kind::Eagle(a.m4gn().unwrap().clone()),
        ];
        for kind in [a.kind.clone()].into_iter().chain(others) {
            a.kind = kind;
            let text = serde_json::to_string(&a).unwrap();
            assert!(text.contains(&format!("\"kind\":\"{}\"", a.name().name())), "{text}");
            assert_eq!(read(&text).unwrap(), a);
            let new = ["node_sums", "world_edges", "node_rwse_steps"];
            assert!(!new.iter().any(|key| text.contains(key)), "files of before have no such keys: {text}");
        }
    }

    #[test]
    fn switches_survive_json() {
        let mut a = spec().architecture;
        a.micro =
            MicroSpec { node_sums: NodeSums::Before, world_edges: WorldEdges::Apart, node_rwse_steps: 4 };
        assert_eq!(read(&serde_json::to_string(&a).unwrap()).unwrap(), a);
    }

    #[test]
    fn keys_of_another_kind_are_refused() {
        let shape = r#""width":8,"hidden_layers":1,"activation":"relu""#;
        for (rest, word) in [
            (r#""layers":1"#, "missing field `kind`"),
            (r#""kind":"gat","layers":1"#, "mesh-graph-net"),
            (r#""kind":"gcn","layers_before":1"#, "gcn has layers"),
            (r#""kind":"gcn""#, "layers: missing"),
            (r#""kind":"gcn","layers":1,"levels":1"#, "levels: kind gcn has layers"),
            (r#""kind":"bsms-gnn","layers":1"#, "layers: kind bsms-gnn has levels"),
            (r#""kind":"m4gn","layers_before":1"#, "macro stage"),
            (r#""kind":"eagle","layers_before":1"#, "kind eagle: the macro stage"),
            (r#""kind":"mesh-graph-net","layers":1,"layers_after":1"#, "layers_after"),
            (r#""kind":"gcn","layers":1,"width_":1"#, "width_"),
        ] {
            m4gn_samples::fails(read(&format!("{{{shape},{rest}}}")), &[word]);
        }
    }
}
