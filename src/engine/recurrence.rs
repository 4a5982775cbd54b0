//! A gated recurrent unit over the nodes of each segment (the pooling of EAGLE: Janny et al. 2023), in fp32 in either precision:
//!
//! `r = s(W_r x + b_r + U_r h + c_r)`, `z = s(W_z x + b_z + U_z h + c_z)`, `n = tanh(W_n x + b_n + r (U_n h + c_n))`,
//! `h <- (1 - z) n + z h`, from h = 0, with s the logistic function and x the latents of one node after another.
//!
//! Segments are read side by side, so many as products suit, the longest first, so that those that go on are the first rows.

use super::kernels::{Buffer, Function, Output, padded};
use super::tiles::blocks;
use super::weights::{Linear, Weights};
use m4gn_base::Result;
use m4gn_structure::Sequence;
use std::ops::Range;

/// Segments that are read side by side.
#[derive(Clone, Debug)]
pub struct Together {
    /// The longest first.
    pub segments: Vec<u32>,
    /// Rows of each step: one for each segment that has so many nodes.
    pub steps: Vec<Range<usize>>,
    /// Node of each row.
    pub node: Vec<i32>,
}

/// All of a sequence, whose owned node i stands at `place[i]`.
pub fn together(sequence: &Sequence, place: &[u32]) -> Vec<Together> {
    let range = |s: u32| sequence.row[s as usize] as usize..sequence.row[s as usize + 1] as usize;
    let mut own: Vec<u32> = (0..sequence.row.len() as u32 - 1).filter(|&s| !range(s).is_empty()).collect();
    own.sort_by_key(|&s| std::cmp::Reverse(range(s).len()));
    let side_by_side = |rows: Range<usize>| {
        let segments = own[rows].to_vec();
        let (mut steps, mut node) = (Vec::new(), Vec::new());
        for t in 0..range(segments[0]).len() {
            let first = node.len();
            let here = segments.iter().map(|&s| range(s)).take_while(|r| t < r.len());
            let at = |i: i32| place.get(i as usize).map_or(i, |&p| p as i32);
            node.extend(here.map(|r| at(sequence.node[r.start + t])));
            steps.push(first..node.len());
        }
        Together { segments, steps, node }
    };
    blocks::<f32>(own.len()).map(side_by_side).collect()
}

/// What reading leaves, a row a step and segment; derivatives are made of it.
#[derive(Default)]
pub struct ReadStates {
    /// Latents of the nodes.
    pub x: Buffer<f32>,
    /// States before a step.
    pub before: Buffer<f32>,
    /// Reset and update gates and new values, side by side, in rows of [`Recurrence::stride`].
    pub gates: Buffer<f32>,
    /// `U h + c` of the three.
    pub hidden: Buffer<f32>,
    /// The last states, a row a segment.
    pub state: Buffer<f32>,
}

impl ReadStates {
    fn fit(&mut self, rows: usize, segments: usize, columns: usize, stride: usize) {
        self.x.fit(rows * columns);
        self.before.fit(rows * columns);
        self.gates.fit(rows * stride);
        self.hidden.fit(rows * stride);
        self.state.fit(segments * columns);
    }
}

/// Its weights.
pub struct Recurrence {
    /// The width.
    pub d: usize,
    /// The width, padded.
    pub columns: usize,
    /// `W` and `b`.
    pub input: Linear<f32>,
    /// `U` and `c`.
    pub hidden: Linear<f32>,
}

impl Recurrence {
    /// Of a model of width d.
    pub fn new(weights: &mut Weights, d: usize) -> Result<Self> {
        let mut linear = |of: &str| Linear::new(weights, &format!("segment.recurrence.{of}"));
        Ok(Recurrence { d, columns: padded(d), input: linear("input")?, hidden: linear("hidden")? })
    }

    /// Columns of the three gates.
    pub fn stride(&self) -> usize {
        self.input.weight.columns()
    }

    /// Reads nodes whose latents are rows of `nodes`, up to the last states in `kept`.
    pub fn read(&self, segments: &Together, kept: &mut ReadStates, nodes: &[f32]) {
        let (d, columns, stride) = (self.d, self.columns, self.stride());
        kept.fit(segments.node.len(), segments.segments.len(), columns, stride);
        for (x, &node) in kept.x.chunks_exact_mut(columns).zip(&segments.node) {
            x.copy_from_slice(&nodes[node as usize * columns..(node as usize + 1) * columns]);
        }
        kept.state.fill(0.0);
        for rows in &segments.steps {
            let (n, wide) = (rows.len(), rows.start * stride..rows.end * stride);
            let state = &mut kept.state[..n * columns];
            kept.before[rows.start * columns..rows.end * columns].copy_from_slice(state);
            let (gates, hidden) = (&mut kept.gates[wide.clone()], &mut kept.hidden[wide]);
            let x = (&kept.x[rows.start * columns..], columns);
            self.input.run(x, n, Function::Identity, Output::Wide(&mut *gates));
            self.hidden.run((&*state, columns), n, Function::Identity, Output::Wide(&mut *hidden));
            let rows = gates.chunks_exact_mut(stride).zip(hidden.chunks_exact(stride));
            for (h, (gates, hidden)) in state.chunks_exact_mut(columns).zip(rows) {
                for (i, h) in h.iter_mut().enumerate().take(d) {
                    let r = logistic(gates[i] + hidden[i]);
                    let z = logistic(gates[d + i] + hidden[d + i]);
                    let new = (gates[2 * d + i] + r * hidden[2 * d + i]).tanh();
                    *h = (1.0 - z) * new + z * *h;
                    (gates[i], gates[d + i], gates[2 * d + i]) = (r, z, new);
                }
            }
        }
    }
}

fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
