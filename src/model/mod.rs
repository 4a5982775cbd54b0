//! What a model is: its architecture, the fields it reads and writes, and its weights (safetensors).

mod check;
mod file;
mod segmentation;
mod tensors;

pub use segmentation::{ModalOperator, SegmentMethod, SegmentSpec};
pub use tensors::{Model, Tensor};

use crate::mesh::NodeType;
use serde::{Deserialize, Serialize};

/// How a field leaves the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// Not predicted.
    None,
    /// The change over one stride (paper: the time derivative).
    Delta,
    /// The value at the end of the stride.
    Value,
}

/// One physical field of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldSpec {
    /// OpenFOAM's name of the field, `U` or `p`.
    pub name: String,
    /// True for a vector (one feature a solved direction), false for a scalar.
    pub vector: bool,
    /// Exponents of mass, length, time, temperature, moles, current, luminous intensity (`dimensionSet`).
    pub dimensions: [i32; 7],
    /// Whether the field is a node feature.
    pub input: bool,
    /// Whether and how it is predicted.
    pub output: Output,
}

impl FieldSpec {
    /// Components as features in `dim` solved directions.
    pub fn components(&self, dim: usize) -> usize {
        if self.vector { dim } else { 1 }
    }

    /// Its unit in those of SI: `m/s`, `kg/m/s^2`; `1` without dimensions.
    pub fn unit(&self) -> String {
        let power = |name: &str, exponent: i32| match exponent {
            1 => name.to_string(),
            n => format!("{name}^{n}"),
        };
        let names = ["kg", "m", "s", "K", "mol", "A", "cd"];
        let all = || names.into_iter().zip(self.dimensions);
        let above: Vec<String> = all().filter(|d| d.1 > 0).map(|(n, d)| power(n, d)).collect();
        let below = all()
            .filter(|d| d.1 < 0)
            .map(|(n, d)| format!("/{}", power(n, -d)));
        let above = match above.is_empty() {
            true => "1".to_string(),
            false => above.join(" "),
        };
        above + &below.collect::<String>()
    }
}

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

impl MacroSpec {
    /// Positional features a segment: random walk, then centroid.
    pub fn n_position_features(&self, dim: usize) -> usize {
        self.rwse_steps + if self.centroids { dim } else { 0 }
    }
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

/// The network's shape.
///
/// Order of a forward step: encoders (eq. 1), `layers_before` message-passing layers (eq. 2, 3), macro stage
/// (eq. 9 to 13), and, when `layers_after` > 0, `h <- h + dispatch([h, h_S])` and that many more layers; the
/// decoder reads `[h, h_S]` (section 3.4.3), or `h` alone without a macro stage. The paper has `layers_after = 0`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Architecture {
    /// Latent width d.
    pub width: usize,
    /// Hidden layers of each MLP; an MLP has one more linear layer (the paper's 3-layer MLP: 2).
    pub hidden_layers: usize,
    /// Activation between linear layers.
    pub activation: Activation,
    /// Message-passing layers before the macro stage.
    pub layers_before: usize,
    /// Message-passing layers after it.
    pub layers_after: usize,
    /// Macro stage; none: a plain MeshGraphNet.
    pub segment_transformer: Option<MacroSpec>,
}

/// Bodies at points that an obstacle may touch (section 3.1, Lagrangian systems).
///
/// Nodes are the bodies' points and the obstacle's. The first field is the displacement from rest: it carries the
/// positions, enters through the edges only, and its change is what the model predicts. Every node has the prescribed
/// motion of the obstacle over the stride (0 in a body) as a feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// World edges lead from the obstacle's points to points of a body's skin that are nearer than this, m.
    pub radius: f64,
}

/// Everything about a model but its numbers: the `m4gn` entry of the safetensors header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSpec {
    /// Version of this header's schema: 1.
    pub format: u32,
    /// Solved directions.
    pub dim: usize,
    /// Time the model advances in one step, s.
    pub stride: f64,
    /// Fields in the order of their features.
    pub fields: Vec<FieldSpec>,
    /// Node types in the order of their one-hot features.
    pub node_types: Vec<NodeType>,
    /// Network.
    pub architecture: Architecture,
    /// Bodies at points and their contact; none: fields at the cells of a mesh that does not move.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactSpec>,
    /// Segmentation the model was trained with.
    #[serde(deserialize_with = "segmentation::of_model_file")]
    pub segments: SegmentSpec,
    /// Where it came from: configuration, data, seed, steps, errors. For people; the engine ignores it.
    pub training: serde_json::Value,
}

impl ModelSpec {
    /// Features that change with time: of the fields that are inputs, then the obstacle's motion where the model knows
    /// contact.
    pub fn n_field_inputs(&self) -> usize {
        let inputs = self.fields.iter().filter(|f| f.input);
        let fields: usize = inputs.map(|f| f.components(self.dim)).sum();
        fields + if self.contact.is_some() { self.dim } else { 0 }
    }

    /// Node features: field inputs, then those that do not change with time.
    pub fn n_node_features(&self) -> usize {
        self.n_field_inputs() + self.n_static_features()
    }

    /// Node features that do not change with time: the one-hot node type, then the offset from the segment's
    /// centroid where the macro stage has `offsets`.
    pub fn n_static_features(&self) -> usize {
        self.node_types.len() + self.n_offset_features()
    }

    /// Components of the offset from the segment's centroid: the solved directions, or none.
    pub fn n_offset_features(&self) -> usize {
        match &self.architecture.segment_transformer {
            Some(m) if m.offsets => self.dim,
            _ => 0,
        }
    }

    /// Positional features a segment.
    pub fn n_position_features(&self) -> usize {
        self.architecture
            .segment_transformer
            .as_ref()
            .map_or(0, |m| m.n_position_features(self.dim))
    }

    /// Edge features: displacement from receiver to sender in the solved directions, and its length. With contact at
    /// rest (0 for world edges), then at present, then 1 for a world edge (table 2: m, |m|, x, |x|).
    pub fn n_edge_features(&self) -> usize {
        match self.contact {
            Some(_) => 2 * (self.dim + 1) + 1,
            None => self.dim + 1,
        }
    }

    /// Outputs a node, in the order of the fields that are predicted.
    pub fn n_outputs(&self) -> usize {
        self.fields
            .iter()
            .filter(|f| f.output != Output::None)
            .map(|f| f.components(self.dim))
            .sum()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A small network with every part in it: U (delta) and p (value), two layers before and one after the macro
    /// stage, positional encoding.
    pub(crate) fn spec() -> ModelSpec {
        let field = |name: &str, vector, output| FieldSpec {
            name: name.into(),
            vector,
            dimensions: if vector {
                [0, 1, -1, 0, 0, 0, 0]
            } else {
                [0, 2, -2, 0, 0, 0, 0]
            },
            input: true,
            output,
        };
        ModelSpec {
            format: 1,
            dim: 2,
            stride: 0.01,
            fields: vec![field("U", true, Output::Delta), field("p", false, Output::Value)],
            node_types: vec![NodeType::Fluid, NodeType::Wall, NodeType::Inlet, NodeType::Outlet],
            architecture: Architecture {
                width: 8,
                hidden_layers: 1,
                activation: Activation::Relu,
                layers_before: 2,
                layers_after: 1,
                segment_transformer: Some(MacroSpec {
                    layers: 1,
                    heads: 2,
                    ffn_width: 12,
                    rwse_steps: 5,
                    centroids: true,
                    offsets: true,
                }),
            },
            contact: None,
            segments: SegmentSpec {
                count: 4,
                ..SegmentSpec::default()
            },
            training: serde_json::json!({ "seed": 1 }),
        }
    }

    /// The same network for bodies at points.
    pub(crate) fn bodies() -> ModelSpec {
        let mut s = spec();
        s.dim = 3;
        s.fields.truncate(1);
        s.fields[0].name = "D".into();
        s.fields[0].dimensions = [0, 1, 0, 0, 0, 0, 0];
        s.fields[0].input = false;
        s.node_types = vec![NodeType::Obstacle, NodeType::Body, NodeType::Handle];
        s.contact = Some(ContactSpec { radius: 0.5 });
        s
    }

    #[test]
    fn units() {
        let of = |dimensions| {
            let field = FieldSpec {
                dimensions,
                ..spec().fields[0].clone()
            };
            field.unit()
        };
        assert_eq!(of([0, 1, -1, 0, 0, 0, 0]), "m/s");
        assert_eq!(of([1, -1, -2, 0, 0, 0, 0]), "kg/m/s^2");
        assert_eq!(of([0, 2, -2, 0, 0, 0, 0]), "m^2/s^2");
        assert_eq!(
            (of([0; 7]), of([0, 0, -1, 0, 0, 0, 0])),
            ("1".into(), "1/s".into())
        );
    }

    #[test]
    fn features_of_bodies_are_counted() {
        let s = bodies();
        assert!(s.check().is_ok());
        let counts = (s.n_field_inputs(), s.n_node_features(), s.n_edge_features());
        assert_eq!(counts, (3, 9, 9));
    }

    #[test]
    fn features_are_counted() {
        let s = spec();
        assert_eq!(
            (
                s.n_field_inputs(),
                s.n_node_features(),
                s.n_edge_features(),
                s.n_outputs()
            ),
            (3, 9, 3, 3)
        );
    }

    #[test]
    fn descriptions_survive_json() {
        let s = spec();
        assert_eq!(
            serde_json::from_str::<ModelSpec>(&serde_json::to_string(&s).unwrap()).unwrap(),
            s
        );
        let unknown = serde_json::to_string(&s)
            .unwrap()
            .replacen("\"dim\"", "\"dimm\"", 1);
        assert!(serde_json::from_str::<ModelSpec>(&unknown).is_err());
    }
}
