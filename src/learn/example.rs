//! Loss and gradient of one example on the native engine, through all its unrolled steps.

use super::backend::{Batch, Example, Learned};
use super::native::{Live, Moved, NativeBackend};
use super::normaliser::Normaliser;
use super::samples::Sample;
use m4gn_base::Result;
use m4gn_engine::backward::{InputGradient, Scales, Worker, normal};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Bytes that one thread keeps of unrolled steps; beyond it they are computed again in the backward pass.
const KEEP: usize = 1 << 30;

/// An application of the network: the state before it, and, where edges move, those there.
struct Applied {
    state: Vec<f32>,
    graph: Option<Moved>,
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
    ) -> Result<Learned> {
        let sample = &self.work.train[example.sample];
        let live = &self.lives[example.sample][usize::from(example.mirror)];
        let (domain, base) = (&live.domain, &live.graph);
        let stride = self.work.frames_a_step;
        let frame = |step: usize| sample.state(example.frame + step * stride, example.mirror);
        let mut state = frame(0)?;
        self.add_noise(sample, example.seed, &mut state);
        let (mut inputs, mut target) = (Vec::new(), Vec::new());
        let mut moments = None;
        let mut graph = live.at(&mut state)?;
        if batch.accumulate {
            let next = frame(1)?;
            domain.inputs(&state, &next, &mut inputs);
            domain.target(&state, &next, &mut target);
            let edges = graph.as_ref().map_or(base, |g| &g.0).edge_features();
            moments = Some(Normaliser::of_example(&self.spec, &inputs, edges, &target));
        }
        let mut losses = vec![0.0; self.groups.len()];
        if !batch.learn {
            return Ok(Learned { gradient: None, losses, moments });
        }
        let m = self.spec.n_outputs();
        let mut outputs = vec![0.0; sample.n_cells() * m];
        // Derivatives by the normalised outputs of each step, and the applications they belong to.
        let mut d_outputs: Vec<Vec<f32>> = Vec::new();
        let mut applied: Vec<Applied> = Vec::new();
        let mut keep = batch.unroll;
        for step in 1..=batch.unroll {
            let next = frame(step)?;
            domain.inputs(&state, &next, &mut inputs);
            let here = graph.as_ref().map_or(base, |g| &g.0);
            let tape = if step <= keep { step - 1 } else { 0 };
            self.network.forward(worker, tape, here, scales, &inputs, &mut outputs);
            if step == 1 && batch.unroll > 1 && batch.unroll * self.network.tape_bytes(worker, 0, here) > KEEP
            {
                keep = 1;
            }
            domain.target(&state, &next, &mut target);
            d_outputs.push(self.loss(live, scales, [&outputs, &target], (batch.unroll, share), &mut losses));
            let new = match step < batch.unroll {
                true => {
                    scales.output.to_physical(&mut outputs);
                    let mut new = domain.advance(&state, &outputs, &next);
                    domain.take_level_off(&mut new);
                    new
                }
                false => Vec::new(),
            };
            applied.push(Applied { state: std::mem::replace(&mut state, new), graph: graph.take() });
            if step < batch.unroll {
                graph = live.at(&mut state)?;
            }
        }
        self.backward(worker, scales, live, sample, example, (applied, d_outputs, keep))?;
        let mut gradient = vec![0.0; self.network.layout().len()];
        self.network.flush(worker, &mut gradient);
        Ok(Learned { gradient: Some(gradient), losses, moments })
    }

    /// Through all applications, last to first.
    fn backward(
        &self,
        worker: &mut Worker,
        scales: &Scales,
        live: &Live,
        sample: &Sample,
        example: &Example,
        (applied, d_outputs, keep): (Vec<Applied>, Vec<Vec<f32>>, usize),
    ) -> Result<()> {
        let (domain, base, unroll) = (&live.domain, &live.graph, applied.len());
        let m = self.spec.n_outputs();
        let stride = self.work.frames_a_step;
        let mut by_inputs = InputGradient::default();
        let (mut inputs, mut unread) = (Vec::new(), Vec::new());
        // Derivative by the state behind the step, and that state.
        let mut behind: Option<(Vec<f32>, &[f32])> = None;
        for (step, (application, loss)) in applied.iter().zip(&d_outputs).enumerate().rev() {
            let graph = application.graph.as_ref().map_or(base, |g| &g.0);
            let mut d = loss.clone();
            let mut d_state = None;
            if let Some((mut behind, state)) = behind.take() {
                domain.take_level_off_backward(state, &mut behind);
                let mut physical = vec![0.0; d.len()];
                d_state = Some(domain.advance_backward(&mut behind, &mut physical));
                for (d, physical) in d.chunks_exact_mut(m).zip(physical.chunks_exact(m)) {
                    let both = d.iter_mut().zip(physical).zip(&scales.output.std);
                    both.for_each(|((d, p), std)| *d += p * std);
                }
            }
            if keep < unroll && step + 1 < unroll {
                let next = sample.state(example.frame + (step + 1) * stride, example.mirror)?;
                domain.inputs(&application.state, &next, &mut inputs);
                unread.resize(d.len(), 0.0);
                self.network.forward(worker, 0, graph, scales, &inputs, &mut unread);
            }
            let tape = if keep < unroll { 0 } else { step };
            let wanted = step > 0;
            if wanted {
                by_inputs.nodes.resize(graph.n_nodes() * self.spec.n_field_inputs(), 0.0);
                by_inputs.edges = application.graph.as_ref().map(|_| graph.no_edge_gradient());
            }
            let by = wanted.then_some(&mut by_inputs);
            self.network.backward(worker, tape, graph, scales, &d, by);
            if !wanted {
                continue;
            }
            let size = application.state.len();
            let mut d_state = d_state.unwrap_or_else(|| vec![0.0; size]);
            domain.inputs_backward(&by_inputs.nodes, &mut d_state);
            // The target of a change is as far as the state is off.
            let mut d_target = loss.clone();
            for row in d_target.chunks_exact_mut(m) {
                let scaled = row.iter_mut().zip(&scales.output.inverse);
                scaled.for_each(|(d, inverse)| *d *= -inverse);
            }
            domain.target_backward(&d_target, &mut d_state);
            if let (Some((_, edges)), Some(d)) = (&application.graph, &by_inputs.edges) {
                domain.edges_backward(edges, d, &mut d_state);
            }
            behind = Some((d_state, &application.state));
        }
        Ok(())
    }

    /// Adds to the losses, and gives the derivative of their weighted sum by the normalised outputs. What is held counts in neither.
    fn loss(
        &self,
        live: &Live,
        scales: &Scales,
        [outputs, target]: [&[f32]; 2],
        (unroll, share): (usize, f64),
        losses: &mut [f64],
    ) -> Vec<f32> {
        let m = self.spec.n_outputs();
        let all = outputs.len() / m;
        let cells: Vec<usize> = live.free.iter().map(|free| free.as_ref().map_or(all, |f| f.1)).collect();
        let mut d = vec![0.0; outputs.len()];
        let mut sums = vec![0.0; self.groups.len()];
        let rows = d.chunks_exact_mut(m).zip(outputs.chunks_exact(m)).zip(target.chunks_exact(m));
        for (node, ((d, y), target)) in rows.enumerate() {
            for (k, (&(first, n, weight), sum)) in self.groups.iter().zip(&mut sums).enumerate() {
                if live.free[k].as_ref().is_some_and(|f| !f.0[node]) {
                    continue;
                }
                let factor = (2.0 * weight * share / (unroll * cells[k] * n) as f64) as f32;
                for i in first..first + n {
                    let wanted = (target[i] - scales.output.mean[i]) * scales.output.inverse[i];
                    let off = y[i] - wanted;
                    *sum += f64::from(off) * f64::from(off);
                    d[i] = factor * off;
                }
            }
        }
        for (((loss, sum), &(_, n, _)), cells) in losses.iter_mut().zip(sums).zip(&self.groups).zip(cells) {
            *loss += share * sum / (unroll * cells * n) as f64;
        }
        d
    }

    /// By how much the noise of an example is smaller than it may be. Where all have the same, no number is drawn: those of a seed are
    /// then those from before there was a choice.
    fn share(&self, rng: &mut ChaCha8Rng) -> f64 {
        match self.noise_spread > 1.0 {
            true => self.noise_spread.powf(-rng.random::<f64>()),
            false => 1.0,
        }
    }

    /// Noise on the cells' inputs that are not held; boundary nodes that copy their owner copy the noise.
    pub(crate) fn add_noise(&self, sample: &Sample, seed: u64, state: &mut [f32]) {
        if self.noise.iter().all(|&n| n == 0.0) {
            return;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let share = self.share(&mut rng);
        let width = self.noise.len();
        let rows = state.chunks_exact_mut(width).take(sample.n_cells());
        for (cell, row) in rows.enumerate() {
            for (i, std) in self.noise.iter().enumerate().filter(|(_, std)| **std > 0.0) {
                let noise = (share * std * normal(&mut rng)) as f32;
                if !sample.domain.is_held(cell, i) {
                    row[i] += noise;
                }
            }
        }
        sample.domain.boundary().follow(state, |_| true);
    }
}
