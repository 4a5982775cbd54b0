//! The dominant frequency of a short, coarsely sampled signal, and its statistics.

/// What oscillates in a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillation {
    /// Frequency, 1/s.
    pub frequency: f64,
    /// Amplitude of the sine, in the signal's unit.
    pub amplitude: f64,
    /// Part of the detrended signal's variance that the sine explains, 0 to 1.
    pub explained: f64,
}

/// Fewest samples that a frequency is looked for in.
const MIN_SAMPLES: usize = 8;
/// Fewest periods in the record: below, a drift and an oscillation are not told apart.
const MIN_PERIODS: f64 = 1.5;
/// Trial frequencies per resolution cell 1/T.
const OVERSAMPLING: f64 = 16.0;
/// Least part of the variance that the sine must explain; noise alone explains some 4 / samples.
const MIN_EXPLAINED: f64 = 0.2;

/// The sine that fits the signal best beside a straight line, in Hann-weighted least squares.
///
/// The weighted fit of `1, t, cos 2 pi f t, sin 2 pi f t` at each frequency is the least-squares spectrum (Lomb and
/// Scargle, with the trend fitted together with the sine, so that neither disturbs the other); its maximum is then
/// refined by golden-section search. Times need not be equidistant. Frequencies up to 1/2 of the median sampling rate.
///
/// None: fewer than 8 samples, fewer than 1.5 periods, or no sine that explains a fifth of the variance.
pub fn dominant_oscillation(times: &[f64], values: &[f64]) -> Option<Oscillation> {
    let n = times.len().min(values.len());
    if n < MIN_SAMPLES {
        return None;
    }
    let fit = Fit::new(&times[..n], &values[..n])?;
    let duration = times[n - 1] - times[0];
    let mut steps: Vec<f64> = times[..n].windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let (lowest, highest) = (MIN_PERIODS / duration, 0.5 / steps[steps.len() / 2]);
    let spacing = 1.0 / (OVERSAMPLING * duration);
    let trials = ((highest - lowest) / spacing).floor();
    if !trials.is_finite() || trials < 1.0 {
        return None;
    }
    let best = (0..=trials as usize)
        .map(|k| lowest + k as f64 * spacing)
        .map(|f| (f, fit.explained(f)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let frequency = maximum(|f| fit.explained(f), (best.0 - spacing).max(0.5 * lowest), best.0 + spacing);
    let explained = fit.explained(frequency);
    let amplitude = fit.amplitude(frequency)?;
    (explained >= MIN_EXPLAINED).then_some(Oscillation { frequency, amplitude, explained })
}

/// Most means over equal intervals that rows are made into.
const MOST_MEANS: usize = 4096;
/// Part of the fluctuation that must be left in them.
const LEFT: f64 = 0.9;

/// As [`dominant_oscillation`], of many rows at times that may be far from equidistant: of their means over equal intervals, as many as
/// leave what varies. None as well where it varies faster than can be told.
pub fn oscillation_of_rows(times: &[f64], values: &[f64]) -> Option<Oscillation> {
    if times.len() <= MOST_MEANS / 16 {
        return dominant_oscillation(times, values);
    }
    let all = fluctuation(times, values);
    let counts = std::iter::successors(Some(MOST_MEANS / 8), |n| (*n < MOST_MEANS).then_some(2 * n));
    for count in counts {
        let (middles, means) = interval_means(times, values, count);
        if fluctuation(&middles, &means) >= LEFT * all {
            return dominant_oscillation(&middles, &means);
        }
    }
    None
}

/// Means over so many equal intervals of the line through the values, and the middles of these.
fn interval_means(times: &[f64], values: &[f64], count: usize) -> (Vec<f64>, Vec<f64>) {
    let (first, last) = (times[0], times[times.len() - 1]);
    let step = (last - first) / count as f64;
    let (mut i, mut before) = (0, 0.0);
    // The integral up to a time; times ascend.
    let mut integral = |t: f64| {
        while i + 2 < times.len() && times[i + 1] <= t {
            before += 0.5 * (times[i + 1] - times[i]) * (values[i] + values[i + 1]);
            i += 1;
        }
        let (width, here) = (times[i + 1] - times[i], t - times[i]);
        let slope = if width > 0.0 { (values[i + 1] - values[i]) / width } else { 0.0 };
        before + here * (values[i] + 0.5 * slope * here)
    };
    let edges: Vec<f64> = (0..=count).map(|k| integral(first + k as f64 * step)).collect();
    let middles = (0..count).map(|k| first + (k as f64 + 0.5) * step).collect();
    (middles, edges.windows(2).map(|e| (e[1] - e[0]) / step).collect())
}

/// Mean over time of the line through the values; of one time its value, 0 for none.
pub fn mean(times: &[f64], values: &[f64]) -> f64 {
    let weights = weights(times);
    let all: f64 = weights.iter().sum();
    weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>() / all.max(f64::MIN_POSITIVE)
}

/// Root mean square over time of the deviations from the mean.
pub fn fluctuation(times: &[f64], values: &[f64]) -> f64 {
    let m = mean(times, values);
    mean(times, &values.iter().map(|v| (v - m).powi(2)).collect::<Vec<_>>()).sqrt()
}

/// The time that each of these stands for: half of the intervals beside it.
fn weights(times: &[f64]) -> Vec<f64> {
    let n = times.len();
    if n < 2 {
        return vec![1.0; n];
    }
    (0..n).map(|i| 0.5 * (times[(i + 1).min(n - 1)] - times[i.saturating_sub(1)])).collect()
}

/// The middle value, or the mean of the two in the middle; none of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    (n > 0).then(|| 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]))
}

/// Weighted least squares of a line and a sine.
struct Fit<'a> {
    times: Vec<f64>,
    values: &'a [f64],
    weights: Vec<f64>,
    /// Weighted sum of squares left by the line alone.
    around_line: f64,
}

impl<'a> Fit<'a> {
    fn new(times: &[f64], values: &'a [f64]) -> Option<Self> {
        let (first, last) = (*times.first()?, *times.last()?);
        let (centre, duration) = (0.5 * (first + last), last - first);
        let step = duration / (times.len() - 1) as f64;
        // The window reaches one sample beyond the record, so that no sample has weight zero.
        let phase = |t: f64| std::f64::consts::TAU * (t - first + step) / (duration + 2.0 * step);
        let weights: Vec<f64> = times.iter().map(|&t| 0.5 - 0.5 * phase(t).cos()).collect();
        let times = times.iter().map(|t| t - centre).collect();
        let mut fit = Fit { times, values, weights, around_line: 0.0 };
        let line = fit.solve(|t| [1.0, t])?;
        fit.around_line = fit.residual(|t| line[0] + line[1] * t);
        let scale: f64 = fit.weights.iter().zip(values).map(|(w, v)| w * v * v).sum();
        (fit.around_line > 1e-24 * scale && fit.around_line.is_finite()).then_some(fit)
    }

    fn basis(frequency: f64) -> impl Fn(f64) -> [f64; 4] {
        move |t| {
            let (sin, cos) = (std::f64::consts::TAU * frequency * t).sin_cos();
            [1.0, t, cos, sin]
        }
    }

    fn explained(&self, frequency: f64) -> f64 {
        let basis = Self::basis(frequency);
        let Some(c) = self.solve(&basis) else { return 0.0 };
        let left = self.residual(|t| basis(t).iter().zip(&c).map(|(b, c)| b * c).sum());
        1.0 - left / self.around_line
    }

    fn amplitude(&self, frequency: f64) -> Option<f64> {
        self.solve(Self::basis(frequency)).map(|c| c[2].hypot(c[3]))
    }

    fn residual(&self, model: impl Fn(f64) -> f64) -> f64 {
        let terms = self.times.iter().zip(self.values).zip(&self.weights);
        terms.map(|((&t, v), w)| w * (v - model(t)).powi(2)).sum()
    }

    /// Coefficients of the weighted normal equations; none where they are singular.
    fn solve<const M: usize>(&self, basis: impl Fn(f64) -> [f64; M]) -> Option<[f64; M]> {
        let mut matrix = [[0.0; M]; M];
        let mut right = [0.0; M];
        for ((&t, &value), &w) in self.times.iter().zip(self.values).zip(&self.weights) {
            let b = basis(t);
            for i in 0..M {
                right[i] += w * b[i] * value;
                for j in 0..M {
                    matrix[i][j] += w * b[i] * b[j];
                }
            }
        }
        eliminate(matrix, right)
    }
}

/// Gaussian elimination with row pivots.
pub(crate) fn eliminate<const M: usize>(mut a: [[f64; M]; M], mut b: [f64; M]) -> Option<[f64; M]> {
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
    // Each round shrinks the bracket by 0.618: 40 rounds, below 1e-8 of it.
    for _ in 0..40 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn record(duration: f64, step: f64, signal: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> =
            (0..=(duration / step).round() as usize).map(|i| 1.0 + i as f64 * step).collect();
        let values = times.iter().map(|&t| signal(t)).collect();
        (times, values)
    }

    #[test]
    fn pure_sine_is_found_exactly() {
        // 3.7 Hz over 5 s, five samples a period.
        let (times, values) =
            record(5.0, 1.0 / (5.0 * 3.7), |t| 0.8 * (std::f64::consts::TAU * 3.7 * t + 0.4).sin());
        let found = dominant_oscillation(&times, &values).unwrap();
        assert!((found.frequency - 3.7).abs() < 1e-6, "{found:?}");
        assert!((found.amplitude - 0.8).abs() < 1e-6 && found.explained > 1.0 - 1e-9, "{found:?}");
    }

    #[test]
    fn noise_drift_and_offset_cost_less_than_one_per_cent() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for trial in 0..50 {
            let f = 1.5 + 4.0 * rng.random::<f64>();
            let noise: Vec<f64> = (0..400).map(|_| rng.random::<f64>() - 0.5).collect();
            let (times, mut values) = record(5.0, 1.0 / (5.0 * f), |t| {
                3.0 + 0.5 * t + (std::f64::consts::TAU * f * t + trial as f64).sin()
            });
            // Uniform noise with a root mean square of 0.2, a fifth of the amplitude.
            values.iter_mut().zip(&noise).for_each(|(v, e)| *v += 0.2 * 12.0_f64.sqrt() * e);
            let found = dominant_oscillation(&times, &values).unwrap();
            assert!((found.frequency / f - 1.0).abs() < 0.01, "trial {trial}: {f} found as {found:?}");
        }
    }

    #[test]
    fn the_fundamental_wins_over_a_third_harmonic() {
        let w = std::f64::consts::TAU * 2.0;
        let (times, values) = record(4.0, 0.02, |t| (w * t).sin() + 0.3 * (3.0 * w * t).sin());
        let found = dominant_oscillation(&times, &values).unwrap();
        assert!((found.frequency - 2.0).abs() < 0.002, "{found:?}");
    }

    /// A row a solver step and a row a stride, as a run with jumps has them.
    #[test]
    fn rows_weigh_by_their_time() {
        let mut times = vec![0.0];
        while times[times.len() - 1] < 100.0 {
            let solver = times.len() % 60 < 40;
            times.push(times[times.len() - 1] + if solver { 0.005 } else { 0.25 });
        }
        let wave = |t: f64| 2.0 + (std::f64::consts::TAU * 0.163 * t).sin();
        let values: Vec<f64> = times.iter().map(|&t| wave(t)).collect();
        assert!(times.len() > MOST_MEANS / 16);
        let found = oscillation_of_rows(&times, &values).unwrap().frequency;
        assert!((found / 0.163 - 1.0).abs() < 2e-3, "{found}");
        assert!((mean(&times, &values) - 2.0).abs() < 0.02);
        // Two rows stand for as little as the time between them
        let (middles, means) = interval_means(&[0.0, 1.0, 4.0], &[0.0, 2.0, 2.0], 2);
        assert_eq!((middles, means), (vec![1.0, 3.0], vec![1.5, 2.0]));
    }

    #[test]
    fn unequal_steps_are_allowed() {
        let times: Vec<f64> = (0..60).map(|i| 0.05 * i as f64 + 0.01 * (i % 3) as f64).collect();
        let values: Vec<f64> = times.iter().map(|t| (std::f64::consts::TAU * 2.3 * t).cos()).collect();
        assert!((dominant_oscillation(&times, &values).unwrap().frequency - 2.3).abs() < 1e-6);
    }

    #[test]
    fn steady_lines_noise_and_short_records_have_no_frequency() {
        let (times, values) = record(5.0, 0.05, |t| 2.0 - 0.1 * t);
        assert_eq!(dominant_oscillation(&times, &values), None);
        assert_eq!(dominant_oscillation(&times, &vec![1.0; times.len()]), None);
        assert_eq!(dominant_oscillation(&times[..5], &values[..5]), None);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let noise: Vec<f64> = (0..times.len()).map(|_| rng.random::<f64>()).collect();
        assert_eq!(dominant_oscillation(&times, &noise), None);
    }

    #[test]
    fn statistics_of_a_known_list() {
        let times = [0.0, 1.0, 3.0, 4.0];
        assert_eq!(mean(&times, &[1.0, 2.0, 6.0, 2.0]), (1.5 + 8.0 + 4.0) / 4.0);
        assert!((fluctuation(&times, &[1.0, -1.0, 1.0, -1.0]) - 1.0).abs() < 1e-15);
        assert_eq!((mean(&[], &[]), mean(&[1.0], &[5.0])), (0.0, 5.0));
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 9.0]), Some(3.0));
        assert_eq!(median([]), None);
    }
}
