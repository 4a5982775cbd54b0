//! Gradients of bodies through several strides.

use crate::backend::{Backend, Batch, Example, Rollout};
use crate::config::TrainingConfig;
use crate::native::NativeBackend;
use crate::normaliser::Normaliser;
use crate::samples::Sample;
use crate::workload::Workload;
use m4gn_engine::backward::Layout;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::Body;
use m4gn_model::{Activation, Model, ModelSpec};
use std::collections::BTreeMap;

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
    TrainingConfig { noise: [("D".to_string(), 0.01)].into(), mirror: true, ..TrainingConfig::default() }
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

/// Its displacement grows with the square of the time: the error of the first frame with the fourth power, on and on.
#[test]
fn a_body_that_leaves_the_numbers_is_measured_beside_the_frame_that_is_held() {
    let spec = spec();
    let (work, _) = bar(&spec);
    let mut backend = NativeBackend::new(&training(), &spec, &work, 1).unwrap();
    let weights = vec![1e30; Layout::new(&spec).len()];
    let rollout = Rollout { sample: 0, frame: 0, steps: 3, single: false };
    let errors = backend.roll_out(&weights, &Normaliser::new(&spec), &[rollout]).unwrap().remove(0);
    assert_eq!((errors.len(), errors[2][0]), (3, f64::INFINITY));
    let growth = errors[2][1] / errors[0][1];
    assert!((growth - 81.0).abs() < 1e-3, "{errors:?}");
}

/// The change that is wanted takes the noise away: it varies by more than the recorded one.
#[test]
fn noise_is_corrected() {
    let spec = spec();
    let (work, _) = bar(&spec);
    let layout = Layout::new(&spec);
    let weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    let spread = |t: &TrainingConfig| {
        let mut backend = NativeBackend::new(t, &spec, &work, 1).unwrap();
        learn(&mut backend, None, &weights, 1).2.scales().output.std
    };
    let recorded = spread(&TrainingConfig { noise: BTreeMap::new(), ..training() });
    let noisy = spread(&training());
    assert!(recorded[0] < noisy[0], "{recorded:?} {noisy:?}");
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
    unrolled_on(spec, &bar(spec).0, &training());
}

fn unrolled_on(spec: &ModelSpec, work: &Workload, t: &TrainingConfig) {
    let mut backend = NativeBackend::new(t, spec, work, 1).unwrap();
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

/// A flow at points, those of its walls at rest and those of its inlet at .5 m/s.
fn points(spec: &ModelSpec) -> Workload {
    let mesh = m4gn_samples::mesh::at_points(m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0));
    let mut sample = Sample::of_mesh(&mesh, spec, &spec.segments, None).unwrap();
    sample.n_frames = 12;
    for frame in 0..sample.n_frames {
        let wave = |x: &[f64; 3], k: f64| (k * x[0] + 2.0 * x[1] + 0.2 * frame as f64).sin() as f32;
        let mut rows: Vec<[f32; 3]> =
            mesh.cell_centres.iter().map(|x| [wave(x, 1.0), wave(x, 3.0), wave(x, 2.0)]).collect();
        for face in &mesh.boundary {
            let owner = face.owner as usize;
            match face.kind {
                NodeType::Wall => rows[owner][..2].fill(0.0),
                NodeType::Inlet => rows[owner][..2].copy_from_slice(&[0.5, 0.0]),
                _ => {}
            }
        }
        let faces: Vec<[f32; 3]> = mesh.boundary.iter().map(|b| rows[b.owner as usize]).collect();
        let state = [rows, faces].concat().concat();
        sample.domain.boundary_mut().see(&state);
        sample.frames.extend(state);
    }
    sample.domain.boundary_mut().settle();
    let sample = std::sync::Arc::new(sample);
    Workload { train: vec![sample.clone()], valid: vec![sample], frames_a_step: STRIDE, names: vec![] }
}

fn flow() -> (ModelSpec, TrainingConfig) {
    let mut spec = m4gn_samples::model::spec();
    spec.architecture.activation = Activation::Silu;
    spec.segments.method = m4gn_model::SegmentMethod::Metis;
    let noise = [("U".to_string(), 0.05), ("p".to_string(), 0.05)].into();
    (spec, TrainingConfig { noise, ..training() })
}

/// Where points are held: no noise, no loss, and the recorded value after each stride.
#[test]
fn points_of_walls_are_prescribed() {
    let (spec, t) = flow();
    let work = points(&spec);
    let sample = &work.train[0];
    let held = |node: usize, i: usize| sample.domain.is_held(node, i);
    let count = (0..sample.n_cells()).filter(|&node| held(node, 0)).count();
    assert!(count > 8 && count < sample.n_cells() / 2, "{count} of {}", sample.n_cells());

    let backend = NativeBackend::new(&t, &spec, &work, 1).unwrap();
    let clean = sample.state(3, false).unwrap();
    let mut noisy = clean.clone();
    backend.add_noise(sample, 7, &mut noisy);
    let outputs: Vec<f32> = (0..3 * sample.n_cells()).map(|i| 1.0 + i as f32).collect();
    let next = sample.state(5, false).unwrap();
    let after = sample.domain.advance(&clean, &outputs, &next);
    for node in 0..sample.n_cells() {
        for (i, at) in (3 * node..3 * node + 3).enumerate() {
            assert_eq!(noisy[at] == clean[at], held(node, i), "noise at component {i} of node {node}");
            assert_eq!(after[at] == next[at], held(node, i), "component {i} of node {node} after a stride");
        }
    }

    // What is wanted at held points counts in neither loss nor gradient; at others it does.
    let weights = Layout::new(&spec).flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    let learned = |shifted: Option<bool>, normaliser: Option<&Normaliser>| {
        let mut work = points(&spec);
        let sample = std::sync::Arc::make_mut(&mut work.train[0]);
        let width = sample.frames.len() / sample.n_frames;
        let nodes: Vec<usize> =
            (0..sample.n_cells()).filter(|&n| Some(sample.domain.is_held(n, 0)) == shifted).collect();
        // The frames that the examples of `learn` end at.
        for at in [3, 6].into_iter().flat_map(|frame| nodes.iter().map(move |node| frame * width + 3 * node))
        {
            sample.frames[at] += 1.0;
        }
        let mut backend = NativeBackend::new(&t, &spec, &work, 1).unwrap();
        learn(&mut backend, normaliser, &weights, 1)
    };
    let (loss, gradient, normaliser) = learned(None, None);
    let (same, as_before, _) = learned(Some(true), Some(&normaliser));
    assert_eq!((same, as_before == gradient), (loss, true));
    assert!(learned(Some(false), Some(&normaliser)).0 > 1.1 * loss);
}

/// Through three strides of a flow with held points.
#[test]
fn the_gradient_goes_past_held_points() {
    let (spec, t) = flow();
    unrolled_on(&spec, &points(&spec), &t);
}
