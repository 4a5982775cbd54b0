//! The macro stage (eq. 9 to 13) in fp32, forward with what is kept, and backward.

use super::attention::{Attention, AttentionTape, AttentionWork, add, add_rows};
use super::graph::Members;
use super::mlp::{Mlp, MlpTape, Work, activate, fit, function};
use super::recurrence::{Recurrence, RecurrenceTape};
use super::weights::{Dense, Gradients, Slots, Vector};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Kept, Normed, Output, activation_backward, padded, product,
};
use crate::tiles::{block, blocks};
use m4gn_mesh::Result;
use m4gn_model::{MacroSpec, ModelSpec};

/// Weights of the macro stage.
#[derive(Debug)]
pub struct Stage {
    isa: Isa,
    columns: usize,
    /// In place of means.
    recurrence: Option<Recurrence>,
    first: Dense<f32>,
    encoder: Mlp<f32>,
    position: Option<Position>,
    layers: Vec<Attention>,
}

/// The perceptron of the positional encoding, which has no norm.
#[derive(Debug)]
struct Position {
    /// Features.
    n: usize,
    layers: Vec<Dense<f32>>,
    biases: Vec<Vector>,
    function: Function,
}

/// What the macro stage keeps.
#[derive(Debug)]
pub struct StageTape {
    recurrence: RecurrenceTape,
    means: Buffer<f32>,
    encoder: MlpTape<f32>,
    /// Features of the positional encoding, then the values of each layer.
    position: Vec<Buffer<f32>>,
    slopes: Vec<Buffer<f32>>,
    layers: Vec<AttentionTape>,
    /// h_S
    pub latents: Buffer<f32>,
    work: AttentionWork,
}

impl Stage {
    /// The macro stage of a model.
    pub fn new(isa: Isa, slots: &mut Slots, spec: &ModelSpec, of: &MacroSpec) -> Result<Self> {
        let a = &spec.architecture;
        let n = spec.n_position_features();
        let name = |i: usize| format!("segment.position.{i}");
        let position = match n {
            0 => None,
            _ => Some(Position {
                n,
                layers: (0..=a.hidden_layers)
                    .map(|i| Dense::whole(isa, slots, &name(i)))
                    .collect::<Result<_>>()?,
                biases: (0..=a.hidden_layers)
                    .map(|i| Vector::new(slots, &format!("{}.bias", name(i))))
                    .collect::<Result<_>>()?,
                function: function(a),
            }),
        };
        Ok(Stage {
            isa,
            columns: padded(a.width),
            recurrence: match a.needs().sequences {
                true => Some(Recurrence::new(isa, slots, a.width)?),
                false => None,
            },
            first: Dense::whole(isa, slots, "segment.encoder.0")?,
            encoder: Mlp::new(isa, slots, "segment.encoder", a)?,
            position,
            layers: (0..of.layers).map(|l| Attention::new(isa, slots, a, of, l)).collect::<Result<_>>()?,
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.recurrence.iter_mut().for_each(|r| r.load(flat));
        self.first.load(flat);
        self.encoder.load(flat);
        if let Some(position) = &mut self.position {
            position.layers.iter_mut().for_each(|l| l.load(flat));
            position.biases.iter_mut().for_each(|b| b.load(flat));
        }
        self.layers.iter_mut().for_each(|l| l.load(flat));
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        let position = self.position.iter().flat_map(|p| &p.layers);
        self.recurrence.as_ref().map_or(0, |r| r.bytes())
            + self.first.bytes()
            + self.encoder.bytes()
            + position.map(|l| l.bytes()).sum::<usize>()
            + self.layers.iter().map(|l| l.bytes()).sum::<usize>()
    }

    /// Nothing kept yet.
    pub fn tape(&self, heads: usize) -> StageTape {
        let empty = |n: usize| (0..n).map(|_| Buffer::new(0)).collect();
        let n = self.position.as_ref().map_or(0, |p| p.layers.len());
        StageTape {
            recurrence: RecurrenceTape::new(),
            means: Buffer::new(0),
            encoder: MlpTape::new(&self.encoder),
            position: empty(n),
            slopes: empty(n),
            layers: self.layers.iter().map(|_| AttentionTape::new(heads)).collect(),
            latents: Buffer::new(0),
            work: AttentionWork::new(),
        }
    }

    /// From node latents to h_S in the tape.
    pub fn forward(&self, members: &Members, tape: &mut StageTape, work: &mut Work<f32>, nodes: &[f32]) {
        let (columns, k) = (self.columns, members.count);
        fit(&mut tape.means, k * columns);
        fit(&mut tape.latents, k * columns);
        tape.encoder.fit(k, columns);
        match &self.recurrence {
            Some(unit) => unit.forward(&members.together, &mut tape.recurrence, nodes, &mut tape.means),
            None => average(members, columns, nodes, &mut tape.means),
        }
        for rows in blocks::<f32>(k) {
            let x = (&tape.means[rows.start * columns..], columns);
            let bias = Addend::Bias(&self.encoder.first_bias.data);
            let (value, slope) = tape.encoder.first(&rows, columns);
            let (weight, f) = (self.first.forward(), self.encoder.function());
            activate(self.isa, weight, x, rows.len(), bias, f, &mut work.wide, value, slope);
            let out = Normed::Wide(&mut tape.latents[rows.start * columns..rows.end * columns]);
            self.encoder.forward(&mut tape.encoder, &rows, &mut work.wide, out);
        }
        if let Some(position) = &self.position {
            self.encode_positions(position, members, tape, work);
        }
        let latents = &mut tape.latents[..k * columns];
        for (layer, kept) in self.layers.iter().zip(&mut tape.layers) {
            layer.forward(kept, &mut tape.work, work, latents);
        }
    }

    fn encode_positions(
        &self,
        position: &Position,
        members: &Members,
        tape: &mut StageTape,
        work: &mut Work<f32>,
    ) {
        let (isa, columns, k) = (self.isa, self.columns, members.count);
        let stride = padded(position.n);
        fit(&mut tape.position[0], k * stride);
        let features = members.position.chunks_exact(position.n);
        for (to, from) in tape.position[0].chunks_exact_mut(stride).zip(features) {
            to[..position.n].copy_from_slice(from);
        }
        for buffer in tape.position.iter_mut().skip(1).chain(&mut tape.slopes) {
            fit(buffer, k * columns);
        }
        let last = position.layers.len() - 1;
        for rows in blocks::<f32>(k) {
            let n = rows.len();
            for (i, layer) in position.layers.iter().enumerate() {
                let width = if i == 0 { stride } else { columns };
                let (done, next) = tape.position.split_at_mut(i + 1);
                let x = (&done[i][rows.start * width..rows.end * width], width);
                let bias = Addend::Bias(&position.biases[i].data);
                let range = rows.start * columns..rows.end * columns;
                if i < last {
                    let (value, slope) = (&mut next[0][range.clone()], &mut tape.slopes[i + 1][range]);
                    let weight = layer.forward();
                    activate(isa, weight, x, n, bias, position.function, &mut work.wide, value, slope);
                } else {
                    let out = Output::Wide(&mut work.wide[..]);
                    product(isa, layer.forward(), x, n, bias, Function::Identity, out);
                    add(&mut tape.latents[range], &work.wide);
                }
            }
        }
    }

    /// From dL/d h_S in `d`, `[K x columns]`, which is spoilt; what falls on the nodes is added there.
    pub fn backward(
        &self,
        members: &Members,
        tape: &mut StageTape,
        work: &mut Work<f32>,
        d: &mut [f32],
        d_nodes: &mut [f32],
        gradients: &mut Gradients,
    ) {
        let (columns, k) = (self.columns, members.count);
        for (layer, kept) in self.layers.iter().zip(&tape.layers).rev() {
            layer.backward(kept, &mut tape.work, work, d, gradients);
        }
        for i in 0..blocks::<f32>(k).len() {
            let rows = block::<f32>(i, k);
            let (n, range) = (rows.len(), rows.start * columns..rows.end * columns);
            if let Some(position) = &self.position {
                self.positions_backward(position, tape, i, k, work, &d[range.clone()], gradients);
            }
            work.wide[..n * columns].copy_from_slice(&d[range.clone()]);
            self.encoder.backward(&tape.encoder, &rows, work, gradients);
            let dy = (&work.narrow[..], columns);
            let x = (&tape.means[range.clone()], columns);
            self.first.learn(dy, x, n, gradients, &mut work.pairs);
            self.first.back(dy, n, &mut d[range]);
        }
        if let Some(unit) = &self.recurrence {
            return unit.backward(&members.together, &mut tape.recurrence, work, d, d_nodes, gradients);
        }
        for s in 0..k {
            let mean = &mut d[s * columns..(s + 1) * columns];
            mean.iter_mut().for_each(|m| *m *= members.inverse_sizes[s]);
            for &p in &members.place[members.place_row[s] as usize..members.place_row[s + 1] as usize] {
                add(&mut d_nodes[p as usize * columns..(p as usize + 1) * columns], mean);
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn positions_backward(
        &self,
        position: &Position,
        tape: &StageTape,
        i: usize,
        k: usize,
        work: &mut Work<f32>,
        d: &[f32],
        gradients: &mut Gradients,
    ) {
        let (isa, columns, stride) = (self.isa, self.columns, padded(position.n));
        let rows = block::<f32>(i, k);
        let n = rows.len();
        work.narrow[..d.len()].copy_from_slice(d);
        let last = position.layers.len() - 1;
        add_rows(d, columns, gradients.block(position.biases[last].slot));
        for (i, layer) in position.layers.iter().enumerate().rev() {
            let width = if i == 0 { stride } else { columns };
            let range = rows.start * width..rows.end * width;
            let x = &tape.position[i][range.clone()];
            let Work { wide, narrow, pairs } = &mut *work;
            layer.learn((&*narrow, columns), (x, width), n, gradients, pairs);
            if i > 0 {
                layer.back((&*narrow, columns), n, wide);
                let kept = match position.function {
                    Function::Silu => Kept::Slope(&tape.slopes[i][range]),
                    _ => Kept::Value(x),
                };
                let bias = gradients.block(position.biases[i - 1].slot);
                activation_backward(isa, kept, (n, columns), wide, narrow, bias);
            }
        }
    }
}

/// The means over the segments' nodes.
fn average(members: &Members, columns: usize, nodes: &[f32], means: &mut [f32]) {
    for (s, mean) in means.chunks_exact_mut(columns).take(members.count).enumerate() {
        mean.fill(0.0);
        for &p in &members.place[members.place_row[s] as usize..members.place_row[s + 1] as usize] {
            add(mean, &nodes[p as usize * columns..(p as usize + 1) * columns]);
        }
        mean.iter_mut().for_each(|m| *m *= members.inverse_sizes[s]);
    }
}
