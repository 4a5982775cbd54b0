//! The macro stage (eq. 9 to 13) in fp32, forward with what is kept, and backward.

use super::attention::{AttentionWork, add};
use super::encoder_decoder::EncoderTape;
use super::graph::Segments;
use super::mlp::Work;
use super::recurrence::RecurrenceTape;
use crate::kernels::{Buffer, Normed, Number};
use crate::members::Members;
use crate::perceptron::PerceptronTape;
use crate::segment_stage::Stage;
use crate::tiles::{blocks, numbers};
use crate::transformer::{Heads, Scratch, TransformerTape};
use crate::weights::Gradients;

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

impl StageTape {
    /// Nothing kept yet.
    pub fn new(stage: &Stage) -> Self {
        StageTape {
            recurrence: RecurrenceTape::default(),
            encoder: EncoderTape::new(&stage.encoder),
            position: PerceptronTape::default(),
            layers: stage.layers.iter().map(|l| l.tape(stage.of.heads)).collect(),
            scratch: stage.scratch(f32::ROWS),
            heads: stage.heads(0),
            latents: Buffer::default(),
            work: AttentionWork::default(),
        }
    }
}

impl Stage {
    /// From node latents to h_S in the tape.
    pub fn forward(&self, of: &Segments, tape: &mut StageTape, work: &mut Work<f32>, nodes: &[f32]) {
        let (columns, members) = (self.columns, &of.members);
        let k = members.count;
        tape.latents.fit(k * columns);
        tape.encoder.fit(k, &self.encoder);
        let means = &mut tape.encoder.features;
        match &self.recurrence {
            Some(unit) => unit.forward(&of.together, &mut tape.recurrence, nodes, means),
            None => average(members, columns, nodes, means),
        }
        for rows in blocks::<f32>(k) {
            let out = Normed::Wide(&mut tape.latents[numbers(&rows, columns)]);
            self.encoder.forward(&mut tape.encoder, &rows, &mut work.wide, out);
        }
        if let Some(position) = &self.position {
            position.forward(&of.position, &mut tape.position, &mut work.wide, &mut tape.latents);
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
        of: &Segments,
        tape: &mut StageTape,
        work: &mut Work<f32>,
        d: &mut [f32],
        d_nodes: &mut [f32],
        gradients: &mut Gradients,
    ) {
        let (columns, members) = (self.columns, &of.members);
        let k = members.count;
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
            return unit.backward(&of.together, &mut tape.recurrence, work, d, d_nodes, gradients);
        }
        for s in 0..k {
            let mean = &mut d[s * columns..(s + 1) * columns];
            mean.iter_mut().for_each(|m| *m *= members.inverse_sizes[s] as f32);
            for &p in members.places(s) {
                add(&mut d_nodes[p as usize * columns..(p as usize + 1) * columns], mean);
            }
        }
    }
}

/// The means over the segments' nodes.
fn average(members: &Members, columns: usize, nodes: &[f32], means: &mut [f32]) {
    for (s, mean) in means.chunks_exact_mut(columns).take(members.count).enumerate() {
        mean.fill(0.0);
        for &p in members.places(s) {
            add(mean, &nodes[p as usize * columns..(p as usize + 1) * columns]);
        }
        mean.iter_mut().for_each(|m| *m *= members.inverse_sizes[s] as f32);
    }
}
