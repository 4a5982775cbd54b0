//! What a step of the network costs: graphs of a given size, the work counted from the shapes, and what the machine
//! that it is measured on can do.

mod export;
mod graph;
pub mod machine;
pub mod memory;
mod timing;
mod training;
mod workload;

pub use export::export;
pub use graph::{hexahedra, o_mesh, o_mesh_structure};
pub use timing::{Runs, Timing, processor_time};
pub use training::{Prepared, Trial};
pub use workload::{Source, Workload};

use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, FieldSpec, Kind, M4gn, MacroSpec, MicroSpec, ModelSpec, Output, Precision,
    SegmentSpec,
};

/// Shape of a network that is made for a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Solved directions.
    pub dim: usize,
    /// Message-passing layers.
    pub layers: usize,
    /// Latent width d.
    pub width: usize,
    /// Hidden layers of each perceptron.
    pub hidden_layers: usize,
    /// Number of segments K; none: a MeshGraphNet without macro stage.
    pub segments: Option<usize>,
}

impl Shape {
    /// A network of this shape that reads U and p and predicts both. The macro stage, where there is one, is that of
    /// the paper (section 4.2): 4 layers, 8 heads, feed-forward width 4 d, all layers before it.
    pub fn spec(&self) -> ModelSpec {
        let field = |name: &str, vector, length, output| FieldSpec {
            name: name.into(),
            vector,
            dimensions: [0, length, -length, 0, 0, 0, 0],
            input: true,
            output,
            floor: None,
        };
        ModelSpec {
            format: 1,
            dim: self.dim,
            stride: 0.01,
            fields: vec![field("U", true, 1, Output::Delta), field("p", false, 2, Output::Value)],
            node_types: NodeType::ALL.to_vec(),
            architecture: Architecture {
                width: self.width,
                hidden_layers: self.hidden_layers,
                activation: Activation::Relu,
                micro: MicroSpec::default(),
                kind: match self.segments {
                    None => Kind::MeshGraphNet { layers: self.layers },
                    Some(_) => Kind::M4gn(M4gn {
                        layers_before: self.layers,
                        layers_after: 0,
                        segment_transformer: MacroSpec {
                            layers: 4,
                            heads: 8,
                            ffn_width: 4 * self.width,
                            rwse_steps: 0,
                            centroids: false,
                            offsets: false,
                        },
                    }),
                },
            },
            contact: None,
            resolution: None,
            segments: SegmentSpec { count: self.segments.unwrap_or(36), ..SegmentSpec::default() },
            precision: Precision::Fp32,
            trained_on: None,
            calibration: None,
            training: serde_json::json!({ "note": "random weights" }),
        }
    }
}
