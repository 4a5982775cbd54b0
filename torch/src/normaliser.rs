//! Online normalisers: mean and standard deviation of inputs, edge features and outputs, accumulated in f64
//! over the first batches, then frozen.

use crate::samples::Components;
use m4gn::model::{ModelSpec, Tensor as ModelTensor};
use std::collections::BTreeMap;
use tch::{Device, Kind, Tensor};

/// Count, sum and sum of squares of each channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Rows seen.
    pub count: f64,
    /// Sum of each channel.
    pub sum: Vec<f64>,
    /// Sum of squares of each channel.
    pub square: Vec<f64>,
}

impl Moments {
    /// No rows of `channels` channels.
    pub fn new(channels: usize) -> Self {
        Moments {
            count: 0.0,
            sum: vec![0.0; channels],
            square: vec![0.0; channels],
        }
    }

    /// The rows of a tensor `[rows x channels]`.
    pub fn of(rows: &Tensor) -> Self {
        let rows = rows.to_kind(Kind::Double);
        let host = |t: Tensor| Vec::<f64>::try_from(t.to_device(Device::Cpu)).unwrap_or_default();
        let dims = Some(&[0i64][..]);
        Moments {
            count: rows.size()[0] as f64,
            sum: host(rows.sum_dim_intlist(dims, false, Kind::Double)),
            square: host(rows.square().sum_dim_intlist(dims, false, Kind::Double)),
        }
    }

    /// Adds other rows.
    pub fn add(&mut self, other: &Moments) {
        self.count += other.count;
        self.sum.iter_mut().zip(&other.sum).for_each(|(a, b)| *a += b);
        self.square
            .iter_mut()
            .zip(&other.square)
            .for_each(|(a, b)| *a += b);
    }

    /// Mean and standard deviation; the deviation of a constant channel is 1, which leaves it at 0.
    pub fn mean_std(&self) -> (Vec<f32>, Vec<f32>) {
        let n = self.count.max(1.0);
        let mean: Vec<f64> = self.sum.iter().map(|s| s / n).collect();
        let std = mean.iter().zip(&self.square).map(|(m, q)| {
            let variance = (q / n - m * m).max(0.0);
            if variance <= 1e-12 * (m * m + f64::MIN_POSITIVE) {
                1.0
            } else {
                variance.sqrt() as f32
            }
        });
        (mean.iter().map(|&m| m as f32).collect(), std.collect())
    }
}

/// The three sets of moments of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Normaliser {
    /// Node field inputs.
    pub node: Moments,
    /// Edge features.
    pub edge: Moments,
    /// Outputs.
    pub output: Moments,
}

/// Means and deviations on the device.
pub struct Scales {
    /// Of node field inputs, `[inputs]`.
    pub node: (Tensor, Tensor),
    /// Of edge features, `[dim + 1]`.
    pub edge: (Tensor, Tensor),
    /// Of outputs, `[outputs]`.
    pub output: (Tensor, Tensor),
}

impl Normaliser {
    /// Nothing seen yet.
    pub fn new(spec: &ModelSpec, components: &Components) -> Self {
        Normaliser {
            node: Moments::new(spec.n_field_inputs()),
            edge: Moments::new(spec.n_edge_features()),
            output: Moments::new(components.outputs.len()),
        }
    }

    /// Adds what another one has seen.
    pub fn add(&mut self, other: &Normaliser) {
        self.node.add(&other.node);
        self.edge.add(&other.edge);
        self.output.add(&other.output);
    }

    /// The three by the names of the model's tensors.
    pub fn named(&self) -> [(&'static str, &Moments); 3] {
        [
            ("norm.node", &self.node),
            ("norm.edge", &self.edge),
            ("norm.output", &self.output),
        ]
    }

    /// The model's `norm.*` tensors.
    pub fn tensors(&self) -> BTreeMap<String, ModelTensor> {
        let mut tensors = BTreeMap::new();
        for (name, moments) in self.named() {
            let (mean, std) = moments.mean_std();
            tensors.insert(
                format!("{name}.mean"),
                ModelTensor {
                    shape: vec![mean.len()],
                    data: mean,
                },
            );
            tensors.insert(
                format!("{name}.std"),
                ModelTensor {
                    shape: vec![std.len()],
                    data: std,
                },
            );
        }
        tensors
    }

    /// Means and deviations as tensors.
    pub fn scales(&self, device: Device) -> Scales {
        let pair = |m: &Moments| {
            let (mean, std) = m.mean_std();
            (
                Tensor::from_slice(&mean).to_device(device),
                Tensor::from_slice(&std).to_device(device),
            )
        };
        Scales {
            node: pair(&self.node),
            edge: pair(&self.edge),
            output: pair(&self.output),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_of_known_rows() {
        let mut m = Moments::of(&Tensor::from_slice(&[1f32, 5.0, 3.0, 5.0]).view([2, 2]));
        m.add(&Moments::of(&Tensor::from_slice(&[5f32, 5.0]).view([1, 2])));
        let (mean, std) = m.mean_std();
        assert_eq!(mean, [3.0, 5.0]);
        assert!((std[0] - (8f32 / 3.0).sqrt()).abs() < 1e-6);
        assert_eq!(std[1], 1.0, "a constant channel is left alone");
    }
}
