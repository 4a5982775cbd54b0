//! The macro stage: segment features (eq. 9, or a recurrence over a segment's nodes), positional encoding (eq. 10), segment transformer (eq. 11 to 13).
//!
//! Segment sums are made over all ranks in fp64; from there on every rank computes the same K rows, in fp32 in either
//! precision.

use super::encoder_decoder::Encoder;
use super::kernels::{Addend, Buffer, Function, Isa, Normed, Number, Output, padded};
use super::members::Members;
use super::perceptron::Perceptron;
use super::pool::{Parts, Pool};
use super::recurrence::{ReadStates, Recurrence, Together, together};
use super::tiles::{block, blocks};
use super::transformer::{self, TransformerLayer};
use super::weights::{Dense, Vector, Weights};
use m4gn_base::Result;
use m4gn_model::{Architecture, MacroSpec, ModelSpec};
use m4gn_parallel::{Comm, Halo};
use m4gn_structure::{Segmentation, Structure};

/// Weights of the macro stage.
pub struct Stage {
    isa: Isa,
    d: usize,
    /// The width, padded.
    pub columns: usize,
    pub of: MacroSpec,
    /// In place of the mean over a segment's nodes.
    pub recurrence: Option<Recurrence>,
    pub encoder: Encoder<f32>,
    /// f_sp of the positional encoding.
    pub position: Option<Perceptron>,
    pub layers: Vec<TransformerLayer>,
}

impl Stage {
    /// Those of a model; none where it has no macro stage.
    pub fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Option<Self>> {
        let a = &spec.architecture;
        let Some(of) = a.segment_transformer() else { return Ok(None) };
        Ok(Some(Stage {
            isa: weights.isa,
            d: a.width,
            columns: padded(a.width),
            of: of.clone(),
            recurrence: match a.needs().sequences {
                true => Some(Recurrence::new(weights, a.width)?),
                false => None,
            },
            encoder: Encoder::new(weights, "segment.encoder", a.width, a)?,
            position: match spec.n_position_features() {
                0 => None,
                n => Some(Perceptron::new(weights, "segment.position", n, a)?),
            },
            layers: (0..of.layers)
                .map(|l| TransformerLayer::new(weights, a, of, l))
                .collect::<Result<_>>()?,
        }))
    }

    /// Heads of k segments.
    pub fn heads(&self, k: usize) -> transformer::Heads {
        transformer::Heads::new(self.isa, k, self.d, self.of.heads)
    }

    /// A thread's buffers, for k segments.
    pub fn scratch(&self, k: usize) -> transformer::Scratch {
        transformer::Scratch::new(k, self.d, &self.of)
    }
}

/// h += dispatch([h, h_S]), where the model carries on after the macro stage.
pub struct Dispatch<T> {
    /// Of h.
    pub own: Dense<T>,
    /// Of h_S.
    pub segment: Dense<f32>,
    /// Of both.
    pub bias: Vector,
}

impl<T: Number> Dispatch<T> {
    /// That of a model; none where no layers follow the macro stage.
    pub fn new(weights: &mut Weights, a: &Architecture) -> Result<Option<Self>> {
        let name = "segment.dispatch";
        Ok(match a.m4gn().is_some_and(|m| m.layers_after > 0) {
            true => Some(Dispatch {
                own: Dense::part(weights, name, 0, a.width)?,
                segment: Dense::part(weights, name, a.width, a.width)?,
                bias: Vector::new(weights, &format!("{name}.bias"))?,
            }),
            false => None,
        })
    }

    /// The part of k segments, W_S h_S + b, a row each.
    pub fn table(&self, latents: &[f32], k: usize, out: &mut Buffer<f32>) {
        out.fit(k * self.segment.columns());
        let x = (latents, self.segment.columns());
        self.segment.run(x, k, Addend::Bias(&self.bias.data), Function::Identity, Output::Wide(out));
    }
}

/// The macro stage of a model on a graph.
pub struct SegmentStage {
    weights: Stage,
    pub members: Members,
    /// Where the model has a recurrence.
    reader: Option<Reader>,
    /// The positional encoding behind f_sp, the same in every step.
    position: Option<Vec<f32>>,

    sums: Buffer<f64>,
    means: Buffer<f32>,
    /// h_S
    latents: Buffer<f32>,
    /// Queries, keys, values.
    projections: [Buffer<f32>; 3],
    heads: transformer::Heads,
    scratch: Vec<transformer::Scratch>,
}

/// The nodes that this rank reads with a recurrent unit.
struct Reader {
    parts: Vec<(Together, ReadStates)>,
    halo: Halo,
    /// Latents of the owned nodes, and of those that the halo brings.
    nodes: Buffer<f32>,
}

impl Reader {
    /// The last states in place of the sums of means; rows of segments that other ranks read are zero.
    fn run(
        &mut self,
        unit: &Recurrence,
        comm: &Comm,
        pool: &Pool,
        scratch: &mut [transformer::Scratch],
        nodes: &[f32],
        sums: &mut [f64],
    ) {
        let columns = unit.columns;
        self.nodes[..nodes.len()].copy_from_slice(nodes);
        self.halo.exchange_f32(comm, &mut self.nodes, columns);
        let (nodes, n) = (&self.nodes, self.parts.len());
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

impl SegmentStage {
    /// The macro stage of a model for the segments of a structure; `node` is the graph's node at each place of the engine's order.
    pub fn new(
        weights: Stage,
        spec: &ModelSpec,
        structure: &Structure,
        segments: &Segmentation,
        node: &[u32],
        n_threads: usize,
    ) -> Result<Self> {
        let (k, columns) = (segments.count, weights.columns);
        let members = Members::new(segments, spec, node)?;
        let reader = structure.sequence_for(spec.architecture.needs())?.map(|sequence| {
            let mut places = vec![0; node.len()];
            (0..).zip(node).for_each(|(p, &i)| places[i as usize] = p);
            let parts = together(sequence, &places).into_iter().map(|t| (t, ReadStates::default()));
            Reader {
                parts: parts.collect(),
                halo: sequence.halo.renumbered(&places),
                nodes: Buffer::new((node.len() + sequence.halo.n_ghosts()) * columns),
            }
        });
        let position = weights.position.as_ref().map(|position| {
            let mut encoded = vec![0.0; k * columns];
            position.run(&segments.position, &mut encoded);
            encoded
        });
        Ok(SegmentStage {
            members,
            reader,
            position,
            sums: Buffer::new(k * columns),
            means: Buffer::new(k * columns),
            latents: Buffer::new(k * columns),
            projections: [0; 3].map(|_| Buffer::new(k * columns)),
            heads: weights.heads(k),
            scratch: (0..n_threads).map(|_| weights.scratch(k)).collect(),
            weights,
        })
    }

    /// Moves the members to another order of the nodes: `before` is each node's place until now, `node` the node at
    /// each place from now on.
    pub fn reorder(&mut self, before: &[u32], node: &[u32]) {
        let places: Vec<u32> = node.iter().map(|&i| before[i as usize]).collect();
        self.members = self.members.reordered(&places);
        let Some(reader) = &mut self.reader else { return };
        let mut now = vec![0; node.len()];
        (0..).zip(&places).for_each(|(p, &before)| now[before as usize] = p);
        reader.halo = reader.halo.renumbered(&now);
        for node in reader.parts.iter_mut().flat_map(|(part, _)| &mut part.node) {
            *node = now.get(*node as usize).map_or(*node, |&p| p as i32);
        }
    }

    /// h_S, rows of the padded width.
    pub fn latents(&self) -> &[f32] {
        &self.latents
    }

    /// From node latents, in the engine's order, to h_S. Collective.
    pub fn run(&mut self, comm: &Comm, pool: &Pool, nodes: &[f32]) {
        let Stage { columns, recurrence, encoder, .. } = &self.weights;
        let (k, columns, members) = (self.members.count, *columns, &self.members);
        let sums = Parts::new(&mut self.sums);
        let add = |_: &mut transformer::Scratch, s: usize| {
            // SAFETY: task s has row s.
            let sum = unsafe { sums.rows(&(s..s + 1), columns) };
            sum.fill(0.0);
            for &p in members.places(s) {
                let h = &nodes[p as usize * columns..(p as usize + 1) * columns];
                sum.iter_mut().zip(h).for_each(|(sum, h)| *sum += f64::from(*h));
            }
        };
        match (&mut self.reader, recurrence) {
            (Some(reader), Some(unit)) => {
                reader.run(unit, comm, pool, &mut self.scratch, nodes, &mut self.sums);
            }
            _ => pool.run(&mut self.scratch, k, add, || ()),
        }
        comm.sum_f64(&mut self.sums);
        let rows = self.means.chunks_exact_mut(columns).zip(self.sums.chunks_exact(columns));
        for ((mean, sum), inverse) in rows.zip(&members.inverse_sizes) {
            // A last state is no sum.
            let share = if recurrence.is_some() { 1.0 } else { *inverse };
            mean.iter_mut().zip(sum).for_each(|(m, s)| *m = (s * share) as f32);
        }

        let (means, position) = (&self.means, self.position.as_deref());
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
        for layer in &self.weights.layers {
            let (projections, heads) = (&mut self.projections, &mut self.heads);
            layer.run(pool, &mut self.scratch, projections, heads, &mut self.latents);
        }
    }
}
