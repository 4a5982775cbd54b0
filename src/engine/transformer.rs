//! The segment transformer (eq. 11 to 13) on K rows of the padded width, in fp32.

use super::activations::{Activated, Place};
use super::kernels::{
    Addend, Buffer, Function, Isa, Normed, Output, Packed, layer_norm, layer_norm_keep, padded, product,
    softmax,
};
use super::pool::{Parts, Pool};
use super::tiles::{block, blocks, numbers};
use super::weights::{Dense, Linear, NormWeights, Vector, Weights};
use m4gn_base::Result;
use m4gn_model::{Architecture, MacroSpec};
use std::ops::Range;

/// One layer: attention and a point-wise network, each behind a layer norm and beside a residual.
pub struct TransformerLayer {
    pub isa: Isa,
    pub columns: usize,
    /// Numbers of a head.
    pub width: usize,
    pub norm1: NormWeights,
    /// Queries, keys, values.
    pub projections: [Dense<f32>; 3],
    pub output: Linear<f32>,
    pub norm2: NormWeights,
    pub first: Linear<f32>,
    pub second: Linear<f32>,
    pub function: Function,
    /// For the derivatives of norms, which end in a bias where a perceptron stands before them: nobody reads it.
    pub no_bias: Vector,
}

/// K^T `[d_h x K]` and V `[K x d_h]` of each head, as products read them.
pub struct Heads {
    k: usize,
    packed: Vec<(Packed<f32>, Packed<f32>)>,
}

/// A thread's buffers, for a block of rows.
pub struct Scratch {
    /// Rows of the padded width, or of that of the point-wise network.
    pub a: Buffer<f32>,
    /// As `a`.
    pub b: Buffer<f32>,
    /// As `a`.
    pub c: Buffer<f32>,
    /// Rows of the padded number of segments.
    scores: Buffer<f32>,
}

/// A layer norm's output and what its derivative needs.
#[derive(Default)]
pub struct Normal {
    pub out: Buffer<f32>,
    pub normed: Buffer<f32>,
    pub scale: Buffer<f32>,
}

/// What a layer keeps for its derivative, a row a segment.
pub struct TransformerTape {
    pub norm1: Normal,
    /// Queries, keys, values.
    pub projections: [Buffer<f32>; 3],
    /// Attention of each head, rows of the padded number of segments.
    pub attention: Vec<Buffer<f32>>,
    pub mixed: Buffer<f32>,
    pub norm2: Normal,
    pub hidden: Activated<f32>,
}

impl Heads {
    /// For k segments of width d.
    pub fn new(isa: Isa, k: usize, d: usize, heads: usize) -> Self {
        let width = d / heads;
        let head = |_| (Packed::zero(isa, width, k), Packed::zero(isa, k, width));
        Heads { k, packed: (0..heads).map(head).collect() }
    }

    /// How many segments they are for.
    pub fn k(&self) -> usize {
        self.k
    }
}

impl Scratch {
    /// For k segments of width d.
    pub fn new(k: usize, d: usize, spec: &MacroSpec) -> Self {
        let rows = block::<f32>(0, k).len();
        let size = rows * padded(d).max(padded(spec.ffn_width));
        Scratch {
            a: Buffer::new(size),
            b: Buffer::new(size),
            c: Buffer::new(size),
            scores: Buffer::new(rows * padded(k)),
        }
    }
}

impl Normal {
    fn fit(&mut self, k: usize, columns: usize) {
        self.out.fit(k * columns);
        self.normed.fit(k * columns);
        self.scale.fit(k);
    }
}

impl TransformerTape {
    /// Room for k segments.
    pub fn fit(&mut self, k: usize, layer: &TransformerLayer) {
        let columns = layer.columns;
        self.norm1.fit(k, columns);
        self.norm2.fit(k, columns);
        self.projections.iter_mut().for_each(|p| p.fit(k * columns));
        self.attention.iter_mut().for_each(|p| p.fit(k * padded(k)));
        self.mixed.fit(k * columns);
        self.hidden.fit(k * layer.first.weight.columns());
    }
}

impl TransformerLayer {
    /// Layer `l` of the segment transformer.
    pub fn new(weights: &mut Weights, a: &Architecture, spec: &MacroSpec, l: usize) -> Result<Self> {
        let name = |part: &str| format!("segment.transformer.{l}.{part}");
        let mut dense = |part: &str| Dense::whole(weights, &name(part));
        let projections = [dense("q")?, dense("k")?, dense("v")?];
        let mut linear = |part: &str| Linear::new(weights, &name(part));
        let (output, first, second) = (linear("o")?, linear("ffn.0")?, linear("ffn.1")?);
        Ok(TransformerLayer {
            isa: weights.isa,
            columns: padded(a.width),
            width: a.width / spec.heads,
            norm1: NormWeights::new(weights, &name("norm1"))?,
            projections,
            output,
            norm2: NormWeights::new(weights, &name("norm2"))?,
            first,
            second,
            function: a.activation.into(),
            no_bias: Vector::unread(weights, a.width),
        })
    }

    /// Nothing kept yet.
    pub fn tape(&self, heads: usize) -> TransformerTape {
        TransformerTape {
            norm1: Normal::default(),
            projections: Default::default(),
            attention: (0..heads).map(|_| Buffer::default()).collect(),
            mixed: Buffer::default(),
            norm2: Normal::default(),
            hidden: Activated::new(self.function),
        }
    }

    /// What scores are multiplied by.
    pub fn scale(&self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }

    /// Advances h_S in place; `projections` have room for rows of all segments.
    pub fn run(
        &self,
        pool: &Pool,
        scratch: &mut [Scratch],
        projections: &mut [Buffer<f32>; 3],
        heads: &mut Heads,
        latents: &mut [f32],
    ) {
        let (columns, k) = (self.columns, heads.k);
        let n_blocks = blocks::<f32>(k).len();
        let parts = projections.each_mut().map(|p| Parts::new(p));
        let project = |s: &mut Scratch, i: usize| {
            let rows = block::<f32>(i, k);
            // SAFETY: blocks are disjoint.
            let out = parts.each_ref().map(|p| unsafe { p.rows(&rows, columns) });
            self.project(s, &latents[numbers(&rows, columns)], &rows, out, None);
        };
        pool.run(scratch, n_blocks, project, || ());

        let n_heads = heads.packed.len();
        let packed = Parts::new(&mut heads.packed);
        let pack = |_: &mut Scratch, h: usize| {
            // SAFETY: task h has head h.
            let head = &mut unsafe { packed.rows(&(h..h + 1), 1) }[0];
            self.pack(h, projections, head);
        };
        pool.run(scratch, n_heads, pack, || ());

        let (heads, queries) = (&*heads, &projections[0][..]);
        let latents = Parts::new(latents);
        let attend = |s: &mut Scratch, i: usize| {
            let rows = block::<f32>(i, k);
            // SAFETY: blocks are disjoint.
            let x = unsafe { latents.rows(&rows, columns) };
            self.attend(s, queries, heads, &rows, x, None);
            self.feed_forward(s, &rows, x, None);
        };
        pool.run(scratch, n_blocks, attend, || ());
    }

    /// The same on the caller's thread, with what is kept.
    pub fn keep(&self, s: &mut Scratch, heads: &mut Heads, tape: &mut TransformerTape, latents: &mut [f32]) {
        let (columns, k) = (self.columns, heads.k);
        tape.fit(k, self);
        for rows in blocks::<f32>(k) {
            let (range, TransformerTape { projections, norm1, .. }) = (numbers(&rows, columns), &mut *tape);
            let out = projections.each_mut().map(|p| &mut p[range.clone()]);
            self.project(s, &latents[range.clone()], &rows, out, Some(norm1));
        }
        for (h, head) in heads.packed.iter_mut().enumerate() {
            self.pack(h, &tape.projections, head);
        }
        for rows in blocks::<f32>(k) {
            let x = &mut latents[numbers(&rows, columns)];
            let TransformerTape { projections, attention, mixed, norm2, hidden, .. } = &mut *tape;
            self.attend(s, &projections[0], heads, &rows, x, Some((attention, mixed)));
            self.feed_forward(s, &rows, x, Some((norm2, hidden)));
        }
    }

    /// Queries, keys and values of these rows of h_S.
    fn project(
        &self,
        s: &mut Scratch,
        x: &[f32],
        rows: &Range<usize>,
        out: [&mut [f32]; 3],
        tape: Option<&mut Normal>,
    ) {
        let x = (self.normalise(&self.norm1, x, rows, &mut s.a, tape), self.columns);
        for (projection, out) in self.projections.iter().zip(out) {
            projection.run(x, rows.len(), Addend::Nothing, Function::Identity, Output::Wide(out));
        }
    }

    /// Keys and values of head h.
    fn pack(
        &self,
        h: usize,
        projections: &[Buffer<f32>; 3],
        (keys, values): &mut (Packed<f32>, Packed<f32>),
    ) {
        let at = |row: usize, i: usize| row * self.columns + h * self.width + i;
        keys.fill(|i, row| projections[1][at(row, i)]);
        values.fill(|row, i| projections[2][at(row, i)]);
    }

    /// h_S += O [heads of softmax(Q K^T / sqrt(d_h)) V] with Q, K, V of LN(h_S): eq. 11, 12 and the first sum of 13,
    /// for these rows of it. Scores and what the heads mixed are kept where there is room for them.
    fn attend(
        &self,
        s: &mut Scratch,
        queries: &[f32],
        heads: &Heads,
        rows: &Range<usize>,
        x: &mut [f32],
        tape: Option<(&mut Vec<Buffer<f32>>, &mut Buffer<f32>)>,
    ) {
        let (isa, columns, width, n) = (self.isa, self.columns, self.width, rows.len());
        let (stride, none) = (padded(heads.k), Function::Identity);
        let Scratch { a, b, scores, .. } = s;
        let (mut kept, mixed) = match tape {
            None => (None, &mut a[..n * columns]),
            Some((attention, mixed)) => (Some(attention), &mut mixed[numbers(rows, columns)]),
        };
        mixed.fill(0.0);
        for (h, (keys, values)) in heads.packed.iter().enumerate() {
            let queries = (&queries[rows.start * columns + h * width..], columns);
            let scores = match &mut kept {
                None => &mut scores[..n * stride],
                Some(attention) => &mut attention[h][numbers(rows, stride)],
            };
            product(isa, keys, queries, n, Addend::Nothing, none, Output::Wide(&mut *scores));
            softmax(isa, scores, stride, heads.k, self.scale());
            product(isa, values, (&*scores, stride), n, Addend::Nothing, none, Output::Wide(&mut b[..]));
            let rows = mixed.chunks_exact_mut(columns).zip(b.chunks_exact(values.columns()));
            for (to, from) in rows {
                to[h * width..(h + 1) * width].copy_from_slice(&from[..width]);
            }
        }
        self.output.add((&*mixed, columns), n, x);
    }

    /// h_S += FFN(LN(h_S)), the second sum of eq. 13, for these rows of it.
    fn feed_forward(
        &self,
        s: &mut Scratch,
        rows: &Range<usize>,
        x: &mut [f32],
        tape: Option<(&mut Normal, &mut Activated<f32>)>,
    ) {
        let (n, wide) = (rows.len(), self.first.weight.columns());
        let (norm, hidden) = tape.unzip();
        let from = (self.normalise(&self.norm2, x, rows, &mut s.a, norm), self.columns);
        let place = match hidden {
            None => Place { function: self.function, value: &mut s.b[..], slope: None },
            Some(hidden) => hidden.place(numbers(rows, wide)),
        };
        let hidden = place.fill_wide(&self.first.weight, from, n, self.first.bias(), &mut s.c);
        self.second.add((hidden, wide), n, x);
    }

    /// LN of these rows, in `out` or where they are kept.
    fn normalise<'a>(
        &self,
        norm: &NormWeights,
        x: &[f32],
        rows: &Range<usize>,
        out: &'a mut [f32],
        tape: Option<&'a mut Normal>,
    ) -> &'a [f32] {
        let Some(Normal { out, normed, scale }) = tape else {
            layer_norm::<f32>(self.isa, &norm.norm, x, rows.len(), Normed::Wide(&mut *out));
            return out;
        };
        let range = numbers(rows, self.columns);
        let (out, keep) = (&mut out[range.clone()], (&mut normed[range], &mut scale[rows.clone()]));
        layer_norm_keep::<f32>(self.isa, &norm.norm, x, rows.len(), Normed::Wide(&mut *out), keep);
        out
    }
}
