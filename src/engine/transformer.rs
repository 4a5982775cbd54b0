//! The segment transformer (eq. 11 to 13) on K rows of the padded width, in fp32.

use super::kernels::{
    Addend, Buffer, Function, Isa, Norm, Normed, Output, Packed, layer_norm, padded, product, softmax,
};
use super::linear::{self, Linear};
use super::pool::{Parts, Pool};
use super::tiles::{block, blocks};
use m4gn_base::Result;
use m4gn_model::{MacroSpec, Model};

/// One layer: attention and a point-wise network, each behind a layer norm and beside a residual.
pub struct TransformerLayer {
    isa: Isa,
    norm1: Norm,
    /// Queries, keys and values side by side, each padded.
    projection: Packed<f32>,
    output: Linear<f32>,
    norm2: Norm,
    first: Linear<f32>,
    second: Linear<f32>,
    function: Function,
}

/// Queries of all segments, and keys and values of each head as products read them.
pub struct Heads {
    width: usize,
    /// Queries, keys, values: rows of three padded widths.
    projections: Buffer<f32>,
    /// K^T `[d_h x K]` and V `[K x d_h]` of each head.
    packed: Vec<(Packed<f32>, Packed<f32>)>,
}

/// One thread's buffers, for a block of rows.
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

impl Heads {
    /// For k segments.
    pub fn new(isa: Isa, k: usize, d: usize, heads: usize) -> Self {
        let width = d / heads;
        Heads {
            width,
            projections: Buffer::new(k * 3 * padded(d)),
            packed: (0..heads).map(|_| (Packed::zero(isa, width, k), Packed::zero(isa, k, width))).collect(),
        }
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

impl TransformerLayer {
    /// Layer `l` of the model's segment transformer.
    pub fn new(isa: Isa, model: &Model, l: usize) -> Result<Self> {
        let name = |part: &str| format!("segment.transformer.{l}.{part}");
        let d = model.spec.architecture.width;
        let columns = padded(d);
        let [q, k, v] = ["q", "k", "v"].map(|p| model.tensor(&format!("{}.weight", name(p))));
        let parts = [q?, k?, v?];
        let projection = Packed::new(isa, d, 3 * columns, |i, o| match (o / columns, o % columns) {
            (part, o) if o < d => parts[part].data[o * d + i],
            _ => 0.0,
        });
        Ok(TransformerLayer {
            isa,
            norm1: linear::norm(model, &name("norm1"))?,
            projection,
            output: Linear::new(isa, model, &name("o"))?,
            norm2: linear::norm(model, &name("norm2"))?,
            first: Linear::new(isa, model, &name("ffn.0"))?,
            second: Linear::new(isa, model, &name("ffn.1"))?,
            function: model.spec.architecture.activation.into(),
        })
    }

    /// Advances h_S in place.
    pub fn run(&self, pool: &Pool, scratch: &mut [Scratch], heads: &mut Heads, latents: &mut [f32]) {
        let columns = self.output.weight.columns();
        let k = latents.len() / columns;
        let n_blocks = blocks::<f32>(k).len();
        let projections = Parts::new(&mut heads.projections);
        let project = |s: &mut Scratch, i: usize| {
            let rows = block::<f32>(i, k);
            // SAFETY: blocks are disjoint.
            let out = unsafe { projections.rows(&rows, 3 * columns) };
            let n = rows.len();
            let x = &latents[rows.start * columns..rows.end * columns];
            layer_norm::<f32>(self.isa, &self.norm1, x, n, Normed::Wide(&mut s.a));
            let (x, none) = ((&s.a[..], columns), Function::Identity);
            product(self.isa, &self.projection, x, n, Addend::Nothing, none, Output::Wide(out));
        };
        pool.run(scratch, n_blocks, project, || ());

        let width = heads.width;
        let all = &heads.projections;
        let n_heads = heads.packed.len();
        let packed = Parts::new(&mut heads.packed);
        let pack = |_: &mut Scratch, h: usize| {
            // SAFETY: task h has head h.
            let (keys, values) = &mut unsafe { packed.rows(&(h..h + 1), 1) }[0];
            let part = |p: usize| move |row: usize, i: usize| all[(3 * row + p) * columns + h * width + i];
            let (key, value) = (part(1), part(2));
            keys.fill(|i, row| key(row, i));
            values.fill(value);
        };
        pool.run(scratch, n_heads, pack, || ());

        let heads = &*heads;
        let latents = Parts::new(latents);
        let attend = |s: &mut Scratch, i: usize| {
            let rows = block::<f32>(i, k);
            // SAFETY: blocks are disjoint.
            let x = unsafe { latents.rows(&rows, columns) };
            self.attend(s, heads, rows.start, x);
            self.feed_forward(s, x);
        };
        pool.run(scratch, n_blocks, attend, || ());
    }

    /// h_S += O [heads of softmax(Q K^T / sqrt(d_h)) V] with Q, K, V of LN(h_S): eq. 11, 12 and the first sum of 13,
    /// for the rows `x` from `first`.
    fn attend(&self, s: &mut Scratch, heads: &Heads, first: usize, x: &mut [f32]) {
        let (isa, columns, width) = (self.isa, self.output.weight.columns(), heads.width);
        let n = x.len() / columns;
        let k = heads.projections.len() / (3 * columns);
        let Scratch { a, b, scores, .. } = s;
        a[..n * columns].fill(0.0);
        for (h, (keys, values)) in heads.packed.iter().enumerate() {
            let queries = &heads.projections[first * 3 * columns + h * width..];
            let scores = &mut scores[..n * keys.columns()];
            let none = Function::Identity;
            let from = (queries, 3 * columns);
            product(isa, keys, from, n, Addend::Nothing, none, Output::Wide(&mut *scores));
            softmax(isa, scores, keys.columns(), k, 1.0 / (width as f32).sqrt());
            let out = Output::Wide(&mut *b);
            product(isa, values, (scores, keys.columns()), n, Addend::Nothing, none, out);
            let rows = a.chunks_exact_mut(columns).zip(b.chunks_exact(values.columns())).take(n);
            for (to, from) in rows {
                to[h * width..(h + 1) * width].copy_from_slice(&from[..width]);
            }
        }
        self.output.add(isa, (a, columns), n, x);
    }

    /// h_S += FFN(LN(h_S)), the second sum of eq. 13.
    fn feed_forward(&self, s: &mut Scratch, x: &mut [f32]) {
        let columns = self.output.weight.columns();
        let n = x.len() / columns;
        layer_norm::<f32>(self.isa, &self.norm2, x, n, Normed::Wide(&mut s.a));
        self.first.run(self.isa, (&s.a, columns), n, self.function, Output::Wide(&mut s.b));
        self.second.add(self.isa, (&s.b, self.first.weight.columns()), n, x);
    }
}
