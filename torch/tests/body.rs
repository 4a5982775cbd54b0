//! A body's step in libtorch against the same step of a session. A test program of its own: the segments need PETSc, which is
//! not made for several threads, and other tests would run beside it.

use m4gn_domain::Components;
use m4gn_model::{
    Architecture, ContactSpec, Kind, M4gn, MacroSpec, MicroSpec, Model, ModelSpec, NodeSums, SegmentMethod,
    SegmentSpec, WorldEdges,
};
use m4gn_parallel::Comm;
use m4gn_step::{Session, SessionOptions};
use m4gn_torch::contact;
use m4gn_torch::network::Network;
use m4gn_torch::normaliser::Scales;
use m4gn_torch::rollout::{State, Stepper};
use m4gn_torch::samples::Sample;
use m4gn_torch::weights::Layout;
use tch::{Device, Tensor};

fn spec() -> ModelSpec {
    let segment_transformer =
        MacroSpec { layers: 2, heads: 4, ffn_width: 48, rwse_steps: 3, centroids: true, offsets: true };
    let small = m4gn_samples::model::bodies();
    ModelSpec {
        stride: 0.05,
        architecture: Architecture {
            width: 32,
            kind: Kind::M4gn(M4gn { layers_before: 2, layers_after: 2, segment_transformer }),
            ..small.architecture
        },
        contact: Some(ContactSpec { radius: 0.6 }),
        segments: SegmentSpec {
            method: SegmentMethod::SlicExp,
            count: 6,
            overlap: 1,
            modes: 1,
            ..Default::default()
        },
        ..small
    }
}

fn relative(a: &Tensor, b: &Tensor) -> f64 {
    (a - b).norm().double_value(&[]) / b.norm().double_value(&[])
}

/// A trajectory at points through the training's own reading and stepping against a session of the core crate: features,
/// world edges, segments, held points.
#[test]
fn bodies_take_the_same_step_in_training_and_in_a_session() {
    let mut spec = spec();
    same_steps(&spec);
    spec.architecture.micro =
        MicroSpec { world_edges: WorldEdges::Apart, node_sums: NodeSums::Before, node_rwse_steps: 4 };
    same_steps(&spec);
    spec.architecture.micro = MicroSpec::default();
    for kind in [Kind::BsmsGnn { levels: 2 }, Kind::GUNet { levels: 2 }, Kind::Gcn { layers: 2 }] {
        spec.fields[0].input = matches!(kind, Kind::Gcn { .. });
        spec.architecture.kind = kind;
        same_steps(&spec);
    }
}

fn same_steps(spec: &ModelSpec) {
    let body = m4gn_samples::bodies::block([6, 2, 2], [3.0, 1.0, 1.0]);
    let obstacle = m4gn_samples::bodies::octahedron([2.6, 0.5, 1.6], 0.5);
    let model = Model::random(spec.clone(), 7).unwrap();
    let options = SessionOptions::default();
    let mut session = Session::new(Comm::serial(), &body.mesh(Some(&obstacle)), &model, &options).unwrap();

    let mesh = body.mesh(Some(&obstacle));
    let sample = m4gn_learn::samples::Sample::of_mesh(&mesh, spec, &spec.segments, None).unwrap();
    let sample = Sample::new(&std::sync::Arc::new(sample), spec, Device::Cpu).unwrap();
    let layout = Layout::new(spec);
    let weights = layout.views(&Tensor::from_slice(&layout.flatten(&model).unwrap()), false);
    let network = Network::new(&spec.architecture, &weights);
    let scale = |name: &str| {
        let part = |which: &str| Tensor::from_slice(&model.tensors[&format!("norm.{name}.{which}")].data);
        (part("mean"), part("std"))
    };
    let scales = Scales { node: scale("node"), edge: scale("edge"), output: scale("output") };
    let stepper = Stepper::new(spec, &Components::new(spec), Device::Cpu);
    let domains = [sample.domain(false)];
    let tensor = |rows: &[[f64; 3]]| {
        let flat: Vec<f32> = rows.iter().flatten().map(|&v| v as f32).collect();
        Tensor::from_slice(&flat).view([-1, 3])
    };
    let mut displacement: Vec<[f64; 3]> =
        body.positions.iter().map(|x| [0.01 * x[0], -0.02 * x[0] * x[1], -0.03 * x[0] * x[0]]).collect();
    for step in 0..3 {
        let at = |s: i32| vec![[0.0, 0.01, -0.15 * f64::from(s)]; 6];
        let (now, next) = (at(step), at(step + 1));
        let state = State { cells: tensor(&displacement), boundary: tensor(&now) };
        let target = State { cells: state.cells.shallow_clone(), boundary: tensor(&next) };
        let graph = contact::at_state(sample.topologies[0].share(), &domains, &state).unwrap();
        let edges = contact::edge_features(&graph, &state);
        let inputs = stepper.inputs(&domains, &state, &target).unwrap();
        let output = stepper.predict(&network, &graph, (&inputs, &edges), &scales);
        let after = stepper.advance(&scales, &sample.boundary, &state, &output, &target);
        let before = displacement.clone();
        session.step_body(&mut displacement, [&now, &next]).unwrap();
        let error = relative(&after.cells, &tensor(&displacement));
        assert!(error < 1e-5, "step {step}: {error:e}");
        assert!(relative(&after.cells, &tensor(&before)) > 1e-2, "nothing moved");
        displacement.iter_mut().flatten().for_each(|v| *v *= 0.02);
    }
}
