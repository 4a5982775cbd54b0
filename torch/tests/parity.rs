//! The tch model against the native engine on the same weights, and unions of graphs against single ones.

mod common;

use m4gn::engine::{Engine, Forward, SegmentView};
use m4gn::graph::Graph;
use m4gn::mesh::{NodeType, sample};
use m4gn::model::{
    Activation, Architecture, FieldSpec, MacroSpec, Model, ModelSpec, Output, SegmentMethod, SegmentSpec,
};
use m4gn::parallel::Comm;
use m4gn::segments;
use m4gn_torch::inference::Inference;
use m4gn_torch::samples::Parts;
use tch::Device;

fn spec(architecture: Architecture, overlap: usize) -> ModelSpec {
    let field = |name: &str, vector, output| FieldSpec {
        name: name.into(),
        vector,
        dimensions: [0; 7],
        input: true,
        output,
    };
    ModelSpec {
        format: 1,
        dim: 2,
        stride: 0.05,
        fields: vec![field("U", true, Output::Delta), field("p", false, Output::Value)],
        node_types: vec![NodeType::Fluid, NodeType::Wall, NodeType::Inlet, NodeType::Outlet],
        architecture,
        segments: SegmentSpec {
            method: SegmentMethod::Metis,
            count: 6,
            overlap,
            ..Default::default()
        },
        training: serde_json::Value::Null,
    }
}

/// Largest difference of the two backends, relative to the largest output.
fn difference(spec: &ModelSpec) -> f64 {
    let model = Model::random(spec.clone(), 7).unwrap();
    let comm = Comm::serial();
    let mesh = sample::triangles(14, 9, 1.6, 0.41);
    let mut graph = Graph::new(&mesh, &comm).unwrap();
    let cut = segments::segment(&mesh, &mut graph, &spec.segments, &comm, None).unwrap();
    let features = m4gn::segments::features(&spec, &mesh, &cut, &comm);
    let view = SegmentView {
        count: cut.count,
        member_row: &cut.member_row,
        member: &cut.member,
        sizes: &cut.sizes,
        position: &features.position,
        offsets: &features.offsets,
    };
    let parts = Parts {
        n_cells: graph.n_cells,
        node_types: &graph.node_types[..graph.n_owned],
        senders: &graph.senders,
        receivers: &graph.receivers,
        edge_features: &graph.edge_features,
        segments: cut.count,
        member_row: &cut.member_row,
        member: &cut.member,
        sizes: &cut.sizes,
        position: &features.position,
        offsets: &features.offsets,
    };
    let inputs: Vec<f32> = (0..graph.n_owned * 3).map(|i| (i as f32 * 0.37).sin()).collect();
    let (mut native, mut torch) = (vec![0f32; graph.n_cells * 3], vec![0f32; graph.n_cells * 3]);
    Engine::new(&model, &graph, Some(&view), 1)
        .unwrap()
        .forward(&comm, &inputs, &mut native)
        .unwrap();
    Inference::with_model(&model, &parts, Device::Cpu)
        .unwrap()
        .step(&inputs, &mut torch)
        .unwrap();
    let largest = native.iter().fold(0f32, |m, v| m.max(v.abs()));
    assert!(
        largest > 1e-3 && largest.is_finite(),
        "outputs that say nothing: {largest}"
    );
    let worst = native
        .iter()
        .zip(&torch)
        .fold(0f32, |m, (a, b)| m.max((a - b).abs()));
    (worst / largest) as f64
}

#[test]
fn native_engine_and_tch_model_agree() {
    let network = |before, after, macro_stage: Option<MacroSpec>, activation, hidden_layers| Architecture {
        width: 32,
        hidden_layers,
        activation,
        layers_before: before,
        layers_after: after,
        segment_transformer: macro_stage,
    };
    let stage = |layers, rwse_steps| {
        let geometry = rwse_steps > 0;
        Some(MacroSpec {
            layers,
            heads: 4,
            ffn_width: 48,
            rwse_steps,
            centroids: geometry,
            offsets: geometry,
        })
    };
    for (architecture, overlap) in [
        (network(3, 0, None, Activation::Relu, 1), 0),
        (network(3, 0, stage(2, 0), Activation::Relu, 2), 0),
        (network(2, 2, stage(2, 5), Activation::Silu, 1), 0),
        (network(2, 1, stage(1, 0), Activation::Relu, 1), 2),
    ] {
        let relative = difference(&spec(architecture.clone(), overlap));
        // fp32 sums in different orders, over a few layers.
        assert!(
            relative < 1e-5,
            "{relative:e} for {architecture:?}, overlap {overlap}"
        );
    }
}
