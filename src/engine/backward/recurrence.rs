//! The gated recurrent unit over the nodes of each segment, backward.

use super::attention::{add, add_rows};
use super::mlp::Work;
use crate::kernels::Buffer;
use crate::recurrence::{ReadStates, Recurrence, Together};
use crate::weights::Gradients;

/// What it keeps, for each group of segments, and derivatives by the sums of the gates.
#[derive(Default)]
pub struct RecurrenceTape {
    kept: Vec<ReadStates>,
    d_input: Buffer<f32>,
    d_hidden: Buffer<f32>,
    d_state: Buffer<f32>,
    back: Buffer<f32>,
}

impl Recurrence {
    /// The last state of each segment to its row of `out`.
    pub fn forward(&self, parts: &[Together], tape: &mut RecurrenceTape, nodes: &[f32], out: &mut [f32]) {
        let columns = self.columns;
        tape.kept.resize_with(tape.kept.len().max(parts.len()), ReadStates::default);
        for (part, kept) in parts.iter().zip(&mut tape.kept) {
            self.read(part, kept, nodes);
            for (&s, state) in part.segments.iter().zip(kept.state.chunks_exact(columns)) {
                out[s as usize * columns..(s as usize + 1) * columns].copy_from_slice(state);
            }
        }
    }

    /// From derivatives by the last states, rows of `d`; what falls on the nodes is added there.
    pub fn backward(
        &self,
        parts: &[Together],
        tape: &mut RecurrenceTape,
        work: &mut Work<f32>,
        d: &[f32],
        d_nodes: &mut [f32],
        gradients: &mut Gradients,
    ) {
        let (width, columns, stride) = (self.d, self.columns, self.stride());
        for (part, kept) in parts.iter().zip(&tape.kept) {
            let (rows, count) = (part.node.len(), part.segments.len());
            tape.d_input.fit(rows * stride);
            tape.d_hidden.fit(rows * stride);
            tape.back.fit(rows * columns);
            tape.d_state.fit(count * columns);
            for (to, &s) in tape.d_state.chunks_exact_mut(columns).zip(&part.segments) {
                to.copy_from_slice(&d[s as usize * columns..(s as usize + 1) * columns]);
            }
            for step in part.steps.iter().rev() {
                let (n, wide) = (step.len(), step.start * stride..step.end * stride);
                let states = tape.d_state.chunks_exact_mut(columns).take(n);
                let before = kept.before[step.start * columns..].chunks_exact(columns);
                let gates = kept.gates[wide.clone()].chunks_exact(stride);
                let hidden = kept.hidden[wide.clone()].chunks_exact(stride);
                let d_input = tape.d_input[wide.clone()].chunks_exact_mut(stride);
                let d_hidden = tape.d_hidden[wide.clone()].chunks_exact_mut(stride);
                let kept = before.zip(gates).zip(hidden);
                for ((dh, ((before, gates), hidden)), (d_input, d_hidden)) in
                    states.zip(kept).zip(d_input.zip(d_hidden))
                {
                    for (i, (dh, before)) in dh.iter_mut().zip(before).enumerate().take(width) {
                        let (r, z, new) = (gates[i], gates[width + i], gates[2 * width + i]);
                        let d_new = *dh * (1.0 - z) * (1.0 - new * new);
                        let d_update = *dh * (before - new) * z * (1.0 - z);
                        let d_reset = d_new * hidden[2 * width + i] * r * (1.0 - r);
                        for (row, last) in [(&mut *d_input, d_new), (&mut *d_hidden, d_new * r)] {
                            (row[i], row[width + i], row[2 * width + i]) = (d_reset, d_update, last);
                        }
                        *dh *= z;
                    }
                }
                let back = &mut tape.back[..n * columns];
                self.hidden.weight.back((&tape.d_hidden[wide], stride), n, back);
                add(&mut tape.d_state[..n * columns], back);
            }
            for (linear, dy, x) in
                [(&self.input, &tape.d_input, &kept.x), (&self.hidden, &tape.d_hidden, &kept.before)]
            {
                let dy = &dy[..rows * stride];
                linear.weight.learn((dy, stride), (x, columns), rows, gradients, &mut work.pairs);
                add_rows(dy, stride, gradients.block(linear.bias.slot));
            }
            self.input.weight.back((&tape.d_input, stride), rows, &mut tape.back);
            for (&node, d) in part.node.iter().zip(tape.back.chunks_exact(columns)) {
                add(&mut d_nodes[node as usize * columns..(node as usize + 1) * columns], d);
            }
        }
    }
}
