//! The two ends of the network, with what is kept, and backward. What sees physical fields is in fp32 in either precision,
//! as in the engine.

use super::graph::TrainGraph;
use super::layer::Shared;
use super::mlp::{Work, layers_backward};
use crate::encoder_decoder::{Decoder, DecoderTape, Encoder};
use crate::kernels::{Buffer, Normed, Number, activation_backward, narrow};
use crate::members::Members;
use crate::mlp::MlpTape;
use crate::tiles::{Scratch, blocks, numbers};
use crate::weights::Gradients;
use std::ops::Range;

/// What an encoder keeps.
pub struct EncoderTape<T> {
    /// Normalised features.
    pub features: Buffer<f32>,
    pub rest: MlpTape<T>,
}

impl<T: Number> EncoderTape<T> {
    pub fn new(encoder: &Encoder<T>) -> Self {
        EncoderTape { features: Buffer::default(), rest: MlpTape::new(&encoder.rest) }
    }

    /// Room for this many rows.
    pub fn fit(&mut self, rows: usize, encoder: &Encoder<T>) {
        self.features.fit(rows * encoder.stride);
        self.rest.fit(rows, encoder.rest.columns);
    }
}

impl<T: Number> Encoder<T> {
    /// Latents of some rows of the tape's features.
    pub fn forward(&self, tape: &mut EncoderTape<T>, rows: &Range<usize>, wide: &mut [f32], out: Normed<T>) {
        let x = (&tape.features[rows.start * self.stride..], self.stride);
        let kept = self.rest.rows(Some(&mut tape.rest), rows, Default::default());
        self.run(x, rows.len(), self.bias(), kept, wide, out);
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

impl<T: Number> Decoder<T> {
    /// `[cells x outputs]` in the graph's order; `table` is what h_S contributes to the first layer, a row a segment.
    pub fn forward(
        &self,
        graph: &TrainGraph,
        tape: &mut DecoderTape<T>,
        scratch: &mut Scratch<T>,
        (nodes, table): (&[f32], &[f32]),
        outputs: &mut [f32],
    ) {
        let (m, cells) = (self.n_outputs, &graph.cells);
        let of = graph.segments.as_ref().filter(|_| self.segment.is_some());
        let table = of.map(|of| (table, &of.members));
        for rows in blocks::<T>(cells.len()) {
            let own = &cells[rows.clone()];
            let stride = self.run(nodes, table, own, scratch, Some((tape, rows)));
            for (&(_, cell), y) in own.iter().zip(scratch.raw.chunks_exact(stride)) {
                outputs[cell as usize * m..(cell as usize + 1) * m].copy_from_slice(&y[..m]);
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
            activation_backward(isa, tape.last.saved(range.clone()), (n, columns), wide, dy, sum);
            s.work.wide[..n * columns].copy_from_slice(&fp32.wide[..n * columns]);
            narrow(isa, &fp32.wide[..n * columns], &mut s.work.narrow[..n * columns]);
            let layers = (&self.inner[..], &tape.values[..]);
            layers_backward(isa, layers, &self.first_bias, (&rows, columns), &mut s.work, gradients);
            let Work { wide, narrow: dz, pairs } = &mut s.work;
            let x = (&tape.latents[range], columns);
            self.first.learn((dz, columns), x, n, gradients, pairs);
            let cells = &graph.cells[rows];
            if let Some(of) = graph.segments.as_ref().filter(|_| self.segment.is_some()) {
                for (&(place, _), d) in cells.iter().zip(wide.chunks_exact(columns)) {
                    of.members.spread_mean(place as usize, d, d_table);
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
        let own = self.of(place);
        let share = 1.0 / own.len() as f32;
        for &s in own {
            let to = &mut table[s as usize * d.len()..(s as usize + 1) * d.len()];
            to.iter_mut().zip(d).for_each(|(to, d)| *to += share * d);
        }
    }
}
