//! The macro stage (eq. 9 to 13) in fp32, forward with what is kept, and backward.

use super::attention::{Attention, AttentionTape, AttentionWork, add};
use super::graph::Members;
use super::mlp::{Mlp, MlpTape, Work, activate, fit};
use super::perceptron::{Perceptron, PerceptronTape};
use super::recurrence::{Recurrence, RecurrenceTape};
use super::weights::{Dense, Gradients, Slots};
use crate::kernels::{Addend, Buffer, Isa, Normed, padded};
use crate::tiles::{block, blocks};
use m4gn_base::Result;
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
    position: Option<Perceptron>,
    layers: Vec<Attention>,
}

/// What the macro stage keeps.
#[derive(Debug)]
pub struct StageTape {
    recurrence: RecurrenceTape,
    means: Buffer<f32>,
    encoder: MlpTape<f32>,
    position: PerceptronTape,
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
        let position = match n {
            0 => None,
            _ => Some(Perceptron::new(isa, slots, "segment.position", n, a)?),
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
        self.position.iter_mut().for_each(|p| p.load(flat));
        self.layers.iter_mut().for_each(|l| l.load(flat));
    }

    /// Bytes of the weights.
    pub fn bytes(&self) -> usize {
        self.recurrence.as_ref().map_or(0, |r| r.bytes())
            + self.first.bytes()
            + self.encoder.bytes()
            + self.position.as_ref().map_or(0, |p| p.bytes())
            + self.layers.iter().map(|l| l.bytes()).sum::<usize>()
    }

    /// Nothing kept yet.
    pub fn tape(&self, heads: usize) -> StageTape {
        StageTape {
            recurrence: RecurrenceTape::new(),
            means: Buffer::new(0),
            encoder: MlpTape::new(&self.encoder),
            position: PerceptronTape::default(),
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
            position.forward(&members.position, &mut tape.position, work, &mut tape.latents);
        }
        let latents = &mut tape.latents[..k * columns];
        for (layer, kept) in self.layers.iter().zip(&mut tape.layers) {
            layer.forward(kept, &mut tape.work, work, latents);
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
                position.backward(&tape.position, &rows, work, &d[range.clone()], gradients);
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
