//! Higher-order dynamic mode decomposition (Le Clainche and Vega, SIAM J. Appl. Dyn. Syst. 16, 2017) in the space of the
//! snapshots: nothing in it is as long as a state.
//!
//! With the delayed states `h_k = (x_k, ..., x_{k+q-1})`, the mean of the window taken from each, `A` the delayed states that have a
//! successor and `B` their successors, `A = U S V^T` reduced to `r` directions, the operator is `M = U^T B V S^-1`. All of it follows from
//! inner products of the snapshots: `A^T A = V S^2 V^T`, `M = S^-1 V^T A^T B V S^-1`.

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side, c64};
use serde::{Deserialize, Serialize};

/// Directions whose singular value is below this times the largest are rounding.
const ROUNDING: f64 = 1e-6;

/// What is chosen of a decomposition beside its snapshots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shape {
    /// States of a delayed state, q.
    pub delays: usize,
    /// Directions that are kept at most, r.
    pub rank: usize,
    /// Whether modes that grow go on growing; otherwise their eigenvalues are brought to the unit circle.
    pub growing: bool,
}

/// Inner products of the snapshots of a window, and which of them follow each other.
pub struct Window {
    /// Snapshots.
    m: usize,
    /// m times m, of differences from any common state.
    products: Vec<f64>,
    /// Sample numbers, ascending.
    numbers: Vec<i64>,
}

impl Window {
    /// Of the products of the snapshots with these sample numbers, in their order.
    pub fn new(numbers: Vec<i64>, products: Vec<f64>) -> Self {
        Window { m: numbers.len(), products, numbers }
    }

    /// Its first or last snapshots.
    pub fn part(&self, range: std::ops::Range<usize>) -> Window {
        let rows = range.clone().map(|i| &self.products[i * self.m..][range.clone()]);
        Window::new(self.numbers[range.clone()].to_vec(), rows.flatten().copied().collect())
    }

    /// Snapshots.
    pub fn len(&self) -> usize {
        self.m
    }

    /// Sample numbers, ascending.
    pub fn numbers(&self) -> &[i64] {
        &self.numbers
    }

    /// Products of a snapshot with all.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.products[i * self.m..][..self.m]
    }

    /// Whether its snapshots are all the same.
    pub fn is_still(&self) -> bool {
        let square = |i: usize, j: usize| self.row(i)[i] - 2.0 * self.row(i)[j] + self.row(j)[j];
        (1..self.m).all(|i| square(i, 0) <= 0.0)
    }
}

/// Places of delayed states that have a successor, of snapshots with these sample numbers.
pub(crate) fn starts(numbers: &[i64], delays: usize) -> Vec<usize> {
    let follows = |i: &usize| numbers[i + delays] - numbers[*i] == delays as i64;
    (0..numbers.len().saturating_sub(delays)).filter(follows).collect()
}

/// Eigenvectors of a symmetric matrix whose values are above a part of the largest, and these values: largest first, `most` at most.
pub(crate) fn directions(of: &Mat<f64>, part: f64, most: usize) -> Option<(Mat<f64>, Vec<f64>)> {
    let n = of.nrows();
    let eigen = of.self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let largest = values[n - 1];
    if largest.is_nan() || largest <= 0.0 {
        return None;
    }
    let count = (0..n).filter(|&i| values[i] > part * largest).count().min(most);
    let columns = Mat::from_fn(n, count, |i, k| vectors[(i, n - 1 - k)]);
    Some((columns, (0..count).map(|k| values[n - 1 - k]).collect()))
}

/// The delayed states of a window, decomposed once for all ranks of a fit.
pub struct Delayed {
    delays: usize,
    m: usize,
    starts: Vec<usize>,
    /// `V S^-1`, a column a direction, largest first.
    lift: Mat<f64>,
    /// M of all directions; that of fewer is its leading block.
    operator: Mat<f64>,
    /// Means of the products' rows, and the mean of all.
    means: Vec<f64>,
    mean: f64,
}

/// Growth a stride up to which a mode is part of a trend: a linear one is two modes next to 1, on either side, and without one of them
/// half of it would be lost. It grows by a thousandth over 1000 strides.
const TREND: f64 = 1e-6;

impl Delayed {
    /// None where the window has too few delayed states, or does not vary.
    pub fn new(window: &Window, delays: usize, most: usize) -> Option<Self> {
        let (m, starts) = (window.m, starts(&window.numbers, delays));
        if starts.len() < 2 || delays == 0 {
            return None;
        }
        let means: Vec<f64> = (0..m).map(|i| window.row(i).iter().sum::<f64>() / m as f64).collect();
        let mean = means.iter().sum::<f64>() / m as f64;
        let centred = Mat::from_fn(m, m, |i, j| window.products[i * m + j] - means[i] - means[j] + mean);
        let sum = |i: usize, j: usize| (0..delays).map(|l| centred[(i + l, j + l)]).sum::<f64>();
        let n = starts.len();
        let own = Mat::from_fn(n, n, |a, b| sum(starts[a.max(b)], starts[a.min(b)]));
        let next = Mat::from_fn(n, n, |a, b| sum(starts[a], starts[b] + 1));
        let (vectors, values) = directions(&own, ROUNDING * ROUNDING, most)?;
        if values.is_empty() {
            return None;
        }
        let lift = Mat::from_fn(n, values.len(), |i, k| vectors[(i, k)] / values[k].sqrt());
        let operator = lift.transpose() * &next * &lift;
        Some(Delayed { delays, m, starts, lift, operator, means, mean })
    }

    /// Directions that are there.
    pub fn rank(&self) -> usize {
        self.lift.ncols()
    }

    /// The decomposition with `rank` directions at most. None where its eigenvalue problem has no solution.
    pub fn modes(&self, rank: usize, growing: bool) -> Option<Dmd> {
        let r = rank.min(self.rank());
        let eigen = self.operator.submatrix(0, 0, r, r).to_owned().eigen().ok()?;
        let found = eigen.S().column_vector();
        let mut order: Vec<usize> = (0..r).collect();
        let key = |i: usize| (found[i].re.hypot(found[i].im), found[i].im.atan2(found[i].re));
        order.sort_by(|&a, &b| {
            let ((size_a, angle_a), (size_b, angle_b)) = (key(a), key(b));
            let angles = angle_a.abs().total_cmp(&angle_b.abs()).then(angle_b.total_cmp(&angle_a));
            size_b.total_cmp(&size_a).then(angles)
        });
        // Of length 1, so that amplitudes compare.
        let length = |k: usize| (0..r).map(|i| eigen.U()[(i, order[k])].norm_sqr()).sum::<f64>().sqrt();
        let lengths: Vec<f64> = (0..r).map(length).collect();
        let modes = Mat::from_fn(r, r, |i, k| eigen.U()[(i, order[k])] * (1.0 / lengths[k]));
        let inverse = modes.partial_piv_lu().inverse();
        if !(0..r).all(|i| (0..r).all(|k| inverse[(i, k)].re.is_finite() && inverse[(i, k)].im.is_finite())) {
            return None;
        }
        let eigenvalues = order.iter().map(|&i| [found[i].re, found[i].im]).map(|[re, im]| {
            let size = re.hypot(im);
            if size > 1.0 + TREND && !growing { [re / size, im / size] } else { [re, im] }
        });
        let lift = self.lift.submatrix(0, 0, self.starts.len(), r);
        // From amplitudes to the weights of the delayed states, and back from products with them.
        let lift = Mat::from_fn(lift.nrows(), r, |i, k| c64::new(lift[(i, k)], 0.0));
        Some(Dmd {
            shape: Shape { delays: self.delays, rank: r, growing },
            m: self.m,
            starts: self.starts.clone(),
            eigenvalues: eigenvalues.collect(),
            raise: flat(&(&lift * &modes)),
            lower: flat(&(&inverse * lift.transpose())),
            means: self.means.clone(),
            mean: self.mean,
        })
    }
}

fn flat(a: &Mat<c64>) -> Vec<[f64; 2]> {
    let rows = (0..a.nrows()).flat_map(|i| (0..a.ncols()).map(move |k| a[(i, k)]));
    rows.map(|v| [v.re, v.im]).collect()
}

/// A decomposition: what a window of snapshots says of any later time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dmd {
    /// What it was made with; the rank is that which was there.
    pub shape: Shape,
    m: usize,
    starts: Vec<usize>,
    eigenvalues: Vec<[f64; 2]>,
    /// Delayed states times modes: `V S^-1 P`.
    raise: Vec<[f64; 2]>,
    /// Modes times delayed states: `P^-1 S^-1 V^T`.
    lower: Vec<[f64; 2]>,
    means: Vec<f64>,
    mean: f64,
}

impl Dmd {
    /// That of a window of so many snapshots that are all the same: their mean at any time.
    pub fn still(snapshots: usize) -> Self {
        Dmd {
            shape: Shape { delays: 1, rank: 0, growing: false },
            m: snapshots,
            starts: Vec::new(),
            eigenvalues: Vec::new(),
            raise: Vec::new(),
            lower: Vec::new(),
            means: vec![0.0; snapshots],
            mean: 0.0,
        }
    }

    /// Snapshots of its window.
    pub fn snapshots(&self) -> usize {
        self.m
    }

    /// Eigenvalues of a stride (real and imaginary part): largest first, of a pair the one above the real axis first.
    pub fn eigenvalues(&self) -> &[[f64; 2]] {
        &self.eigenvalues
    }

    /// Amplitudes of the modes at present. `history`: products of the last `delays` states with the window's snapshots, oldest first.
    pub fn amplitudes(&self, history: &[&[f64]]) -> Vec<[f64; 2]> {
        let r = self.eigenvalues.len();
        let offsets: Vec<f64> = history.iter().map(|row| row.iter().sum::<f64>() / self.m as f64).collect();
        let mut amplitudes = vec![[0.0; 2]; r];
        for (a, &start) in self.starts.iter().enumerate() {
            let terms = history.iter().zip(&offsets).enumerate();
            let product: f64 =
                terms.map(|(l, (row, o))| row[start + l] - o - self.means[start + l] + self.mean).sum();
            for (k, amplitude) in amplitudes.iter_mut().enumerate() {
                let [re, im] = self.lower[k * self.starts.len() + a];
                amplitude[0] += re * product;
                amplitude[1] += im * product;
            }
        }
        amplitudes
    }

    /// The state `strides` after the present, as weights of the window's snapshots, whose sum is 1.
    pub fn weights(&self, amplitudes: &[[f64; 2]], strides: f64) -> Vec<f64> {
        let r = self.eigenvalues.len();
        let now: Vec<[f64; 2]> = (0..r).map(|k| self.later(k, amplitudes[k], strides)).collect();
        let mut weights = vec![0.0; self.m];
        let mut sum = 0.0;
        for (a, &start) in self.starts.iter().enumerate() {
            let row = &self.raise[a * r..][..r];
            let w: f64 = row.iter().zip(&now).map(|(p, y)| p[0] * y[0] - p[1] * y[1]).sum();
            weights[start + self.shape.delays - 1] += w;
            sum += w;
        }
        let rest = (1.0 - sum) / self.m as f64;
        weights.iter_mut().for_each(|w| *w += rest);
        weights
    }

    /// The amplitude of mode `k` so many strides later.
    fn later(&self, k: usize, [x, y]: [f64; 2], strides: f64) -> [f64; 2] {
        let [re, im] = self.eigenvalues[k];
        let (size, angle) = (re.hypot(im).powf(strides), im.atan2(re) * strides);
        let (c, s) = (size * angle.cos(), size * angle.sin());
        [c * x - s * y, c * y + s * x]
    }

    /// What mode `k` and its conjugate add to the mean of the window `strides` after the present, and a quarter of their period before that (0 where
    /// they do not oscillate), as weights of the window's snapshots, whose sum is 0.
    pub fn shape_of(&self, amplitudes: &[[f64; 2]], k: usize, strides: f64) -> [Vec<f64>; 2] {
        let (r, oscillates) = (self.eigenvalues.len(), self.oscillates(k));
        let both = if oscillates { 2.0 } else { 1.0 };
        let [x, y] = self.later(k, amplitudes[k], strides).map(|v| both * v);
        let mut parts = [vec![0.0; self.m], vec![0.0; self.m]];
        for (a, &start) in self.starts.iter().enumerate() {
            let ([p, q], last) = (self.raise[a * r + k], start + self.shape.delays - 1);
            parts[0][last] += p * x - q * y;
            parts[1][last] += if oscillates { p * y + q * x } else { 0.0 };
        }
        for part in &mut parts {
            let mean = part.iter().sum::<f64>() / self.m as f64;
            part.iter_mut().for_each(|w| *w -= mean);
        }
        parts
    }
}
