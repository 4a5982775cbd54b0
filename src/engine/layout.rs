//! All weights as one flat vector: one place for the optimiser, the gradient's norm, running averages and checkpoints.

use m4gn_base::{Error, Result, refuse};
use m4gn_model::{Model, ModelSpec, Tensor};
use rand::RngExt;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Name, shape and place of each weight in the flat vector; the normalisers are not among them.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    entries: Vec<(String, Vec<usize>)>,
    /// First number of each, and the end.
    starts: Vec<usize>,
}

impl Layout {
    /// The layout of a model.
    pub fn new(spec: &ModelSpec) -> Self {
        let entries: Vec<_> =
            Model::tensor_shapes(spec).into_iter().filter(|(name, _)| !name.starts_with("norm.")).collect();
        let mut starts = vec![0];
        for (_, shape) in &entries {
            starts.push(starts[starts.len() - 1] + shape.iter().product::<usize>());
        }
        Layout { entries, starts }
    }

    /// Number of weights.
    pub fn len(&self) -> usize {
        self.starts[self.entries.len()]
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Names and shapes in order.
    pub fn entries(&self) -> &[(String, Vec<usize>)] {
        &self.entries
    }

    /// First number of each in the flat vector, and the end.
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// First number and shape of a weight.
    ///
    /// # Errors
    /// [`Error::Internal`] for a name that the model lacks.
    pub fn find(&self, name: &str) -> Result<(usize, &[usize])> {
        let at = self.entries.binary_search_by(|(n, _)| n.as_str().cmp(name));
        at.map(|at| (self.starts[at], &self.entries[at].1[..]))
            .map_err(|_| Error::Internal(format!("the network has no weight {name}")))
    }

    /// Random first weights: matrices normal with He's variance 2/n (1/n without an activation behind, less on residual
    /// branches), biases 0, gains 1.
    pub fn initial(&self, spec: &ModelSpec, rng: &mut impl RngExt) -> Vec<f32> {
        let last = spec.architecture.hidden_layers.to_string();
        let mut flat = Vec::with_capacity(self.len());
        for (name, shape) in &self.entries {
            let n: usize = shape.iter().product();
            let parts: Vec<&str> = name.split('.').collect();
            let (tail, layer) =
                (parts[parts.len() - 1], parts.get(parts.len().wrapping_sub(2)).copied().unwrap_or(""));
            if shape.len() == 2 {
                let transformer = name.starts_with("segment.transformer");
                let gain = match layer {
                    "o" => 0.5,
                    "1" if transformer => 0.5,
                    "0" if transformer => 2f64.sqrt(),
                    "q" | "k" | "v" => 1.0,
                    "dispatch" => 0.5,
                    _ if layer == last => 1.0,
                    _ => 2f64.sqrt(),
                };
                let scale = gain / (shape[1] as f64).sqrt();
                flat.extend((0..n).map(|_| (scale * normal(rng)) as f32));
            } else {
                let gains = tail == "weight";
                flat.extend((0..n).map(|_| if gains { 1.0 } else { 0.0 }));
            }
        }
        flat
    }

    /// The flat vector of a model's weights.
    ///
    /// # Errors
    /// [`Error::Model`] where the model's tensors are not this layout's.
    pub fn flatten(&self, model: &Model) -> Result<Vec<f32>> {
        let mut flat = Vec::with_capacity(self.len());
        for (name, shape) in &self.entries {
            let tensor = model.tensor(name)?;
            refuse(tensor.shape != *shape, Error::Model, || {
                format!("tensor '{name}': expected {shape:?}, found {:?}", tensor.shape)
            })?;
            flat.extend_from_slice(&tensor.data);
        }
        Ok(flat)
    }

    /// The model's tensors from the flat vector, which is as long as the layout.
    pub fn unflatten(&self, flat: &[f32]) -> BTreeMap<String, Tensor> {
        let parts = self.entries.iter().zip(self.starts.windows(2));
        parts
            .map(|((name, shape), bounds)| {
                let tensor = Tensor { shape: shape.clone(), data: flat[bounds[0]..bounds[1]].to_vec() };
                (name.clone(), tensor)
            })
            .collect()
    }
}

/// A standard normal number (Box-Muller, one of the pair).
pub fn normal(rng: &mut impl RngExt) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}
