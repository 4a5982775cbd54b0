//! A perceptron in fp32 without a norm: its derivative.

use super::attention::add_rows;
use super::mlp::Work;
use crate::kernels::activation_backward;
use crate::perceptron::{Perceptron, PerceptronTape};
use crate::tiles::numbers;
use crate::weights::Gradients;
use std::ops::Range;

impl Perceptron {
    /// From derivatives by the outputs of some rows.
    pub fn backward(
        &self,
        tape: &PerceptronTape,
        rows: &Range<usize>,
        work: &mut Work<f32>,
        d: &[f32],
        gradients: &mut Gradients,
    ) {
        let (n, [columns, mut stride]) = (rows.len(), self.columns);
        let d = &d[..n * stride];
        work.narrow[..d.len()].copy_from_slice(d);
        add_rows(d, stride, gradients.block(self.layers[self.layers.len() - 1].bias.slot));
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let width = self.width(i);
            let range = numbers(rows, width);
            let Work { wide, narrow, pairs } = &mut *work;
            let x = (&tape.before(i)[range.clone()], width);
            layer.weight.learn((&*narrow, stride), x, n, gradients, pairs);
            if let Some(before) = i.checked_sub(1) {
                layer.weight.back((&*narrow, stride), n, wide);
                let bias = gradients.block(self.layers[before].bias.slot);
                let kept = tape.values[before].saved(range);
                activation_backward(self.isa, kept, (n, columns), wide, narrow, bias);
                stride = columns;
            }
        }
    }
}
