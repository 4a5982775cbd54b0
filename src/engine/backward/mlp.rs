//! A perceptron behind the product of its first layer: its forward pass with what is kept, and its backward pass.

use super::weights::{Gradients, Linear, NormWeights, Slots, Vector};
use crate::kernels::{
    Addend, Bf16, Buffer, Function, Isa, Kept, Normed, Number, Output, Packed, Pairs, activation_backward,
    layer_norm_keep, narrow, norm_backward, padded, product, silu_keep,
};
use m4gn_base::Result;
use m4gn_model::Architecture;
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
pub struct Mlp<T> {
    isa: Isa,
    /// Columns of the latents, padded.
    pub columns: usize,
    /// Bias of the first layer.
    pub first_bias: Vector,
    tail: Vec<Linear<T>>,
    norm: NormWeights,
    function: Function,
}

/// What a perceptron keeps, a row each.
pub struct MlpTape<T> {
    values: Vec<Activated<T>>,
    normed: Buffer<T>,
    scale: Buffer<f32>,
}

/// One thread's buffers.
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
}

/// What an activation leaves, a row each: its values, and its derivative where the values do not tell it.
pub struct Activated<T> {
    pub value: Buffer<T>,
    slope: Option<Buffer<T>>,
}

impl<T: Number> Activated<T> {
    pub fn new(function: Function) -> Self {
        Activated { value: Buffer::default(), slope: (function == Function::Silu).then(Buffer::default) }
    }

    /// Room for so many numbers.
    pub fn fit(&mut self, len: usize) {
        fit(&mut self.value, len);
        self.slope.iter_mut().for_each(|s| fit(s, len));
    }

    pub fn bytes(&self) -> usize {
        self.value.bytes() + self.slope.as_ref().map_or(0, |s| s.bytes())
    }

    /// `f(x W + addend)` to these rows.
    pub fn fill(
        &mut self,
        isa: Isa,
        weight: &Packed<T>,
        x: (&[T], usize),
        rows: &Range<usize>,
        addend: Addend<T>,
        wide: &mut [f32],
    ) {
        if self.slope.is_some() {
            return self.fill_from(isa, weight, x, rows, addend, wide);
        }
        let out = Output::Narrow(&mut self.value[numbers(rows, weight.columns())]);
        product(isa, weight, x, rows.len(), addend, Function::Relu, out);
    }

    /// The same from a layer in another precision.
    pub fn fill_from<U: Number>(
        &mut self,
        isa: Isa,
        weight: &Packed<U>,
        x: (&[U], usize),
        rows: &Range<usize>,
        addend: Addend<U>,
        wide: &mut [f32],
    ) {
        let range = numbers(rows, weight.columns());
        let wide = &mut wide[..range.len()];
        let f = if self.slope.is_some() { Function::Identity } else { Function::Relu };
        product(isa, weight, x, rows.len(), addend, f, Output::Wide(wide));
        let value = &mut self.value[range.clone()];
        match &mut self.slope {
            Some(slope) => silu_keep(isa, wide, value, &mut slope[range]),
            None => narrow(isa, wide, value),
        }
    }

    /// As [`activation_backward`] reads these numbers.
    pub fn kept(&self, range: Range<usize>) -> Kept<'_, T> {
        match &self.slope {
            Some(slope) => Kept::Slope(&slope[range]),
            None => Kept::Value(&self.value[range]),
        }
    }
}

/// Where rows of so many columns stand.
pub fn numbers(rows: &Range<usize>, columns: usize) -> Range<usize> {
    rows.start * columns..rows.end * columns
}

impl<T: Number> MlpTape<T> {
    pub fn new<U>(mlp: &Mlp<U>) -> Self {
        MlpTape {
            values: mlp.tail.iter().map(|_| Activated::new(mlp.function)).collect(),
            normed: Buffer::default(),
            scale: Buffer::default(),
        }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, columns: usize) {
        self.values.iter_mut().for_each(|v| v.fit(rows * columns));
        fit(&mut self.normed, rows * columns);
        fit(&mut self.scale, rows);
    }

    /// Of the first layer.
    pub fn first(&mut self) -> &mut Activated<T> {
        &mut self.values[0]
    }

    pub fn bytes(&self) -> usize {
        self.values.iter().map(|v| v.bytes()).sum::<usize>() + self.normed.bytes() + self.scale.bytes()
    }
}

impl<T: Number> Mlp<T> {
    /// Layers 1 to h of perceptron `name`, whose latents all have width d, the first layer's bias and the norm.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, architecture: &Architecture) -> Result<Self> {
        let layer = |i: usize| Linear::new(isa, slots, &format!("{name}.{i}"));
        Ok(Mlp {
            isa,
            columns: padded(architecture.width),
            tail: (1..=architecture.hidden_layers).map(layer).collect::<Result<_>>()?,
            first_bias: Vector::new(slots, &format!("{name}.0.bias"))?,
            norm: NormWeights::new(slots, &format!("{name}.norm"))?,
            function: architecture.activation.into(),
        })
    }

    /// From the first layer's activations in the tape to the normed output.
    pub fn forward(&self, tape: &mut MlpTape<T>, rows: &Range<usize>, wide: &mut [f32], out: Normed<T>) {
        let (n, range) = (rows.len(), numbers(rows, self.columns));
        for (i, layer) in self.tail.iter().enumerate() {
            let (done, next) = tape.values.split_at_mut(i + 1);
            let (weight, x) = (&layer.weight.forward, (&done[i].value[range.clone()], self.columns));
            match next.first_mut() {
                Some(next) => next.fill(self.isa, weight, x, rows, layer.bias(), wide),
                None => {
                    let out = Output::Wide(&mut wide[..range.len()]);
                    product(self.isa, weight, x, n, layer.bias(), Function::Identity, out);
                }
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
        let range = numbers(rows, self.columns);
        let [gain, shift] = self.norm.slots;
        let bias = self.tail.last().map_or(&self.first_bias, |layer| &layer.bias).slot;
        let kept = (&tape.normed[range], &tape.scale[rows.clone()]);
        let sums = gradients.three([gain, shift, bias]);
        norm_backward(self.isa, &self.norm.norm, kept, rows.len(), &mut work.wide, &mut work.narrow, sums);
        let layers = (&self.tail[..], &tape.values[..]);
        layers_backward(self.isa, layers, &self.first_bias, (rows, self.columns), work, gradients);
    }
}

/// From dL/d (what layers of so many columns each give) of some rows, in `wide` and `narrow`, to dL/d (what the activation before the
/// first of them is applied to). `first_bias` is that of the layer before.
pub fn layers_backward<T: Number>(
    isa: Isa,
    (layers, values): (&[Linear<T>], &[Activated<T>]),
    first_bias: &Vector,
    (rows, columns): (&Range<usize>, usize),
    Work { wide, narrow, pairs }: &mut Work<T>,
    gradients: &mut Gradients,
) {
    let (n, range) = (rows.len(), numbers(rows, columns));
    for (i, (layer, value)) in layers.iter().zip(values).enumerate().rev() {
        layer.weight.learn((narrow, columns), (&value.value[range.clone()], columns), n, gradients, pairs);
        layer.weight.back((narrow, columns), n, wide);
        let bias = i.checked_sub(1).map_or(first_bias, |i| &layers[i].bias);
        let sum = gradients.block(bias.slot);
        activation_backward(isa, value.kept(range.clone()), (n, columns), wide, narrow, sum);
    }
}
