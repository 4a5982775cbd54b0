//! Online normalisers: mean and standard deviation of inputs, edge features and outputs, accumulated in f64
//! over the first batches, then frozen.

use m4gn_base::{Error, Result};
use m4gn_domain::Statistics;
use m4gn_engine::backward::{Scale, Scales};
use m4gn_model::{Model, ModelSpec, Tensor};
use std::collections::BTreeMap;

/// Count, sum and sum of squares of each channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Rows that each channel was seen in.
    pub count: Vec<f64>,
    /// Sum of each channel.
    pub sum: Vec<f64>,
    /// Sum of squares of each channel.
    pub square: Vec<f64>,
}

impl Moments {
    /// No rows of `channels` channels.
    pub fn new(channels: usize) -> Self {
        Moments { count: vec![0.0; channels], sum: vec![0.0; channels], square: vec![0.0; channels] }
    }

    /// The rows of `rows [n x channels]`.
    pub fn of(rows: &[f32], channels: usize) -> Self {
        Self::of_present(rows, channels, |_, _| true)
    }

    /// The rows of `rows [n x channels]`, of each only the channels that `present` says it has.
    fn of_present(rows: &[f32], channels: usize, present: impl Fn(&[f32], usize) -> bool) -> Self {
        let mut moments = Moments::new(channels);
        for row in rows.chunks_exact(channels.max(1)) {
            for (i, x) in row.iter().enumerate().filter(|(i, _)| present(row, *i)) {
                let x = f64::from(*x);
                moments.count[i] += 1.0;
                moments.sum[i] += x;
                moments.square[i] += x * x;
            }
        }
        moments
    }

    /// The same with one deviation for all channels, around 0.
    fn alike(mut self) -> Self {
        let mean = self.square.iter().sum::<f64>() / self.square.len().max(1) as f64;
        self.square.fill(mean);
        self.sum.fill(0.0);
        self
    }

    /// One row that stands for many with this mean and deviation.
    fn standing_for(mean: &[f32], std: &[f32]) -> Self {
        let wide = |x: &f32| f64::from(*x);
        Moments {
            count: vec![1.0; mean.len()],
            sum: mean.iter().map(wide).collect(),
            square: mean.iter().zip(std).map(|(m, s)| wide(m).powi(2) + wide(s).powi(2)).collect(),
        }
    }

    /// Adds other rows.
    pub fn add(&mut self, other: &Moments) {
        let pairs =
            [(&mut self.count, &other.count), (&mut self.sum, &other.sum), (&mut self.square, &other.square)];
        for (own, other) in pairs {
            own.iter_mut().zip(other).for_each(|(a, b)| *a += b);
        }
    }

    /// Mean and standard deviation; the deviation of a constant channel is 1, which leaves it at 0.
    pub fn mean_std(&self) -> (Vec<f32>, Vec<f32>) {
        let count = || self.count.iter().map(|n| n.max(1.0));
        let mean: Vec<f64> = self.sum.iter().zip(count()).map(|(s, n)| s / n).collect();
        let std = mean.iter().zip(&self.square).zip(count()).map(|((m, q), n)| {
            let variance = (q / n - m * m).max(0.0);
            if variance <= 1e-12 * (m * m + f64::MIN_POSITIVE) { 1.0 } else { variance.sqrt() as f32 }
        });
        (mean.iter().map(|&m| m as f32).collect(), std.collect())
    }

    /// Whether these can be moments of so many channels.
    pub fn check(&self, channels: usize) -> std::result::Result<(), String> {
        let found = [self.count.len(), self.sum.len(), self.square.len()];
        if found != [channels; 3] {
            return Err(format!("{found:?} channels, expected {channels}"));
        }
        let mut all = self.sum.iter().chain(&self.square).chain(&self.count);
        let mut positive = self.square.iter().chain(&self.count);
        match all.all(|v| v.is_finite()) && positive.all(|v| *v >= 0.0) {
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

    /// What one example shows: node inputs, edge features and outputs, physical.
    ///
    /// Of a body, a feature of an edge is seen in the edges of its kind alone, and the three components of the displacement have one
    /// deviation: a direction in which a body hardly moves is not worth more than another.
    pub fn of_example(spec: &ModelSpec, inputs: &[f32], edges: &[f32], outputs: &[f32]) -> Self {
        let output = Moments::of(outputs, spec.n_outputs());
        let statistics = Statistics::of(spec);
        let node = Moments::of_present(inputs, spec.n_field_inputs(), statistics.node);
        let edge = Moments::of_present(edges, spec.n_edge_features(), statistics.edge);
        let output = if statistics.outputs_alike { output.alike() } else { output };
        Normaliser { node, edge, output }
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
        Ok(Normaliser { node: moments("node")?, edge: moments("edge")?, output: moments("output")? })
    }

    /// Adds what another one has seen.
    pub fn add(&mut self, other: &Normaliser) {
        self.node.add(&other.node);
        self.edge.add(&other.edge);
        self.output.add(&other.output);
    }

    /// The three by the names of the model's tensors.
    pub fn named(&self) -> [(&'static str, &Moments); 3] {
        [("norm.node", &self.node), ("norm.edge", &self.edge), ("norm.output", &self.output)]
    }

    /// Whether these can be the moments of a model.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first that cannot.
    pub fn check(&self, spec: &ModelSpec) -> Result<()> {
        let counts = [spec.n_field_inputs(), spec.n_edge_features(), spec.n_outputs()];
        for ((name, moments), channels) in self.named().into_iter().zip(counts) {
            moments.check(channels).map_err(|what| Error::Input(format!("{name}: {what}")))?;
        }
        Ok(())
    }

    /// All its numbers.
    pub fn numbers_mut(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        let all = [&mut self.node, &mut self.edge, &mut self.output];
        all.into_iter().flat_map(|m| [&mut m.count, &mut m.sum, &mut m.square])
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
        Scales { node: scale(&self.node), edge: scale(&self.edge), output: scale(&self.output) }
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
    fn an_edge_of_a_body_shows_the_features_of_its_kind() {
        let spec = m4gn_samples::model::bodies();
        let n = spec.n_edge_features();
        let mut edges = vec![0.0; 3 * n];
        // Two edges of the mesh, lengths 3 and 5, and a world edge of length 7.
        edges[3] = 3.0;
        edges[n + 3] = 5.0;
        edges[2 * n + 11] = 7.0;
        edges[3 * n - 1] = 1.0;
        let outputs = [1.0, 2.0, -2.0, 1.0, 2.0, 2.0];
        let seen = Normaliser::of_example(&spec, &[0.0; 16], &edges, &outputs);
        let (mean, std) = seen.edge.mean_std();
        assert_eq!((mean[3], std[3]), (4.0, 1.0));
        assert_eq!((mean[11], seen.edge.count[11]), (7.0, 1.0));
        assert!((mean[n - 1] - 1.0 / 3.0).abs() < 1e-6, "every edge says its kind");
        let (mean, std) = seen.output.mean_std();
        assert_eq!(mean, [0.0; 3]);
        assert!(std.iter().all(|s| (s - 3f32.sqrt()).abs() < 1e-6), "{std:?}");
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
