//! Normalisers, and features and derivatives in their units.

use super::kernels::Number;
use m4gn_base::Result;
use m4gn_model::Model;

/// Mean and deviation of the channels of features.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Means.
    pub mean: Vec<f32>,
    /// Deviations.
    pub std: Vec<f32>,
    /// One over these.
    pub inverse: Vec<f32>,
}

impl Scale {
    /// Of means and deviations.
    pub fn new(mean: Vec<f32>, std: Vec<f32>) -> Self {
        let inverse = std.iter().map(|s| 1.0 / s).collect();
        Scale { mean, std, inverse }
    }

    /// Normaliser `name` of a model.
    ///
    /// # Errors
    /// [`m4gn_base::Error::Model`] for one that is missing.
    pub fn of_model(model: &Model, name: &str) -> Result<Self> {
        let part = |which: &str| model.tensor(&format!("norm.{name}.{which}")).map(|t| t.data.clone());
        Ok(Self::new(part("mean")?, part("std")?))
    }

    /// Of channels that are normalised already.
    pub(crate) fn unit(channels: usize) -> Self {
        Self::new(vec![0.0; channels], vec![1.0; channels])
    }

    /// Number of channels.
    pub(crate) fn channels(&self) -> usize {
        self.mean.len()
    }

    /// Rows of normalised channels to physical ones.
    pub fn to_physical(&self, rows: &mut [f32]) {
        for row in rows.chunks_exact_mut(self.mean.len()) {
            let scales = self.mean.iter().zip(&self.std);
            let pairs = row.iter_mut().zip(scales);
            pairs.for_each(|(y, (mean, std))| *y = *y * std + mean);
        }
    }

    /// A row of channels.
    pub(crate) fn normalise<T: Number>(&self, row: &[f32], to: &mut [T]) {
        let scales = self.mean.iter().zip(&self.inverse);
        for ((to, x), (mean, inverse)) in to.iter_mut().zip(row).zip(scales) {
            *to = T::from_f32((x - mean) * inverse);
        }
    }

    /// Rows of channels in this order, to rows of `columns`.
    pub(crate) fn normalise_rows<T: Number>(
        &self,
        rows: &[f32],
        order: &[u32],
        columns: usize,
        to: &mut [T],
    ) {
        let k = self.channels();
        for (to, &i) in to.chunks_exact_mut(columns).zip(order) {
            self.normalise(&rows[i as usize * k..(i as usize + 1) * k], to);
        }
    }

    /// Derivatives by physical channels from those by normalised ones.
    pub(crate) fn derivative(&self, d: &[f32], to: &mut [f32]) {
        to.iter_mut().zip(d).zip(&self.inverse).for_each(|((to, d), inverse)| *to = d * inverse);
    }
}
