//! Adam (Kingma and Ba 2015, algorithm 1) on the flat vector of weights, with its whole state in the open so that a
//! checkpoint can hold it.

use crate::Isa;
use crate::kernels;

/// Weights and Adam's moments.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Weights.
    pub weights: Vec<f32>,
    /// Running mean of the gradient.
    pub first: Vec<f32>,
    /// Running mean of its square.
    pub second: Vec<f32>,
    /// Running average of the weights, what is validated and exported; none: the weights are.
    pub average: Option<Vec<f32>>,
    /// Updates made.
    pub updates: u64,
    betas: [f64; 2],
}

impl Adam {
    /// First weights, no moments yet.
    pub fn new(weights: Vec<f32>, betas: [f64; 2], average: bool) -> Self {
        Adam {
            first: vec![0.0; weights.len()],
            second: vec![0.0; weights.len()],
            average: average.then(|| weights.clone()),
            weights,
            updates: 0,
            betas,
        }
    }

    /// One update with a gradient of this norm; `clip` is the largest norm, 0: no limit.
    pub fn update(&mut self, gradient: &[f32], norm: f64, rate: f64, clip: f64, ema_decay: f64) {
        self.updates += 1;
        let n = self.updates.min(i32::MAX as u64) as i32;
        let [b1, b2] = self.betas;
        let numbers = kernels::Adam {
            clip: if clip > 0.0 && norm > clip {
                (clip / norm) as f32
            } else {
                1.0
            },
            betas: [b1 as f32, b2 as f32],
            rest: [(1.0 - b1) as f32, (1.0 - b2) as f32],
            rate: (rate / (1.0 - b1.powi(n))) as f32,
            correction: (1.0 / (1.0 - b2.powi(n)).sqrt()) as f32,
        };
        let (first, second) = (&mut self.first, &mut self.second);
        kernels::adam(Isa::detect(), numbers, gradient, &mut self.weights, first, second);
        if let Some(average) = &mut self.average {
            // A short memory at first, so that the average does not hold on to the random start.
            let decay = ema_decay.min((1.0 + f64::from(n)) / (10.0 + f64::from(n)));
            let (keep, take) = (decay as f32, (1.0 - decay) as f32);
            let pairs = average.iter_mut().zip(&self.weights);
            pairs.for_each(|(average, weight)| *average = *average * keep + weight * take);
        }
    }

    /// The weights to validate and export.
    pub fn best_guess(&self) -> &[f32] {
        self.average.as_ref().unwrap_or(&self.weights)
    }
}

/// Euclidean norm, in fp64.
pub fn norm(gradient: &[f32]) -> f64 {
    gradient
        .iter()
        .map(|g| f64::from(*g) * f64::from(*g))
        .sum::<f64>()
        .sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_update_moves_each_weight_by_the_rate() {
        // With one gradient, m/(1-b1) = g and v/(1-b2) = g^2: each weight moves by rate * sign(g), clipped or not.
        for clip in [0.0, 1.0] {
            let mut adam = Adam::new(vec![1.0, 2.0], [0.9, 0.999], true);
            let gradient = [3f32, -4.0];
            assert_eq!(norm(&gradient), 5.0);
            adam.update(&gradient, 5.0, 0.5, clip, 0.999);
            let w = &adam.weights;
            assert!((w[0] - 0.5).abs() < 1e-6 && (w[1] - 2.5).abs() < 1e-6, "{w:?}");
            let share = if clip > 0.0 { 0.2 } else { 1.0 };
            assert!((adam.first[0] - 0.3 * share).abs() < 1e-6, "{:?}", adam.first);
            // (1 + 1) / (10 + 1) of the start is kept.
            let average = adam.best_guess()[0];
            assert!(
                (average - (2.0 / 11.0 + 0.5 * 9.0 / 11.0)).abs() < 1e-6,
                "{average}"
            );
        }
    }
}
