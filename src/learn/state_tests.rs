//! What the displacement changed by over the stride before, as a part of the state.

use super::*;
use crate::backend::{Backend, Batch, Example};
use crate::config::TrainingConfig;
use crate::inputs;
use crate::native::NativeBackend;
use crate::normaliser::Normaliser;
use crate::workload::Workload;
use m4gn_engine::backward::Layout;
use m4gn_mesh::body::Body;
use m4gn_model::{Activation, Model, ModelSpec};

const STRIDE: usize = 2;

fn spec(history: usize) -> ModelSpec {
    let mut spec = m4gn_samples::model::bodies();
    spec.segments.count = 3;
    spec.segments.modes = 1;
    // Without kinks, which differences would step over.
    spec.architecture.activation = Activation::Silu;
    spec.contact.as_mut().unwrap().history = history;
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
    let mut sample = Sample::of_mesh(&mesh, spec, &spec.segments, None, None).unwrap();
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

fn close(a: f32, b: f32) {
    assert!((a - b).abs() < 1e-5, "{a} {b}");
}

#[test]
fn a_frame_has_the_change_since_the_stride_before() {
    let spec = spec(1);
    let (work, body) = bar(&spec);
    let sample = &work.train[0];
    // The square of 0.1 frame less that of a stride before; of the first frame nothing, of the second that since the first one.
    for (frame, change) in [(0, 0.0), (1, 0.01), (2, 0.04), (5, 0.16)] {
        for mirror in [false, true] {
            let state = sample.state(frame, STRIDE, mirror).unwrap();
            let (now, changes) = sample.domain.parts(&state);
            let changes = changes.unwrap();
            assert_eq!(now.len(), changes.len());
            let sign = if mirror { -1.0 } else { 1.0 };
            for (p, x) in body.positions.iter().enumerate() {
                let x = x[0] as f32;
                close(changes[3 * p + 1], sign * -0.2 * change * x);
                close(changes[3 * p + 2], 0.3 * change * x * x);
                close(now[3 * p + 2], 0.3 * (0.1 * frame as f32).powi(2) * x * x);
            }
            // The obstacle moves evenly.
            let obstacle = &changes[3 * body.positions.len()..];
            close(obstacle[1], sign * 0.01 * frame.min(STRIDE) as f32);
            close(obstacle[2], -0.1 * frame.min(STRIDE) as f32);
        }
    }
    // Without a history a state is a frame.
    let (work, _) = bar(&self::spec(0));
    let sample = &work.train[0];
    let frame = sample.frame(5).unwrap();
    assert_eq!(sample.state(5, STRIDE, false).unwrap(), *frame);
    assert!(sample.domain.parts(&frame).1.is_none());
}

#[test]
fn a_step_leaves_its_change_behind() {
    let spec = spec(1);
    let (work, body) = bar(&spec);
    let sample = &work.train[0];
    let state = sample.state(4, STRIDE, false).unwrap();
    let next = sample.state(4 + STRIDE, STRIDE, false).unwrap();
    let outputs: Vec<f32> = (0..3 * sample.n_cells()).map(|i| 0.01 * i as f32).collect();
    let new = sample.domain.advance(&state, &outputs, &next);
    let half = state.len() / 2;
    for (p, x) in body.positions.iter().enumerate() {
        for i in 3 * p..3 * p + 3 {
            // Held points and the obstacle go as they are told.
            let held = x[0] == 0.0;
            let expected = if held { next[half + i] } else { outputs[i] };
            assert_eq!(new[half + i], expected);
            let expected = if held { next[i] } else { state[i] + outputs[i] };
            assert_eq!(new[i], expected);
        }
    }
    assert_eq!(new[3 * body.positions.len()..half], next[3 * body.positions.len()..half]);
    assert_eq!(new[half + 3 * body.positions.len()..], next[half + 3 * body.positions.len()..]);
    // What the network is told of it then.
    let mut inputs = Vec::new();
    sample.domain.inputs(&new, &next, &mut inputs);
    for (row, change) in inputs.chunks_exact(11).zip(new[half..].chunks_exact(3)) {
        assert_eq!(row[8..], *change);
    }
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

/// Through three strides, each of which reads what the one before changed: the derivative along the gradient, and along a direction of
/// its own, is that of differences.
#[test]
fn the_gradient_through_an_unroll_is_that_of_differences() {
    let spec = spec(1);
    let (work, _) = bar(&spec);
    let mut backend = NativeBackend::new(&training(), &spec, &work, 1).unwrap();
    let layout = Layout::new(&spec);
    let weights = layout.flatten(&Model::random(spec.clone(), 3).unwrap()).unwrap();
    for unroll in [2, 3] {
        let (_, gradient, normaliser) = learn(&mut backend, None, &weights, unroll);
        let length = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let along: Vec<f32> = gradient.iter().map(|g| (f64::from(*g) / length) as f32).collect();
        // The first layer's weights of the change alone, which nothing else hides.
        let (start, shape) = layout.find("encoder.node.0.weight").unwrap();
        let columns = shape[1];
        let mut change = vec![0.0; weights.len()];
        for row in 0..shape[0] {
            for column in 8..11 {
                change[start + row * columns + column] = 0.3 * (1.7 * (row * columns + column) as f32).sin();
            }
        }
        for direction in [along, change] {
            let expected: f64 =
                gradient.iter().zip(&direction).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            let mut at = |size: f32| {
                let moved: Vec<f32> = weights.iter().zip(&direction).map(|(w, d)| w + size * d).collect();
                learn(&mut backend, Some(&normaliser), &moved, unroll).0
            };
            let found = (at(1e-2) - at(-1e-2)) / 2e-2;
            assert!((found / expected - 1.0).abs() < 1e-2, "{unroll} strides: {found} and {expected}");
        }
    }
}

/// Two bars that see each other by world edges, through three strides. How near they come counts as given, so that the network here does
/// not read it.
#[test]
fn the_gradient_goes_from_body_to_body() {
    let mut spec = spec(0);
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
    let (_, gradient, normaliser) = learn(&mut backend, None, &weights, 3);
    let mut direction = gradient;
    nearness.iter().for_each(|&i| direction[i] = 0.0);
    let length = direction.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
    let mut at = |size: f64| {
        let pairs = weights.iter().zip(&direction);
        let moved: Vec<f32> = pairs.map(|(w, d)| w + (size * f64::from(*d) / length) as f32).collect();
        learn(&mut backend, Some(&normaliser), &moved, 3).0
    };
    let found = (at(1e-2) - at(-1e-2)) / 2e-2;
    assert!((found / length - 1.0).abs() < 1e-2, "{found} and {length}");
}

/// A model from before, given a history, says what it said.
#[test]
fn a_history_that_is_added_changes_nothing_at_first() {
    let (old, new) = (spec(0), spec(1));
    assert!(inputs::follow_contact(old.contact, new.contact));
    assert!(!inputs::follow_contact(new.contact, old.contact));
    let ((work_old, _), (work_new, _)) = (bar(&old), bar(&new));
    let model = Model::random(old.clone(), 3).unwrap();
    let extended = inputs::extend(model.clone(), &new, &work_new).unwrap();
    assert_eq!(extended.spec.contact, new.contact);
    let (mean, std) = (&extended.tensors["norm.node.mean"].data, &extended.tensors["norm.node.std"].data);
    assert_eq!((mean.len(), &mean[8..]), (11, &[0.0; 3][..]));
    assert!(std[8] > 0.0 && std[8] != 1.0 && std[8..].iter().all(|s| *s == std[8]));
    let losses = |spec: &ModelSpec, work: &Workload, model: &Model| {
        let mut backend = NativeBackend::new(&training(), spec, work, 1).unwrap();
        let weights = Layout::new(spec).flatten(model).unwrap();
        let normaliser = Normaliser::of_model(model).unwrap();
        learn(&mut backend, Some(&normaliser), &weights, 2).0
    };
    let (before, after) = (losses(&old, &work_old, &model), losses(&new, &work_new, &extended));
    assert!((after / before - 1.0).abs() < 1e-6, "{before} {after}");
}

/// In this bar a stride's change is the square of the distance from the handle (in z), times a number of its own.
#[test]
fn an_example_came_at_another_pace_and_its_change_is_off() {
    let spec = spec(1);
    let (work, body) = bar(&spec);
    let sample = &work.train[0];
    let start = |pace: f64, noise: f64, seed: u64| {
        let mut t = training();
        t.noise.clear();
        (t.history_pace, t.history_noise) = (pace, noise);
        let backend = NativeBackend::new(&t, &spec, &work, 1).unwrap();
        let example = Example { sample: 0, frame: 5, mirror: false, seed, weight: 1.0 };
        backend.start(sample, &example).unwrap()
    };
    let frame = sample.state(5, STRIDE, false).unwrap();
    assert_eq!(start(0.0, 0.0, 1), frame);
    let tip = body.positions.iter().position(|x| x[0] == 3.0).unwrap();
    let half = frame.len() / 2;
    // The factor of the change, and how far the obstacle came.
    let of_change = |state: &[f32]| (state[half + 3 * tip + 2] / (0.3 * 9.0), -10.0 * state[frame.len() - 1]);
    let mut seen = [false; 2 * STRIDE + 1];
    for seed in 0..60 {
        let state = start(1.0, 0.0, seed);
        assert_eq!(state[..half], frame[..half]);
        let (factor, frames) = of_change(&state);
        let frames = frames.round() as usize;
        let t = |frame: usize| (0.1 * frame as f32).powi(2);
        close(factor, t(5) - t(5 - frames));
        seen[frames] = true;
    }
    assert_eq!(seen, [true; 2 * STRIDE + 1]);
    let mut largest = 0f32;
    for seed in 0..20 {
        let state = start(0.0, 0.5, seed);
        let n = 3 * sample.n_cells();
        assert_eq!(state[..half], frame[..half]);
        let off = of_change(&state).0 - of_change(&frame).0;
        for (p, x) in body.positions.iter().enumerate() {
            let at = half + 3 * p + 2;
            close(state[at] - frame[at], 0.3 * off * (x[0] * x[0]) as f32);
        }
        assert_eq!(state[half + n..], frame[half + n..]);
        largest = largest.max(off.abs());
    }
    assert!(largest > 0.02, "{largest}");
}
