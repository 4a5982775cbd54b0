//! The two ends of the network, forward with what is kept, and backward. What sees physical fields is in fp32 in
//! either precision, as in the engine.

use super::graph::{Members, TrainGraph};
use super::layer::Shared;
use super::mlp::{Activated, Mlp, MlpTape, Work, fit, layers_backward, numbers};
use super::weights::{Dense, Gradients, Linear, Slots, Vector};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Normed, Number, Output, activation_backward, add_means, narrow, padded,
    product,
};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::{Architecture, ModelSpec};
use std::ops::Range;

/// A perceptron on features, with a layer norm at the end (eq. 1).
pub struct Encoder<T> {
    isa: Isa,
    first: Dense<f32>,
    rest: Mlp<T>,
    /// Features, padded.
    pub stride: usize,
}

/// What an encoder keeps.
pub struct EncoderTape<T> {
    /// Normalised features.
    pub features: Buffer<f32>,
    rest: MlpTape<T>,
}

impl<T: Number> EncoderTape<T> {
    pub fn new(encoder: &Encoder<T>) -> Self {
        EncoderTape { features: Buffer::default(), rest: MlpTape::new(&encoder.rest) }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, encoder: &Encoder<T>) {
        fit(&mut self.features, rows * encoder.stride);
        self.rest.fit(rows, encoder.rest.columns);
    }

    pub fn bytes(&self) -> usize {
        self.features.bytes() + self.rest.bytes()
    }
}

impl<T: Number> Encoder<T> {
    /// Perceptron `name`.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str, a: &Architecture) -> Result<Self> {
        let features = slots.layout.find(&format!("{name}.0.weight"))?.1[1];
        Ok(Encoder {
            isa,
            first: Dense::whole(isa, slots, &format!("{name}.0"))?,
            rest: Mlp::new(isa, slots, name, a)?,
            stride: padded(features),
        })
    }

    /// Latents of some rows of the tape's features.
    pub fn forward(&self, tape: &mut EncoderTape<T>, rows: &Range<usize>, wide: &mut [f32], out: Normed<T>) {
        let x = (&tape.features[rows.start * self.stride..], self.stride);
        let bias = Addend::Bias(&self.rest.first_bias.data);
        let weight = &self.first.forward;
        tape.rest.first().fill_from(self.isa, weight, x, rows, bias, wide);
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
}

/// The decoder on [h, h_S] (section 3.4.3), to normalised outputs.
pub struct Decoder<T> {
    isa: Isa,
    columns: usize,
    n_outputs: usize,
    function: Function,
    first: Dense<T>,
    first_bias: Vector,
    /// Of h_S in the first layer.
    pub segment: Option<Dense<f32>>,
    inner: Vec<Linear<T>>,
    last: Linear<f32>,
}

/// What the decoder keeps, a row a cell.
pub struct DecoderTape<T> {
    latents: Buffer<T>,
    values: Vec<Activated<T>>,
    /// The last layer's input.
    last: Activated<f32>,
}

impl<T: Number> DecoderTape<T> {
    pub fn new(decoder: &Decoder<T>) -> Self {
        DecoderTape {
            latents: Buffer::default(),
            values: decoder.inner.iter().map(|_| Activated::new(decoder.function)).collect(),
            last: Activated::new(decoder.function),
        }
    }

    /// Room for this many cells.
    pub fn fit(&mut self, cells: usize, columns: usize) {
        fit(&mut self.latents, cells * columns);
        self.values.iter_mut().for_each(|v| v.fit(cells * columns));
        self.last.fit(cells * columns);
    }

    pub fn bytes(&self) -> usize {
        self.latents.bytes() + self.values.iter().map(|v| v.bytes()).sum::<usize>() + self.last.bytes()
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
            function: a.activation.into(),
            first: Dense::columns(isa, slots, &name(0), 0, d)?,
            first_bias: Vector::new(slots, "decoder.0.bias")?,
            segment: match a.decodes_segments() {
                true => Some(Dense::columns(isa, slots, &name(0), d, d)?),
                false => None,
            },
            inner: (1..h).map(|i| Linear::new(isa, slots, &name(i))).collect::<Result<_>>()?,
            last: Linear::new(isa, slots, &name(h))?,
        })
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
        for rows in blocks::<T>(graph.cells.len()) {
            let n = rows.len();
            let range = numbers(&rows, columns);
            for (i, &(place, _)) in graph.cells[rows.clone()].iter().enumerate() {
                let place = place as usize;
                let to = &mut tape.latents[(rows.start + i) * columns..][..columns];
                narrow(isa, &nodes[place * columns..(place + 1) * columns], to);
                let sum = &mut fp32.wide[i * columns..(i + 1) * columns];
                sum.copy_from_slice(&self.first_bias.data);
                if let Some(members) = graph.members.as_ref().filter(|_| self.segment.is_some()) {
                    let row = &members.row[place..=place + 1];
                    add_means(isa, sum, columns, table, row, &members.member);
                }
            }
            let DecoderTape { latents, values, last } = tape;
            let mut x = (&latents[range.clone()], columns);
            let (mut weight, mut addend) = (&self.first.forward, Addend::Rows(&fp32.wide[..]));
            let wide = &mut s.work.wide[..n * columns];
            for (layer, value) in self.inner.iter().zip(values) {
                value.fill(isa, weight, x, &rows, addend, wide);
                x = (&value.value[range.clone()], columns);
                (weight, addend) = (&layer.weight.forward, layer.bias());
            }
            last.fill_from(isa, weight, x, &rows, addend, wide);
            let (weight, x) = (&self.last.weight.forward, (&last.value[range], columns));
            let out = Output::Wide(&mut fp32.wide[..]);
            product(isa, weight, x, n, self.last.bias(), Function::Identity, out);
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
        for rows in blocks::<T>(graph.cells.len()) {
            let (n, range) = (rows.len(), numbers(&rows, columns));
            let last = &self.last.weight;
            let stride = last.forward.columns();
            let bias = gradients.block(self.last.bias.slot);
            fp32.narrow[..n * stride].fill(0.0);
            for (i, &(_, cell)) in graph.cells[rows.clone()].iter().enumerate() {
                let from = &d_outputs[cell as usize * m..(cell as usize + 1) * m];
                fp32.narrow[i * stride..i * stride + m].copy_from_slice(from);
                bias.iter_mut().zip(from).for_each(|(sum, d)| *sum += d);
            }
            let Work { wide, narrow: dy, pairs } = &mut *fp32;
            last.learn((dy, stride), (&tape.last.value[range.clone()], columns), n, gradients, pairs);
            last.back((dy, stride), n, wide);
            let bias = self.inner.last().map_or(&self.first_bias, |layer| &layer.bias);
            let sum = gradients.block(bias.slot);
            activation_backward(isa, tape.last.kept(range.clone()), (n, columns), wide, dy, sum);
            s.work.wide[..n * columns].copy_from_slice(&fp32.wide[..n * columns]);
            narrow(isa, &fp32.wide[..n * columns], &mut s.work.narrow[..n * columns]);
            let layers = (&self.inner[..], &tape.values[..]);
            layers_backward(isa, layers, &self.first_bias, (&rows, columns), &mut s.work, gradients);
            let Work { wide, narrow: dz, pairs } = &mut s.work;
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
