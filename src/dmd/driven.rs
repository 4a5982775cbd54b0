//! Dynamic mode decomposition with inputs that are known (Proctor, Brunton and Kutz, SIAM J. Appl. Dyn. Syst. 15, 2016), and with their
//! products with the state (bilinear: Goswami and Paley, CDC 2017), in the space of the snapshots: nothing in it is as long as a state.
//!
//! A state is the mean of the window, what follows from the inputs at once (a pressure answers the rate of a flow rate, and a potential flow
//! the flow rate), and a rest: `x = mean + Y E v + Y P S^-1 z`. `Y` are the centred snapshots, `E` the directions of their inputs, `v` the
//! inputs, and `P S^2 P^T` the inner products of the rests. The first part makes the inputs of a prediction those that are prescribed. The rest
//! follows by least squares: `z_k+1 = W (z_k, ..., z_k-q+1, v_k+1, ..., v_k-q+1, 1, (v_k+1 + v_k)/2 (z_k, v_k, v_k+1))`.

use crate::dmd::{Window, directions, starts};
use faer::Mat;
use serde::{Deserialize, Serialize};

/// Inputs that are told apart at most: more would leave too few states for each.
const INPUTS: usize = 4;

/// Of the largest: what an input varies by below this is left to the check of the inputs.
const SMALL: f64 = 1e-4;

/// Directions of the rests below this times the largest are rounding.
const ROUNDING: f64 = 1e-6;

/// Singular values of the least squares below this times the largest are left out.
const CUT: f64 = 1e-3;

/// How far a prediction may be from the mean, over the window's farthest state; and an input beyond the window's, over their range.
const FAR: f64 = 2.0;
const BEYOND: f64 = 0.25;

/// What is chosen of it beside its snapshots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DrivenShape {
    /// States that the next one follows from, q.
    pub delays: usize,
    /// Directions of the rests that are kept at most.
    pub rank: usize,
    /// Whether products of inputs and state are part of it.
    pub products: bool,
}

/// A window whose states are split into what follows from the inputs at once, and the rest.
pub(crate) struct Split {
    m: usize,
    /// Sample numbers, ascending.
    numbers: Vec<i64>,
    centre: Centre,
    input_centre: Centre,
    /// A column an input: `E`, and the sums of its squares over the window.
    inputs: Mat<f64>,
    squares: Vec<f64>,
    /// A column a direction, largest first: `P` and `S`.
    rests: Mat<f64>,
    sizes: Vec<f64>,
    /// Products of the rests' directions with the inputs' parts, `P^T Y^T Y E`.
    cross: Mat<f64>,
}

/// Takes the mean of a window from products with its snapshots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Centre {
    means: Vec<f64>,
    mean: f64,
}

impl Centre {
    fn new(window: &Window) -> Self {
        let m = window.len() as f64;
        let means: Vec<f64> = (0..window.len()).map(|i| window.row(i).iter().sum::<f64>() / m).collect();
        let mean = means.iter().sum::<f64>() / m;
        Centre { means, mean }
    }

    fn of(&self, row: &[f64]) -> Vec<f64> {
        let own = row.iter().sum::<f64>() / row.len() as f64;
        row.iter().zip(&self.means).map(|(p, mean)| p - own - mean + self.mean).collect()
    }

    fn all(&self, window: &Window) -> Mat<f64> {
        let rows: Vec<Vec<f64>> = (0..window.len()).map(|i| self.of(window.row(i))).collect();
        Mat::from_fn(window.len(), window.len(), |i, j| rows[i.max(j)][i.min(j)])
    }
}

impl Split {
    /// `inputs`: the products of what is prescribed alone. None where that does not vary, or all else does not.
    pub fn new(window: &Window, inputs: &Window, most: usize) -> Option<Self> {
        let (centre, input_centre) = (Centre::new(window), Centre::new(inputs));
        let (own, squares) = directions(&input_centre.all(inputs), SMALL * SMALL, INPUTS + 1)?;
        if squares.len() > INPUTS {
            return None;
        }
        let all = centre.all(window);
        let answers = &all * &own;
        // What is left of each state: (1 - E E^T) C (1 - E E^T)
        let once = &all - &answers * own.transpose();
        let left = &once - &own * (own.transpose() * &once);
        let (rests, values) = directions(&left, ROUNDING * ROUNDING, most)?;
        let cross = rests.transpose() * &answers;
        let sizes = values.iter().map(|v| v.sqrt()).collect();
        let numbers = window.numbers().to_vec();
        Some(Split {
            m: window.len(),
            numbers,
            centre,
            input_centre,
            inputs: own,
            squares,
            rests,
            sizes,
            cross,
        })
    }

    /// With so many directions at most. None where there are too few states.
    pub fn fit(&self, shape: DrivenShape) -> Option<Driven> {
        let (m, q, k) = (self.m, shape.delays, self.squares.len());
        let r = shape.rank.min(self.sizes.len());
        let mut driven = Driven {
            shape: DrivenShape { rank: r, ..shape },
            m,
            centre: self.centre.clone(),
            input_centre: self.input_centre.clone(),
            raise_inputs: flat(&self.inputs, k),
            squares: self.squares.clone(),
            raise: (0..m)
                .flat_map(|i| (0..r).map(move |j| self.rests[(i, j)] / self.sizes[j] * self.sizes[0]))
                .collect(),
            sizes: self.sizes[..r].to_vec(),
            cross: (0..r).flat_map(|j| (0..k).map(move |l| self.cross[(j, l)])).collect(),
            weights: Vec::new(),
            range: Vec::new(),
            farthest: 0.0,
        };
        let scale = (m as f64).sqrt();
        let rests: Vec<Vec<f64>> = (0..m)
            .map(|i| (0..r).map(|j| scale * self.rests[(i, j)] * self.sizes[j] / self.sizes[0]).collect())
            .collect();
        let inputs: Vec<Vec<f64>> =
            (0..m).map(|i| (0..k).map(|l| scale * self.inputs[(i, l)]).collect()).collect();
        // States that follow each other: the solver's stretches between jumps.
        let starts = starts(&self.numbers, q);
        let n = starts.len();
        if n < 2 || r == 0 {
            return None;
        }
        let of = |&i: &usize| features(&rests[i..i + q], &inputs[i..=i + q], shape.products);
        let features: Vec<Vec<f64>> = starts.iter().map(of).collect();
        // W = B V S^-2 V^T A^T, of A^T A = V S^2 V^T
        let a = Mat::from_fn(features[0].len(), n, |f, i| features[i][f]);
        let b = Mat::from_fn(r, n, |j, i| rests[starts[i] + q][j]);
        let (vectors, values) = directions(&(a.transpose() * &a), CUT * CUT, n)?;
        let inverse = Mat::from_fn(n, values.len(), |i, s| vectors[(i, s)] / values[s]);
        let weights = (&b * &inverse) * (vectors.transpose() * a.transpose());
        driven.weights = flat(&weights, weights.ncols());
        driven.farthest = rests.iter().map(|z| length(z)).fold(0.0, f64::max);
        driven.range = (0..k)
            .map(|l| {
                let of = |pick: fn(f64, f64) -> f64, from: f64| inputs.iter().map(|v| v[l]).fold(from, pick);
                [of(f64::min, f64::INFINITY), of(f64::max, f64::NEG_INFINITY)]
            })
            .collect();
        driven.weights.iter().all(|w| w.is_finite()).then_some(driven)
    }
}

fn flat(a: &Mat<f64>, columns: usize) -> Vec<f64> {
    (0..a.nrows()).flat_map(|i| (0..columns).map(move |k| a[(i, k)])).collect()
}

fn length(z: &[f64]) -> f64 {
    z.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// What the next state follows from: the last states and their inputs, oldest first, and the next one's inputs.
fn features(rests: &[Vec<f64>], inputs: &[Vec<f64>], products: bool) -> Vec<f64> {
    let mut all: Vec<f64> = rests.iter().chain(inputs).flatten().copied().collect();
    all.push(1.0);
    if products {
        let (now, next) = (&inputs[inputs.len() - 2], &inputs[inputs.len() - 1]);
        for (a, b) in now.iter().zip(next) {
            let others = rests[rests.len() - 1].iter().chain(now).chain(next);
            all.extend(others.map(|other| 0.5 * (a + b) * other));
        }
    }
    all
}

/// What a window of snapshots and the inputs from now on say of later times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Driven {
    pub(crate) shape: DrivenShape,
    m: usize,
    centre: Centre,
    input_centre: Centre,
    /// Snapshots times inputs, `E`.
    raise_inputs: Vec<f64>,
    squares: Vec<f64>,
    /// Snapshots times directions, `P S^-1`, over the largest of S.
    raise: Vec<f64>,
    sizes: Vec<f64>,
    /// Directions times inputs.
    cross: Vec<f64>,
    /// Directions times features, W.
    weights: Vec<f64>,
    /// Least and largest of each input in the window, and the farthest of its rests.
    range: Vec<[f64; 2]>,
    farthest: f64,
}

impl Driven {
    /// Inputs.
    pub fn inputs(&self) -> usize {
        self.squares.len()
    }

    /// The inputs of a state from the products of what is prescribed in it with that of the window's snapshots.
    pub(crate) fn input(&self, row: &[f64]) -> Vec<f64> {
        let (k, centred) = (self.inputs(), self.input_centre.of(row));
        let of =
            |l: usize| centred.iter().enumerate().map(|(i, c)| self.raise_inputs[i * k + l] * c).sum::<f64>();
        (0..k).map(|l| (self.m as f64).sqrt() * of(l) / self.squares[l]).collect()
    }

    /// Square of the difference of inputs, over that of what they vary by in the window.
    pub(crate) fn square(&self, a: &[f64], b: &[f64]) -> f64 {
        let off: f64 =
            a.iter().zip(b).zip(&self.squares).map(|((a, b), square)| square * (a - b).powi(2)).sum();
        off / self.squares.iter().sum::<f64>()
    }

    /// The rest of a state from its products with the window's snapshots, and its inputs.
    pub(crate) fn rest(&self, row: &[f64], input: &[f64]) -> Vec<f64> {
        let (r, k, scale) = (self.shape.rank, self.inputs(), (self.m as f64).sqrt());
        let centred = self.centre.of(row);
        let of = |j: usize| {
            let product: f64 = centred.iter().enumerate().map(|(i, c)| self.raise[i * r + j] * c).sum();
            let answers: f64 = input.iter().enumerate().map(|(l, v)| self.cross[j * k + l] * v).sum();
            scale * product / self.sizes[0].powi(2) - answers / (self.sizes[j] * self.sizes[0])
        };
        (0..r).map(of).collect()
    }

    /// The rests of the states after these: one for each further input. Says why there are none.
    pub(crate) fn follow(&self, rests: &[Vec<f64>], inputs: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, String> {
        let (q, mut all) = (self.shape.delays, rests.to_vec());
        for next in rests.len()..inputs.len() {
            for (v, [least, most]) in inputs[next].iter().zip(&self.range) {
                let beyond = BEYOND * (most - least);
                if !(least - beyond..=most + beyond).contains(v) {
                    return Err("an input goes beyond what the fit has seen: the solver goes on".into());
                }
            }
            let features = features(&all[next - q..next], &inputs[next - q..=next], self.shape.products);
            let rows = self.weights.chunks_exact(features.len());
            let z: Vec<f64> = rows.map(|row| row.iter().zip(&features).map(|(w, f)| w * f).sum()).collect();
            let far = length(&z);
            if far.is_nan() || far > FAR * self.farthest {
                return Err("the fit leaves what it has seen: the solver goes on".into());
            }
            all.push(z);
        }
        Ok(all)
    }

    /// A state of these inputs and this rest, as weights of the window's snapshots, whose sum is 1.
    pub(crate) fn weights(&self, rest: &[f64], input: &[f64]) -> Vec<f64> {
        let (r, k, scale) = (self.shape.rank, self.inputs(), 1.0 / (self.m as f64).sqrt());
        let mut weights: Vec<f64> = (0..self.m)
            .map(|i| {
                let own: f64 = input.iter().zip(&self.raise_inputs[i * k..]).map(|(v, e)| v * e).sum();
                let left: f64 = rest.iter().zip(&self.raise[i * r..]).map(|(z, p)| z * p).sum();
                scale * (own + left)
            })
            .collect();
        let mean = (1.0 - weights.iter().sum::<f64>()) / self.m as f64;
        weights.iter_mut().for_each(|w| *w += mean);
        weights
    }
}
