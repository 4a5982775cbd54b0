//! The tch model against the native engine on the same weights.

use m4gn_engine::{Engine, EngineOptions, Forward};
use m4gn_model::{
    Activation, Architecture, Kind, M4gn, MacroSpec, MicroSpec, Model, ModelSpec, NodeSums, SegmentMethod,
    SegmentSpec,
};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_structure::Structure;
use m4gn_torch::inference::Inference;
use tch::Device;

fn spec(architecture: Architecture, overlap: usize) -> ModelSpec {
    ModelSpec {
        stride: 0.05,
        architecture,
        segments: SegmentSpec { method: SegmentMethod::Metis, count: 6, overlap, ..Default::default() },
        ..m4gn_samples::model::spec()
    }
}

/// Largest difference of the two backends, relative to the largest output.
fn difference(spec: &ModelSpec) -> f64 {
    let model = Model::random(spec.clone(), 7).unwrap();
    let comm = Comm::serial();
    let mesh = sample::triangles(14, 9, 1.6, 0.41);
    let modal = m4gn_modes::Modal::default();
    let structure = Structure::new(&mesh, spec, &spec.segments, &modal, None, &comm).unwrap();
    let graph = &structure.graph;
    let inputs: Vec<f32> = (0..graph.n_owned * 3).map(|i| (i as f32 * 0.37).sin()).collect();
    let (mut native, mut torch) = (vec![0f32; graph.n_cells * 3], vec![0f32; graph.n_cells * 3]);
    Engine::new(&model, &structure, &EngineOptions::default())
        .unwrap()
        .forward(&comm, &inputs, &mut native)
        .unwrap();
    Inference::new(&model, &structure, Device::Cpu).unwrap().step(&inputs, &mut torch).unwrap();
    let largest = native.iter().fold(0f32, |m, v| m.max(v.abs()));
    assert!(largest > 1e-3 && largest.is_finite(), "outputs that say nothing: {largest}");
    let worst = native.iter().zip(&torch).fold(0f32, |m, (a, b)| m.max((a - b).abs()));
    (worst / largest) as f64
}

#[test]
fn native_engine_and_tch_model_agree() {
    let stage = |layers, rwse_steps| {
        let geometry = rwse_steps > 0;
        MacroSpec { layers, heads: 4, ffn_width: 48, rwse_steps, centroids: geometry, offsets: geometry }
    };
    let around = |layers_before, layers_after, segment_transformer| M4gn {
        layers_before,
        layers_after,
        segment_transformer,
    };
    let (relu, silu) = (Activation::Relu, Activation::Silu);
    for (kind, activation, hidden_layers, overlap) in [
        (Kind::MeshGraphNet { layers: 3 }, relu, 1, 0),
        (Kind::Gcn { layers: 2 }, silu, 1, 0),
        (Kind::BsmsGnn { levels: 3 }, relu, 2, 0),
        (Kind::BsmsGnn { levels: 9 }, silu, 1, 0),
        (Kind::GUNet { levels: 4 }, silu, 1, 0),
        (Kind::Eagle(around(2, 1, stage(2, 3))), relu, 1, 0),
        (Kind::Eagle(around(1, 2, stage(1, 0))), silu, 2, 2),
        (Kind::M4gn(around(3, 0, stage(2, 0))), relu, 2, 0),
        (Kind::M4gn(around(2, 2, stage(2, 5))), silu, 1, 0),
        (Kind::M4gn(around(2, 1, stage(1, 0))), relu, 1, 2),
    ] {
        let none = MicroSpec::default();
        let architecture = Architecture { width: 32, hidden_layers, activation, micro: none, kind };
        let [before, walk] =
            [MicroSpec { node_sums: NodeSums::Before, ..none }, MicroSpec { node_rwse_steps: 6, ..none }];
        for micro in [none, before, walk] {
            let mut spec = spec(architecture.clone(), overlap);
            spec.architecture.micro = micro;
            if spec.check().is_err() {
                assert!(!architecture.passes_messages(), "{architecture:?} takes no {micro:?}");
                continue;
            }
            let relative = difference(&spec);
            // fp32 sums in different orders, over a few layers.
            assert!(relative < 1e-5, "{relative:e} for {:?}, overlap {overlap}", spec.architecture);
        }
    }
}
