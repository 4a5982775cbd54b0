//! Adam (Kingma and Ba 2015, algorithm 1) and Muon (Jordan 2024) on the flat vector of weights, with their whole state in the
//! open so that a checkpoint can hold it.

use super::Layout;
use super::muon::{Matrix, hidden_matrices, orthogonalise};
use crate::Isa;
use crate::kernels;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Mutex;

/// Which rule makes updates of gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpdateRule {
    /// Adam for all weights.
    #[default]
    Adam,
    /// Muon for the matrices between latent vectors, Adam for the other weights.
    Muon,
}

/// Weights and the optimiser's moments.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimiser {
    /// Weights.
    pub weights: Vec<f32>,
    /// Running mean of the gradient: Adam's first moment, Muon's momentum.
    pub first: Vec<f32>,
    /// Running mean of its square; 0 where the rule is Muon.
    pub second: Vec<f32>,
    /// Running average of the weights, what is validated and exported; none: the weights are.
    pub average: Option<Vec<f32>>,
    /// Updates made.
    pub updates: u64,
    betas: [f64; 2],
    /// The matrices whose rule is Muon.
    matrices: Vec<Matrix>,
    /// Threads that share them.
    threads: usize,
}

impl Optimiser {
    /// First weights, no moments yet. `betas` are the decay rates of Adam's moments.
    pub fn new(weights: Vec<f32>, betas: [f64; 2], average: bool) -> Self {
        Optimiser {
            first: vec![0.0; weights.len()],
            second: vec![0.0; weights.len()],
            average: average.then(|| weights.clone()),
            weights,
            updates: 0,
            betas,
            matrices: Vec::new(),
            threads: 1,
        }
    }

    /// The same with this rule, for a network of this layout and latent width, on so many threads: what comes out does not
    /// depend on their number.
    pub fn with_rule(mut self, rule: UpdateRule, layout: &Layout, width: usize, threads: usize) -> Self {
        self.threads = threads.max(1);
        self.matrices = match rule {
            UpdateRule::Adam => Vec::new(),
            UpdateRule::Muon => hidden_matrices(layout, width),
        };
        self
    }

    /// One update with a gradient of this norm; `clip` is the largest norm, 0: no limit.
    pub fn update(&mut self, gradient: &[f32], norm: f64, rate: f64, clip: f64, ema_decay: f64) {
        self.updates += 1;
        let n = self.updates.min(i32::MAX as u64) as i32;
        let [b1, b2] = self.betas;
        let numbers = kernels::Adam {
            clip: if clip > 0.0 && norm > clip { (clip / norm) as f32 } else { 1.0 },
            betas: [b1 as f32, b2 as f32],
            rest: [(1.0 - b1) as f32, (1.0 - b2) as f32],
            rate: (rate / (1.0 - b1.powi(n))) as f32,
            correction: (1.0 / (1.0 - b2.powi(n)).sqrt()) as f32,
        };
        let mut done = 0;
        for at in 0..self.matrices.len() {
            let range = self.matrices[at].range();
            self.adam(numbers, gradient, done..range.start);
            done = range.end;
        }
        self.adam(numbers, gradient, done..self.weights.len());
        self.muon(numbers.clip, rate as f32, gradient);
        if let Some(average) = &mut self.average {
            // A short memory at first, so that the average does not hold on to the random start.
            let decay = ema_decay.min((1.0 + f64::from(n)) / (10.0 + f64::from(n)));
            let (keep, take) = (decay as f32, (1.0 - decay) as f32);
            let pairs = average.iter_mut().zip(&self.weights);
            pairs.for_each(|(average, weight)| *average = *average * keep + weight * take);
        }
    }

    fn adam(&mut self, numbers: kernels::Adam, gradient: &[f32], range: Range<usize>) {
        let gradient = &gradient[range.clone()];
        let weights = &mut self.weights[range.clone()];
        let (first, second) = (&mut self.first[range.clone()], &mut self.second[range]);
        kernels::adam(Isa::detect(), numbers, gradient, weights, first, second);
    }

    /// Muon with Nesterov's momentum, which needs no correction at the start since its length does not count.
    fn muon(&mut self, clip: f32, rate: f32, gradient: &[f32]) {
        const BETA: f32 = 0.95;
        let mut changes: Vec<(Matrix, Vec<f32>)> = Vec::with_capacity(self.matrices.len());
        for matrix in &self.matrices {
            let pairs = self.first[matrix.range()].iter_mut().zip(&gradient[matrix.range()]);
            let change = pairs.map(|(first, gradient)| {
                let gradient = (1.0 - BETA) * clip * gradient;
                *first = BETA * *first + gradient;
                BETA * *first + gradient
            });
            changes.push((*matrix, change.collect()));
        }
        // Large matrices and small ones: each thread takes the next that is left.
        let left = Mutex::new(changes.iter_mut());
        let next = || left.lock().ok()?.next();
        let work = || {
            while let Some((matrix, change)) = next() {
                orthogonalise(change, matrix.rows, matrix.columns);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.threads.min(self.matrices.len()) {
                // Fewer where the system gives no more.
                let _ = std::thread::Builder::new().spawn_scoped(scope, work);
            }
            work();
        });
        for (matrix, change) in &changes {
            let pairs = self.weights[matrix.range()].iter_mut().zip(change);
            pairs.for_each(|(weight, change)| *weight -= rate * change);
        }
    }

    /// The weights to validate and export.
    pub fn best_guess(&self) -> &[f32] {
        self.average.as_ref().unwrap_or(&self.weights)
    }
}

/// Euclidean norm, in fp64.
pub fn norm(gradient: &[f32]) -> f64 {
    gradient.iter().map(|g| f64::from(*g) * f64::from(*g)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_update_moves_each_weight_by_the_rate() {
        // With one gradient, m/(1-b1) = g and v/(1-b2) = g^2: each weight moves by rate * sign(g), clipped or not.
        for clip in [0.0, 1.0] {
            let mut adam = Optimiser::new(vec![1.0, 2.0], [0.9, 0.999], true);
            let gradient = [3f32, -4.0];
            assert_eq!(norm(&gradient), 5.0);
            adam.update(&gradient, 5.0, 0.5, clip, 0.999);
            let w = &adam.weights;
            assert!((w[0] - 0.5).abs() < 1e-6 && (w[1] - 2.5).abs() < 1e-6, "{w:?}");
            let share = if clip > 0.0 { 0.2 } else { 1.0 };
            assert!((adam.first[0] - 0.3 * share).abs() < 1e-6, "{:?}", adam.first);
            // (1 + 1) / (10 + 1) of the start is kept.
            let average = adam.best_guess()[0];
            assert!((average - (2.0 / 11.0 + 0.5 * 9.0 / 11.0)).abs() < 1e-6, "{average}");
        }
    }

    #[test]
    fn muon_moves_its_matrices_along_all_directions_alike_and_leaves_the_rest_to_adam() {
        // One weight, a matrix of 2 x 2, one weight. The gradient of the matrix is diag(4, 1).
        let matrix = Matrix { start: 1, rows: 2, columns: 2 };
        let mut muon = Optimiser::new(vec![0.0; 6], [0.9, 0.999], false);
        muon.matrices = vec![matrix];
        let gradient = [3.0, 4.0, 0.0, 0.0, 1.0, -2.0];
        muon.update(&gradient, norm(&gradient), 0.1, 0.0, 0.0);
        let w = &muon.weights;
        assert!((w[0] + 0.1).abs() < 1e-6 && (w[5] - 0.1).abs() < 1e-6, "{w:?}");
        assert!(w[2].abs() < 1e-7 && w[3].abs() < 1e-7, "{w:?}");
        // rate * 0.2 * sqrt(2) times a singular value between 0.7 and 1.2, though one is four times the other.
        let unit = 0.1 * 0.2 * 2f32.sqrt();
        for value in [w[1], w[4]] {
            assert!((0.65..1.25).contains(&(-value / unit)), "{w:?}");
        }
        assert_eq!(muon.second[1..5], [0.0; 4]);
        // The momentum is 0.05 of the first gradient.
        assert!((muon.first[1] - 0.2).abs() < 1e-6, "{:?}", muon.first);
    }
}
