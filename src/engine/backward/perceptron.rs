//! A perceptron in fp32 without a norm, on features that do not change with time: the positional encodings (section 3.4.1).

use super::attention::{add, add_rows};
use super::mlp::{Activated, Work, fit, numbers};
use super::weights::{Gradients, Linear, Slots};
use crate::kernels::{Buffer, Function, Isa, Output, activation_backward, padded, product};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::Architecture;
use std::ops::Range;

/// Its weights.
pub struct Perceptron {
    isa: Isa,
    /// Features.
    n: usize,
    /// Columns of the rows behind the hidden layers, and of the outputs, padded.
    columns: [usize; 2],
    layers: Vec<Linear<f32>>,
    function: Function,
}

/// Features, then the values of each layer.
#[derive(Default)]
pub struct PerceptronTape {
    features: Buffer<f32>,
    values: Vec<Activated<f32>>,
}

impl PerceptronTape {
    pub fn bytes(&self) -> usize {
        self.features.bytes() + self.values.iter().map(|v| v.bytes()).sum::<usize>()
    }

    /// What layer i reads.
    fn before(&self, i: usize) -> &[f32] {
        i.checked_sub(1).map_or(&self.features, |i| &self.values[i].value)
    }
}

impl Perceptron {
    /// Perceptron `name`, of n features.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, n: usize, a: &Architecture) -> Result<Self> {
        let name = |i: usize| format!("{name}.{i}");
        let outputs = slots.layout.find(&format!("{}.weight", name(a.hidden_layers)))?.1[0];
        Ok(Perceptron {
            isa,
            n,
            columns: [padded(a.width), padded(outputs)],
            layers: (0..=a.hidden_layers)
                .map(|i| Linear::new(isa, slots, &name(i)))
                .collect::<Result<_>>()?,
            function: a.activation.into(),
        })
    }

    /// Columns of what layer i reads.
    fn width(&self, i: usize) -> usize {
        if i == 0 { padded(self.n) } else { self.columns[0] }
    }

    /// Adds the outputs of rows of features to rows of the padded number of outputs.
    pub fn forward(&self, features: &[f32], tape: &mut PerceptronTape, work: &mut Work<f32>, to: &mut [f32]) {
        let (isa, last) = (self.isa, self.layers.len() - 1);
        let count = features.len() / self.n;
        fit(&mut tape.features, count * self.width(0));
        tape.values.resize_with(last, || Activated::new(self.function));
        tape.values.iter_mut().for_each(|v| v.fit(count * self.columns[0]));
        let rows = tape.features.chunks_exact_mut(self.width(0)).zip(features.chunks_exact(self.n));
        rows.for_each(|(to, from)| to[..self.n].copy_from_slice(from));
        for rows in blocks::<f32>(count) {
            for (i, layer) in self.layers.iter().enumerate() {
                let width = self.width(i);
                let (done, next) = tape.values.split_at_mut(i);
                let from = done.last().map_or(&tape.features, |v| &v.value);
                let (weight, x) = (&layer.weight.forward, (&from[numbers(&rows, width)], width));
                match next.first_mut() {
                    Some(next) => next.fill(isa, weight, x, &rows, layer.bias(), &mut work.wide),
                    None => {
                        let out = Output::Wide(&mut work.wide[..]);
                        product(isa, weight, x, rows.len(), layer.bias(), Function::Identity, out);
                        add(&mut to[numbers(&rows, self.columns[1])], &work.wide);
                    }
                }
            }
        }
    }

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
                let kept = tape.values[before].kept(range);
                activation_backward(self.isa, kept, (n, columns), wide, narrow, bias);
                stride = columns;
            }
        }
    }
}
