//! Least squares of a sine beside a straight line.

use crate::Row;

/// Part of the variance that a sine must explain to be one; noise alone explains some 4 / values.
const MIN_EXPLAINED: f64 = 0.2;

/// The frequency, 1/s, of the sine that fits the rows best within `step` about `frequency`, beside a straight line; none where no sine explains
/// a fifth of the variance.
///
/// The fit of `1, t, cos 2 pi f t, sin 2 pi f t` weighs rows by Hann's window and by the time that they stand for. It is the least-squares
/// spectrum (Lomb and Scargle, with the trend fitted together with the sine, so that neither disturbs the other); its maximum is found
/// by golden-section search. Times need not be equidistant.
pub fn refined(rows: &[Row], frequency: f64, step: f64) -> Option<f64> {
    let fit = Fit::new(rows)?;
    let found = maximum(|f| fit.explained(f), (frequency - step).max(0.5 * frequency), frequency + step);
    (fit.explained(found) >= MIN_EXPLAINED).then_some(found)
}

/// Weighted least squares of a line and a sine.
struct Fit {
    /// Over the duration: in seconds the equations of a record of microseconds, or of months, look singular.
    times: Vec<f64>,
    duration: f64,
    /// About the line that fits best: there is nothing large for a small sine to be lost in.
    values: Vec<f64>,
    weights: Vec<f64>,
    /// Weighted sum of squares of the values.
    around_line: f64,
}

impl Fit {
    fn new(rows: &[Row]) -> Option<Self> {
        let (first, last) = (rows.first()?.time, rows.last()?.time);
        let (centre, duration) = (0.5 * (first + last), last - first);
        let step = duration / rows.len() as f64;
        // The window reaches one row beyond the record, so that none has weight zero.
        let phase = |t: f64| std::f64::consts::TAU * (t - first + step) / (duration + 2.0 * step);
        let mut fit = Fit {
            times: rows.iter().map(|r| (r.time - centre) / duration).collect(),
            duration,
            values: rows.iter().map(|r| r.value).collect(),
            weights: rows.iter().map(|r| r.weight * (0.5 - 0.5 * phase(r.time).cos())).collect(),
            around_line: 0.0,
        };
        let scale = fit.squares();
        let ([offset, slope], _) = fit.solve(|t| [1.0, t])?;
        fit.values.iter_mut().zip(&fit.times).for_each(|(v, t)| *v -= offset + slope * t);
        fit.around_line = fit.squares();
        (fit.around_line > 1e-24 * scale && fit.around_line.is_finite()).then_some(fit)
    }

    fn squares(&self) -> f64 {
        self.weights.iter().zip(&self.values).map(|(w, v)| w * v * v).sum()
    }

    /// Part of the squares that the best sine of this frequency explains.
    fn explained(&self, frequency: f64) -> f64 {
        let basis = |t: f64| {
            let (sin, cos) = (std::f64::consts::TAU * frequency * self.duration * t).sin_cos();
            [1.0, t, cos, sin]
        };
        let Some((coefficients, right)) = self.solve(basis) else { return 0.0 };
        coefficients.iter().zip(right).map(|(c, r)| c * r).sum::<f64>() / self.around_line
    }

    /// Coefficients and right-hand side of the weighted normal equations; none where they are singular.
    fn solve<const M: usize>(&self, basis: impl Fn(f64) -> [f64; M]) -> Option<([f64; M], [f64; M])> {
        let mut matrix = [[0.0; M]; M];
        let mut right = [0.0; M];
        for ((&t, &value), &w) in self.times.iter().zip(&self.values).zip(&self.weights) {
            let b = basis(t);
            for i in 0..M {
                right[i] += w * b[i] * value;
                for j in 0..M {
                    matrix[i][j] += w * b[i] * b[j];
                }
            }
        }
        Some((eliminate(matrix, right)?, right))
    }
}

/// The solution of a linear system by Gaussian elimination with row pivots; none where it is singular.
pub fn eliminate<const M: usize>(mut a: [[f64; M]; M], mut b: [f64; M]) -> Option<[f64; M]> {
    let scale = a.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
    for k in 0..M {
        let pivot = (k..M).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        if a[pivot][k].abs() <= 1e-13 * scale {
            return None;
        }
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..M {
            let factor = a[i][k] / a[k][k];
            let upper = a[k];
            a[i].iter_mut().zip(upper).skip(k).for_each(|(v, u)| *v -= factor * u);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..M).rev() {
        let known: f64 = (k + 1..M).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    Some(b)
}

/// Golden-section search for the maximum of a function with one peak in `[low, high]`.
fn maximum(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut x1, mut x2) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut f1, mut f2) = (f(x1), f(x2));
    // Each round shrinks the bracket by 0.618: 28 rounds, to some 1e-6 of it.
    for _ in 0..28 {
        if f1 < f2 {
            (low, x1, f1) = (x1, x2, f2);
            x2 = low + ratio * (high - low);
            f2 = f(x2);
        } else {
            (high, x2, f2) = (x2, x1, f1);
            x1 = high - ratio * (high - low);
            f1 = f(x1);
        }
    }
    0.5 * (low + high)
}
