//! The figures of one run against the full run.

use crate::compare::Comparison;
use serde::{Deserialize, Serialize};

/// Errors of a run; forces are relative to the full run's and keep their sign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Velocity error over the first stride, over that of holding the last field before the first jump.
    pub first: Option<f64>,
    /// The same over the first jump.
    pub jump: Option<f64>,
    /// The same over the whole run.
    pub end: Option<f64>,
    /// Times of the three, s after the takeover.
    pub horizons: [f64; 3],
    /// Velocity errors at the three, RMSE over the stored times up to there, m/s.
    pub errors: [f64; 3],
    /// Those of holding, m/s.
    pub hold_last: [f64; 3],
    /// Mean drag.
    pub drag: Option<f64>,
    /// Root mean square of the lift; none where the full run's wake is steady.
    pub lift: Option<f64>,
    /// Shedding frequency; none where one of the two runs has none.
    pub frequency: Option<f64>,
    /// Where the full run's wake is steady: the lift's root mean square over the mean drag in this run.
    pub unsteadiness: Option<f64>,
    /// Replaced part of the time after the start-up; none of a plain solver.
    pub replaced: Option<f64>,
    /// Number of cells.
    pub cells: usize,
}

impl Score {
    /// From a comparison; a stride lasts `stride` s where the surrogate does not say otherwise, a jump `strides`.
    pub fn of(c: &Comparison, stride: f64, strides: f64) -> Self {
        let said = c.surrogate.as_ref().and_then(|s| s["stride"].as_f64());
        let stride = said.unwrap_or(stride);
        let last = c.times.len() - 1;
        // The first stored time at or after the horizon.
        let at = |after: f64| {
            let reached = |t: &f64| *t >= c.takeover + after * (1.0 - 1e-6);
            c.times.iter().position(reached).unwrap_or(last)
        };
        let places = [at(stride), at(strides * stride), last];
        let ratio = |i: usize| (c.hold_last_rmse[i] > 0.0).then(|| c.velocity_rmse[i] / c.hold_last_rmse[i]);
        let relative = |v: [f64; 2]| (v[0] != 0.0).then(|| v[1] / v[0] - 1.0);
        let steady = c.mean_drag.is_some() && c.lift_error.is_none();
        Score {
            first: ratio(places[0]),
            jump: ratio(places[1]),
            end: ratio(last),
            horizons: places.map(|i| c.times[i] - c.takeover),
            errors: places.map(|i| c.velocity_rmse[i]),
            hold_last: places.map(|i| c.hold_last_rmse[i]),
            drag: c.mean_drag.and_then(relative),
            lift: c.lift_rms.filter(|_| !steady).and_then(relative),
            frequency: match c.frequency {
                [Some(a), Some(b)] => relative([a, b]),
                _ => None,
            },
            unsteadiness: match (c.lift_rms, c.mean_drag) {
                (Some(lift), Some(drag)) if steady && drag[1] != 0.0 => Some(lift[1] / drag[1].abs()),
                _ => None,
            },
            replaced: c.replaced_fraction,
            cells: c.cells_b,
        }
    }
}

/// The middle value, or the mean of the two in the middle; none of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    (n > 0).then(|| 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 9.0]), Some(3.0));
        assert_eq!(median([]), None);
    }
}
