//! The dominant frequency.

use std::f64::consts::TAU;

/// What oscillates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Periods in the record.
    pub periods: f64,
    /// Share of the variance about a straight line that is at this frequency and its harmonics, 0 to 1.
    pub share: f64,
}

/// Fewest periods in a record: below, a drift and an oscillation are not told apart.
const MIN_PERIODS: f64 = 1.5;
/// Most values that a frequency is refined on.
const REFINED_ON: usize = 4096;

/// The strongest line in the spectrum of equidistant values, each the mean over its interval.
///
/// Hann's window on the values about a straight line, transformed with at least as many zeros; the highest frequency is that of
/// 4 values. The least squares fit of a sine refines the maximum.
pub fn dominant(values: &[f64]) -> Option<Line> {
    let n = values.len();
    let centred = about_line(values);
    let power: f64 = centred.iter().map(|v| v * v).sum();
    if n < 8 || power <= 0.0 || !power.is_finite() {
        return None;
    }
    let length = 2 * n.next_power_of_two();
    let mut signal = vec![(0.0, 0.0); length];
    for (i, v) in centred.iter().enumerate() {
        signal[i].0 = v * (0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos());
    }
    transform(&mut signal);
    let spectrum: Vec<f64> = signal[..=length / 2].iter().map(|(re, im)| re * re + im * im).collect();
    // Entries of the spectrum for each period in the record
    let per_period = length as f64 / n as f64;
    let (lowest, highest) = ((MIN_PERIODS * per_period).ceil() as usize, length / 4);
    let best = (lowest..highest).max_by(|a, b| spectrum[*a].total_cmp(&spectrum[*b]))?;
    let total: f64 = spectrum.iter().sum();
    let near = |periods: f64| {
        let half = (0.1 * periods).max(2.0) * per_period;
        let at = periods * per_period;
        let range = (at - half).max(0.0) as usize..((at + half) as usize + 1).min(spectrum.len());
        if range.start >= range.end { 0.0 } else { spectrum[range].iter().sum::<f64>() }
    };
    let found = best as f64 / per_period;
    let periods = refined(&centred, found, 1.0 / per_period);
    let harmonics =
        [2.0, 3.0].map(|k| k * periods).into_iter().filter(|p| *p * per_period < length as f64 / 2.0);
    let share = (near(periods) + harmonics.map(near).sum::<f64>()) / total;
    Some(Line { periods, share: share.min(1.0) })
}

/// The values less the straight line that fits them best.
pub fn about_line(values: &[f64]) -> Vec<f64> {
    let (mean, slope) = line(values);
    let middle = 0.5 * (values.len() as f64 - 1.0);
    values.iter().enumerate().map(|(i, v)| v - mean - slope * (i as f64 - middle)).collect()
}

/// Mean, and slope for each value, of the straight line that fits best.
pub fn line(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let middle = 0.5 * (n - 1.0);
    let along: f64 = values.iter().enumerate().map(|(i, v)| (i as f64 - middle) * (v - mean)).sum();
    (mean, along / (n * (n * n - 1.0) / 12.0).max(f64::MIN_POSITIVE))
}

/// Golden-section search of the frequency whose sine explains most, `step` periods about `periods`.
fn refined(values: &[f64], periods: f64, step: f64) -> f64 {
    let group = values.len().div_ceil(REFINED_ON);
    let coarse: Vec<f64> = values.chunks(group).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    if coarse.len() as f64 <= 4.0 * periods {
        return periods;
    }
    let explained = |p: f64| explained(&coarse, p * group as f64 / values.len() as f64);
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = (periods - step, periods + step);
    let (mut x1, mut x2) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut f1, mut f2) = (explained(x1), explained(x2));
    for _ in 0..24 {
        if f1 < f2 {
            (low, x1, f1) = (x1, x2, f2);
            x2 = low + ratio * (high - low);
            f2 = explained(x2);
        } else {
            (high, x2, f2) = (x2, x1, f1);
            x1 = high - ratio * (high - low);
            f1 = explained(x1);
        }
    }
    0.5 * (low + high)
}

/// Sum of squares that a constant and a sine of this frequency (periods for each value) explain beyond the constant.
fn explained(values: &[f64], frequency: f64) -> f64 {
    let (turn_s, turn_c) = (TAU * frequency).sin_cos();
    let (mut s, mut c) = (0.0_f64, 1.0_f64);
    let n = values.len() as f64;
    let [mut sy, mut ss, mut sc, mut sss, mut scc, mut ssc, mut sys, mut syc] = [0.0; 8];
    for y in values {
        sy += y;
        ss += s;
        sc += c;
        sss += s * s;
        scc += c * c;
        ssc += s * c;
        sys += y * s;
        syc += y * c;
        (s, c) = (s * turn_c + c * turn_s, c * turn_c - s * turn_s);
    }
    let (sss, scc, ssc) = (sss - ss * ss / n, scc - sc * sc / n, ssc - ss * sc / n);
    let (sys, syc) = (sys - sy * ss / n, syc - sy * sc / n);
    let determinant = sss * scc - ssc * ssc;
    if determinant <= 1e-12 * sss * scc {
        return 0.0;
    }
    (sys * sys * scc - 2.0 * sys * syc * ssc + syc * syc * sss) / determinant
}

/// The discrete Fourier transform in place; the length is a power of two.
fn transform(x: &mut [(f64, f64)]) {
    let n = x.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            x.swap(i, j);
        }
    }
    let turns: Vec<(f64, f64)> = (0..n / 2).map(|k| (-TAU * k as f64 / n as f64).sin_cos()).collect();
    let mut half = 1;
    while half < n {
        let stride = n / (2 * half);
        for block in x.chunks_exact_mut(2 * half) {
            let (low, high) = block.split_at_mut(half);
            for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let (s, c) = turns[k * stride];
                let t = (b.0 * c - b.1 * s, b.0 * s + b.1 * c);
                *b = (a.0 - t.0, a.1 - t.1);
                *a = (a.0 + t.0, a.1 + t.1);
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_is_that_of_the_sum() {
        let values: Vec<f64> = (0..16).map(|i| f64::from((i * i) % 7) - 2.0).collect();
        let mut x: Vec<(f64, f64)> = values.iter().map(|v| (*v, 0.0)).collect();
        transform(&mut x);
        for (k, (re, im)) in x.iter().enumerate() {
            let sum = |f: fn(f64) -> f64| -> f64 {
                values.iter().enumerate().map(|(i, v)| v * f(-TAU * (i * k) as f64 / 16.0)).sum()
            };
            assert!((re - sum(f64::cos)).abs() < 1e-12 && (im - sum(f64::sin)).abs() < 1e-12, "{k}");
        }
    }

    #[test]
    fn a_sine_on_a_line_is_found_with_its_periods() {
        for periods in [2.3, 7.0, 40.77, 333.3] {
            let n = 2000;
            let at = |i: i32| f64::from(i) / f64::from(n);
            let values: Vec<f64> =
                (0..n).map(|i| 3.0 + (TAU * periods * at(i) + 1.0).sin() + 0.2 * at(i)).collect();
            let found = dominant(&values).unwrap();
            assert!((found.periods - periods).abs() < 0.05, "{found:?}, not {periods}");
            assert!(found.share > 0.95, "{found:?}");
        }
        assert_eq!(dominant(&[1.0; 100]), None);
    }
}
