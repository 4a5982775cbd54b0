//! Adam (Kingma and Ba 2015, algorithm 1) on the flat vector of weights, with its whole state in the open so
//! that a checkpoint can hold it.

use tch::{Device, Kind, Tensor};

/// Weights and Adam's moments.
pub struct Optimiser {
    /// Weights.
    pub weights: Tensor,
    /// Running mean of the gradient.
    pub first: Tensor,
    /// Running mean of its square.
    pub second: Tensor,
    /// Running average of the weights, what is validated and exported; none: the weights are.
    pub average: Option<Tensor>,
    /// Updates made.
    pub updates: u64,
    betas: [f64; 2],
}

impl Optimiser {
    /// First weights, no moments yet.
    pub fn new(weights: &[f32], betas: [f64; 2], average: bool, device: Device) -> Self {
        let weights = Tensor::from_slice(weights).to_device(device);
        Optimiser {
            first: weights.zeros_like(),
            second: weights.zeros_like(),
            average: average.then(|| weights.copy()),
            weights,
            updates: 0,
            betas,
        }
    }

    /// One update; returns the gradient's norm before it was clipped. `clip` = 0: no limit.
    pub fn update(&mut self, gradient: &Tensor, rate: f64, clip: f64, ema_decay: f64) -> f64 {
        tch::no_grad(|| {
            let norm = gradient.norm().double_value(&[]);
            let gradient = if clip > 0.0 && norm > clip {
                gradient * (clip / norm)
            } else {
                gradient.shallow_clone()
            };
            self.updates += 1;
            let n = self.updates.min(i32::MAX as u64) as i32;
            let [b1, b2] = self.betas;
            self.first *= b1;
            self.first += &gradient * (1.0 - b1);
            self.second *= b2;
            self.second += gradient.square() * (1.0 - b2);
            let denominator = self.second.sqrt() / (1.0 - b2.powi(n)).sqrt() + 1e-8;
            self.weights -= (&self.first / denominator) * (rate / (1.0 - b1.powi(n)));
            if let Some(average) = &mut self.average {
                // A short memory at first, so that the average does not hold on to the random start.
                let decay = ema_decay.min((1.0 + n as f64) / (10.0 + n as f64));
                *average *= decay;
                *average += &self.weights * (1.0 - decay);
            }
            norm
        })
    }

    /// The weights to validate and export.
    pub fn best_guess(&self) -> &Tensor {
        self.average.as_ref().unwrap_or(&self.weights)
    }
}

/// A flat tensor on the host.
pub fn to_host(tensor: &Tensor) -> Vec<f32> {
    let host = tensor.to_device(Device::Cpu).to_kind(Kind::Float).contiguous();
    let mut values = vec![0f32; host.numel()];
    let count = values.len();
    host.copy_data(&mut values, count);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_update_moves_each_weight_by_the_rate() {
        // With one gradient, m/(1-b1) = g and v/(1-b2) = g^2: each weight moves by rate * sign(g).
        let mut adam = Optimiser::new(&[1.0, 2.0], [0.9, 0.999], false, Device::Cpu);
        let norm = adam.update(&Tensor::from_slice(&[3f32, -4.0]), 0.5, 0.0, 0.0);
        assert!((norm - 5.0).abs() < 1e-6);
        let w = to_host(&adam.weights);
        assert!((w[0] - 0.5).abs() < 1e-6 && (w[1] - 2.5).abs() < 1e-6, "{w:?}");
    }
}
