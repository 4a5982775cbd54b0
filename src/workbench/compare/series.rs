//! Something over time in one run: what is told of it, and how many times that takes.

use crate::signal;
use m4gn_averages::spectrum;
use serde::Serialize;

/// Fewest times of a mean, of what varies by and of a frequency.
pub(super) const FEWEST: usize = 8;

/// Values at times that need not be equally far apart.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Series {
    pub times: Vec<f64>,
    pub values: Vec<f64>,
}

/// What is told of it, weighed by time; none where there are too few times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Mean over time.
    pub mean: Option<f64>,
    /// Root mean square about the mean.
    pub rms: Option<f64>,
    /// 1/s; none as well where it does not oscillate over at least 1.5 periods.
    pub frequency: Option<f64>,
}

impl Series {
    /// What lies between two times, s.
    pub fn between(&self, from: f64, to: f64) -> Series {
        let slack = 1e-9 * to.abs().max(1e-9);
        let all = self.times.iter().copied().zip(self.values.iter().copied());
        let (times, values) = all.filter(|(t, _)| *t >= from - slack && *t <= to + slack).unzip();
        Series { times, values }
    }

    /// `longest`: the interval beyond which times are too far apart to tell a frequency, s.
    pub fn statistics(&self, longest: f64) -> Statistics {
        if self.times.len() < FEWEST {
            return Statistics::default();
        }
        let resolved = self.times.windows(2).all(|w| w[1] - w[0] <= longest * (1.0 + 1e-6));
        let found = resolved.then(|| spectrum::frequency(&self.times, &self.values)).flatten();
        Statistics {
            mean: Some(signal::mean(&self.times, &self.values)),
            rms: Some(signal::fluctuation(&self.times, &self.values)),
            frequency: found,
        }
    }
}

/// A figure of both runs: what it is, A and B, and the error.
pub(super) type Row = (String, [Option<f64>; 2], String);

/// B / A - 1; none where one of them is missing, or A is zero.
pub(crate) fn change(pair: [Option<f64>; 2]) -> Option<f64> {
    match pair {
        [Some(a), Some(b)] if a != 0.0 => Some(b / a - 1.0),
        _ => None,
    }
}

/// The size of the [`change`].
pub(super) fn relative(pair: [Option<f64>; 2]) -> Option<f64> {
    change(pair).map(f64::abs)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A period of 6.14 s, stored each 8.33 s: the sine through them has 23.3 s.
    #[test]
    fn times_that_are_too_far_apart_tell_no_frequency() {
        let times: Vec<f64> = (0..20).map(|i| 8.333 * i as f64).collect();
        let values = times.iter().map(|t| 2.0 + (std::f64::consts::TAU * t / 6.14).sin()).collect();
        let series = Series { times, values };
        let alias = series.statistics(f64::INFINITY).frequency.unwrap();
        assert!((alias - 0.0429).abs() < 1e-3, "{alias}");
        let found = series.statistics(1.0);
        assert_eq!(found.frequency, None);
        assert!((found.mean.unwrap() - 2.0).abs() < 0.1);
    }

    #[test]
    fn few_times_tell_no_mean() {
        let few = Series { times: vec![1.0, 2.0], values: vec![3.0, 4.0] };
        assert_eq!(few.statistics(9.0), Statistics::default());
        assert_eq!(few.between(1.5, 2.0).values, [4.0]);
    }

    #[test]
    fn errors_need_both_runs() {
        assert_eq!(relative([Some(2.0), Some(1.0)]), Some(0.5));
        assert_eq!([relative([None, Some(1.0)]), relative([Some(0.0), Some(1.0)])], [None, None]);
    }
}
