//! Writes a small model with random weights, for tests and for trying out a case without training:
//! `random_model FILE [SEED]`. It knows U (change) and p (value) in two dimensions; with `random_model FILE SEED solid`
//! the displacement D of a solid and its rate, with segments of the elastic body's modes; with `random_model FILE SEED scalar`
//! a graph convolutional network that knows U, p_rgh and the passive scalar T (changes of U and T, p_rgh itself); with
//! `random_model FILE SEED levels` a network of the first kind's fields on coarser graphs.

use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, FieldSpec, Kind, ModalOperator, Model, ModelSpec, Output, SegmentSpec,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: random_model FILE [SEED]")?;
    let seed = arguments.next().map_or(Ok(1), |s| s.parse())?;
    let spec = match arguments.next().as_deref() {
        None => flow(),
        Some("solid") => solid(),
        Some("scalar") => scalar(),
        Some("levels") => levels(),
        Some(other) => return Err(format!("'{other}': expected solid, scalar or levels").into()),
    };
    Model::random(spec, seed)?.write(path)?;
    Ok(())
}

fn field(name: &str, vector: bool, dimensions: [i32; 7], output: Output) -> FieldSpec {
    FieldSpec { name: name.into(), vector, dimensions, input: true, output, floor: None }
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

fn levels() -> ModelSpec {
    let flow = flow();
    ModelSpec {
        architecture: Architecture { kind: Kind::BsmsGnn { levels: 3 }, ..flow.architecture },
        ..flow
    }
}

fn flow() -> ModelSpec {
    let mut spec = m4gn_samples::model::spec();
    spec.architecture.activation = Activation::Silu;
    if let Kind::M4gn(m) = &mut spec.architecture.kind {
        (m.segment_transformer.ffn_width, m.segment_transformer.rwse_steps) = (16, 4);
    }
    spec.segments.modes = 3;
    spec.training = serde_json::json!({ "note": "random weights" });
    spec
}
