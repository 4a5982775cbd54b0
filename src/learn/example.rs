//! Loss and gradient of one example on the native engine, through all its unrolled steps.

use super::backend::{Batch, Example};
use super::native::NativeBackend;
use super::normaliser::Normaliser;
use super::samples::Sample;
use m4gn_contact::graph::{ContactGraph, N_FEATURES, features_backward};
use m4gn_engine::backward::{InputGradient, Scales, TrainGraph, Worker, normal};
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

/// Bytes that one thread keeps of unrolled steps; beyond it they are computed again in the backward pass.
const KEEP: usize = 1 << 30;

/// The graph of a body at a state, with its senders and receivers.
pub(crate) type Moved = (TrainGraph, Vec<i32>, Vec<i32>);

/// An application of the network: the state before it, and, of bodies, the graph there with its senders and receivers.
struct Applied {
    state: Vec<f32>,
    graph: Option<Moved>,
}

/// What comes of one example.
pub struct Piece {
    /// Its part of the gradient.
    pub gradient: Option<Vec<f32>>,
    /// Its part of the losses.
    pub losses: Vec<f64>,
    /// What the normalisers need.
    pub moments: Option<Normaliser>,
}

impl NativeBackend<'_> {
    /// Loss and gradient of an example, whose part of the batch is `share`.
    pub(crate) fn learn_one(
        &self,
        worker: &mut Worker,
        scales: &Scales,
        example: &Example,
        batch: &Batch,
        share: f64,
    ) -> Result<Piece> {
        let sample = &self.work.train[example.sample];
        let base = &self.graphs[example.sample][usize::from(example.mirror)];
        let stride = self.work.frames_a_step;
        let frame = |step: usize| {
            self.stepper
                .frame(sample, example.frame + step * stride, example.mirror)
        };
        let mut contact = sample.contact.as_ref().map(|c| match example.mirror {
            true => c.reflected(),
            false => c.clone(),
        });
        let began = Instant::now();
        let mut state = self.start(sample, example)?;
        let (mut inputs, mut target) = (Vec::new(), Vec::new());
        let mut moments = None;
        let mut graph = at_state(base, &mut contact, self.stepper.parts(&state).0)?;
        if batch.accumulate {
            let next = frame(1)?;
            self.stepper.inputs(contact.as_ref(), &state, &next, &mut inputs);
            self.stepper.target(sample, &state, &next, &mut target);
            let edges = graph.as_ref().map_or(base, |g| &g.0).edge_features();
            moments = Some(Normaliser::of_example(&self.spec, &inputs, edges, &target));
        }
        let mut losses = vec![0.0; self.groups.len()];
        if !batch.learn {
            return Ok(Piece {
                gradient: None,
                losses,
                moments,
            });
        }
        let m = self.spec.n_outputs();
        let mut outputs = vec![0.0; sample.n_cells() * m];
        // Derivatives by the normalised outputs of each step, and the applications they belong to.
        let mut d_outputs: Vec<Vec<f32>> = Vec::new();
        let mut applied: Vec<Applied> = Vec::new();
        let mut keep = batch.unroll;
        for step in 1..=batch.unroll {
            let next = frame(step)?;
            self.stepper.inputs(contact.as_ref(), &state, &next, &mut inputs);
            let here = graph.as_ref().map_or(base, |g| &g.0);
            let tape = if step <= keep { step - 1 } else { 0 };
            self.network
                .forward(worker, tape, here, scales, &inputs, &mut outputs);
            if step == 1 && batch.unroll > 1 && batch.unroll * self.network.memory(worker).2 > KEEP {
                keep = 1;
            }
            self.stepper.target(sample, &state, &next, &mut target);
            let mut d = self.loss(scales, &outputs, &target, (batch.unroll, share), &mut losses);
            if let Some(smoother) = self.smoothers.get(example.sample) {
                smoother.add_smooth(&mut d, m);
            }
            d_outputs.push(d);
            let new = match step < batch.unroll {
                true => {
                    scales.output.to_physical(&mut outputs);
                    self.stepper.advance(sample, &state, &outputs, &next)
                }
                false => Vec::new(),
            };
            applied.push(Applied {
                state: std::mem::replace(&mut state, new),
                graph: graph.take(),
            });
            if step < batch.unroll {
                graph = at_state(base, &mut contact, self.stepper.parts(&state).0)?;
            }
        }
        let began = self.lap(1, began);
        self.backward(
            worker,
            scales,
            (base, contact.as_ref()),
            sample,
            example,
            (applied, d_outputs, keep),
        )?;
        let mut gradient = vec![0.0; self.network.layout().len()];
        self.network.flush(worker, &mut gradient);
        self.lap(2, began);
        Ok(Piece {
            gradient: Some(gradient),
            losses,
            moments,
        })
    }

    /// Through all applications, last to first.
    fn backward(
        &self,
        worker: &mut Worker,
        scales: &Scales,
        (base, contact): (&TrainGraph, Option<&ContactGraph>),
        sample: &Sample,
        example: &Example,
        (applied, d_outputs, keep): (Vec<Applied>, Vec<Vec<f32>>, usize),
    ) -> Result<()> {
        let unroll = applied.len();
        let m = self.spec.n_outputs();
        let stride = self.work.frames_a_step;
        let mut by_inputs = InputGradient::default();
        let (mut inputs, mut unread) = (Vec::new(), Vec::new());
        // Derivative by the state behind the step.
        let mut behind: Option<Vec<f32>> = None;
        for (step, (application, loss)) in applied.iter().zip(&d_outputs).enumerate().rev() {
            let graph = application.graph.as_ref().map_or(base, |g| &g.0);
            let mut d = loss.clone();
            let mut d_state = None;
            if let Some(mut behind) = behind.take() {
                let mut physical = vec![0.0; d.len()];
                d_state = Some(self.stepper.advance_backward(sample, &mut behind, &mut physical));
                for (d, physical) in d.chunks_exact_mut(m).zip(physical.chunks_exact(m)) {
                    let both = d.iter_mut().zip(physical).zip(&scales.output.std);
                    both.for_each(|((d, p), std)| *d += p * std);
                }
            }
            if keep < unroll && step + 1 < unroll {
                let next = self
                    .stepper
                    .frame(sample, example.frame + (step + 1) * stride, example.mirror)?;
                self.stepper
                    .inputs(contact, &application.state, &next, &mut inputs);
                unread.resize(d.len(), 0.0);
                self.network
                    .forward(worker, 0, graph, scales, &inputs, &mut unread);
            }
            let tape = if keep < unroll { 0 } else { step };
            let wanted = step > 0 && self.through_unroll;
            if wanted {
                by_inputs
                    .nodes
                    .resize(graph.n_nodes() * self.spec.n_field_inputs(), 0.0);
                by_inputs.edges = application
                    .graph
                    .as_ref()
                    .map(|_| vec![0.0; graph.edge_features().len()]);
            }
            let by = wanted.then_some(&mut by_inputs);
            self.network.backward(worker, tape, graph, scales, &d, by);
            if !wanted {
                continue;
            }
            let size = application.state.len();
            let mut d_state = d_state.unwrap_or_else(|| vec![0.0; size]);
            self.stepper.inputs_backward(&by_inputs.nodes, &mut d_state);
            // The target of a change is as far as the state is off.
            let mut d_target = loss.clone();
            for row in d_target.chunks_exact_mut(m) {
                let scaled = row.iter_mut().zip(&scales.output.inverse);
                scaled.for_each(|(d, inverse)| *d *= -inverse);
            }
            self.stepper.target_backward(&d_target, &mut d_state);
            if let (Some((graph, senders, receivers)), Some(d)) = (&application.graph, &by_inputs.edges) {
                edges_backward(graph.edge_features(), d, (senders, receivers), &mut d_state);
            }
            behind = Some(d_state);
        }
        Ok(())
    }

    /// Adds to the losses, and gives the derivative of their weighted sum by the normalised outputs.
    fn loss(
        &self,
        scales: &Scales,
        outputs: &[f32],
        target: &[f32],
        (unroll, share): (usize, f64),
        losses: &mut [f64],
    ) -> Vec<f32> {
        let m = self.spec.n_outputs();
        let cells = outputs.len() / m;
        let mut d = vec![0.0; outputs.len()];
        let mut sums = vec![0.0; self.groups.len()];
        for ((d, y), target) in d
            .chunks_exact_mut(m)
            .zip(outputs.chunks_exact(m))
            .zip(target.chunks_exact(m))
        {
            for (&(first, n, weight), sum) in self.groups.iter().zip(&mut sums) {
                let factor = (2.0 * weight * share / (unroll * cells * n) as f64) as f32;
                for i in first..first + n {
                    let wanted = (target[i] - scales.output.mean[i]) * scales.output.inverse[i];
                    let off = y[i] - wanted;
                    *sum += f64::from(off) * f64::from(off);
                    d[i] = factor * off;
                }
            }
        }
        for ((loss, sum), &(_, n, _)) in losses.iter_mut().zip(sums).zip(&self.groups) {
            *loss += share * sum / (unroll * cells * n) as f64;
        }
        d
    }

    /// The state that an example starts from: its frame with noise. With a history, what is said of the stride before is not always that
    /// of the trajectory.
    pub(crate) fn start(&self, sample: &Sample, example: &Example) -> Result<Vec<f32>> {
        // Numbers of its own, so that those of the noise are the same with a history and without.
        let mut rng = ChaCha8Rng::seed_from_u64(example.seed);
        rng.set_stream(1);
        let stride = self.work.frames_a_step;
        let frames = match rng.random::<f64>() < self.history_pace {
            true => rng.random_range(0..=2 * stride),
            false => stride,
        };
        let mut state = self
            .stepper
            .frame_after(sample, example.frame, frames, example.mirror)?;
        if self.history_noise > 0.0 && self.stepper.parts(&state).1.is_some() {
            let other = rng.random_range(0..sample.n_frames);
            let other = self.stepper.frame(sample, other, example.mirror)?;
            let first = self.stepper.parts(&state).0.len();
            let moving = first..first + self.noise.len() * sample.n_cells();
            let times = (self.share(&mut rng) * self.history_noise * normal(&mut rng)) as f32;
            let pairs = state[moving.clone()].iter_mut().zip(&other[moving]);
            pairs.for_each(|(change, other)| *change += times * other);
        }
        self.add_noise(sample, example.seed, &mut state);
        Ok(state)
    }

    /// By how much the noise of an example is smaller than it may be. Where all have the same, no number is drawn: those of a seed are
    /// then those from before there was a choice.
    fn share(&self, rng: &mut ChaCha8Rng) -> f64 {
        match self.noise_spread > 1.0 {
            true => self.noise_spread.powf(-rng.random::<f64>()),
            false => 1.0,
        }
    }

    /// Noise on the cells' inputs; boundary nodes that copy their owner copy the noise.
    pub(crate) fn add_noise(&self, sample: &Sample, seed: u64, state: &mut [f32]) {
        if self.noise.iter().all(|&n| n == 0.0) {
            return;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let share = self.share(&mut rng);
        let width = self.noise.len();
        let (now, changes) = state.split_at_mut(self.stepper.parts(state).0.len());
        let mut changes = changes.chunks_exact_mut(width);
        let rows = now.chunks_exact_mut(width).take(sample.n_cells());
        for (cell, row) in rows.enumerate() {
            let mut change = changes.next();
            let held = sample.held.as_ref().is_some_and(|held| held[cell]);
            for (i, std) in self.noise.iter().enumerate().filter(|(_, std)| **std > 0.0) {
                let noise = (share * std * normal(&mut rng)) as f32;
                if !held {
                    row[i] += noise;
                    // It came in the stride before: where the body was then is known.
                    if let Some(change) = &mut change {
                        change[i] += noise;
                    }
                }
            }
        }
        self.stepper.copy_to_boundary(sample, state, false);
    }
}

/// The graph of a body at a state, with its senders and receivers; none for cells, whose graph stays.
pub(crate) fn at_state(
    base: &TrainGraph,
    contact: &mut Option<ContactGraph>,
    state: &[f32],
) -> Result<Option<Moved>> {
    let Some(contact) = contact else { return Ok(None) };
    let graph = contact.update(&Comm::serial(), state)?;
    Ok(Some((
        base.with_edges(graph),
        graph.senders.clone(),
        graph.receivers.clone(),
    )))
}

/// From the derivative by the features of a body's edges to that by the displacement of its nodes.
fn edges_backward(features: &[f32], d: &[f32], (senders, receivers): (&[i32], &[i32]), d_state: &mut [f32]) {
    let rows = features.chunks_exact(N_FEATURES).zip(d.chunks_exact(N_FEATURES));
    for ((x, d), (&s, &r)) in rows.zip(senders.iter().zip(receivers)) {
        for (i, by) in features_backward(x, d).into_iter().enumerate() {
            d_state[3 * s as usize + i] += by;
            d_state[3 * r as usize + i] -= by;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::TrainingConfig;
    use super::super::workload::Workload;
    use super::*;
    use m4gn_mesh::sample::{flow, triangles};

    /// Two decades: the logarithms lie evenly between those of 0.0004 and 0.04.
    #[test]
    fn noise_has_a_size_in_each_example() {
        let (spec, mesh) = (m4gn_model::sample::spec(), triangles(6, 4, 1.5, 1.0));
        let mut sample = Sample::of_mesh(&mesh, &spec, &spec.segments, None, None).unwrap();
        let nodes = mesh
            .cell_centres
            .iter()
            .chain(mesh.boundary.iter().map(|face| &face.centre));
        let frame = nodes.flat_map(|&x| {
            let ([u, v], p) = flow(x, [0.3, 0.5]);
            [u, v, p]
        });
        sample.push(&mesh, &spec, frame.collect());
        let work = Workload {
            train: vec![sample.clone().into()],
            valid: vec![],
            frames_a_step: 2,
            names: vec![],
        };
        let before = sample.frame(0).unwrap().into_owned();
        let logarithms = |noise_spread: f64| -> Vec<f64> {
            let training = TrainingConfig {
                noise: [("U".to_string(), 0.04)].into(),
                noise_spread,
                ..TrainingConfig::default()
            };
            let backend = NativeBackend::new(&training, &spec, &work, 1).unwrap();
            let size = |seed| {
                let mut state = before.clone();
                backend.add_noise(&sample, seed, &mut state);
                let cells = sample.n_cells() * sample.width;
                let square = state[..cells]
                    .iter()
                    .zip(&before)
                    .map(|(a, b)| f64::from(a - b).powi(2));
                // Two components of three
                (square.sum::<f64>() / (2 * sample.n_cells()) as f64).sqrt().ln()
            };
            (0..200).map(size).collect()
        };
        let (least, most) = (0.0004f64.ln(), 0.04f64.ln());
        assert!(logarithms(1.0).iter().all(|l| (l - most).abs() < 0.5));
        let sizes = logarithms(100.0);
        assert!(sizes.iter().all(|l| (least - 0.5..most + 0.5).contains(l)));
        for third in 0..3 {
            let from = least + f64::from(third) / 3.0 * (most - least);
            let here = sizes
                .iter()
                .filter(|l| (from..from + (most - least) / 3.0).contains(l));
            assert!((45..=90).contains(&here.count()), "{sizes:?}");
        }
    }
}
