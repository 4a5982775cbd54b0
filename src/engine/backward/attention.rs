//! The segment transformer (eq. 11 to 13) on all segments of a graph, in fp32, forward with what is kept, and backward.

use super::mlp::{Activated, Work, fit, numbers};
use super::weights::{Dense, Gradients, Linear, NormWeights, Slots, Vector};
use crate::kernels::{
    Addend, Buffer, Function, Isa, Normed, Output, activation_backward, layer_norm_keep, multiply_add,
    norm_backward, padded, product, softmax, softmax_backward,
};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::{Architecture, MacroSpec};

/// One layer: attention and a point-wise network, each behind a layer norm and beside a residual.
pub struct Attention {
    isa: Isa,
    columns: usize,
    heads: usize,
    /// Numbers of a head.
    width: usize,
    norm1: NormWeights,
    /// Queries, keys, values.
    projections: [Dense<f32>; 3],
    output: Linear<f32>,
    norm2: NormWeights,
    first: Linear<f32>,
    second: Linear<f32>,
    function: Function,
    /// For the sums of norms, which end in a bias where a perceptron stands before them: nobody reads it.
    no_bias: Vector,
}

/// A layer norm's output and what its derivative needs.
#[derive(Default)]
struct Normal {
    out: Buffer<f32>,
    normed: Buffer<f32>,
    scale: Buffer<f32>,
}

/// What a layer keeps.
pub struct AttentionTape {
    norm1: Normal,
    /// Queries, keys, values.
    projections: [Buffer<f32>; 3],
    /// Attention of each head `[k x padded k]`.
    attention: Vec<Buffer<f32>>,
    mixed: Buffer<f32>,
    norm2: Normal,
    hidden: Activated<f32>,
}

/// Buffers for derivatives of all segments.
#[derive(Default)]
pub struct AttentionWork {
    d_projections: [Buffer<f32>; 3],
    d_mixed: Buffer<f32>,
    scores: Buffer<f32>,
    transposed: Buffer<f32>,
}

impl Normal {
    fn fit(&mut self, k: usize, columns: usize) {
        fit(&mut self.out, k * columns);
        fit(&mut self.normed, k * columns);
        fit(&mut self.scale, k);
    }
}

impl Attention {
    /// Layer `l` of the segment transformer.
    pub fn new(isa: Isa, slots: &mut Slots, a: &Architecture, spec: &MacroSpec, l: usize) -> Result<Self> {
        let name = |part: &str| format!("segment.transformer.{l}.{part}");
        let mut dense = |part: &str| Dense::whole(isa, slots, &name(part));
        let projections = [dense("q")?, dense("k")?, dense("v")?];
        let mut linear = |part: &str| Linear::new(isa, slots, &name(part));
        let (output, first, second) = (linear("o")?, linear("ffn.0")?, linear("ffn.1")?);
        Ok(Attention {
            isa,
            columns: padded(a.width),
            heads: spec.heads,
            width: a.width / spec.heads,
            norm1: NormWeights::new(slots, &name("norm1"))?,
            projections,
            output,
            norm2: NormWeights::new(slots, &name("norm2"))?,
            first,
            second,
            function: a.activation.into(),
            no_bias: Vector::unread(slots, a.width),
        })
    }

    /// Nothing kept yet.
    pub fn tape(&self) -> AttentionTape {
        AttentionTape {
            norm1: Normal::default(),
            projections: Default::default(),
            attention: (0..self.heads).map(|_| Buffer::default()).collect(),
            mixed: Buffer::default(),
            norm2: Normal::default(),
            hidden: Activated::new(self.function),
        }
    }

    /// Advances k rows in place.
    pub fn forward(
        &self,
        tape: &mut AttentionTape,
        w: &mut AttentionWork,
        work: &mut Work<f32>,
        x: &mut [f32],
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let k = x.len() / columns;
        let wide = self.first.weight.forward.columns();
        let stride = padded(k);
        tape.norm1.fit(k, columns);
        tape.norm2.fit(k, columns);
        tape.projections.iter_mut().for_each(|p| fit(p, k * columns));
        tape.attention.iter_mut().for_each(|p| fit(p, k * stride));
        fit(&mut tape.mixed, k * columns);
        tape.hidden.fit(k * wide);
        fit(&mut w.transposed, columns * stride);
        self.normalise(&self.norm1, &mut tape.norm1, x);
        for (projection, out) in self.projections.iter().zip(&mut tape.projections) {
            let from = (&tape.norm1.out[..], columns);
            let out = Output::Wide(&mut out[..]);
            product(isa, &projection.forward, from, k, Addend::Nothing, Function::Identity, out);
        }
        let [q, key, value] = &tape.projections;
        tape.mixed[..k * columns].fill(0.0);
        for (h, attention) in tape.attention.iter_mut().enumerate() {
            let (at, d) = (h * self.width, self.width);
            let p = &mut attention[..k * stride];
            p.fill(0.0);
            transpose(key, (k, at, d), (columns, stride), &mut w.transposed);
            multiply_add(isa, (k, d, k), 1.0, (&q[at..], columns), (&w.transposed, stride), (p, stride));
            softmax(isa, p, stride, k, self.scale());
            let out = (&mut tape.mixed[at..], columns);
            multiply_add(isa, (k, k, d), 1.0, (p, stride), (&value[at..], columns), out);
        }
        let (output, second) = (&self.output, &self.second);
        let bias = Addend::Output(&output.bias.data);
        let from = (&tape.mixed[..], columns);
        product(isa, &output.weight.forward, from, k, bias, Function::Identity, Output::Wide(x));
        self.normalise(&self.norm2, &mut tape.norm2, x);
        for rows in blocks::<f32>(k) {
            let from = (&tape.norm2.out[rows.start * columns..], columns);
            let weight = &self.first.weight.forward;
            tape.hidden.fill(isa, weight, from, &rows, self.first.bias(), &mut work.wide);
        }
        let bias = Addend::Output(&second.bias.data);
        let from = (&tape.hidden.value[..], wide);
        product(isa, &second.weight.forward, from, k, bias, Function::Identity, Output::Wide(x));
    }

    fn scale(&self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }

    fn normalise(&self, norm: &NormWeights, tape: &mut Normal, x: &[f32]) {
        let n = x.len() / self.columns;
        let out = Normed::<f32>::Wide(&mut tape.out[..]);
        let keep = (&mut tape.normed[..], &mut tape.scale[..]);
        layer_norm_keep(self.isa, &norm.norm, x, n, out, keep);
    }

    /// From derivatives by the rows behind the layer to those before it, in place.
    pub fn backward(
        &self,
        tape: &AttentionTape,
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
            let kept = tape.hidden.kept(inner);
            activation_backward(isa, kept, (n, wide), &mut work.wide, &mut work.narrow, bias);
            let from = (&tape.norm2.out[range.clone()], columns);
            self.first.weight.learn((&work.narrow, wide), from, n, gradients, &mut work.pairs);
            let Work { wide: out, narrow, .. } = &mut *work;
            self.first.weight.back((&*narrow, wide), n, out);
            self.through_norm((&self.norm2, &tape.norm2), rows.start, n, work, gradients);
            add(&mut d[range], &work.wide);
        }
        fit(&mut w.d_mixed, k * columns);
        fit(&mut w.scores, k * padded(k));
        fit(&mut w.transposed, columns.max(k) * padded(k).max(columns));
        w.d_projections.iter_mut().for_each(|p| fit(p, k * columns));
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
    fn through_attention(&self, tape: &AttentionTape, w: &mut AttentionWork, k: usize) {
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
