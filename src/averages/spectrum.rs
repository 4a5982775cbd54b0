//! The dominant frequency.

use crate::{Row, Series, sine};
use realfft::RealFftPlanner;
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
/// Most values that a frequency is looked for in.
pub const MOST_VALUES: usize = 1 << 14;
/// Most values that a frequency is refined on, where each period has four.
const REFINED_ON: usize = 1024;

/// The strongest line in the spectrum of equidistant values, each the mean over its interval.
///
/// Hann's window on the values about a straight line, transformed with at least as many zeros; the fit of a sine ([`sine::refined`])
/// refines the maximum.
pub fn dominant(values: &[f64]) -> Option<Line> {
    let n = values.len();
    let centred = about_line(values);
    let power: f64 = centred.iter().map(|v| v * v).sum();
    if n < 8 || power <= 0.0 || !power.is_finite() {
        return None;
    }
    let length = 2 * n.next_power_of_two();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let (mut signal, mut found) = (transform.make_input_vec(), transform.make_output_vec());
    for (i, (to, v)) in signal.iter_mut().zip(&centred).enumerate() {
        *to = v * (0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos());
    }
    transform.process(&mut signal, &mut found).ok()?;
    let spectrum: Vec<f64> = found.iter().map(|c| c.norm_sqr()).collect();
    // Entries of the spectrum for each period in the record
    let per_period = length as f64 / n as f64;
    let (lowest, highest) = ((MIN_PERIODS * per_period).ceil() as usize, length / 2);
    let best = (lowest..highest).max_by(|a, b| spectrum[*a].total_cmp(&spectrum[*b]))?;
    let total: f64 = spectrum.iter().sum();
    let near = |periods: f64| {
        let half = (0.1 * periods).max(2.0) * per_period;
        let at = periods * per_period;
        let range = (at - half).max(0.0) as usize..((at + half) as usize + 1).min(spectrum.len());
        if range.start >= range.end { 0.0 } else { spectrum[range].iter().sum::<f64>() }
    };
    let found = best as f64 / per_period;
    // Means hide what is faster than they are
    let group = n.div_ceil(REFINED_ON).min((n as f64 / (4.0 * found)) as usize).max(1);
    let row = |(i, c): (usize, &[f64])| Row {
        time: (i as f64 + 0.5) * (group as f64) / n as f64,
        value: c.iter().sum::<f64>() / c.len() as f64,
        weight: c.len() as f64,
        surrogate: false,
    };
    let rows: Vec<Row> = values.chunks(group).enumerate().map(row).collect();
    let periods = sine::refined(&rows, found, 1.0).unwrap_or(found);
    let harmonics =
        [2.0, 3.0].map(|k| k * periods).into_iter().filter(|p| *p * per_period < length as f64 / 2.0);
    let share = (near(periods) + harmonics.map(near).sum::<f64>()) / total;
    Some(Line { periods, share: share.min(1.0) })
}

/// The dominant frequency, 1/s, of values at times that need not be equidistant, each row standing for the time since the one before.
///
/// None for fewer than 8 rows, and where no sine of at least 1.5 periods explains a fifth of the variance about a straight line.
pub fn frequency(times: &[f64], values: &[f64]) -> Option<f64> {
    let series = Series::of(times, values);
    let duration = series.duration();
    let equidistant = series.pieces((0.0, duration), series.len().clamp(1, MOST_VALUES), |r| r.value);
    let found = dominant(&equidistant)?.periods / duration;
    sine::refined(series.rows(), found, 0.5 / duration)
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_sine_on_a_line_is_found_with_its_periods() {
        for (n, periods) in
            [(2000, 2.3), (2000, 7.0), (2000, 40.77), (2000, 233.3), (8000, 405.02), (16384, 4000.2)]
        {
            let at = |i: i32| f64::from(i) / f64::from(n);
            let values: Vec<f64> =
                (0..n).map(|i| 3.0 + (TAU * periods * at(i) + 1.0).sin() + 0.2 * at(i)).collect();
            let found = dominant(&values).unwrap();
            assert!((found.periods - periods).abs() < 0.05, "{found:?}, not {periods}");
            assert!(found.share > 0.95, "{found:?}");
        }
        assert_eq!(dominant(&[1.0; 100]), None);
    }

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
        let found = frequency(&times, &values).unwrap();
        assert!((found - 3.7).abs() < 1e-6, "{found:?}");
        // The same in records of 5 ns and of 160 years
        for unit in [1e-9, 1e9] {
            let times: Vec<f64> = times.iter().map(|t| unit * t).collect();
            let found = frequency(&times, &values).unwrap();
            assert!((unit * found - 3.7).abs() < 1e-6, "{unit}: {found:?}");
        }
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
            let found = frequency(&times, &values).unwrap();
            assert!((found / f - 1.0).abs() < 0.01, "trial {trial}: {f} found as {found:?}");
        }
    }

    #[test]
    fn the_fundamental_wins_over_a_third_harmonic() {
        let w = std::f64::consts::TAU * 2.0;
        let (times, values) = record(4.0, 0.02, |t| (w * t).sin() + 0.3 * (3.0 * w * t).sin());
        let found = frequency(&times, &values).unwrap();
        assert!((found - 2.0).abs() < 0.002, "{found:?}");
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
        let found = frequency(&times, &values).unwrap();
        assert!((found / 0.163 - 1.0).abs() < 2e-3, "{found}");
    }

    #[test]
    fn unequal_steps_are_allowed() {
        let times: Vec<f64> = (0..60).map(|i| 0.05 * i as f64 + 0.01 * (i % 3) as f64).collect();
        let values: Vec<f64> = times.iter().map(|t| (std::f64::consts::TAU * 2.3 * t).cos()).collect();
        assert!((frequency(&times, &values).unwrap() - 2.3).abs() < 1e-6);
    }

    #[test]
    fn steady_lines_noise_and_short_records_have_no_frequency() {
        let (times, values) = record(5.0, 0.05, |t| 2.0 - 0.1 * t);
        assert_eq!(frequency(&times, &values), None);
        assert_eq!(frequency(&times, &vec![1.0; times.len()]), None);
        assert_eq!(frequency(&times[..5], &values[..5]), None);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let noise: Vec<f64> = (0..times.len()).map(|_| rng.random::<f64>()).collect();
        assert_eq!(frequency(&times, &noise), None);
    }
}
