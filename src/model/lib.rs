//! What a model is: its architecture, the fields it reads and writes, and its weights (safetensors).

mod architecture;
mod calibration;
mod check;
mod file;
mod level;
mod micro;
pub mod modal;
mod nodes;
mod precision;
mod ranges;
mod resolution;
mod segmentation;
mod solid;
pub mod tensor_file;
mod tensors;
mod trained_on;

#[cfg(test)]
extern crate self as m4gn_model;
#[cfg(test)]
#[path = "../../tests/samples/model.rs"]
pub mod sample;

pub use architecture::{Activation, Architecture, ArchitectureKeys, Kind, KindName, M4gn, MacroSpec, Needs};
pub use calibration::{Calibration, Growth, RolloutErrors};
pub use level::{Level, has_level};
pub use micro::{MicroSpec, NodeSums, WorldEdges};
pub use precision::Precision;
pub use ranges::Ranges;
pub use resolution::Resolution;
pub use segmentation::{ModalOperator, SegmentEntries, SegmentMethod, SegmentSpec};
pub use solid::Solid;
pub use tensors::{Model, Tensor};
pub use trained_on::{Extent, InputRange, TrainedOn, cell_size};

use m4gn_base::{Error, Result};
use m4gn_mesh::NodeType;
use serde::{Deserialize, Serialize};

/// Most segments: their adjacency is dense and replicated, 0.5 GB at this number.
pub const MAX_SEGMENTS: usize = 8192;

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
    /// Of a scalar that is positive, in its unit: networks see `ln(max(x, floor))`, and whatever they say is not below it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
}

impl FieldSpec {
    /// A value as networks see it.
    pub fn seen(&self, x: f64) -> f64 {
        match self.floor {
            // Not max(), which takes the floor in place of a value that is no number
            Some(floor) => if x < floor { floor } else { x }.ln(),
            None => x,
        }
    }

    /// The value that networks see so.
    pub fn physical(&self, seen: f64) -> f64 {
        let Some(floor) = self.floor else { return seen };
        let x = seen.exp();
        if x < floor { floor } else { x }
    }

    /// Components as features in `dim` solved directions.
    pub fn components(&self, dim: usize) -> usize {
        if self.vector { dim } else { 1 }
    }

    /// Whether it is read and not predicted: whoever takes steps gives it anew.
    pub fn is_given(&self) -> bool {
        self.input && self.output == Output::None
    }

    /// Whether it is the velocity of a flow, m/s. The rate `ddt(D)` of a solid is none: how fast a body is at the moment says
    /// where it is in its vibration, and not which case it is.
    pub fn is_velocity(&self) -> bool {
        self.vector && self.dimensions == [0, 1, -1, 0, 0, 0, 0] && !self.name.starts_with("ddt(")
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
        let below = all().filter(|d| d.1 < 0).map(|(n, d)| format!("/{}", power(n, -d)));
        let above = match above.is_empty() {
            true => "1".to_string(),
            false => above.join(" "),
        };
        above + &below.collect::<String>()
    }
}

/// Bodies at points that an obstacle may touch (section 3.1, Lagrangian systems).
///
/// Nodes are the bodies' points and the obstacle's. The first field is the displacement from rest: it carries the
/// positions, enters through edges and distances from the obstacle, and its change is what the model predicts. Every node has
/// [`N_CONTACT_INPUTS`] features of the obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// World edges lead from the obstacle's points to points of a body's skin that are nearer than this, m.
    pub radius: f64,
}

/// Node inputs of bodies at points: the motion of an obstacle's point, or how near the obstacle is to a point of the skin, now and
/// after its motion, and whereto it would push the point.
pub const N_CONTACT_INPUTS: usize = 8;

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
    /// Mean distance of neighbouring nodes that the network was trained on, m: the cells of finer meshes are agglomerated to
    /// groups of this size. None: the nodes are the cells of any mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<f64>,
    /// Segmentation the model was trained with.
    #[serde(deserialize_with = "segmentation::of_model_file")]
    pub segments: SegmentSpec,
    /// In what the training computed the products. The phase of a long rollout holds for this precision alone; fp32 in models
    /// from before there was this entry.
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub precision: Precision,
    /// Ranges of the data that it was trained on; none in models from before there was this entry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trained_on: Option<TrainedOn>,
    /// How the errors of its rollouts grow; none before `m4gn calibrate`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
    /// Where it came from: configuration, data, seed, steps, errors. For people; the engine ignores it.
    pub training: serde_json::Value,
}

impl ModelSpec {
    /// Node features: field inputs, then those that do not change with time.
    pub fn n_node_features(&self) -> usize {
        self.n_field_inputs() + self.n_static_features()
    }

    /// Node features that do not change with time: the one-hot node type, then the offset from the segment's
    /// centroid where the macro stage has `offsets`.
    pub fn n_static_features(&self) -> usize {
        self.node_types.len() + self.n_offset_features()
    }

    /// Which of [`ModelSpec::node_types`] a node of this code is of.
    ///
    /// # Errors
    /// [`Error::Model`] for a type that is not among them.
    pub fn place_of_type(&self, code: i32) -> Result<usize> {
        self.node_types.iter().position(|t| *t as i32 == code).ok_or_else(|| {
            let known: Vec<_> = self.node_types.iter().map(|t| t.name()).collect();
            let found = NodeType::from_code(code).map_or("unknown", |t| t.name());
            Error::Model(format!("the model knows {}; the mesh has a {found} node", known.join(", ")))
        })
    }

    /// Components of the offset from the segment's centroid: the solved directions, or none.
    pub fn n_offset_features(&self) -> usize {
        match self.architecture.segment_transformer() {
            Some(m) if m.offsets => self.dim,
            _ => 0,
        }
    }

    /// Positional features a segment: random walk, then centroid.
    pub fn n_position_features(&self) -> usize {
        let walk_and_centroid = |m: &MacroSpec| m.rwse_steps + if m.centroids { self.dim } else { 0 };
        self.architecture.segment_transformer().map_or(0, walk_and_centroid)
    }

    /// Outputs a node, in the order of the fields that are predicted.
    pub fn n_outputs(&self) -> usize {
        self.fields.iter().filter(|f| f.output != Output::None).map(|f| f.components(self.dim)).sum()
    }
}

#[cfg(test)]
mod tests;
