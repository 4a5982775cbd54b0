//! Online normalisers: mean and standard deviation of inputs, edge features and outputs, accumulated in f64
//! over the first batches, then frozen.

use m4gn_engine::backward::{Scale, Scales};
use m4gn_mesh::{Error, Result};
use m4gn_model::{Model, ModelSpec, Tensor};
use std::collections::BTreeMap;

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

    /// The rows of `rows [n x channels]`.
    pub fn of(rows: &[f32], channels: usize) -> Self {
        let mut moments = Moments::new(channels);
        for row in rows.chunks_exact(channels.max(1)) {
            moments.count += 1.0;
            let sums = moments.sum.iter_mut().zip(&mut moments.square);
            for ((sum, square), x) in sums.zip(row) {
                let x = f64::from(*x);
                *sum += x;
                *square += x * x;
            }
        }
        moments
    }

    /// One row that stands for many with this mean and deviation.
    fn standing_for(mean: &[f32], std: &[f32]) -> Self {
        let wide = |x: &f32| f64::from(*x);
        Moments {
            count: 1.0,
            sum: mean.iter().map(wide).collect(),
            square: mean
                .iter()
                .zip(std)
                .map(|(m, s)| wide(m).powi(2) + wide(s).powi(2))
                .collect(),
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

    /// Whether these can be moments of so many channels.
    pub fn check(&self, channels: usize) -> std::result::Result<(), String> {
        if (self.sum.len(), self.square.len()) != (channels, channels) {
            let found = (self.sum.len(), self.square.len());
            return Err(format!(
                "{} and {} channels, expected {channels}",
                found.0, found.1
            ));
        }
        let all = self.sum.iter().chain(&self.square).chain([&self.count]);
        let least = self.square.iter().fold(self.count, |m, v| m.min(*v));
        match all.clone().all(|v| v.is_finite()) && least >= 0.0 {
            true => Ok(()),
            false => Err("a count or sum that is negative or not finite".into()),
        }
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

impl Normaliser {
    /// Nothing seen yet.
    pub fn new(spec: &ModelSpec) -> Self {
        Normaliser {
            node: Moments::new(spec.n_field_inputs()),
            edge: Moments::new(spec.n_edge_features()),
            output: Moments::new(spec.n_outputs()),
        }
    }

    /// Those of a model.
    ///
    /// # Errors
    /// [`Error::Model`] for a model without them.
    pub fn of_model(model: &Model) -> Result<Self> {
        let moments = |name: &str| -> Result<Moments> {
            let mean = &model.tensor(&format!("norm.{name}.mean"))?.data;
            let std = &model.tensor(&format!("norm.{name}.std"))?.data;
            Ok(Moments::standing_for(mean, std))
        };
        Ok(Normaliser {
            node: moments("node")?,
            edge: moments("edge")?,
            output: moments("output")?,
        })
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

    /// Whether these can be the moments of a model.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first that cannot.
    pub fn check(&self, spec: &ModelSpec) -> Result<()> {
        let counts = [spec.n_field_inputs(), spec.n_edge_features(), spec.n_outputs()];
        for ((name, moments), channels) in self.named().into_iter().zip(counts) {
            moments
                .check(channels)
                .map_err(|what| Error::Input(format!("{name}: {what}")))?;
        }
        Ok(())
    }

    /// All numbers in a row, and back.
    pub fn flat(&self) -> Vec<f64> {
        let all = self.named().into_iter().flat_map(|(_, m)| {
            let counts = std::iter::once(&m.count);
            counts.chain(&m.sum).chain(&m.square).copied()
        });
        all.collect()
    }

    /// Takes all numbers from a row that [`Normaliser::flat`] made of one of this shape.
    pub fn set_flat(&mut self, mut flat: &[f64]) {
        for m in [&mut self.node, &mut self.edge, &mut self.output] {
            let channels = m.sum.len();
            m.count = flat[0];
            m.sum.copy_from_slice(&flat[1..1 + channels]);
            m.square.copy_from_slice(&flat[1 + channels..1 + 2 * channels]);
            flat = &flat[1 + 2 * channels..];
        }
    }

    /// The model's `norm.*` tensors.
    pub fn tensors(&self) -> BTreeMap<String, Tensor> {
        let mut tensors = BTreeMap::new();
        for (name, moments) in self.named() {
            let (mean, std) = moments.mean_std();
            for (part, data) in [("mean", mean), ("std", std)] {
                let shape = vec![data.len()];
                tensors.insert(format!("{name}.{part}"), Tensor { shape, data });
            }
        }
        tensors
    }

    /// Means and deviations.
    pub fn scales(&self) -> Scales {
        let scale = |m: &Moments| {
            let (mean, std) = m.mean_std();
            Scale::new(mean, std)
        };
        Scales {
            node: scale(&self.node),
            edge: scale(&self.edge),
            output: scale(&self.output),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_of_known_rows() {
        let mut m = Moments::of(&[1f32, 5.0, 3.0, 5.0], 2);
        m.add(&Moments::of(&[5f32, 5.0], 2));
        let (mean, std) = m.mean_std();
        assert_eq!(mean, [3.0, 5.0]);
        assert!((std[0] - (8f32 / 3.0).sqrt()).abs() < 1e-6);
        assert_eq!(std[1], 1.0, "a constant channel is left alone");
        let again = Moments::standing_for(&mean, &std).mean_std();
        assert!((again.1[0] / std[0] - 1.0).abs() < 1e-6 && again.0 == mean);
    }

    #[test]
    fn damaged_moments_are_told() {
        let good = Moments::of(&[1f32, 5.0], 2);
        assert!(good.check(2).is_ok());
        assert!(good.check(3).unwrap_err().contains("expected 3"));
        let mut bad = good.clone();
        bad.square[1] = f64::INFINITY;
        assert!(bad.check(2).is_err());
        bad.square[1] = -1.0;
        assert!(bad.check(2).is_err());
    }
}
