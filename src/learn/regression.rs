//! The decoder's last layer by linear regression on its own inputs, in closed form: what else the network has learned stays,
//! and a pass over the examples does what hundreds of optimisation steps do.
//!
//! With x the layer's input and a 1, y the normalised target and W the layer's weights and bias, the sum over all rows of
//! `|W x - y|^2`, plus `ridge` times the sum over i of `g_ii |w_i - w0_i|^2`, is least where
//! `(G + ridge diag G) W^T = B + ridge diag(G) W0^T`, with G the sum of x x^T, B that of x y^T and W0 the weights to stay near.
//! The scale g_ii makes the ridge a share of each input's own part, whatever its size.

use super::backend::Example;
use super::native::NativeBackend;
use super::normaliser::Normaliser;
use super::together::own_share;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use m4gn_engine::backward::{Layout, Scales, Worker};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::ModelSpec;
use std::ops::Range;

/// A share of the largest g_ii that is added to all: inputs that are always 0 have weights all the same.
const FLOOR: f64 = 1e-9;

/// Sums of a linear regression.
#[derive(Clone, Debug, PartialEq)]
pub struct Regression {
    /// Numbers of x, with the 1, and of y.
    inputs: usize,
    outputs: usize,
    /// `[inputs x inputs]` of G, of which the part at and above the diagonal is filled, then `[inputs x outputs]` of B.
    pub sums: Vec<f64>,
}

impl Regression {
    /// Of no rows.
    pub fn new(spec: &ModelSpec) -> Self {
        let (inputs, outputs) = (spec.architecture.width + 1, spec.n_outputs());
        Regression { inputs, outputs, sums: vec![0.0; inputs * (inputs + outputs)] }
    }

    /// Adds rows of x without the 1, and of y, where `counts` says so of the row.
    fn add_rows(&mut self, x: &[f32], y: &[f32], counts: impl Fn(usize) -> bool) {
        let (gram, moment) = self.sums.split_at_mut(self.inputs * self.inputs);
        let mut row = vec![1.0; self.inputs];
        let rows = x.chunks_exact(self.inputs - 1).zip(y.chunks_exact(self.outputs));
        for (_, (x, y)) in rows.enumerate().filter(|(i, _)| counts(*i)) {
            row.iter_mut().zip(x).for_each(|(to, x)| *to = f64::from(*x));
            for (i, &xi) in row.iter().enumerate().filter(|(_, xi)| **xi != 0.0) {
                let sums = gram[i * self.inputs + i..(i + 1) * self.inputs].iter_mut();
                sums.zip(&row[i..]).for_each(|(sum, xj)| *sum += xi * xj);
                let sums = moment[i * self.outputs..(i + 1) * self.outputs].iter_mut();
                sums.zip(y).for_each(|(sum, y)| *sum += xi * f64::from(*y));
            }
        }
    }

    /// Adds the rows of another one, each so many times.
    pub fn add(&mut self, other: &Regression, times: f64) {
        let pairs = self.sums.iter_mut().zip(&other.sums);
        pairs.for_each(|(sum, other)| *sum += times * other);
    }

    /// Puts the layer's best weights near `start` into `weights`, flat both. False, and nothing changed, if they are not finite.
    ///
    /// # Errors
    /// [`Error::Internal`] for a layer of another size.
    pub fn solve(&self, layer: &Layer, ridge: f64, start: &[f32], weights: &mut [f32]) -> Result<bool> {
        let (k, m) = (self.inputs, self.outputs);
        if layer.weight.len() != (k - 1) * m || layer.bias.len() != m {
            return Err(Error::Internal("sums of a layer of another size".into()));
        }
        let (gram, moment) = self.sums.split_at(k * k);
        let g = |i: usize, j: usize| gram[i.min(j) * k + i.max(j)];
        let floor = FLOOR * (0..k).map(|i| g(i, i)).fold(0.0, f64::max);
        let held = |i: usize| ridge * g(i, i) + floor;
        let place = |i: usize, o: usize| match i + 1 == k {
            true => layer.bias.start + o,
            false => layer.weight.start + o * (k - 1) + i,
        };
        let matrix = Mat::from_fn(k, k, |i, j| g(i, j) + if i == j { held(i) } else { 0.0 });
        let right = Mat::from_fn(k, m, |i, o| moment[i * m + o] + held(i) * f64::from(start[place(i, o)]));
        let Ok(factor) = matrix.llt(Side::Lower) else {
            return Ok(false);
        };
        let found = factor.solve(&right);
        let numbers = (0..k).flat_map(|i| (0..m).map(move |o| (i, o)));
        if !numbers.clone().all(|(i, o)| (found[(i, o)] as f32).is_finite()) {
            return Ok(false);
        }
        numbers.for_each(|(i, o)| weights[place(i, o)] = found[(i, o)] as f32);
        Ok(true)
    }
}

/// Where the decoder's last layer is in the flat vector of weights.
#[derive(Clone, Debug)]
pub struct Layer {
    /// `[outputs x inputs]`
    weight: Range<usize>,
    bias: Range<usize>,
}

impl Layer {
    /// The decoder's last one.
    ///
    /// # Errors
    /// As [`Layout::find`].
    pub fn last(spec: &ModelSpec, layout: &Layout) -> Result<Self> {
        let range = |part: &str| {
            let name = format!("decoder.{}.{part}", spec.architecture.hidden_layers);
            let (start, shape) = layout.find(&name)?;
            Ok(start..start + shape.iter().product::<usize>())
        };
        Ok(Layer { weight: range("weight")?, bias: range("bias")? })
    }
}

impl NativeBackend<'_> {
    /// The sums over examples, each rolled out for `unroll` steps with the weights, which its rows are then of. Collective; all
    /// ranks fail together. The sums are the same on all ranks.
    ///
    /// # Errors
    /// What the engine may fail with.
    pub fn regress(
        &mut self,
        comm: &Comm,
        weights: &[f32],
        normaliser: &Normaliser,
        examples: &[Example],
        unroll: usize,
    ) -> Result<Regression> {
        self.network.load(weights);
        let scales = normaliser.scales();
        let own = own_share(comm, examples);
        let pieces =
            self.each(own.len(), |backend, worker, i| backend.regress_one(worker, &scales, &own[i], unroll));
        let mut sum = Regression::new(&self.spec);
        comm.agree(pieces)?.iter().for_each(|piece| sum.add(piece, 1.0));
        comm.sum_f64(&mut sum.sums);
        Ok(sum)
    }

    fn regress_one(
        &self,
        worker: &mut Worker,
        scales: &Scales,
        example: &Example,
        unroll: usize,
    ) -> Result<Regression> {
        let sample = &self.work.train[example.sample];
        let live = &self.lives[example.sample][usize::from(example.mirror)];
        let (domain, stride) = (&live.domain, self.work.frames_a_step);
        let mut state = self.start(sample, example)?;
        let m = self.spec.n_outputs();
        let mut outputs = vec![0.0; sample.n_cells() * m];
        let (mut inputs, mut target, mut rows) = (Vec::new(), Vec::new(), Vec::new());
        let mut sum = Regression::new(&self.spec);
        for step in 1..=unroll {
            let next = sample.state(example.frame + step * stride, stride, example.mirror)?;
            domain.inputs(&state, &next, &mut inputs);
            let moved = live.at(&mut state)?;
            let graph = moved.as_ref().map_or(&live.graph, |(graph, ..)| graph);
            self.network.forward(worker, 0, graph, scales, &inputs, &mut outputs);
            self.network.last_inputs(worker, 0, graph, &mut rows);
            domain.target(&state, &next, &mut target);
            scales.output.to_normalised(&mut target);
            sum.add_rows(&rows, &target, |cell| !domain.is_held(cell));
            scales.output.to_physical(&mut outputs);
            state = domain.advance(&state, &outputs, &next);
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One input and one output: x = 1, 2, 3 with a 1, y = 2 x - 1.
    fn line() -> (Regression, Layer) {
        let mut sums = Regression { inputs: 2, outputs: 1, sums: vec![0.0; 6] };
        sums.add_rows(&[1.0, 2.0, 3.0, 50.0], &[1.0, 3.0, 5.0, 0.0], |row| row < 3);
        let layer = Layer { weight: 1..2, bias: 0..1 };
        (sums, layer)
    }

    #[test]
    fn a_line_is_found_and_a_large_ridge_keeps_the_weights() {
        let (sums, layer) = line();
        // G = [14 6; . 3], B = [22 9]
        assert_eq!(sums.sums, [14.0, 6.0, 0.0, 3.0, 22.0, 9.0]);
        let mut weights = [0f32; 2];
        assert!(sums.solve(&layer, 1e-9, &[0.0; 2], &mut weights).unwrap());
        assert!((weights[0] + 1.0).abs() < 1e-4 && (weights[1] - 2.0).abs() < 1e-4, "{weights:?}");
        assert!(sums.solve(&layer, 1e9, &[7.0, 5.0], &mut weights).unwrap());
        assert!((weights[0] - 7.0).abs() < 1e-4 && (weights[1] - 5.0).abs() < 1e-4, "{weights:?}");
        // (28 6; 6 6) (w b) = (22 + 14, 9 + 3) for a ridge of 1 near w = b = 1.
        assert!(sums.solve(&layer, 1.0, &[1.0, 1.0], &mut weights).unwrap());
        assert!(
            (weights[1] - 144.0 / 132.0).abs() < 1e-5 && (weights[0] - 120.0 / 132.0).abs() < 1e-5,
            "{weights:?}"
        );
    }

    #[test]
    fn rows_that_count_often_and_sums_that_say_nothing() {
        let (sums, layer) = line();
        let mut twice = sums.clone();
        twice.add(&sums, 1.0);
        assert!(twice.sums.iter().zip(&sums.sums).all(|(a, b)| *a == 2.0 * b));
        let mut weights = [3f32, 4.0];
        let mut bad = sums.clone();
        bad.sums[0] = f64::NAN;
        for unusable in [bad, Regression { sums: vec![0.0; 6], ..sums.clone() }] {
            assert!(!unusable.solve(&layer, 1e-3, &[0.0; 2], &mut weights).unwrap());
            assert_eq!(weights, [3.0, 4.0]);
        }
        let other = Layer { weight: 0..3, bias: 3..4 };
        assert!(sums.solve(&other, 1e-3, &[0.0; 4], &mut [0.0; 4]).is_err());
    }
}
