//! A perceptron behind the product of its first layer: its derivative.

use crate::activations::Activated;
use crate::kernels::{Bf16, Buffer, Isa, Number, Pairs, activation_backward, norm_backward};
use crate::mlp::{Mlp, MlpTape};
use crate::tiles::numbers;
use crate::weights::{Gradients, Linear, Vector};
use std::ops::Range;

/// Most rows that are worked on at a time.
pub const ROWS: usize = Bf16::ROWS;

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

impl<T: Number> Mlp<T> {
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
        activation_backward(isa, value.saved(range.clone()), (n, columns), wide, narrow, sum);
    }
}
