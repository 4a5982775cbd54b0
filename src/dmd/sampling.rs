//! Uniform times from a solver's steps, which need not be.

use serde::{Deserialize, Serialize};

/// Of an interval: times that are nearer to each other are the same.
pub(crate) const SAME: f64 = 1e-6;

/// The times of samples: `time + (n - number) interval` of the present stretch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Grid {
    pub interval: f64,
    /// A sample and its time.
    pub number: i64,
    pub time: f64,
}

impl Grid {
    pub fn time_of(&self, number: i64) -> f64 {
        self.time + (number - self.number) as f64 * self.interval
    }

    /// Samples from the grid's start to a time, rounded to 1e-9: the times of a run that is carried on have other last bits, and what is
    /// predicted has not.
    pub fn position(&self, time: f64) -> f64 {
        let position = self.number as f64 + (time - self.time) / self.interval;
        (position * 1e9).round() / 1e9
    }

    /// The sample at a time, if there is one.
    pub fn at(&self, time: f64) -> Option<i64> {
        let nearest = self.position(time).round();
        ((self.position(time) - nearest).abs() < SAME).then_some(nearest as i64)
    }

    /// Whether a time is later than a sample.
    pub fn is_later(&self, time: f64, number: i64) -> bool {
        self.position(time) > number as f64 + SAME
    }

    /// The first sample later than a time.
    pub fn after(&self, time: f64) -> i64 {
        (self.position(time) + SAME).floor() as i64 + 1
    }
}
