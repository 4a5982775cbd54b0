//! Gradients of bodies through several strides.

use crate::backend::{Backend, Batch, Example};
use crate::config::TrainingConfig;
use crate::native::NativeBackend;
use crate::normaliser::Normaliser;
use crate::samples::Sample;
use crate::workload::Workload;
use m4gn_engine::backward::Layout;
use m4gn_mesh::body::Body;
use m4gn_model::{Activation, Model, ModelSpec};

const STRIDE: usize = 2;

fn spec() -> ModelSpec {
    let mut spec = m4gn_samples::model::bodies();
    spec.segments.count = 3;
    spec.segments.modes = 1;
    // Without kinks, which differences would step over.
    spec.architecture.activation = Activation::Silu;
    spec
}

/// Displacement of a point at rest in `x` in a frame: in y and z with the square of the time.
fn displacement(x: [f64; 3], frame: usize) -> [f32; 3] {
    let (t, x) = (0.1 * frame as f32, x.map(|v| v as f32));
    [0.0, -0.2 * t * t * x[0], 0.3 * t * t * x[0] * x[0]]
}

/// A bar that bends, with an obstacle that moves out of its reach, so that the gradient has no part that counts as given.
fn bar(spec: &ModelSpec) -> (Workload, Body) {
    bending(m4gn_samples::bodies::block([4, 1, 1], [3.0, 1.0, 1.0]), spec)
}

fn bending(body: Body, spec: &ModelSpec) -> (Workload, Body) {
    let obstacle = m4gn_samples::bodies::octahedron([2.6, 0.5, 9.0], 0.5);
    let mesh = body.mesh(Some(&obstacle));
    let mut sample = Sample::of_mesh(&mesh, spec, &spec.segments, None).unwrap();
    sample.n_frames = 12;
    for frame in 0..sample.n_frames {
        let points = body.positions.iter().flat_map(|x| displacement(*x, frame));
        sample.frames.extend(points);
        let t = 0.1 * frame as f32;
        sample.frames.extend([0.0, 0.1 * t, -t].repeat(obstacle.positions.len()));
    }
    let sample = std::sync::Arc::new(sample);
    let work =
        Workload { train: vec![sample.clone()], valid: vec![sample], frames_a_step: STRIDE, names: vec![] };
    (work, body)
}

fn training() -> TrainingConfig {
    TrainingConfig { noise: [("D".to_string(), 0.01)].into(), ..TrainingConfig::default() }
}

/// Loss and gradient of two examples, one of them reflected, from which normalisers are made as well.
fn learn(
    backend: &mut NativeBackend,
    normaliser: Option<&Normaliser>,
    weights: &[f32],
    unroll: usize,
) -> (f64, Vec<f32>, Normaliser) {
    let example = |frame, mirror, seed| Example { sample: 0, frame, mirror, seed, weight: 1.0 };
    let examples = [example(1, false, 11), example(4, true, 12)];
    let batch = Batch { examples: &examples, micro: 1, total: 2, unroll, accumulate: true, learn: false };
    let none = Normaliser::new(&backend.spec);
    let normaliser = match normaliser {
        Some(normaliser) => normaliser.clone(),
        None => backend.learn(weights, &none, &batch).unwrap().moments.unwrap(),
    };
    let batch = Batch { accumulate: false, learn: true, ..batch };
    let learned = backend.learn(weights, &normaliser, &batch).unwrap();
    (learned.losses.iter().sum(), learned.gradient.unwrap(), normaliser)
}

/// The change that is wanted: with noise that is not corrected the recorded one, to the bit, else one that takes it away.
#[test]
fn noise_is_corrected_as_far_as_asked() {
    let spec = spec();
    let (work, _) = bar(&spec);
    let layout = Layout::new(&spec);
    let weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    let spread = |t: &TrainingConfig| {
        let mut backend = NativeBackend::new(t, &spec, &work, 1).unwrap();
        learn(&mut backend, None, &weights, 1).2.scales().output.std
    };
    let recorded = spread(&TrainingConfig::default());
    let with = |noise_correction| spread(&TrainingConfig { noise_correction, ..training() });
    let (none, half, whole) = (with(0.0), with(0.5), with(1.0));
    assert_eq!(none, recorded);
    assert!(none[0] < half[0] && half[0] < whole[0], "{none:?} {half:?} {whole:?}");
}

/// Through three strides: the derivative along the gradient is that of differences.
#[test]
fn the_gradient_through_an_unroll_is_that_of_differences() {
    unrolled(&spec());
    for mut spec in m4gn_samples::model::bodies_of_other_kinds() {
        spec.architecture.activation = Activation::Silu;
        unrolled(&spec);
    }
}

fn unrolled(spec: &ModelSpec) {
    let (work, _) = bar(spec);
    let mut backend = NativeBackend::new(&training(), spec, &work, 1).unwrap();
    let layout = Layout::new(spec);
    let weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    for unroll in [2, 3] {
        let (_, gradient, normaliser) = learn(&mut backend, None, &weights, unroll);
        along(&mut backend, &normaliser, (&weights, &gradient), unroll, (3e-4, 1e-3));
    }
}

/// Checks the derivative along a direction, of which the length is expected, by a difference of this size to this tolerance.
fn along(
    backend: &mut NativeBackend,
    normaliser: &Normaliser,
    (weights, direction): (&[f32], &[f32]),
    unroll: usize,
    (size, tolerance): (f64, f64),
) {
    let length = direction.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
    let mut at = |size: f64| {
        let pairs = weights.iter().zip(direction);
        let moved: Vec<f32> = pairs.map(|(w, d)| w + (size * f64::from(*d) / length) as f32).collect();
        learn(backend, Some(normaliser), &moved, unroll).0
    };
    let found = (at(size) - at(-size)) / (2.0 * size);
    assert!((found / length - 1.0).abs() < tolerance, "{unroll} strides: {found} and {length}");
}

/// Two bars that see each other by world edges, through three strides. How near they come counts as given, so that the network here does
/// not read it.
#[test]
fn the_gradient_goes_from_body_to_body() {
    let mut spec = spec();
    spec.contact.as_mut().unwrap().radius = 0.5;
    let (work, body) = bending(m4gn_samples::bodies::stack([4, 1, 1], [3.0, 1.0, 1.0], 0.2), &spec);
    let edges = work.train[0].structure.graph.senders.len();
    // Corners across the gap, both ways: eight of the free points of each.
    assert_eq!(edges, 2 * body.edges.len() + 2 * 12 + 2 * 8);
    let mut backend = NativeBackend::new(&training(), &spec, &work, 1).unwrap();
    let layout = Layout::new(&spec);
    let mut weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    let (start, shape) = layout.find("encoder.node.0.weight").unwrap();
    let nearness: Vec<usize> =
        (0..shape[0]).flat_map(|row| (3..8).map(move |column| start + row * shape[1] + column)).collect();
    nearness.iter().for_each(|&i| weights[i] = 0.0);
    let (_, mut direction, normaliser) = learn(&mut backend, None, &weights, 3);
    nearness.iter().for_each(|&i| direction[i] = 0.0);
    along(&mut backend, &normaliser, (&weights, &direction), 3, (1e-2, 1e-2));
}
