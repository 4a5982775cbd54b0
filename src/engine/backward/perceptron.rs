//! A perceptron in fp32 without a norm, on features that do not change with time: the positional encodings (section 3.4.1).

use super::attention::{add, add_rows};
use super::mlp::{Work, activate, fit, function};
use super::weights::{Dense, Gradients, Slots, Vector};
use crate::kernels::{Addend, Buffer, Function, Isa, Kept, Output, activation_backward, padded, product};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::Architecture;
use std::ops::Range;

/// Its weights.
#[derive(Debug)]
pub struct Perceptron {
    isa: Isa,
    /// Features.
    n: usize,
    /// Columns of the rows behind the hidden layers, and of the outputs, padded.
    columns: [usize; 2],
    layers: Vec<Dense<f32>>,
    biases: Vec<Vector>,
    function: Function,
}

/// Features, then the values of each layer, and slopes of these.
#[derive(Debug, Default)]
pub struct PerceptronTape {
    values: Vec<Buffer<f32>>,
    slopes: Vec<Buffer<f32>>,
}

impl PerceptronTape {
    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.values.iter().chain(&self.slopes).map(|b| b.bytes()).sum()
    }
}

impl Perceptron {
    /// Perceptron `name`, of n features.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, n: usize, a: &Architecture) -> Result<Self> {
        let name = |i: usize| format!("{name}.{i}");
        let outputs = slots.layout().find(&format!("{}.weight", name(a.hidden_layers)))?.1[0];
        let all = 0..=a.hidden_layers;
        Ok(Perceptron {
            isa,
            n,
            columns: [padded(a.width), padded(outputs)],
            layers: all.clone().map(|i| Dense::whole(isa, slots, &name(i))).collect::<Result<_>>()?,
            biases: all.map(|i| Vector::new(slots, &format!("{}.bias", name(i)))).collect::<Result<_>>()?,
            function: function(a),
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.layers.iter_mut().for_each(|l| l.load(flat));
        self.biases.iter_mut().for_each(|b| b.load(flat));
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        self.layers.iter().map(|l| l.bytes()).sum()
    }

    /// Columns of what layer i reads.
    fn width(&self, i: usize) -> usize {
        if i == 0 { padded(self.n) } else { self.columns[0] }
    }

    /// Adds the outputs of rows of features to rows of the padded number of outputs.
    pub fn forward(&self, features: &[f32], tape: &mut PerceptronTape, work: &mut Work<f32>, to: &mut [f32]) {
        let (isa, last) = (self.isa, self.layers.len() - 1);
        let count = features.len() / self.n;
        for buffers in [&mut tape.values, &mut tape.slopes] {
            buffers.resize_with(self.layers.len(), || Buffer::new(0));
            buffers.iter_mut().enumerate().for_each(|(i, b)| fit(b, count * self.width(i)));
        }
        let rows = tape.values[0].chunks_exact_mut(self.width(0)).zip(features.chunks_exact(self.n));
        rows.for_each(|(to, from)| to[..self.n].copy_from_slice(from));
        for rows in blocks::<f32>(count) {
            let n = rows.len();
            for (i, layer) in self.layers.iter().enumerate() {
                let width = self.width(i);
                let (done, next) = tape.values.split_at_mut(i + 1);
                let x = (&done[i][rows.start * width..rows.end * width], width);
                let bias = Addend::Bias(&self.biases[i].data);
                if i < last {
                    let range = rows.start * self.columns[0]..rows.end * self.columns[0];
                    let (value, slope) = (&mut next[0][range.clone()], &mut tape.slopes[i + 1][range]);
                    activate(isa, layer.forward(), x, n, bias, self.function, &mut work.wide, value, slope);
                } else {
                    let out = Output::Wide(&mut work.wide[..]);
                    product(isa, layer.forward(), x, n, bias, Function::Identity, out);
                    add(&mut to[rows.start * self.columns[1]..rows.end * self.columns[1]], &work.wide);
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
        add_rows(d, stride, gradients.block(self.biases[self.layers.len() - 1].slot));
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let width = self.width(i);
            let range = rows.start * width..rows.end * width;
            let x = &tape.values[i][range.clone()];
            let Work { wide, narrow, pairs } = &mut *work;
            layer.learn((&*narrow, stride), (x, width), n, gradients, pairs);
            if i > 0 {
                layer.back((&*narrow, stride), n, wide);
                let kept = match self.function {
                    Function::Silu => Kept::Slope(&tape.slopes[i][range]),
                    _ => Kept::Value(x),
                };
                let bias = gradients.block(self.biases[i - 1].slot);
                activation_backward(self.isa, kept, (n, columns), wide, narrow, bias);
                stride = columns;
            }
        }
    }
}
