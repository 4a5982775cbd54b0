//! All weights as one flat vector, and named views of it.
//!
//! One vector makes the optimiser, the gradient's norm, running averages and checkpoints single operations on
//! single tensors, and gives the backward pass one place to gather the gradient.

use m4gn::model::{Model, ModelSpec, Tensor as ModelTensor};
use m4gn::{Error, Result};
use rand::RngExt;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use tch::{Device, Kind, Tensor};

/// Name, shape and place of each weight in the flat vector; the normalisers are not among them.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    entries: Vec<(String, Vec<i64>)>,
    sizes: Vec<i64>,
}

/// Named tensors, views of the flat vector (and of its bfloat16 copy).
pub struct Weights {
    full: BTreeMap<String, Tensor>,
    half: BTreeMap<String, Tensor>,
}

impl Layout {
    /// The layout of a model.
    pub fn new(spec: &ModelSpec) -> Self {
        let entries: Vec<(String, Vec<i64>)> = Model::tensor_shapes(spec)
            .into_iter()
            .filter(|(name, _)| !name.starts_with("norm."))
            .map(|(name, shape)| (name, shape.iter().map(|&n| n as i64).collect()))
            .collect();
        let sizes = entries.iter().map(|(_, shape)| shape.iter().product()).collect();
        Layout { entries, sizes }
    }

    /// Number of weights.
    pub fn len(&self) -> usize {
        self.sizes.iter().sum::<i64>() as usize
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Named views of the flat vector; gradients flow back to it. With `half`, bfloat16 copies too.
    pub fn views(&self, flat: &Tensor, half: bool) -> Weights {
        let named = |vector: &Tensor| {
            let parts = vector.split_with_sizes(&self.sizes[..], 0);
            self.entries
                .iter()
                .zip(parts)
                .map(|((name, shape), part)| (name.clone(), part.view(&shape[..])))
                .collect()
        };
        Weights {
            full: named(flat),
            half: if half {
                named(&flat.to_kind(Kind::BFloat16))
            } else {
                BTreeMap::new()
            },
        }
    }

    /// Random first weights, the same on every device: matrices normal with He's variance 2/n (1/n without an
    /// activation behind, less on residual branches), biases 0, scales 1.
    pub fn initial(&self, spec: &ModelSpec, rng: &mut impl RngExt) -> Vec<f32> {
        let last = spec.architecture.hidden_layers.to_string();
        let mut flat = Vec::with_capacity(self.len());
        for (name, shape) in &self.entries {
            let n: i64 = shape.iter().product();
            let parts: Vec<&str> = name.split('.').collect();
            let (tail, layer) = (
                parts[parts.len() - 1],
                parts.get(parts.len().wrapping_sub(2)).copied().unwrap_or(""),
            );
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
                let scales = tail == "weight";
                flat.extend((0..n).map(|_| if scales { 1.0 } else { 0.0 }));
            }
        }
        flat
    }

    /// The flat vector of a model's weights.
    pub fn flatten(&self, model: &Model) -> Result<Vec<f32>> {
        let mut flat = Vec::with_capacity(self.len());
        for (name, _) in &self.entries {
            let tensor = model.tensors.get(name).ok_or_else(|| {
                Error::Model(format!(
                    "the model has no tensor `{name}`; it does not fit its own description"
                ))
            })?;
            flat.extend_from_slice(&tensor.data);
        }
        Ok(flat)
    }

    /// The model's tensors from the flat vector.
    pub fn unflatten(&self, flat: &[f32]) -> BTreeMap<String, ModelTensor> {
        let mut at = 0;
        let mut tensors = BTreeMap::new();
        for ((name, shape), &size) in self.entries.iter().zip(&self.sizes) {
            let data = flat[at..at + size as usize].to_vec();
            at += size as usize;
            tensors.insert(
                name.clone(),
                ModelTensor {
                    shape: shape.iter().map(|&n| n as usize).collect(),
                    data,
                },
            );
        }
        tensors
    }
}

impl Weights {
    /// A weight in fp32. Panics for a name that the layout lacks, a defect of this library.
    pub fn full(&self, name: &str) -> &Tensor {
        self.full
            .get(name)
            .unwrap_or_else(|| panic!("no weight named {name}"))
    }

    /// The weight that large products use: bfloat16 where asked for.
    pub fn product(&self, name: &str) -> &Tensor {
        self.half.get(name).unwrap_or_else(|| self.full(name))
    }

    /// Where the weights are.
    pub fn device(&self) -> Device {
        self.full.values().next().map_or(Device::Cpu, Tensor::device)
    }

    /// Whether large products are in bfloat16.
    pub fn is_half(&self) -> bool {
        !self.half.is_empty()
    }
}

/// A standard normal number (Box-Muller, one of the pair), for host-side randomness that no device changes.
pub fn normal(rng: &mut impl RngExt) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}
