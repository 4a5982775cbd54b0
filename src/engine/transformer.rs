//! The macro stage: segment features (eq. 9), positional encoding (eq. 10), segment transformer (eq. 11 to 13).
//!
//! Segment sums are made over all ranks in fp64; from there on every rank computes the same K rows.

use super::Isa;
use super::SegmentView;
use super::kernels::{self, Function};
use super::linear::{self, Norm, Tail, Weight};
use crate::model::{Model, ModelSpec};
use crate::parallel::Comm;
use crate::{Error, Result};
use faer::linalg::matmul::matmul;
use faer::prelude::ReborrowMut;
use faer::{Accum, MatMut, MatRef, Par};

/// Weights, members and buffers of the macro stage.
#[derive(Debug)]
pub struct SegmentStage {
    count: usize,
    width: usize,
    heads: usize,
    member_row: Vec<u32>,
    member: Vec<i32>,
    inverse_sizes: Vec<f64>,

    encoder: Weight,
    encoder_tail: Tail,
    encoder_norm: Norm,
    /// f_sp of the positional encoding, the same in every step `[K x d]`.
    position: Option<Vec<f32>>,
    layers: Vec<TransformerLayer>,
    dispatch: Option<DispatchLayer>,

    sums: Vec<f64>,
    /// h_S `[K x d]`.
    latents: Vec<f32>,
    a: Vec<f32>,
    b: Vec<f32>,
    /// `[K x 3d]`: queries, keys, values.
    projections: Vec<f32>,
    /// `[K x K]` of one head.
    attention: Vec<f32>,
}

#[derive(Debug)]
struct TransformerLayer {
    norm1: Norm,
    /// Queries, keys and values side by side.
    projection: Weight,
    output: Weight,
    output_bias: Vec<f32>,
    norm2: Norm,
    first: Weight,
    first_bias: Vec<f32>,
    second: Weight,
    second_bias: Vec<f32>,
    function: Function,
}

#[derive(Debug)]
struct DispatchLayer {
    node: Weight,
    segment: Weight,
    bias: Vec<f32>,
    table: Vec<f32>,
}

/// What the dispatch adds to a node besides its own part: the mean over its segments of `table`.
pub struct DispatchView<'a> {
    /// `[K x d]`.
    pub table: &'a [f32],
    /// As in [`SegmentView`].
    pub member_row: &'a [u32],
    /// As in [`SegmentView`].
    pub member: &'a [i32],
}

impl SegmentStage {
    /// The macro stage of a model for these segments.
    pub fn new(model: &Model, view: &SegmentView, n_owned: usize) -> Result<Self> {
        let Some(spec) = &model.spec.architecture.segment_transformer else {
            return Err(Error::Model("the model has no segment_transformer".into()));
        };
        check(view, n_owned, &model.spec)?;
        let (k, d) = (view.count, model.spec.architecture.width);
        let encoder_tail = Tail::new(model, "segment.encoder")?;
        let layers = (0..spec.layers)
            .map(|l| TransformerLayer::new(model, l))
            .collect::<Result<_>>()?;
        let dispatch = match model.spec.architecture.layers_after {
            0 => None,
            _ => Some(DispatchLayer {
                node: Weight::columns(model, "segment.dispatch", 0..d)?,
                segment: Weight::columns(model, "segment.dispatch", d..2 * d)?,
                bias: linear::bias(model, "segment.dispatch")?,
                table: vec![0.0; k * d],
            }),
        };
        Ok(SegmentStage {
            count: k,
            width: d,
            heads: spec.heads,
            member_row: view.member_row.to_vec(),
            member: view.member.to_vec(),
            inverse_sizes: view.sizes.iter().map(|s| 1.0 / s.max(1.0)).collect(),
            encoder: Weight::whole(model, "segment.encoder.0")?,
            encoder_tail,
            encoder_norm: Norm::new(model, "segment.encoder.norm")?,
            position: (model.spec.n_position_features() > 0)
                .then(|| encode_position(model, view))
                .transpose()?,
            layers,
            dispatch,
            sums: vec![0.0; k * d],
            latents: vec![0.0; k * d],
            a: vec![0.0; k * d.max(spec.ffn_width)],
            b: vec![0.0; k * d.max(spec.ffn_width)],
            projections: vec![0.0; k * 3 * d],
            attention: vec![0.0; k * k],
        })
    }

    /// K.
    pub fn count(&self) -> usize {
        self.count
    }

    /// h_S `[K x d]`.
    pub fn latents(&self) -> &[f32] {
        &self.latents
    }

    /// As in [`SegmentView`].
    pub fn member_row(&self) -> &[u32] {
        &self.member_row
    }

    /// As in [`SegmentView`].
    pub fn member(&self) -> &[i32] {
        &self.member
    }

    /// From node latents to h_S. Collective.
    pub fn run(&mut self, isa: Isa, comm: &Comm, nodes: &[f32]) {
        let (k, d) = (self.count, self.width);
        self.sums.fill(0.0);
        for (h, bounds) in nodes.chunks_exact(d).zip(self.member_row.windows(2)) {
            for &s in &self.member[bounds[0] as usize..bounds[1] as usize] {
                let sum = &mut self.sums[s as usize * d..(s as usize + 1) * d];
                sum.iter_mut().zip(h).for_each(|(sum, h)| *sum += *h as f64);
            }
        }
        comm.sum_f64(&mut self.sums);
        for ((mean, sum), inverse) in self
            .latents
            .chunks_exact_mut(d)
            .zip(self.sums.chunks_exact(d))
            .zip(&self.inverse_sizes)
        {
            mean.iter_mut()
                .zip(sum)
                .for_each(|(m, s)| *m = (s * inverse) as f32);
        }

        let (tail, norm) = (&self.encoder_tail, &self.encoder_norm);
        self.encoder.apply(&mut self.a, &self.latents, k);
        kernels::bias_activate(isa, &mut self.a[..k * d], &tail.first_bias, tail.first_function);
        let x = tail.run(isa, k, &mut self.a, &mut self.b);
        kernels::layer_norm(
            isa,
            x,
            &tail.last_bias,
            &norm.gain,
            &norm.shift,
            &mut self.latents,
        );
        if let Some(position) = &self.position {
            self.latents.iter_mut().zip(position).for_each(|(x, p)| *x += p);
        }
        for l in 0..self.layers.len() {
            self.attend(isa, l);
            self.feed_forward(isa, l);
        }
    }

    /// h_S += O [heads of softmax(Q K^T / sqrt(d_h)) V] with Q, K, V of LN(h_S): eq. 11, 12 and the first sum of 13.
    fn attend(&mut self, isa: Isa, l: usize) {
        let (k, d) = (self.count, self.width);
        let layer = &self.layers[l];
        let head = d / self.heads;
        layer.norm1.apply(isa, &self.latents, &mut self.a[..k * d]);
        layer.projection.apply(&mut self.projections, &self.a, k);
        let all = MatRef::from_row_major_slice(&self.projections[..], k, 3 * d);
        let mut heads = MatMut::from_row_major_slice_mut(&mut self.b[..k * d], k, d);
        for at in (0..d).step_by(head) {
            let attention = MatMut::from_row_major_slice_mut(&mut self.attention[..], k, k);
            let keys = all.subcols(d + at, head).transpose();
            matmul(
                attention,
                Accum::Replace,
                all.subcols(at, head),
                keys,
                1.0,
                Par::Seq,
            );
            kernels::softmax(isa, &mut self.attention, k, 1.0 / (head as f32).sqrt());
            let attention = MatRef::from_row_major_slice(&self.attention[..], k, k);
            let values = all.subcols(2 * d + at, head);
            matmul(
                heads.rb_mut().subcols_mut(at, head),
                Accum::Replace,
                attention,
                values,
                1.0,
                Par::Seq,
            );
        }
        layer.output.apply_add(&mut self.latents, &self.b, k);
        kernels::bias_activate(isa, &mut self.latents, &layer.output_bias, Function::Identity);
    }

    /// h_S += FFN(LN(h_S)), the second sum of eq. 13.
    fn feed_forward(&mut self, isa: Isa, l: usize) {
        let (k, d) = (self.count, self.width);
        let layer = &self.layers[l];
        layer.norm2.apply(isa, &self.latents, &mut self.a[..k * d]);
        layer.first.apply(&mut self.b, &self.a, k);
        let hidden = &mut self.b[..k * layer.first_bias.len()];
        kernels::bias_activate(isa, hidden, &layer.first_bias, layer.function);
        layer.second.apply_add(&mut self.latents, hidden, k);
        kernels::bias_activate(isa, &mut self.latents, &layer.second_bias, Function::Identity);
    }

    /// Computes the segments' part of the dispatch, W_S h_S + b, and returns the nodes' weight with it. None when
    /// the model ends with the macro stage.
    pub fn prepare_dispatch(&mut self) -> Option<(&Weight, DispatchView<'_>)> {
        let DispatchLayer {
            node,
            segment,
            bias,
            table,
        } = self.dispatch.as_mut()?;
        segment.apply(table, &self.latents, self.count);
        for row in table.chunks_exact_mut(self.width) {
            row.iter_mut().zip(&*bias).for_each(|(x, b)| *x += b);
        }
        Some((
            node,
            DispatchView {
                table,
                member_row: &self.member_row,
                member: &self.member,
            },
        ))
    }
}

impl TransformerLayer {
    fn new(model: &Model, l: usize) -> Result<Self> {
        let name = |part: &str| format!("segment.transformer.{l}.{part}");
        let projections = ["q", "k", "v"].map(|p| Weight::whole(model, &name(p)));
        let projections = projections.into_iter().collect::<Result<Vec<_>>>()?;
        Ok(TransformerLayer {
            norm1: Norm::new(model, &name("norm1"))?,
            projection: Weight::beside(&projections),
            output: Weight::whole(model, &name("o"))?,
            output_bias: linear::bias(model, &name("o"))?,
            norm2: Norm::new(model, &name("norm2"))?,
            first: Weight::whole(model, &name("ffn.0"))?,
            first_bias: linear::bias(model, &name("ffn.0"))?,
            second: Weight::whole(model, &name("ffn.1"))?,
            second_bias: linear::bias(model, &name("ffn.1"))?,
            function: linear::function(model.spec.architecture.activation),
        })
    }
}

/// f_sp(p) of every segment (section 3.4.1) `[K x d]`.
fn encode_position(model: &Model, view: &SegmentView) -> Result<Vec<f32>> {
    let isa = Isa::detect();
    let (k, d) = (view.count, model.spec.architecture.width);
    let tail = Tail::new(model, "segment.position")?;
    let (mut a, mut b) = (vec![0.0; k * d], vec![0.0; k * d]);
    Weight::whole(model, "segment.position.0")?.apply(&mut a, view.position, k);
    kernels::bias_activate(isa, &mut a, &tail.first_bias, tail.first_function);
    let out = tail.run(isa, k, &mut a, &mut b);
    kernels::bias_activate(isa, out, &tail.last_bias, Function::Identity);
    Ok(out.to_vec())
}

fn check(view: &SegmentView, n_owned: usize, spec: &ModelSpec) -> Result<()> {
    let k = view.count;
    let encodings = k * spec.n_position_features();
    let offsets = n_owned * spec.n_offset_features();
    let rows_fit = view.member_row.len() == n_owned + 1
        && view.member_row.windows(2).all(|w| w[0] < w[1])
        && view.member_row[n_owned] as usize == view.member.len();
    let members_fit = view
        .member
        .iter()
        .all(|&s| usize::try_from(s).is_ok_and(|s| s < k));
    if !rows_fit
        || !members_fit
        || view.sizes.len() != k
        || view.position.len() != encodings
        || view.offsets.len() != offsets
    {
        return Err(Error::Input(format!(
            "segments: expected one or more of {k} for each of {n_owned} nodes, {k} sizes, {encodings} encodings and {offsets} \
             offsets; found {} nodes, {} sizes, {} encodings, {} offsets, segment numbers {} within range",
            view.member_row.len().saturating_sub(1),
            view.sizes.len(),
            view.position.len(),
            view.offsets.len(),
            if members_fit { "all" } else { "not all" }
        )));
    }
    Ok(())
}
