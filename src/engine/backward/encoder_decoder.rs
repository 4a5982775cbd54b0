//! The two ends of the network, forward with what is kept, and backward. What sees physical fields is in fp32 in
//! either precision, as in the engine.

use super::graph::{Members, TrainGraph};
use super::layer::Shared;
use super::mlp::{Mlp, MlpTape, Work, activate, activate_wide, fit, function};
use super::weights::{Dense, Gradients, Slots, Vector};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Kept, Normed, Number, Output, activation_backward, add_means, narrow,
    padded, product, silu_keep,
};
use crate::tiles::{block, blocks};
use m4gn_base::Result;
use m4gn_model::{Architecture, ModelSpec};
use std::ops::Range;

/// A perceptron on features, with a layer norm at the end (eq. 1).
#[derive(Debug)]
pub struct Encoder<T> {
    isa: Isa,
    first: Dense<f32>,
    rest: Mlp<T>,
    /// Features, padded.
    pub stride: usize,
}

/// What an encoder keeps.
#[derive(Debug)]
pub struct EncoderTape<T> {
    /// Normalised features.
    pub features: Buffer<f32>,
    rest: MlpTape<T>,
}

impl<T: Number> EncoderTape<T> {
    /// Empty.
    pub fn new(encoder: &Encoder<T>) -> Self {
        EncoderTape { features: Buffer::new(0), rest: MlpTape::new(&encoder.rest) }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, encoder: &Encoder<T>) {
        fit(&mut self.features, rows * encoder.stride);
        self.rest.fit(rows, encoder.rest.columns);
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.features.bytes() + self.rest.bytes()
    }
}

impl<T: Number> Encoder<T> {
    /// Perceptron `name`.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, a: &Architecture) -> Result<Self> {
        let features = slots.layout().find(&format!("{name}.0.weight"))?.1[1];
        Ok(Encoder {
            isa,
            first: Dense::whole(isa, slots, &format!("{name}.0"))?,
            rest: Mlp::new(isa, slots, name, a)?,
            stride: padded(features),
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.first.load(flat);
        self.rest.load(flat);
    }

    /// Latents of some rows of the tape's features.
    pub fn forward(&self, tape: &mut EncoderTape<T>, rows: &Range<usize>, wide: &mut [f32], out: Normed<T>) {
        let x = (&tape.features[rows.start * self.stride..], self.stride);
        let bias = Addend::Bias(&self.rest.first_bias.data);
        let (value, slope) = tape.rest.first(rows, self.rest.columns);
        let (weight, f) = (self.first.forward(), self.rest.function());
        activate_wide(self.isa, weight, x, rows.len(), bias, f, wide, value, slope);
        self.rest.forward(&mut tape.rest, rows, wide, out);
    }

    /// From dL/d latents of some rows in `shared.work.wide`; those by the features go to `d_features`, rows of the
    /// padded number, where asked for.
    pub fn backward(
        &self,
        tape: &EncoderTape<T>,
        rows: &Range<usize>,
        work: &mut Work<T>,
        fp32: &mut Work<f32>,
        gradients: &mut Gradients,
        d_features: Option<&mut [f32]>,
    ) {
        self.rest.backward(&tape.rest, rows, work, gradients);
        let n = rows.len();
        let dy = (&work.wide[..], self.rest.columns);
        let x = (&tape.features[rows.start * self.stride..], self.stride);
        self.first.learn(dy, x, n, gradients, &mut fp32.pairs);
        if let Some(d) = d_features {
            self.first.back(dy, n, d);
        }
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        self.first.bytes() + self.rest.bytes()
    }
}

/// The decoder on [h, h_S] (section 3.4.3), to normalised outputs.
#[derive(Debug)]
pub struct Decoder<T> {
    isa: Isa,
    columns: usize,
    n_outputs: usize,
    function: Function,
    first: Dense<T>,
    /// Of h_S in the first layer.
    pub segment: Option<Dense<f32>>,
    inner: Vec<Dense<T>>,
    last: Dense<f32>,
    /// Of all layers.
    biases: Vec<Vector>,
}

/// What the decoder keeps, a row a cell.
#[derive(Debug)]
pub struct DecoderTape<T> {
    latents: Buffer<T>,
    values: Vec<Buffer<T>>,
    slopes: Vec<Buffer<T>>,
    /// The last layer's input, and its derivative where the value does not tell it.
    last: [Buffer<f32>; 2],
}

impl<T: Number> DecoderTape<T> {
    /// Empty.
    pub fn new(decoder: &Decoder<T>) -> Self {
        let empty = || decoder.inner.iter().map(|_| Buffer::new(0)).collect();
        DecoderTape {
            latents: Buffer::new(0),
            values: empty(),
            slopes: empty(),
            last: [Buffer::new(0), Buffer::new(0)],
        }
    }

    /// Room for this many cells.
    pub fn fit(&mut self, cells: usize, columns: usize) {
        let all = self.values.iter_mut().chain(&mut self.slopes);
        all.chain([&mut self.latents]).for_each(|b| fit(b, cells * columns));
        self.last.iter_mut().for_each(|b| fit(b, cells * columns));
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        let rows = self.values.iter().chain(&self.slopes).map(|b| b.bytes());
        rows.sum::<usize>() + self.latents.bytes() + self.last[0].bytes() + self.last[1].bytes()
    }
}

impl<T: Number> Decoder<T> {
    /// The decoder of a model.
    pub fn new(isa: Isa, slots: &mut Slots, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        let (d, h) = (a.width, a.hidden_layers);
        let name = |i: usize| format!("decoder.{i}");
        Ok(Decoder {
            isa,
            columns: padded(d),
            n_outputs: spec.n_outputs(),
            function: function(a),
            first: Dense::columns(isa, slots, &name(0), 0, d)?,
            segment: match a.decodes_segments() {
                true => Some(Dense::columns(isa, slots, &name(0), d, d)?),
                false => None,
            },
            inner: (1..h).map(|i| Dense::whole(isa, slots, &name(i))).collect::<Result<_>>()?,
            last: Dense::whole(isa, slots, &name(h))?,
            biases: (0..=h)
                .map(|i| Vector::new(slots, &format!("decoder.{i}.bias")))
                .collect::<Result<_>>()?,
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.first.load(flat);
        self.segment.iter_mut().for_each(|s| s.load(flat));
        self.inner.iter_mut().for_each(|l| l.load(flat));
        self.last.load(flat);
        self.biases.iter_mut().for_each(|b| b.load(flat));
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        let segment = self.segment.as_ref().map_or(0, |s| s.bytes());
        self.first.bytes() + segment + self.last.bytes() + self.inner.iter().map(|l| l.bytes()).sum::<usize>()
    }

    /// `[cells x outputs]` in the graph's order; `table` is what h_S contributes to the first layer, a row a segment.
    pub fn forward(
        &self,
        graph: &TrainGraph,
        tape: &mut DecoderTape<T>,
        s: &mut Shared<T>,
        fp32: &mut Work<f32>,
        (nodes, table): (&[f32], &[f32]),
        outputs: &mut [f32],
    ) {
        let (isa, columns, m) = (self.isa, self.columns, self.n_outputs);
        let silu = self.function == Function::Silu;
        for rows in blocks::<T>(graph.cells.len()) {
            let n = rows.len();
            let range = rows.start * columns..rows.end * columns;
            for (i, &(place, _)) in graph.cells[rows.clone()].iter().enumerate() {
                let place = place as usize;
                let to = &mut tape.latents[(rows.start + i) * columns..][..columns];
                narrow(isa, &nodes[place * columns..(place + 1) * columns], to);
                let sum = &mut fp32.wide[i * columns..(i + 1) * columns];
                sum.copy_from_slice(&self.biases[0].data);
                if let Some(members) = graph.members.as_ref().filter(|_| self.segment.is_some()) {
                    let row = &members.row[place..=place + 1];
                    add_means(isa, sum, columns, table, row, &members.member);
                }
            }
            let all = std::iter::once(&self.first).chain(&self.inner);
            for (i, layer) in all.enumerate() {
                let (done, next) = tape.values.split_at_mut(i);
                let x = match done.last() {
                    Some(x) => (&x[range.clone()], columns),
                    None => (&tape.latents[range.clone()], columns),
                };
                let addend = match i {
                    0 => Addend::Rows(&fp32.wide[..]),
                    i => Addend::Bias(&self.biases[i].data),
                };
                let wide = &mut s.work.wide[..n * columns];
                if let Some(value) = next.first_mut() {
                    let slope = &mut tape.slopes[i][range.clone()];
                    let value = &mut value[range.clone()];
                    activate(isa, layer.forward(), x, n, addend, self.function, wide, value, slope);
                } else {
                    let [last, slope] = &mut tape.last;
                    let out = &mut last[range.clone()];
                    if silu {
                        product(
                            isa,
                            layer.forward(),
                            x,
                            n,
                            addend,
                            Function::Identity,
                            Output::Wide(&mut *wide),
                        );
                        silu_keep(isa, wide, out, &mut slope[range.clone()]);
                    } else {
                        product(isa, layer.forward(), x, n, addend, self.function, Output::Wide(out));
                    }
                }
            }
            let bias = Addend::Bias(&self.biases[self.biases.len() - 1].data);
            let (weight, x) = (self.last.forward(), (&tape.last[0][range], columns));
            let out = Output::Wide(&mut fp32.wide[..]);
            product(isa, weight, x, n, bias, Function::Identity, out);
            let stride = weight.columns();
            for (i, &(_, cell)) in graph.cells[rows].iter().enumerate() {
                let to = &mut outputs[cell as usize * m..(cell as usize + 1) * m];
                to.copy_from_slice(&fp32.wide[i * stride..i * stride + m]);
            }
        }
    }

    /// From dL/d outputs; what falls on nodes and on the table is added there.
    #[allow(clippy::too_many_arguments)]
    pub fn backward(
        &self,
        graph: &TrainGraph,
        tape: &DecoderTape<T>,
        s: &mut Shared<T>,
        fp32: &mut Work<f32>,
        d_outputs: &[f32],
        (d_nodes, d_table): (&mut [f32], &mut [f32]),
        gradients: &mut Gradients,
    ) {
        let (isa, columns, m) = (self.isa, self.columns, self.n_outputs);
        let silu = self.function == Function::Silu;
        for i in 0..blocks::<T>(graph.cells.len()).len() {
            let rows = block::<T>(i, graph.cells.len());
            let n = rows.len();
            let range = rows.start * columns..rows.end * columns;
            let stride = self.last.forward().columns();
            let bias = gradients.block(self.biases[self.biases.len() - 1].slot);
            fp32.narrow[..n * stride].fill(0.0);
            for (i, &(_, cell)) in graph.cells[rows.clone()].iter().enumerate() {
                let from = &d_outputs[cell as usize * m..(cell as usize + 1) * m];
                fp32.narrow[i * stride..i * stride + m].copy_from_slice(from);
                bias.iter_mut().zip(from).for_each(|(sum, d)| *sum += d);
            }
            let Work { wide, narrow: dy, pairs } = &mut *fp32;
            let x = (&tape.last[0][range.clone()], columns);
            self.last.learn((dy, stride), x, n, gradients, pairs);
            self.last.back((dy, stride), n, wide);
            let kept = match silu {
                true => Kept::Slope(&tape.last[1][range.clone()]),
                false => Kept::Value(&tape.last[0][range.clone()]),
            };
            let bias = gradients.block(self.biases[self.inner.len()].slot);
            activation_backward(isa, kept, (n, columns), wide, dy, bias);
            let Work { wide, narrow: dz, pairs } = &mut s.work;
            wide[..n * columns].copy_from_slice(&fp32.wide[..n * columns]);
            narrow(isa, &fp32.wide[..n * columns], &mut dz[..n * columns]);
            for (i, layer) in self.inner.iter().enumerate().rev() {
                let value = &tape.values[i][range.clone()];
                layer.learn((dz, columns), (value, columns), n, gradients, pairs);
                layer.back((dz, columns), n, wide);
                let kept = match silu {
                    true => Kept::Slope(&tape.slopes[i][range.clone()]),
                    false => Kept::Value(value),
                };
                let bias = gradients.block(self.biases[i].slot);
                activation_backward(isa, kept, (n, columns), wide, dz, bias);
            }
            let x = (&tape.latents[range], columns);
            self.first.learn((dz, columns), x, n, gradients, pairs);
            let cells = &graph.cells[rows];
            if let Some(members) = graph.members.as_ref().filter(|_| self.segment.is_some()) {
                for (&(place, _), d) in cells.iter().zip(wide.chunks_exact(columns)) {
                    members.spread_mean(place as usize, d, d_table);
                }
            }
            self.first.back((dz, columns), n, wide);
            for (&(place, _), d) in cells.iter().zip(wide.chunks_exact(columns)) {
                let to = &mut d_nodes[place as usize * columns..(place as usize + 1) * columns];
                to.iter_mut().zip(d).for_each(|(to, d)| *to += d);
            }
        }
    }
}

impl Members {
    /// The derivative of the mean over a place's segments.
    pub fn spread_mean(&self, place: usize, d: &[f32], table: &mut [f32]) {
        let own = &self.member[self.row[place] as usize..self.row[place + 1] as usize];
        let share = 1.0 / own.len() as f32;
        for &s in own {
            let to = &mut table[s as usize * d.len()..(s as usize + 1) * d.len()];
            to.iter_mut().zip(d).for_each(|(to, d)| *to += share * d);
        }
    }
}
