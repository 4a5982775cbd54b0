//! A perceptron behind the product of its first layer, which its callers put together from parts.

use super::activations::{Activated, Activations};
use super::kernels::{Buffer, Function, Isa, Normed, Number, Output, layer_norm, layer_norm_keep, padded};
use super::tiles::numbers;
use super::weights::{Linear, NormWeights, Vector, Weights};
use m4gn_base::Result;
use m4gn_model::Architecture;
use std::ops::Range;

/// Weights of the layers behind the first one, and of the layer norm at the end.
pub struct Mlp<T> {
    pub isa: Isa,
    /// Columns of the latents, padded.
    pub columns: usize,
    /// Bias of the first layer.
    pub first_bias: Vector,
    pub tail: Vec<Linear<T>>,
    pub norm: NormWeights,
    function: Function,
}

/// What a perceptron keeps for its derivative, a row each.
pub struct MlpTape<T> {
    pub values: Vec<Activated<T>>,
    pub normed: Buffer<T>,
    pub scale: Buffer<f32>,
}

/// Where the activations of some rows go, and what the norm keeps of them.
pub struct MlpRows<'a, T> {
    pub activations: Activations<'a, T>,
    norm: Option<(&'a mut [T], &'a mut [f32])>,
}

impl<T: Number> MlpTape<T> {
    pub fn new(mlp: &Mlp<T>) -> Self {
        MlpTape {
            values: mlp.tail.iter().map(|_| Activated::new(mlp.function)).collect(),
            normed: Buffer::default(),
            scale: Buffer::default(),
        }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, columns: usize) {
        self.values.iter_mut().for_each(|v| v.fit(rows * columns));
        self.normed.fit(rows * columns);
        self.scale.fit(rows);
    }
}

impl<T: Number> Mlp<T> {
    /// Layers 1 to h of perceptron `name`, whose latents all have width d, the first layer's bias and the norm.
    pub fn new(weights: &mut Weights, name: &str, architecture: &Architecture) -> Result<Self> {
        let mut layer = |i: usize| Linear::new(weights, &format!("{name}.{i}"));
        Ok(Mlp {
            columns: padded(architecture.width),
            tail: (1..=architecture.hidden_layers).map(&mut layer).collect::<Result<_>>()?,
            first_bias: Vector::new(weights, &format!("{name}.0.bias"))?,
            norm: NormWeights::new(weights, &format!("{name}.norm"))?,
            function: architecture.activation.into(),
            isa: weights.isa,
        })
    }

    /// Rows of a tape, or, where nothing is kept, two buffers.
    pub fn rows<'a>(
        &self,
        tape: Option<&'a mut MlpTape<T>>,
        rows: &Range<usize>,
        buffers: [&'a mut [T]; 2],
    ) -> MlpRows<'a, T> {
        match tape {
            None => MlpRows { activations: Activations::Passing(self.function, buffers), norm: None },
            Some(MlpTape { values, normed, scale }) => MlpRows {
                activations: Activations::Kept(values, rows.clone()),
                norm: Some((&mut normed[numbers(rows, self.columns)], &mut scale[rows.clone()])),
            },
        }
    }

    /// From the first layer's activations of n rows to the normed output; `wide` has room for the rows.
    pub fn forward(&self, n: usize, rows: MlpRows<T>, wide: &mut [f32], out: Normed<T>) {
        let (isa, columns) = (self.isa, self.columns);
        let MlpRows { mut activations, norm } = rows;
        for (i, layer) in (1..).zip(&self.tail) {
            if i < self.tail.len() {
                let (x, place) = activations.of(i, columns);
                place.fill(&layer.weight, (x, columns), n, layer.bias(), wide);
            } else {
                let x = (activations.values(i - 1, columns), columns);
                layer.run(x, n, Function::Identity, Output::Wide(wide));
            }
        }
        match norm {
            None => layer_norm(isa, &self.norm.norm, wide, n, out),
            Some(keep) => layer_norm_keep(isa, &self.norm.norm, wide, n, out, keep),
        }
    }
}
