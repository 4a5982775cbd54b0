//! A limit cycle as a combination of a run's states.
//!
//! The mean and the harmonics of states at known times, by least squares, are combinations of these states, and so is the cycle at any phase. Its
//! weights need the states' inner products and no more.

use faer::Mat;
use std::f64::consts::TAU;

/// Harmonics of a cycle.
const HARMONICS: usize = 3;
/// The mean, and a cosine and a sine of each harmonic.
const COLUMNS: usize = 2 * HARMONICS + 1;
/// Fewest periods that states cover.
const COVERED: f64 = 0.95;
/// Least over largest singular value of the harmonics at the states' times.
const INDEPENDENT: f64 = 0.05;
/// Root mean square of what mean and harmonics leave of the states, over that of their fluctuations, up to which they are a cycle.
const LEFT: f64 = 0.1;
/// Mean and complex harmonics of a run's states: of the n-th, the real and the imaginary part as combinations of the states.
#[derive(Clone, Debug)]
pub struct Cycle {
    /// Row 0: the mean. Rows 2 n - 1 and 2 n: the coefficients of the cosine and the sine of the n-th harmonic.
    rows: Mat<f64>,
}

impl Cycle {
    /// Whether states at these times can be one: they are enough, and cover a period.
    pub fn covers(times: &[f64], period: f64) -> bool {
        let long = |(first, last): (&f64, &f64)| last - first >= COVERED * period;
        period > 0.0 && times.len() > COLUMNS && times.first().zip(times.last()).is_some_and(long)
    }

    /// Of states at these times; `product`: of the i-th with the j-th one. None: they do not cover a period, or do not repeat themselves.
    pub fn new(times: &[f64], period: f64, product: &dyn Fn(usize, usize) -> f64) -> Option<Cycle> {
        if !Self::covers(times, period) {
            return None;
        }
        let (n, end) = (times.len(), *times.last()?);
        let basis = Mat::from_fn(n, COLUMNS, |i, c| {
            let angle = TAU * c.div_ceil(2) as f64 * (times[i] - end) / period;
            match c {
                0 => 1.0,
                c if c % 2 == 1 => angle.cos(),
                _ => angle.sin(),
            }
        });
        let svd = basis.thin_svd().ok()?;
        let values = svd.S().column_vector();
        if values[COLUMNS - 1] <= INDEPENDENT * values[0] {
            return None;
        }
        let rows = svd.pseudoinverse();
        // Of G, the products: tr(G (1 - P)), where P is the projection that these rows are part of, and the one on the mean
        let fitted = &basis * &rows;
        let rest = |part: &dyn Fn(usize, usize) -> f64| -> f64 {
            (0..n).map(|i| product(i, i) - (0..n).map(|j| product(i, j) * part(i, j)).sum::<f64>()).sum()
        };
        let (left, all) = (rest(&|i, j| fitted[(i, j)]), rest(&|_, _| 1.0 / n as f64));
        (all > 0.0 && left <= LEFT * LEFT * all).then_some(Cycle { rows })
    }

    /// The phase by which this cycle is ahead of another one, by the first harmonics: arg <q, q'>. `product`: of the other's i-th state with
    /// the j-th one of this.
    pub fn ahead_of(&self, other: &Cycle, product: &dyn Fn(usize, usize) -> f64) -> f64 {
        let of = |row: usize, column: usize| -> f64 {
            let of_state = |i: usize| -> f64 {
                let sum: f64 = (0..self.rows.ncols()).map(|j| product(i, j) * self.rows[(column, j)]).sum();
                other.rows[(row, i)] * sum
            };
            (0..other.rows.ncols()).map(of_state).sum()
        };
        // q = (cosine's - i sine's)/2
        let (re, im) = (of(1, 1) + of(2, 2), of(2, 1) - of(1, 2));
        im.atan2(re)
    }

    /// The weights of the states in the cycle at phase 0, which is `phase` behind that of its last state.
    pub fn weights(&self, phase: f64) -> Vec<f64> {
        let weight = |j: usize| {
            let harmonic = |n: usize| {
                let angle = n as f64 * phase;
                self.rows[(2 * n - 1, j)] * angle.cos() - self.rows[(2 * n, j)] * angle.sin()
            };
            self.rows[(0, j)] + (1..=HARMONICS).map(harmonic).sum::<f64>()
        };
        (0..self.rows.ncols()).map(weight).collect()
    }
}
