//! Weights of linear layers and perceptrons in the order that the kernels read them.

use super::kernels::{Addend, Function, Isa, Norm, Number, Output, Packed, padded, product};
use m4gn_base::Result;
use m4gn_model::Model;
use std::ops::Range;

/// Columns `columns` of tensor `NAME.weight [outputs, all inputs]`.
pub fn columns<T: Number>(isa: Isa, model: &Model, name: &str, columns: Range<usize>) -> Result<Packed<T>> {
    let tensor = model.tensor(&format!("{name}.weight"))?;
    let (outputs, all) = (tensor.shape[0], tensor.shape[1]);
    Ok(Packed::new(isa, columns.len(), outputs, |i, o| tensor.data[o * all + columns.start + i]))
}

/// All columns.
pub fn whole<T: Number>(isa: Isa, model: &Model, name: &str) -> Result<Packed<T>> {
    let inputs = model.tensor(&format!("{name}.weight"))?.shape[1];
    columns(isa, model, name, 0..inputs)
}

/// All columns of a layer that reads k latents of width d, each padded to whole vectors.
pub fn of_latents<T: Number>(isa: Isa, model: &Model, name: &str, d: usize, k: usize) -> Result<Packed<T>> {
    let tensor = model.tensor(&format!("{name}.weight"))?;
    let columns = padded(d);
    Ok(Packed::new(isa, (k - 1) * columns + d, tensor.shape[0], |i, o| match i % columns {
        at if at < d => tensor.data[(o * k + i / columns) * d + at],
        _ => 0.0,
    }))
}

/// Tensor `NAME.bias`, padded to whole vectors.
pub fn bias(model: &Model, name: &str) -> Result<Vec<f32>> {
    let mut bias = model.tensor(&format!("{name}.bias"))?.data.clone();
    bias.resize(padded(bias.len()), 0.0);
    Ok(bias)
}

/// Tensors `NAME.weight` and `NAME.bias` of a layer norm.
pub fn norm(model: &Model, name: &str) -> Result<Norm> {
    let gain = &model.tensor(&format!("{name}.weight"))?.data;
    Ok(Norm::new(gain, &model.tensor(&format!("{name}.bias"))?.data))
}

/// A linear layer.
pub struct Linear<T> {
    /// Its weight.
    pub weight: Packed<T>,
    /// Its bias, padded.
    pub bias: Vec<f32>,
}

impl<T: Number> Linear<T> {
    /// Tensors `NAME.weight` and `NAME.bias`.
    pub fn new(isa: Isa, model: &Model, name: &str) -> Result<Self> {
        Ok(Linear { weight: whole(isa, model, name)?, bias: bias(model, name)? })
    }

    /// `f(x W + b)` of n rows of x, which stand a stride apart.
    pub fn run(&self, isa: Isa, x: (&[T], usize), n: usize, f: Function, out: Output<T>) {
        product(isa, &self.weight, x, n, Addend::Bias(&self.bias), f, out);
    }

    /// `out += x W + b`, as [`Linear::run`].
    pub fn add(&self, isa: Isa, x: (&[T], usize), n: usize, out: &mut [f32]) {
        let bias = Addend::Output(&self.bias);
        product(isa, &self.weight, x, n, bias, Function::Identity, Output::Wide(out));
    }
}

/// The layers of a perceptron behind its first one, which its callers put together from parts.
pub struct Tail<T> {
    layers: Vec<Linear<T>>,
    /// Between the layers.
    function: Function,
}

impl<T: Number> Tail<T> {
    /// Layers 1 to h of perceptron `name`.
    pub fn new(isa: Isa, model: &Model, name: &str) -> Result<Self> {
        Ok(Tail {
            layers: (1..=model.spec.architecture.hidden_layers)
                .map(|i| Linear::new(isa, model, &format!("{name}.{i}")))
                .collect::<Result<_>>()?,
            function: model.spec.architecture.activation.into(),
        })
    }

    /// What follows the first layer.
    pub fn function(&self) -> Function {
        self.function
    }

    /// From the first layer's activated output in `a` (n rows) to the last layer's in `c`.
    pub fn run(&self, isa: Isa, n: usize, a: &mut [T], b: &mut [T], c: &mut [f32]) {
        let (mut from, mut to) = (a, b);
        let Some((last, inner)) = self.layers.split_last() else {
            return;
        };
        for layer in inner {
            layer.run(isa, (from, layer.weight.columns()), n, self.function, Output::Narrow(to));
            std::mem::swap(&mut from, &mut to);
        }
        last.run(isa, (from, padded(last.weight.inputs())), n, Function::Identity, Output::Wide(c));
    }
}
