//! What a step of the network costs: graphs of a given size, the work counted from the shapes, and what the machine
//! that it is measured on can do.

mod export;
mod graph;
pub mod memory;
mod timing;
mod training;
mod workload;

pub use export::export;
pub use timing::{Runs, Timing, peak, processor_time};
pub use training::{Prepared, Trial};
pub use workload::{Source, Workload};

use graph::{hexahedra, o_mesh_structure};
use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, FieldSpec, Kind, M4gn, MacroSpec, MicroSpec, ModelSpec, Output, Precision,
    SegmentSpec,
};

impl Trial {
    /// A network of this shape that reads U and p, in so many solved directions, and predicts both. The macro stage, where there is one, is that of
    /// the paper (section 4.2): 4 layers, 8 heads, feed-forward width 4 d, all layers before it; without segments there is none (MeshGraphNet).
    pub fn spec(&self, dim: usize) -> ModelSpec {
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
            dim,
            stride: 0.01,
            fields: vec![field("U", true, 1, Output::Delta), field("p", false, 2, Output::Value)],
            node_types: NodeType::ALL.to_vec(),
            architecture: Architecture {
                width: self.width,
                hidden_layers: self.hidden,
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
