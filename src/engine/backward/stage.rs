//! The macro stage (eq. 9 to 13) in fp32, forward with what is kept, and backward.

use super::attention::{Attention, AttentionTape, AttentionWork, add};
use super::graph::Members;
use super::mlp::{Mlp, MlpTape, Work, fit, numbers};
use super::perceptron::{Perceptron, PerceptronTape};
use super::recurrence::{Recurrence, RecurrenceTape};
use super::weights::{Dense, Gradients, Slots};
use crate::kernels::{Addend, Buffer, Isa, Normed, padded};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::{MacroSpec, ModelSpec};

/// Weights of the macro stage.
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

    /// Nothing kept yet.
    pub fn tape(&self) -> StageTape {
        StageTape {
            recurrence: RecurrenceTape::default(),
            means: Buffer::default(),
            encoder: MlpTape::new(&self.encoder),
            position: PerceptronTape::default(),
            layers: self.layers.iter().map(Attention::tape).collect(),
            latents: Buffer::default(),
            work: AttentionWork::default(),
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
            let weight = &self.first.forward;
            tape.encoder.first().fill(self.isa, weight, x, &rows, bias, &mut work.wide);
            let out = Normed::Wide(&mut tape.latents[numbers(&rows, columns)]);
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
        for rows in blocks::<f32>(k) {
            let (n, range) = (rows.len(), numbers(&rows, columns));
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
