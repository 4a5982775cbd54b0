//! Linear layers and perceptrons over row-major rows `[n x d]`.

use super::Isa;
use super::kernels::{Function, bias_activate, layer_norm};
use crate::Result;
use crate::model::{Activation, Model};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// `y = x W` or `y += x W`: x `[n x inputs]`, W `[inputs x outputs]`, y `[n x outputs]`, all row-major.
pub fn multiply(
    y: &mut [f32],
    x: &[f32],
    w: &[f32],
    n: usize,
    inputs: usize,
    outputs: usize,
    accumulate: bool,
) {
    let (y, x) = (&mut y[..n * outputs], &x[..n * inputs]);
    if inputs == 0 {
        if !accumulate {
            y.fill(0.0);
        }
        return;
    }
    let accumulate = if accumulate { Accum::Add } else { Accum::Replace };
    matmul(
        MatMut::from_row_major_slice_mut(y, n, outputs),
        accumulate,
        MatRef::from_row_major_slice(x, n, inputs),
        MatRef::from_row_major_slice(w, inputs, outputs),
        1.0,
        Par::Seq,
    );
}

/// Weights in the order that the product reads: `[inputs x outputs]`.
#[derive(Debug)]
pub struct Weight {
    data: Vec<f32>,
    inputs: usize,
    outputs: usize,
}

impl Weight {
    /// Columns `columns` of tensor `NAME.weight [outputs, all inputs]`, transposed.
    pub fn columns(model: &Model, name: &str, columns: std::ops::Range<usize>) -> Result<Self> {
        let tensor = model.tensor(&format!("{name}.weight"))?;
        let (outputs, all) = (tensor.shape[0], tensor.shape[1]);
        let inputs = columns.len();
        let mut data = vec![0.0; inputs * outputs];
        for o in 0..outputs {
            for (i, c) in columns.clone().enumerate() {
                data[i * outputs + o] = tensor.data[o * all + c];
            }
        }
        Ok(Weight {
            data,
            inputs,
            outputs,
        })
    }

    /// All columns.
    pub fn whole(model: &Model, name: &str) -> Result<Self> {
        let inputs = model.tensor(&format!("{name}.weight"))?.shape[1];
        Self::columns(model, name, 0..inputs)
    }

    /// Weights side by side: one product gives all their outputs.
    pub fn beside(parts: &[Weight]) -> Self {
        let inputs = parts[0].inputs;
        let outputs = parts.iter().map(|p| p.outputs).sum();
        let mut data = Vec::with_capacity(inputs * outputs);
        for i in 0..inputs {
            for p in parts {
                data.extend_from_slice(&p.data[i * p.outputs..(i + 1) * p.outputs]);
            }
        }
        Weight {
            data,
            inputs,
            outputs,
        }
    }

    /// `y = x W` for n rows.
    pub fn apply(&self, y: &mut [f32], x: &[f32], n: usize) {
        multiply(y, x, &self.data, n, self.inputs, self.outputs, false);
    }

    /// `y += x W` for n rows.
    pub fn apply_add(&self, y: &mut [f32], x: &[f32], n: usize) {
        multiply(y, x, &self.data, n, self.inputs, self.outputs, true);
    }
}

/// Tensor `NAME.bias`.
pub fn bias(model: &Model, name: &str) -> Result<Vec<f32>> {
    Ok(model.tensor(&format!("{name}.bias"))?.data.clone())
}

/// Gain and shift of a layer norm.
#[derive(Debug)]
pub struct Norm {
    /// Tensor `NAME.weight`.
    pub gain: Vec<f32>,
    /// Tensor `NAME.bias`.
    pub shift: Vec<f32>,
    zeros: Vec<f32>,
}

impl Norm {
    /// Tensors `NAME.weight` and `NAME.bias`.
    pub fn new(model: &Model, name: &str) -> Result<Self> {
        let gain = model.tensor(&format!("{name}.weight"))?.data.clone();
        let (shift, zeros) = (bias(model, name)?, vec![0.0; gain.len()]);
        Ok(Norm { gain, shift, zeros })
    }

    /// `out = LN(x)` for each row.
    pub fn apply(&self, isa: Isa, x: &[f32], out: &mut [f32]) {
        layer_norm(isa, x, &self.zeros, &self.gain, &self.shift, out);
    }
}

/// The layers of a perceptron behind its first product, which its callers put together from parts.
#[derive(Debug)]
pub struct Tail {
    /// Bias of the first layer; part of what the caller hands in.
    pub first_bias: Vec<f32>,
    /// What the caller applies to the first layer's output (identity when there is only one layer).
    pub first_function: Function,
    /// Bias of the last layer, left to the caller; zeros when the first layer is the last.
    pub last_bias: Vec<f32>,
    layers: Vec<Weight>,
    biases: Vec<Vec<f32>>,
    function: Function,
}

impl Tail {
    /// Layers 1 to h of perceptron `name`.
    pub fn new(model: &Model, name: &str) -> Result<Self> {
        let function = function(model.spec.architecture.activation);
        let h = model.spec.architecture.hidden_layers;
        let first_bias = bias(model, &format!("{name}.0"))?;
        let layers = (1..=h)
            .map(|i| Weight::whole(model, &format!("{name}.{i}")))
            .collect::<Result<Vec<_>>>()?;
        let biases = (1..=h)
            .map(|i| bias(model, &format!("{name}.{i}")))
            .collect::<Result<Vec<_>>>()?;
        let last_bias = biases
            .last()
            .cloned()
            .unwrap_or_else(|| vec![0.0; first_bias.len()]);
        let first_function = if h == 0 { Function::Identity } else { function };
        Ok(Tail {
            first_bias,
            first_function,
            last_bias,
            layers,
            biases,
            function,
        })
    }

    /// From the first layer's activated output in `x` (n rows) to the last layer's output without its bias, which
    /// comes back in one of the two buffers.
    pub fn run<'a>(&self, isa: Isa, n: usize, x: &'a mut [f32], y: &'a mut [f32]) -> &'a mut [f32] {
        let (mut from, mut to) = (x, y);
        let last = self.layers.len().saturating_sub(1);
        let mut outputs = self.first_bias.len();
        for (i, layer) in self.layers.iter().enumerate() {
            layer.apply(to, from, n);
            outputs = layer.outputs;
            if i < last {
                bias_activate(isa, &mut to[..n * outputs], &self.biases[i], self.function);
            }
            std::mem::swap(&mut from, &mut to);
        }
        &mut from[..n * outputs]
    }
}

/// The kernels' name of an activation.
pub fn function(activation: Activation) -> Function {
    match activation {
        Activation::Relu => Function::Relu,
        Activation::Silu => Function::Silu,
    }
}
