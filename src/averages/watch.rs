//! Estimates while a run goes on: when to look, and when a figure is known.

use crate::estimate::{Estimate, estimate};
use crate::series::{Row, Series};

/// How well a figure is to be known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// Half-width, in the figure's unit.
    Absolute(f64),
    /// Half-width over the figure's magnitude.
    Relative(f64),
}

impl Tolerance {
    /// Whether a figure with this half-width, and this change over its record, is known. A straight line that fits noise is steep by
    /// chance, by 1.8 half-widths in root mean square: up to twice the tolerance it is no drift.
    pub fn met(self, figure: f64, half_width: f64, change: f64) -> bool {
        let limit = match self {
            Tolerance::Absolute(limit) => limit,
            Tolerance::Relative(limit) => limit * figure.abs(),
        };
        half_width <= limit && change.abs() <= 2.0 * limit
    }
}

/// Over the tolerance: half-width, and change over the record, below which what is left of a transient does not count, with the fewest independent
/// samples and degrees of freedom that this asks for. The first is for a figure that hardly changes, and slowly, as the mean velocity in a channel; the
/// second for a flow at rest, whose series is a solver's noise. A few periods of what does not repeat itself have few degrees of freedom.
const CLEARLY: [(f64, f64, f64); 2] = [(0.3, 20.0, 10.0), (1e-3, 16.0, 0.0)];

/// What of a series is to be known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Goal {
    /// Tolerance of the mean.
    pub mean: Option<Tolerance>,
    /// Tolerance of the rms of the fluctuations.
    pub rms: Option<Tolerance>,
}

impl Goal {
    /// Whether an estimate has all that is asked for: without drift and a transient that may go on, or clearly within the tolerance.
    pub fn met(&self, e: &Estimate) -> bool {
        let known = |t: Tolerance, steady, figure, half_width, change: f64| {
            let clearly = |(share, samples, freedom)| {
                let enough = e.independent_samples >= samples && e.freedom >= freedom;
                enough && t.met(figure, half_width / share, change / share)
            };
            CLEARLY.into_iter().any(clearly) || (steady && t.met(figure, half_width, change))
        };
        let mean = |t| known(t, e.mean_steady, e.mean, e.half_width, e.mean_change);
        let rms = |t| known(t, e.rms_steady, e.rms, e.rms_half_width, e.rms_change);
        self.mean.is_none_or(mean) && self.rms.is_none_or(rms)
    }
}

/// Growth of the series from one check to the next.
const GROWTH: f64 = 1.1;

/// A series that is looked at now and then.
#[derive(Clone, Debug)]
pub struct Watch {
    /// The rows.
    pub series: Series,
    confidence: f64,
    goal: Goal,
    next: usize,
    met: bool,
    settled: bool,
}

impl Watch {
    /// An empty series.
    pub fn new(confidence: f64, goal: Goal) -> Self {
        Watch { series: Series::default(), confidence, goal, next: 16, met: false, settled: false }
    }

    /// Whether the series has grown by a tenth since the last check.
    pub fn due(&self) -> bool {
        self.series.len() >= self.next
    }

    /// Looks at the series. A figure is settled when a second check in a row finds it within its tolerance.
    pub fn check(&mut self) -> Option<Estimate> {
        self.next = (self.series.len() as f64 * GROWTH).ceil() as usize;
        let found = estimate(&self.series, self.confidence);
        let met = found.as_ref().is_some_and(|e| self.goal.met(e));
        self.settled = met && self.met;
        self.met = met;
        found
    }

    /// Whether the last two checks found what is asked for.
    pub fn settled(&self) -> bool {
        self.settled
    }

    /// What a run that carries on has to know beside the rows: the number of rows at the next check, and what the last one found; 0: not what
    /// is asked for.
    pub fn state(&self) -> (usize, u64) {
        (self.next, if self.met { self.asked() } else { 0 })
    }

    /// What is asked for, as a number above 0.
    fn asked(&self) -> u64 {
        u64::from(crc32c::crc32c(format!("{:?} {}", self.goal, self.confidence).as_bytes())) + 1
    }

    /// Begins with the rows and the [`state`](Self::state) of an earlier run. What that found counts where it was asked for the same.
    pub fn carry_on(&mut self, (next, found): (usize, u64), rows: &[Row]) {
        self.series = Series::default();
        for row in rows {
            self.series.push(*row);
        }
        (self.next, self.settled) = (next.min(2 * rows.len() + 16), false);
        self.met = found == self.asked();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::constant;

    #[test]
    fn what_is_left_of_a_transient_does_not_count_where_the_figure_is_clearly_within_its_tolerance() {
        let series = Series::of(&[1.0, 2.0], &[3.0, 3.0]);
        let found = |half_width: f64, independent_samples: f64| Estimate {
            half_width,
            independent_samples,
            mean_steady: false,
            ..constant(&series, (0.0, 2.0), 3.0)
        };
        let goal = Goal { mean: Some(Tolerance::Relative(0.01)), rms: None };
        assert!(goal.met(&found(0.0089, 20.0)));
        assert!(!goal.met(&found(0.0091, 20.0)), "more than 0.3 of 0.03");
        assert!(!goal.met(&found(0.0089, 19.0)), "few samples");
        let periods = Estimate { freedom: 9.0, ..found(0.0089, 60.0) };
        assert!(!goal.met(&periods), "ten periods, each unlike the one before");
        assert!(goal.met(&found(2e-5, 16.0)) && !goal.met(&found(2e-5, 15.0)), "at rest");
        let steady = Estimate { mean_steady: true, ..found(0.029, 1.0) };
        assert!(goal.met(&steady));
        let drifting = Estimate { mean_change: 0.019, ..found(0.001, 60.0) };
        assert!(!goal.met(&drifting));
    }
}
