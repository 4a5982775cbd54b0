//! The macro stage (eq. 9 to 13) in fp32, forward with what is kept, and backward.

use super::attention::{AttentionWork, add};
use super::encoder_decoder::EncoderTape;
use super::graph::Members;
use super::mlp::Work;
use super::recurrence::RecurrenceTape;
use crate::encoder_decoder::Encoder;
use crate::kernels::{Buffer, Isa, Normed, Number, padded};
use crate::perceptron::{Perceptron, PerceptronTape};
use crate::recurrence::Recurrence;
use crate::tiles::{blocks, numbers};
use crate::transformer::{Heads, Scratch, TransformerLayer, TransformerTape};
use crate::weights::{Gradients, Weights};
use m4gn_base::Result;
use m4gn_model::{MacroSpec, ModelSpec};

/// Weights of the macro stage.
pub struct Stage {
    isa: Isa,
    columns: usize,
    d: usize,
    of: MacroSpec,
    /// In place of means.
    recurrence: Option<Recurrence>,
    encoder: Encoder<f32>,
    position: Option<Perceptron>,
    layers: Vec<TransformerLayer>,
}

/// What the macro stage keeps.
pub struct StageTape {
    recurrence: RecurrenceTape,
    /// Its features are the means.
    encoder: EncoderTape<f32>,
    position: PerceptronTape,
    layers: Vec<TransformerTape>,
    scratch: Scratch,
    heads: Heads,
    /// h_S
    pub latents: Buffer<f32>,
    work: AttentionWork,
}

impl Stage {
    /// The macro stage of a model.
    pub fn new(weights: &mut Weights, spec: &ModelSpec, of: &MacroSpec) -> Result<Self> {
        let a = &spec.architecture;
        let n = spec.n_position_features();
        let position = match n {
            0 => None,
            _ => Some(Perceptron::new(weights, "segment.position", n, a)?),
        };
        Ok(Stage {
            isa: weights.isa,
            columns: padded(a.width),
            d: a.width,
            of: of.clone(),
            recurrence: match a.needs().sequences {
                true => Some(Recurrence::new(weights, a.width)?),
                false => None,
            },
            encoder: Encoder::new(weights, "segment.encoder", a.width, a)?,
            position,
            layers: (0..of.layers)
                .map(|l| TransformerLayer::new(weights, a, of, l))
                .collect::<Result<_>>()?,
        })
    }

    /// Nothing kept yet.
    pub fn tape(&self) -> StageTape {
        StageTape {
            recurrence: RecurrenceTape::default(),
            encoder: EncoderTape::new(&self.encoder),
            position: PerceptronTape::default(),
            layers: self.layers.iter().map(|l| l.tape(self.of.heads)).collect(),
            scratch: Scratch::new(f32::ROWS, self.d, &self.of),
            heads: self.heads(0),
            latents: Buffer::default(),
            work: AttentionWork::default(),
        }
    }

    fn heads(&self, k: usize) -> Heads {
        Heads::new(self.isa, k, self.d, self.of.heads)
    }

    /// From node latents to h_S in the tape.
    pub fn forward(&self, members: &Members, tape: &mut StageTape, work: &mut Work<f32>, nodes: &[f32]) {
        let (columns, k) = (self.columns, members.count);
        tape.latents.fit(k * columns);
        tape.encoder.fit(k, &self.encoder);
        let means = &mut tape.encoder.features;
        match &self.recurrence {
            Some(unit) => unit.forward(&members.together, &mut tape.recurrence, nodes, means),
            None => average(members, columns, nodes, means),
        }
        for rows in blocks::<f32>(k) {
            let out = Normed::Wide(&mut tape.latents[numbers(&rows, columns)]);
            self.encoder.forward(&mut tape.encoder, &rows, &mut work.wide, out);
        }
        if let Some(position) = &self.position {
            position.forward(&members.position, &mut tape.position, &mut work.wide, &mut tape.latents);
        }
        if tape.heads.k() != k {
            tape.heads = self.heads(k);
        }
        let latents = &mut tape.latents[..k * columns];
        for (layer, kept) in self.layers.iter().zip(&mut tape.layers) {
            layer.keep(&mut tape.scratch, &mut tape.heads, kept, latents);
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
            self.encoder.rest.backward(&tape.encoder.rest, &rows, work, gradients);
            let dy = (&work.narrow[..], columns);
            let x = (&tape.encoder.features[range.clone()], columns);
            self.encoder.first.learn(dy, x, n, gradients, &mut work.pairs);
            self.encoder.first.back(dy, n, &mut d[range]);
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
