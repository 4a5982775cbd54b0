//! Writes a small model with random weights, for tests and for trying out a case without training:
//! `random_model FILE [SEED]`. It knows U (change) and p (value) in two dimensions; with `random_model FILE SEED solid`
//! the displacement D of a solid and its rate, with segments of the elastic body's modes; with `random_model FILE SEED scalar`
//! a graph convolutional network that knows U, p_rgh and the passive scalar T (changes of U and T, p_rgh itself).

use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, FieldSpec, Kind, M4gn, MacroSpec, ModalOperator, Model, ModelSpec, Output,
    SegmentSpec,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: random_model FILE [SEED]")?;
    let seed = arguments.next().map_or(Ok(1), |s| s.parse())?;
    let spec = match arguments.next().as_deref() {
        None => flow(),
        Some("solid") => solid(),
        Some("scalar") => scalar(),
        Some(other) => return Err(format!("'{other}': expected solid or scalar").into()),
    };
    Model::random(spec, seed)?.write(path)?;
    Ok(())
}

fn field(name: &str, vector: bool, dimensions: [i32; 7], output: Output) -> FieldSpec {
    FieldSpec { name: name.into(), vector, dimensions, input: true, output }
}

fn solid() -> ModelSpec {
    ModelSpec {
        stride: 0.005,
        fields: vec![
            field("D", true, [0, 1, 0, 0, 0, 0, 0], Output::Delta),
            field("ddt(D)", true, [0, 1, -1, 0, 0, 0, 0], Output::Delta),
        ],
        node_types: vec![NodeType::Fluid, NodeType::Symmetry, NodeType::Handle, NodeType::Free],
        segments: SegmentSpec {
            count: 8,
            modes: 4,
            operator: Some(ModalOperator::Elastic),
            ..SegmentSpec::default()
        },
        ..flow()
    }
}

fn scalar() -> ModelSpec {
    let flow = flow();
    ModelSpec {
        fields: vec![
            field("U", true, [0, 1, -1, 0, 0, 0, 0], Output::Delta),
            field("p_rgh", false, [0, 2, -2, 0, 0, 0, 0], Output::Value),
            field("T", false, [0, 0, 0, 1, 0, 0, 0], Output::Delta),
        ],
        architecture: Architecture { kind: Kind::Gcn { layers: 2 }, ..flow.architecture },
        ..flow
    }
}

fn flow() -> ModelSpec {
    ModelSpec {
        format: 1,
        dim: 2,
        stride: 0.01,
        fields: vec![
            field("U", true, [0, 1, -1, 0, 0, 0, 0], Output::Delta),
            field("p", false, [0, 2, -2, 0, 0, 0, 0], Output::Value),
        ],
        node_types: vec![NodeType::Fluid, NodeType::Wall, NodeType::Inlet, NodeType::Outlet],
        architecture: Architecture {
            width: 8,
            hidden_layers: 1,
            activation: Activation::Silu,
            kind: Kind::M4gn(M4gn {
                layers_before: 2,
                layers_after: 1,
                segment_transformer: MacroSpec {
                    layers: 1,
                    heads: 2,
                    ffn_width: 16,
                    rwse_steps: 4,
                    centroids: true,
                    offsets: true,
                },
            }),
        },
        contact: None,
        resolution: None,
        segments: SegmentSpec { count: 4, modes: 3, ..SegmentSpec::default() },
        precision: m4gn_model::Precision::Fp32,
        trained_on: None,
        calibration: None,
        training: serde_json::json!({ "note": "random weights" }),
    }
}
