//! The segment transformer (eq. 11 to 13) on all segments of a graph, in fp32: its derivative.

use super::mlp::Work;
use crate::kernels::{Buffer, activation_backward, multiply_add, norm_backward, padded, softmax_backward};
use crate::tiles::{blocks, numbers};
use crate::transformer::{Normal, TransformerLayer, TransformerTape};
use crate::weights::{Gradients, NormWeights};

/// Buffers for derivatives of all segments.
#[derive(Default)]
pub struct AttentionWork {
    d_projections: [Buffer<f32>; 3],
    d_mixed: Buffer<f32>,
    scores: Buffer<f32>,
    transposed: Buffer<f32>,
}

impl TransformerLayer {
    /// From derivatives by the rows behind the layer to those before it, in place.
    pub fn backward(
        &self,
        tape: &TransformerTape,
        w: &mut AttentionWork,
        work: &mut Work<f32>,
        d: &mut [f32],
        gradients: &mut Gradients,
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let k = d.len() / columns;
        let wide = self.first.weight.forward.columns();
        for rows in blocks::<f32>(k) {
            let (n, range) = (rows.len(), numbers(&rows, columns));
            add_rows(&d[range.clone()], columns, gradients.block(self.second.bias.slot));
            let dy = (&d[range.clone()], columns);
            let inner = numbers(&rows, wide);
            self.second.weight.learn(
                dy,
                (&tape.hidden.value[inner.clone()], wide),
                n,
                gradients,
                &mut work.pairs,
            );
            self.second.weight.back(dy, n, &mut work.wide);
            let bias = gradients.block(self.first.bias.slot);
            let kept = tape.hidden.saved(inner);
            activation_backward(isa, kept, (n, wide), &mut work.wide, &mut work.narrow, bias);
            let from = (&tape.norm2.out[range.clone()], columns);
            self.first.weight.learn((&work.narrow, wide), from, n, gradients, &mut work.pairs);
            let Work { wide: out, narrow, .. } = &mut *work;
            self.first.weight.back((&*narrow, wide), n, out);
            self.through_norm((&self.norm2, &tape.norm2), rows.start, n, work, gradients);
            add(&mut d[range], &work.wide);
        }
        w.d_mixed.fit(k * columns);
        w.scores.fit(k * padded(k));
        w.transposed.fit(columns.max(k) * padded(k).max(columns));
        w.d_projections.iter_mut().for_each(|p| p.fit(k * columns));
        for rows in blocks::<f32>(k) {
            let (n, range) = (rows.len(), numbers(&rows, columns));
            add_rows(&d[range.clone()], columns, gradients.block(self.output.bias.slot));
            let dy = (&d[range.clone()], columns);
            let from = (&tape.mixed[range.clone()], columns);
            self.output.weight.learn(dy, from, n, gradients, &mut work.pairs);
            self.output.weight.back(dy, n, &mut w.d_mixed[range]);
        }
        self.through_attention(tape, w, k);
        for rows in blocks::<f32>(k) {
            let (n, range) = (rows.len(), numbers(&rows, columns));
            let from = (&tape.norm1.out[range.clone()], columns);
            work.wide[..n * columns].fill(0.0);
            for (projection, dy) in self.projections.iter().zip(&w.d_projections) {
                let dy = (&dy[range.clone()], columns);
                projection.learn(dy, from, n, gradients, &mut work.pairs);
                work.narrow[..n * columns].copy_from_slice(&work.wide[..n * columns]);
                projection.back(dy, n, &mut work.wide);
                let Work { wide, narrow, .. } = &mut *work;
                add(&mut wide[..n * columns], narrow);
            }
            self.through_norm((&self.norm1, &tape.norm1), rows.start, n, work, gradients);
            add(&mut d[range], &work.wide);
        }
    }

    /// In place in `work.wide`.
    fn through_norm(
        &self,
        (norm, tape): (&NormWeights, &Normal),
        first: usize,
        n: usize,
        work: &mut Work<f32>,
        gradients: &mut Gradients,
    ) {
        let [gain, shift] = norm.slots;
        let sums = gradients.three([gain, shift, self.no_bias.slot]);
        let kept = (&tape.normed[first * self.columns..], &tape.scale[first..]);
        norm_backward(self.isa, &norm.norm, kept, n, &mut work.wide, &mut work.narrow, sums);
    }

    /// From derivatives by what the heads mixed to those by queries, keys and values.
    fn through_attention(&self, tape: &TransformerTape, w: &mut AttentionWork, k: usize) {
        let (isa, columns, stride) = (self.isa, self.columns, padded(k));
        let [q, key, value] = &tape.projections;
        let [dq, dk, dv] = &mut w.d_projections;
        for d in [&mut *dq, &mut *dk, &mut *dv] {
            d[..k * columns].fill(0.0);
        }
        let (d_mixed, scores, turned) = (&w.d_mixed, &mut w.scores, &mut w.transposed);
        for (h, p) in tape.attention.iter().enumerate() {
            let (at, d) = (h * self.width, self.width);
            // dV = P^T dY
            transpose(p, (k, 0, k), (stride, stride), turned);
            let dy = (&d_mixed[at..], columns);
            multiply_add(isa, (k, k, d), 1.0, (turned, stride), dy, (&mut dv[at..], columns));
            // dP = dY V^T
            let s = &mut scores[..k * stride];
            s.fill(0.0);
            transpose(value, (k, at, d), (columns, stride), turned);
            multiply_add(isa, (k, d, k), 1.0, dy, (turned, stride), (s, stride));
            softmax_backward(isa, &p[..k * stride], s, (k, stride));
            let scale = self.scale();
            multiply_add(isa, (k, k, d), scale, (s, stride), (&key[at..], columns), (&mut dq[at..], columns));
            transpose(s, (k, 0, k), (stride, stride), turned);
            multiply_add(
                isa,
                (k, k, d),
                scale,
                (turned, stride),
                (&q[at..], columns),
                (&mut dk[at..], columns),
            );
        }
    }
}

/// Columns `at..at + d` of k rows as rows.
fn transpose(x: &[f32], (k, at, d): (usize, usize, usize), (stride, to): (usize, usize), out: &mut [f32]) {
    for i in 0..k {
        for c in 0..d {
            out[c * to + i] = x[i * stride + at + c];
        }
    }
}

/// `x += y`
pub fn add(x: &mut [f32], y: &[f32]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}

/// Sums of rows.
pub fn add_rows(x: &[f32], columns: usize, sums: &mut [f32]) {
    x.chunks_exact(columns).for_each(|row| add(sums, row));
}
