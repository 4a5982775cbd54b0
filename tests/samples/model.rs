//! Small networks for tests and examples.

use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, ContactSpec, FieldSpec, Kind, M4gn, MacroSpec, MicroSpec, ModelSpec, Output,
    Precision, SegmentSpec,
};

/// A small network with every part in it: U (delta) and p (value), two layers before and one after the macro
/// stage, positional encoding.
pub fn spec() -> ModelSpec {
    let field = |name: &str, vector, output| FieldSpec {
        name: name.into(),
        vector,
        dimensions: if vector { [0, 1, -1, 0, 0, 0, 0] } else { [0, 2, -2, 0, 0, 0, 0] },
        input: true,
        output,
        floor: None,
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
            micro: MicroSpec::default(),
            kind: Kind::M4gn(M4gn {
                layers_before: 2,
                layers_after: 1,
                segment_transformer: MacroSpec {
                    layers: 1,
                    heads: 2,
                    ffn_width: 12,
                    rwse_steps: 5,
                    centroids: true,
                    offsets: true,
                },
            }),
        },
        contact: None,
        resolution: None,
        segments: SegmentSpec { count: 4, ..SegmentSpec::default() },
        precision: Precision::Fp32,
        trained_on: None,
        calibration: None,
        training: serde_json::json!({ "seed": 1 }),
    }
}

/// The same network for bodies at points.
pub fn bodies() -> ModelSpec {
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

/// Other kinds of networks for bodies at points.
pub fn bodies_of_other_kinds() -> Vec<ModelSpec> {
    let of = |kind: Kind| {
        let mut s = bodies();
        s.fields[0].input = matches!(kind, Kind::Gcn { .. });
        s.architecture.kind = kind;
        s
    };
    [Kind::BsmsGnn { levels: 2 }, Kind::GUNet { levels: 2 }, Kind::Gcn { layers: 2 }].map(of).to_vec()
}
