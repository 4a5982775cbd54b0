//! The macro stage: segment features (eq. 9, or a recurrence over a segment's nodes), positional encoding (eq. 10), segment transformer (eq. 11 to 13).
//!
//! Segment sums are made over all ranks in fp64; from there on every rank computes the same K rows, in fp32 in either
//! precision.

use super::encoder_decoder::Encoder;
use super::kernels::{Addend, Buffer, Function, Normed, Output, padded};
use super::perceptron::Perceptron;
use super::pool::{Parts, Pool};
use super::recurrence::{ReadStates, Recurrence, Together, together};
use super::tiles::{block, blocks};
use super::transformer::{self, TransformerLayer};
use super::weights::{Dense, Vector, Weights};
use m4gn_base::{Error, Result};
use m4gn_model::{Model, ModelSpec};
use m4gn_parallel::{Comm, Halo};
use m4gn_structure::{Segmentation, Structure};

/// Weights, members and buffers of the macro stage.
pub struct SegmentStage {
    count: usize,
    columns: usize,
    /// Segments of the node at each place, as in [`Segmentation`].
    pub member_row: Vec<u32>,
    /// As in [`Segmentation`].
    pub member: Vec<i32>,
    /// Members of segment s on this rank: `place[place_row[s]..place_row[s + 1]]`, ascending.
    place_row: Vec<u32>,
    place: Vec<u32>,
    inverse_sizes: Vec<f64>,
    /// In place of the mean over a segment's nodes.
    recurrence: Option<Reader>,

    encoder: Encoder<f32>,
    /// f_sp of the positional encoding, the same in every step.
    position: Option<Vec<f32>>,
    layers: Vec<TransformerLayer>,
    dispatch: Option<Dispatch>,

    sums: Buffer<f64>,
    means: Buffer<f32>,
    /// h_S
    latents: Buffer<f32>,
    /// Queries, keys, values.
    projections: [Buffer<f32>; 3],
    heads: transformer::Heads,
    scratch: Vec<transformer::Scratch>,
}

/// A recurrent unit, and the nodes that this rank reads with it.
struct Reader {
    unit: Recurrence,
    parts: Vec<(Together, ReadStates)>,
    halo: Halo,
    /// Latents of the owned nodes, and of those that the halo brings.
    nodes: Buffer<f32>,
}

impl Reader {
    /// The last states in place of the sums of means; rows of segments that other ranks read are zero.
    fn run(
        &mut self,
        comm: &Comm,
        pool: &Pool,
        scratch: &mut [transformer::Scratch],
        nodes: &[f32],
        (sums, columns): (&mut [f64], usize),
    ) {
        self.nodes[..nodes.len()].copy_from_slice(nodes);
        self.halo.exchange_f32(comm, &mut self.nodes, columns);
        let (unit, nodes, n) = (&self.unit, &self.nodes, self.parts.len());
        let parts = Parts::new(&mut self.parts);
        let read = |_: &mut transformer::Scratch, i: usize| {
            // SAFETY: task i has part i.
            let (segments, kept) = &mut unsafe { parts.rows(&(i..i + 1), 1) }[0];
            unit.read(segments, kept, nodes);
        };
        pool.run(scratch, n, read, || ());
        sums.fill(0.0);
        for (segments, kept) in &self.parts {
            for (&s, state) in segments.segments.iter().zip(kept.state.chunks_exact(columns)) {
                let row = &mut sums[s as usize * columns..(s as usize + 1) * columns];
                row.iter_mut().zip(state).for_each(|(to, x)| *to = f64::from(*x));
            }
        }
    }
}

/// h += dispatch([h, h_S]), where the model carries on after the macro stage.
struct Dispatch {
    segment: Dense<f32>,
    bias: Vector,
    table: Buffer<f32>,
}

impl SegmentStage {
    /// The macro stage of a model for the segments of a structure; `node` is the graph's node at each place of the engine's order.
    pub fn new(
        weights: &mut Weights,
        model: &Model,
        structure: &Structure,
        segments: &Segmentation,
        node: &[u32],
        n_threads: usize,
    ) -> Result<Self> {
        let Some(m4gn) = model.spec.architecture.m4gn() else {
            return Err(Error::Model("the model has no macro stage".into()));
        };
        let spec = &m4gn.segment_transformer;
        check(segments, node.len(), &model.spec)?;
        let a = &model.spec.architecture;
        let (isa, k, d) = (weights.isa, segments.count, a.width);
        let columns = padded(d);
        let layers = 0..spec.layers;
        let layers: Vec<_> =
            layers.map(|l| TransformerLayer::new(weights, a, spec, l)).collect::<Result<_>>()?;
        let dispatch = match m4gn.layers_after {
            0 => None,
            _ => Some(Dispatch {
                segment: Dense::part(weights, "segment.dispatch", d, d)?,
                bias: Vector::new(weights, "segment.dispatch.bias")?,
                table: Buffer::new(k * columns),
            }),
        };
        let (member_row, member) = reordered((&segments.member_row, &segments.member), node);
        let (place_row, place) = inverted(k, &member_row, &member);
        let recurrence = match structure.sequence_for(model.spec.architecture.needs())? {
            None => None,
            Some(sequence) => {
                let mut places = vec![0; node.len()];
                (0..).zip(node).for_each(|(p, &i)| places[i as usize] = p);
                let parts = together(sequence, &places).into_iter().map(|t| (t, ReadStates::default()));
                Some(Reader {
                    unit: Recurrence::new(weights, d)?,
                    parts: parts.collect(),
                    halo: sequence.halo.renumbered(&places),
                    nodes: Buffer::new((node.len() + sequence.halo.n_ghosts()) * columns),
                })
            }
        };
        // A last state is no sum.
        let share = |s: &f64| if recurrence.is_some() { 1.0 } else { 1.0 / s.max(1.0) };
        Ok(SegmentStage {
            count: k,
            columns,
            member_row,
            member,
            place_row,
            place,
            inverse_sizes: segments.sizes.iter().map(share).collect(),
            recurrence,
            encoder: Encoder::new(weights, "segment.encoder", d, a)?,
            position: match model.spec.n_position_features() {
                0 => None,
                n => {
                    let mut encoded = vec![0.0; k * columns];
                    let position = Perceptron::new(weights, "segment.position", n, a)?;
                    position.run(&segments.position, &mut encoded);
                    Some(encoded)
                }
            },
            layers,
            dispatch,
            sums: Buffer::new(k * columns),
            means: Buffer::new(k * columns),
            latents: Buffer::new(k * columns),
            projections: [0; 3].map(|_| Buffer::new(k * columns)),
            heads: transformer::Heads::new(isa, k, d, spec.heads),
            scratch: (0..n_threads).map(|_| transformer::Scratch::new(k, d, spec)).collect(),
        })
    }

    /// Moves the members to another order of the nodes: `before` is each node's place until now, `node` the node at
    /// each place from now on.
    pub fn reorder(&mut self, before: &[u32], node: &[u32]) {
        let view = (&self.member_row[..], &self.member[..]);
        let places: Vec<u32> = node.iter().map(|&i| before[i as usize]).collect();
        let (row, member) = reordered(view, &places);
        (self.place_row, self.place) = inverted(self.count, &row, &member);
        (self.member_row, self.member) = (row, member);
        let Some(recurrence) = &mut self.recurrence else { return };
        let mut now = vec![0; node.len()];
        (0..).zip(&places).for_each(|(p, &before)| now[before as usize] = p);
        recurrence.halo = recurrence.halo.renumbered(&now);
        for node in recurrence.parts.iter_mut().flat_map(|(part, _)| &mut part.node) {
            *node = now.get(*node as usize).map_or(*node, |&p| p as i32);
        }
    }

    /// K.
    pub fn count(&self) -> usize {
        self.count
    }

    /// h_S, rows of the padded width.
    pub fn latents(&self) -> &[f32] {
        &self.latents
    }

    /// From node latents, in the engine's order, to h_S. Collective.
    pub fn run(&mut self, comm: &Comm, pool: &Pool, nodes: &[f32]) {
        let (k, columns) = (self.count, self.columns);
        let (row, place) = (&self.place_row, &self.place);
        let sums = Parts::new(&mut self.sums);
        let add = |_: &mut transformer::Scratch, s: usize| {
            // SAFETY: task s has row s.
            let sum = unsafe { sums.rows(&(s..s + 1), columns) };
            sum.fill(0.0);
            for &p in &place[row[s] as usize..row[s + 1] as usize] {
                let h = &nodes[p as usize * columns..(p as usize + 1) * columns];
                sum.iter_mut().zip(h).for_each(|(sum, h)| *sum += f64::from(*h));
            }
        };
        match &mut self.recurrence {
            None => pool.run(&mut self.scratch, k, add, || ()),
            Some(unit) => unit.run(comm, pool, &mut self.scratch, nodes, (&mut self.sums, columns)),
        }
        comm.sum_f64(&mut self.sums);
        let rows = self.means.chunks_exact_mut(columns);
        for ((mean, sum), inverse) in rows.zip(self.sums.chunks_exact(columns)).zip(&self.inverse_sizes) {
            mean.iter_mut().zip(sum).for_each(|(m, s)| *m = (s * inverse) as f32);
        }

        let (means, position) = (&self.means, self.position.as_deref());
        let encoder = &self.encoder;
        let latents = Parts::new(&mut self.latents);
        let encode = |scratch: &mut transformer::Scratch, i: usize| {
            let rows = block::<f32>(i, k);
            // SAFETY: blocks are disjoint.
            let out = unsafe { latents.rows(&rows, columns) };
            let transformer::Scratch { a, b, c, .. } = scratch;
            let from = (&means[rows.start * columns..], columns);
            let buffers = encoder.rest.rows(None, &rows, [a, b]);
            encoder.run(from, rows.len(), encoder.bias(), buffers, c, Normed::Wide(&mut *out));
            if let Some(position) = position {
                let own = &position[rows.start * columns..rows.end * columns];
                out.iter_mut().zip(own).for_each(|(x, p)| *x += p);
            }
        };
        pool.run(&mut self.scratch, blocks::<f32>(k).len(), encode, || ());
        for layer in &self.layers {
            let (projections, heads) = (&mut self.projections, &mut self.heads);
            layer.run(pool, &mut self.scratch, projections, heads, &mut self.latents);
        }
        if let Some(dispatch) = &mut self.dispatch {
            let (x, table) = ((&self.latents[..], columns), Output::Wide(&mut dispatch.table));
            let bias = Addend::Bias(&dispatch.bias.data);
            dispatch.segment.run(x, k, bias, Function::Identity, table);
        }
    }

    /// The segments' part of the dispatch, W_S h_S + b, a row a segment; none when the model ends with the macro
    /// stage.
    pub fn dispatched(&self) -> Option<&[f32]> {
        self.dispatch.as_ref().map(|d| &d.table[..])
    }
}

/// Memberships, rows and members, with nodes in another order.
pub(super) fn reordered((rows, members): (&[u32], &[i32]), node: &[u32]) -> (Vec<u32>, Vec<i32>) {
    let mut row = Vec::with_capacity(node.len() + 1);
    let mut member = Vec::with_capacity(members.len());
    row.push(0);
    for &i in node {
        let own = rows[i as usize] as usize..rows[i as usize + 1] as usize;
        member.extend_from_slice(&members[own]);
        row.push(member.len() as u32);
    }
    (row, member)
}

/// For each of k segments the places that are members.
pub(super) fn inverted(k: usize, member_row: &[u32], member: &[i32]) -> (Vec<u32>, Vec<u32>) {
    let mut row = vec![0u32; k + 1];
    member.iter().for_each(|&s| row[s as usize + 1] += 1);
    (0..k).for_each(|s| row[s + 1] += row[s]);
    let mut next = row.clone();
    let mut place = vec![0; member.len()];
    for (p, bounds) in member_row.windows(2).enumerate() {
        for &s in &member[bounds[0] as usize..bounds[1] as usize] {
            place[next[s as usize] as usize] = p as u32;
            next[s as usize] += 1;
        }
    }
    (row, place)
}

pub(super) fn check(segments: &Segmentation, n_owned: usize, spec: &ModelSpec) -> Result<()> {
    let k = segments.count;
    let encodings = k * spec.n_position_features();
    let offsets = n_owned * spec.n_offset_features();
    let rows_fit = segments.member_row.len() == n_owned + 1
        && segments.member_row[0] == 0
        && segments.member_row.windows(2).all(|w| w[0] < w[1])
        && segments.member_row[n_owned] as usize == segments.member.len();
    let members_fit = segments.member.iter().all(|&s| usize::try_from(s).is_ok_and(|s| s < k));
    if !rows_fit
        || !members_fit
        || segments.sizes.len() != k
        || segments.position.len() != encodings
        || segments.offsets.len() != offsets
    {
        return Err(Error::Input(format!(
            "segments: expected one or more of {k} for each of {n_owned} nodes, {k} sizes, {encodings} encodings and {offsets} \
             offsets; found {} nodes, {} sizes, {} encodings, {} offsets, segment numbers {} within range",
            segments.member_row.len().saturating_sub(1),
            segments.sizes.len(),
            segments.position.len(),
            segments.offsets.len(),
            if members_fit { "all" } else { "not all" }
        )));
    }
    Ok(())
}
