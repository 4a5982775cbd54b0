//! Gradients of the native engine against libtorch's, on every switch of the architecture, through unrolled steps with
//! noise, reflections and batches of several graphs.

use m4gn_data::Trajectory;
use m4gn_engine::Precision;
use m4gn_engine::backward::Layout;
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::samples::Sample;
use m4gn_learn::{Backend, Batch, Example, Learned, NativeBackend, Rollout, TrainingConfig, Workload};
use m4gn_model::{
    Activation, Architecture, ContactSpec, Kind, M4gn, MacroSpec, MicroSpec, Model, ModelSpec, NodeSums,
    Output, SegmentMethod, SegmentSpec, WorldEdges,
};
use m4gn_samples::{distance, training as sample};
use m4gn_torch::backend::TorchBackend;
use m4gn_train::Task;
use m4gn_train::config::Config;
use tch::Device;

fn spec() -> ModelSpec {
    let segment_transformer =
        MacroSpec { layers: 2, heads: 4, ffn_width: 24, rwse_steps: 3, centroids: true, offsets: true };
    let small = m4gn_samples::model::spec();
    ModelSpec {
        stride: 0.02,
        architecture: Architecture {
            width: 32,
            hidden_layers: 2,
            activation: Activation::Silu,
            kind: Kind::M4gn(M4gn { layers_before: 2, layers_after: 1, segment_transformer }),
            ..small.architecture
        },
        segments: SegmentSpec { method: SegmentMethod::Metis, count: 4, ..Default::default() },
        ..small
    }
}

fn stage(spec: &mut ModelSpec) -> &mut MacroSpec {
    &mut spec.architecture.m4gn_mut().unwrap().segment_transformer
}

/// What differs from [`spec`].
type Change = fn(&mut ModelSpec);

const SWITCHES: [(&str, Change); 20] = [
    ("all", |_| ()),
    ("one hidden layer", |s| s.architecture.hidden_layers = 1),
    ("three hidden layers", |s| s.architecture.hidden_layers = 3),
    ("relu", |s| s.architecture.activation = Activation::Relu),
    ("odd width", |s| {
        s.architecture.width = 27;
        stage(s).heads = 3;
    }),
    ("paper's order", |s| s.architecture.m4gn_mut().unwrap().layers_after = 0),
    ("all layers after", |s| {
        let m4gn = s.architecture.m4gn_mut().unwrap();
        (m4gn.layers_before, m4gn.layers_after) = (0, 2);
    }),
    ("mesh-graph-net", |s| {
        s.architecture.kind = Kind::MeshGraphNet { layers: 2 };
    }),
    ("node sums before", |s| s.architecture.micro.node_sums = NodeSums::Before),
    ("node positions", |s| s.architecture.micro.node_rwse_steps = 5),
    ("gcn", |s| s.architecture.kind = Kind::Gcn { layers: 2 }),
    ("bsms-gnn", |s| s.architecture.kind = Kind::BsmsGnn { levels: 3 }),
    ("g-u-net", |s| s.architecture.kind = Kind::GUNet { levels: 3 }),
    ("eagle", |s| {
        let mut stage = s.architecture.m4gn().unwrap().clone();
        stage.layers_after = 1;
        s.architecture.kind = Kind::Eagle(stage);
    }),
    ("no random walk", |s| stage(s).rwse_steps = 0),
    ("no centroids", |s| stage(s).centroids = false),
    ("no offsets", |s| stage(s).offsets = false),
    ("no positions", |s| {
        stage(s).rwse_steps = 0;
        stage(s).centroids = false;
    }),
    ("overlap", |s| s.segments.overlap = 1),
    ("a field that is given", |s| s.fields[1].output = Output::None),
];

/// Trajectories at cells.
fn flows(spec: &ModelSpec) -> Workload {
    let folder = tempfile::tempdir().unwrap();
    sample::write_data(folder.path(), 2).unwrap();
    let read = |number: usize| {
        let path = folder.path().join(format!("{number:03}.h5"));
        m4gn_train::recorded::read(&Trajectory::open(&path).unwrap(), spec).unwrap()
    };
    Workload {
        train: vec![read(0).into(), read(1).into()],
        valid: vec![read(1).into()],
        frames_a_step: 2,
        names: vec![],
    }
}

/// Bodies that bend under an obstacle that comes down; nothing touches the second one.
fn solids(spec: &ModelSpec) -> Workload {
    let read = |length: usize, touched: bool| {
        let body = m4gn_samples::bodies::block([length, 2, 2], [3.0, 1.0, 1.0]);
        let obstacle = touched.then(|| m4gn_samples::bodies::octahedron([2.6, 0.5, 1.6], 0.5));
        let mesh = body.mesh(obstacle.as_ref());
        let mut sample = Sample::of_mesh(&mesh, spec, &spec.segments, None).unwrap();
        sample.n_frames = 8;
        for frame in 0..sample.n_frames {
            let t = 0.1 * frame as f32;
            for x in &body.positions {
                let x = x.map(|v| v as f32);
                sample.frames.extend([
                    0.1 * t * x[1] * x[2],
                    -0.2 * t * x[0] * x[1],
                    -0.3 * t * t * x[0] * x[0],
                ]);
            }
            for _ in 0..obstacle.as_ref().map_or(0, |o| o.positions.len()) {
                sample.frames.extend([0.0, 0.1 * t, -1.5 * t]);
            }
        }
        sample
    };
    Workload {
        train: vec![read(6, true).into(), read(5, false).into()],
        valid: vec![read(6, true).into()],
        frames_a_step: 1,
        names: vec![],
    }
}

/// Weights are not all 1 in fp32, whose results agree to rounding; in bf16 they would only shift what is lost.
fn examples(precision: Precision) -> Vec<Example> {
    let example = |sample, frame, mirror, seed, weight| Example {
        sample,
        frame,
        mirror,
        seed,
        weight: match precision {
            Precision::Fp32 => weight,
            Precision::Bf16 => 1.0,
        },
    };
    vec![example(0, 1, false, 11, 1.0), example(1, 0, true, 12, 0.5), example(1, 2, false, 13, 1.75)]
}

/// Normalisers of the examples, then the loss and gradient of weights of a trained network's size.
fn learn(
    backend: &mut dyn Backend,
    weights: &[f32],
    spec: &ModelSpec,
    (unroll, precision): (usize, Precision),
) -> (Normaliser, Learned) {
    let examples = examples(precision);
    let batch = Batch { examples: &examples, micro: 2, total: 4, unroll, accumulate: true, learn: false };
    let seen = backend.learn(weights, &Normaliser::new(spec), &batch).unwrap();
    let normaliser = seen.moments.unwrap();
    let batch = Batch { accumulate: false, learn: true, ..batch };
    let learned = backend.learn(weights, &normaliser, &batch).unwrap();
    (normaliser, learned)
}

/// The two backends on the same batch.
fn compare(name: &str, spec: &ModelSpec, work: &Workload, precision: Precision, tolerance: f64) {
    spec.check().unwrap();
    let mut training = Config::parse(&sample::config("")).unwrap().training;
    training.precision = precision;
    training.loss_weights = [("U".to_string(), 2.0)].into();
    if spec.contact.is_some() {
        training.noise = [("D".to_string(), 0.01)].into();
    }
    let task = Task { training: &training, spec, work, threads: 2 };
    let layout = Layout::new(spec);
    let mut weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    // Gains that differ from one and biases that differ from zero.
    for (i, w) in weights.iter_mut().enumerate() {
        *w += 0.05 * (1.3 * i as f32).sin();
    }
    for unroll in [1, 3] {
        let mut torch = TorchBackend::new(&task, Device::Cpu).unwrap();
        let mut native = NativeBackend::new(&training, spec, work, 2).unwrap();
        let (mut scales, expected) = learn(&mut torch, &weights, spec, (unroll, precision));
        let (mut own, found) = learn(&mut native, &weights, spec, (unroll, precision));
        for (&mut a, &mut b) in own.numbers_mut().flatten().zip(scales.numbers_mut().flatten()) {
            assert!((a - b).abs() <= 1e-5 * (1.0 + b.abs()), "{name}: moments {a} {b}");
        }
        for (a, b) in found.losses.iter().zip(&expected.losses) {
            assert!((a / b - 1.0).abs() < tolerance, "{name}, {unroll} steps: losses {a} {b}");
        }
        let (found, expected) = (found.gradient.unwrap(), expected.gradient.unwrap());
        let off = distance(&found, &expected);
        println!("{name}, {unroll} steps: {off:.1e}");
        if precision == Precision::Bf16 {
            // Both are rounded, each in its own order: neither may be farther from fp32 than the other.
            let exact = TrainingConfig { precision: Precision::Fp32, ..training.clone() };
            let mut exact = NativeBackend::new(&exact, spec, work, 2).unwrap();
            let exact = learn(&mut exact, &weights, spec, (unroll, precision)).1.gradient.unwrap();
            let (own, other) = (distance(&found, &exact), distance(&expected, &exact));
            println!("    from fp32: {own:.1e}, libtorch {other:.1e}");
            assert!(
                own < 1.5 * other + 5e-3,
                "{name}, {unroll} steps: {own:e} from fp32, libtorch {other:e}"
            );
            assert!(off < 1.5 * (own + other), "{name}: {off:e}");
            assert!(other < 0.5, "{name}: libtorch {other:e} from fp32");
            continue;
        }
        assert!(off < tolerance, "{name}, {unroll} steps: gradients are {off:e} apart");
        // No tensor may hide behind the large ones.
        for (tensor, shape) in layout.entries() {
            let start = layout.find(tensor).unwrap().0;
            let range = start..start + shape.iter().product::<usize>();
            let (a, b) = (&found[range.clone()], &expected[range]);
            let size = b.iter().fold(0f32, |m, v| m.max(v.abs()));
            let off = distance(a, b);
            assert!(
                off < 30.0 * tolerance || size < 1e-6,
                "{name}, {unroll} steps, {tensor}: {off:e} of {size:e}"
            );
        }
    }
    let rollout = [false, true].map(|single| Rollout { sample: 0, frame: 0, steps: 3, single });
    let mut torch = TorchBackend::new(&task, Device::Cpu).unwrap();
    // Rollouts of libtorch are in fp32, and the native ones in the precision of the training.
    let exact = TrainingConfig { precision: Precision::Fp32, ..training.clone() };
    let mut native = NativeBackend::new(&exact, spec, work, 1).unwrap();
    let (normaliser, _) = learn(&mut native, &weights, spec, (1, Precision::Fp32));
    let expected = torch.roll_out(&weights, &normaliser, &rollout).unwrap();
    let found = native.roll_out(&weights, &normaliser, &rollout).unwrap();
    for (a, b) in found.concat().iter().zip(&expected.concat()) {
        assert!((a[0] / b[0] - 1.0).abs() < 1e-3, "{name}: rollout {a:?} {b:?}");
        assert!((a[1] - b[1]).abs() <= 1e-6 * b[1], "{name}: hold {a:?} {b:?}");
    }
}

#[test]
fn gradients_are_those_of_libtorch() {
    for (name, change) in SWITCHES {
        let mut spec = spec();
        change(&mut spec);
        // A value that rounding leaves on the other side of a kink changes the gradient by all that its row adds.
        let tolerance = match spec.architecture.activation {
            Activation::Relu => 1e-3,
            Activation::Silu => 1e-5,
        };
        compare(name, &spec, &flows(&spec), Precision::Fp32, tolerance);
    }
}

#[test]
fn gradients_in_bf16_are_those_of_libtorch() {
    for (name, change) in SWITCHES {
        let mut spec = spec();
        change(&mut spec);
        // A kind that chooses nodes by their latents is refused in bf16.
        if !spec.architecture.needs().whole {
            compare(name, &spec, &flows(&spec), Precision::Bf16, 5e-2);
        }
    }
}

#[test]
fn gradients_of_bodies_are_those_of_libtorch() {
    let (flow, bodies) = (spec(), m4gn_samples::model::bodies());
    let mut spec = ModelSpec {
        stride: flow.stride,
        architecture: flow.architecture,
        contact: Some(ContactSpec { radius: 0.6 }),
        segments: SegmentSpec { method: SegmentMethod::SlicExp, overlap: 1, modes: 1, ..flow.segments },
        ..bodies
    };
    for (name, micro) in [
        ("bodies", MicroSpec::default()),
        ("world edges apart", MicroSpec { world_edges: WorldEdges::Apart, ..MicroSpec::default() }),
        (
            "the paper's",
            MicroSpec { world_edges: WorldEdges::Apart, node_sums: NodeSums::Before, node_rwse_steps: 4 },
        ),
    ] {
        spec.architecture.micro = micro;
        compare(name, &spec, &solids(&spec), Precision::Fp32, 1e-5);
    }
    spec.architecture.micro = MicroSpec::default();
    for kind in [Kind::BsmsGnn { levels: 2 }, Kind::GUNet { levels: 2 }, Kind::Gcn { layers: 2 }] {
        spec.fields[0].input = matches!(kind, Kind::Gcn { .. });
        spec.architecture.kind = kind;
        let name = spec.architecture.name().name();
        compare(name, &spec, &solids(&spec), Precision::Fp32, 1e-5);
    }
}
