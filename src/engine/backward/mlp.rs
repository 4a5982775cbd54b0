//! A perceptron behind the product of its first layer: its forward pass with what is kept, and its backward pass.

use super::weights::{Dense, Gradients, NormWeights, Slots, Vector};
use crate::kernels::{
    Addend, Bf16, Buffer, Function, Isa, Kept, Normed, Number, Output, Packed, Pairs, activation_backward,
    layer_norm_keep, narrow, norm_backward, padded, product, silu_keep,
};
use m4gn_base::Result;
use m4gn_model::{Activation, Architecture};
use std::ops::Range;

/// Most rows that are worked on at a time.
pub const ROWS: usize = Bf16::ROWS;

/// Makes a buffer at least this long.
pub fn fit<T: Number>(buffer: &mut Buffer<T>, len: usize) {
    if buffer.len() < len {
        *buffer = Buffer::new(len);
    }
}

/// Weights of the layers behind the first one, and of the layer norm at the end.
#[derive(Debug)]
pub struct Mlp<T> {
    isa: Isa,
    /// Columns of the latents, padded.
    pub columns: usize,
    /// Bias of the first layer.
    pub first_bias: Vector,
    tail: Vec<Dense<T>>,
    biases: Vec<Vector>,
    norm: NormWeights,
    function: Function,
}

/// What a perceptron keeps, a row each.
#[derive(Debug)]
pub struct MlpTape<T> {
    values: Vec<Buffer<T>>,
    slopes: Vec<Buffer<T>>,
    normed: Buffer<T>,
    scale: Buffer<f32>,
}

/// One thread's buffers.
#[derive(Debug)]
pub struct Work<T> {
    /// Outputs, and derivatives, in fp32.
    pub wide: Buffer<f32>,
    /// Derivatives as products read them.
    pub narrow: Buffer<T>,
    /// For outer products.
    pub pairs: Pairs<T>,
}

impl<T: Number> Work<T> {
    /// For rows of up to `columns`.
    pub fn new(columns: usize) -> Self {
        Work {
            wide: Buffer::new(ROWS * columns),
            narrow: Buffer::new(ROWS * columns),
            pairs: Pairs::new(ROWS, columns, columns),
        }
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.wide.bytes() + self.narrow.bytes()
    }
}

/// The kernels' name of an activation.
pub fn function(architecture: &Architecture) -> Function {
    match architecture.activation {
        Activation::Relu => Function::Relu,
        Activation::Silu => Function::Silu,
    }
}

/// `f(x W + addend)` in rows of `columns` to `value`, and to `slope` its derivative where the value does not tell it.
#[allow(clippy::too_many_arguments)]
pub fn activate<T: Number>(
    isa: Isa,
    weight: &Packed<T>,
    x: (&[T], usize),
    n: usize,
    addend: Addend<T>,
    function: Function,
    wide: &mut [f32],
    value: &mut [T],
    slope: &mut [T],
) {
    match function {
        Function::Silu => {
            let size = n * weight.columns();
            let out = Output::Wide(&mut wide[..size]);
            product(isa, weight, x, n, addend, Function::Identity, out);
            silu_keep(isa, &wide[..size], value, slope);
        }
        f => product(isa, weight, x, n, addend, f, Output::Narrow(value)),
    }
}

/// The same with a first layer in fp32.
#[allow(clippy::too_many_arguments)]
pub fn activate_wide<T: Number>(
    isa: Isa,
    weight: &Packed<f32>,
    x: (&[f32], usize),
    n: usize,
    addend: Addend<f32>,
    function: Function,
    wide: &mut [f32],
    value: &mut [T],
    slope: &mut [T],
) {
    let size = n * weight.columns();
    let silu = function == Function::Silu;
    let f = if silu { Function::Identity } else { function };
    product(isa, weight, x, n, addend, f, Output::Wide(&mut wide[..size]));
    match silu {
        true => silu_keep(isa, &wide[..size], value, slope),
        false => narrow(isa, &wide[..size], &mut value[..size]),
    }
}

impl<T: Number> MlpTape<T> {
    /// Empty.
    pub fn new<U>(mlp: &Mlp<U>) -> Self {
        let n = mlp.tail.len();
        let silu = mlp.function == Function::Silu;
        let empty = |n: usize| (0..n).map(|_| Buffer::new(0)).collect();
        MlpTape {
            values: empty(n),
            slopes: empty(if silu { n } else { 0 }),
            normed: Buffer::new(0),
            scale: Buffer::new(0),
        }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, columns: usize) {
        for buffer in self.values.iter_mut().chain(&mut self.slopes) {
            fit(buffer, rows * columns);
        }
        fit(&mut self.normed, rows * columns);
        fit(&mut self.scale, rows);
    }

    /// Where the first layer's activation of some rows goes, and its derivative.
    pub fn first(&mut self, rows: &Range<usize>, columns: usize) -> (&mut [T], &mut [T]) {
        let range = rows.start * columns..rows.end * columns;
        let slope = match self.slopes.first_mut() {
            Some(slope) => &mut slope[range.clone()],
            None => &mut [],
        };
        (&mut self.values[0][range], slope)
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        let rows = self.values.iter().chain(&self.slopes).map(|b| b.bytes());
        rows.sum::<usize>() + self.normed.bytes() + self.scale.bytes()
    }
}

impl<T: Number> Mlp<T> {
    /// Layers 1 to h of perceptron `name`, whose latents all have width d, the first layer's bias and the norm.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, architecture: &Architecture) -> Result<Self> {
        let layers = 1..=architecture.hidden_layers;
        Ok(Mlp {
            isa,
            columns: padded(architecture.width),
            first_bias: Vector::new(slots, &format!("{name}.0.bias"))?,
            tail: layers
                .clone()
                .map(|i| Dense::whole(isa, slots, &format!("{name}.{i}")))
                .collect::<Result<_>>()?,
            biases: layers.map(|i| Vector::new(slots, &format!("{name}.{i}.bias"))).collect::<Result<_>>()?,
            norm: NormWeights::new(slots, &format!("{name}.norm"))?,
            function: function(architecture),
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.first_bias.load(flat);
        self.tail.iter_mut().for_each(|l| l.load(flat));
        self.biases.iter_mut().for_each(|b| b.load(flat));
        self.norm.load(flat);
    }

    /// Its activation.
    pub fn function(&self) -> Function {
        self.function
    }

    /// From the first layer's activations in the tape to the normed output.
    pub fn forward(&self, tape: &mut MlpTape<T>, rows: &Range<usize>, wide: &mut [f32], out: Normed<T>) {
        let (n, columns) = (rows.len(), self.columns);
        let range = rows.start * columns..rows.end * columns;
        let last = self.tail.len() - 1;
        for (i, (layer, bias)) in self.tail.iter().zip(&self.biases).enumerate() {
            let (done, next) = tape.values.split_at_mut(i + 1);
            let x = (&done[i][range.clone()], columns);
            let addend = Addend::Bias(&bias.data);
            if i == last {
                let out = Output::Wide(&mut wide[..n * columns]);
                product(self.isa, layer.forward(), x, n, addend, Function::Identity, out);
            } else {
                let slope = match tape.slopes.get_mut(i + 1) {
                    Some(slope) => &mut slope[range.clone()],
                    None => &mut [],
                };
                let value = &mut next[0][range.clone()];
                activate(self.isa, layer.forward(), x, n, addend, self.function, wide, value, slope);
            }
        }
        let keep = (&mut tape.normed[range], &mut tape.scale[rows.clone()]);
        layer_norm_keep(self.isa, &self.norm.norm, wide, n, out, keep);
    }

    /// From dL/d output of some rows in `work.wide` to dL/d (what the first layer's activation is applied to), there and
    /// in `work.narrow`.
    pub fn backward(
        &self,
        tape: &MlpTape<T>,
        rows: &Range<usize>,
        work: &mut Work<T>,
        gradients: &mut Gradients,
    ) {
        let (n, columns) = (rows.len(), self.columns);
        let range = rows.start * columns..rows.end * columns;
        let Work { wide, narrow, pairs } = work;
        let [gain, shift] = self.norm.slots();
        let last = self.tail.len() - 1;
        let sums = gradients.three([gain, shift, self.biases[last].slot]);
        let kept = (&tape.normed[range.clone()], &tape.scale[rows.clone()]);
        norm_backward(self.isa, &self.norm.norm, kept, n, wide, narrow, sums);
        for i in (0..=last).rev() {
            let layer = &self.tail[i];
            let value = &tape.values[i][range.clone()];
            layer.learn((narrow, columns), (value, columns), n, gradients, pairs);
            layer.back((narrow, columns), n, wide);
            let kept = match tape.slopes.get(i) {
                Some(slope) => Kept::Slope(&slope[range.clone()]),
                None => Kept::Value(value),
            };
            let bias = match i {
                0 => self.first_bias.slot,
                i => self.biases[i - 1].slot,
            };
            activation_backward(self.isa, kept, (n, columns), wide, narrow, gradients.block(bias));
        }
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        self.tail.iter().map(|l| l.bytes()).sum()
    }
}
