//! A perceptron in fp32 without a norm, on features that do not change with time: the positional encodings (section 3.4.1).

use super::activations::Activated;
use super::kernels::{Buffer, Function, Isa, Number, Output, padded};
use super::tiles::{blocks, numbers};
use super::weights::{Linear, Weights};
use m4gn_base::Result;
use m4gn_model::Architecture;

/// Its weights.
pub struct Perceptron {
    pub isa: Isa,
    /// Features.
    n: usize,
    /// Columns of the rows behind the hidden layers, and of the outputs, padded.
    pub columns: [usize; 2],
    pub layers: Vec<Linear<f32>>,
    function: Function,
}

/// Features, then the values of each layer.
#[derive(Default)]
pub struct PerceptronTape {
    features: Buffer<f32>,
    pub values: Vec<Activated<f32>>,
}

impl PerceptronTape {
    /// What layer i reads.
    pub fn before(&self, i: usize) -> &[f32] {
        i.checked_sub(1).map_or(&self.features, |i| &self.values[i].value)
    }
}

impl Perceptron {
    /// Perceptron `name`, of n features.
    pub fn new(weights: &mut Weights, name: &str, n: usize, a: &Architecture) -> Result<Self> {
        let name = |i: usize| format!("{name}.{i}");
        let outputs = weights.layout.find(&format!("{}.weight", name(a.hidden_layers)))?.1[0];
        Ok(Perceptron {
            isa: weights.isa,
            n,
            columns: [padded(a.width), padded(outputs)],
            layers: (0..=a.hidden_layers).map(|i| Linear::new(weights, &name(i))).collect::<Result<_>>()?,
            function: a.activation.into(),
        })
    }

    /// Columns of what layer i reads.
    pub fn width(&self, i: usize) -> usize {
        if i == 0 { padded(self.n) } else { self.columns[0] }
    }

    /// Adds the outputs of rows of features to rows of the padded number of outputs; `wide` has room for rows.
    pub fn forward(&self, features: &[f32], tape: &mut PerceptronTape, wide: &mut [f32], to: &mut [f32]) {
        let (count, last) = (features.len() / self.n, self.layers.len() - 1);
        tape.features.fit(count * self.width(0));
        tape.values.resize_with(last, || Activated::new(self.function));
        tape.values.iter_mut().for_each(|v| v.fit(count * self.columns[0]));
        let rows = tape.features.chunks_exact_mut(self.width(0)).zip(features.chunks_exact(self.n));
        rows.for_each(|(to, from)| to[..self.n].copy_from_slice(from));
        for rows in blocks::<f32>(count) {
            for (i, layer) in self.layers.iter().enumerate() {
                let (n, width) = (rows.len(), self.width(i));
                let (done, next) = tape.values.split_at_mut(i);
                let from = done.last().map_or(&tape.features, |v| &v.value);
                let x = (&from[numbers(&rows, width)], width);
                match next.first_mut() {
                    Some(next) => {
                        let place = next.place(numbers(&rows, self.columns[0]));
                        place.fill(&layer.weight, x, n, layer.bias(), wide);
                    }
                    None => {
                        layer.run(x, n, Function::Identity, Output::Wide(&mut *wide));
                        let to = to[numbers(&rows, self.columns[1])].iter_mut();
                        to.zip(&*wide).for_each(|(to, y)| *to += y);
                    }
                }
            }
        }
    }

    /// The same where nothing is kept.
    pub fn run(&self, features: &[f32], to: &mut [f32]) {
        let mut wide = vec![0.0; f32::ROWS * self.columns[0].max(self.columns[1])];
        self.forward(features, &mut PerceptronTape::default(), &mut wide, to);
    }
}
