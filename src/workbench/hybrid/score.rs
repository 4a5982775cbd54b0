//! The figures of one run against the full run.

use crate::compare::Comparison;
use crate::compare::displacement::Motion;
use serde::{Deserialize, Serialize};

/// Errors of a run, of a flow's velocity or of a solid's displacement; forces are relative to the full run's and keep their sign.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Error over the first stride, over that of holding the last field before the first jump.
    pub first: Option<f64>,
    /// The same over the first jump.
    pub jump: Option<f64>,
    /// The same over the whole run.
    pub end: Option<f64>,
    /// Times of the three, s after the takeover.
    pub horizons: [f64; 3],
    /// Errors at the three, RMSE over the stored times up to there, m/s (m of a displacement).
    pub errors: [f64; 3],
    /// Those of holding.
    pub hold_last: [f64; 3],
    /// Of a solid: the displacement's error over the whole run, over its root mean square.
    #[serde(default)]
    pub displacement: Option<f64>,
    /// Of a solid: the largest over the stored times of the root mean square over cells of the displacement's error, over the
    /// full run's largest displacement.
    #[serde(default)]
    pub range: Option<f64>,
    /// Of a solid: the largest error of the cell that moves most, over its largest displacement.
    #[serde(default)]
    pub cell: Option<f64>,
    /// Of a solid: root mean square of the error of the reaction force on the patch, over that of the force.
    #[serde(default)]
    pub reaction: Option<f64>,
    /// The same at the times of the solver alone, outside of jumps.
    #[serde(default)]
    pub reaction_of_solver: Option<f64>,
    /// Of a solid: the largest error of the reaction force, over the largest force.
    #[serde(default)]
    pub reaction_max: Option<f64>,
    /// Of a solid: times at which the reaction force was not compared, and why, in words; none where it was at all.
    #[serde(default)]
    pub reaction_left_out: Option<String>,
    /// Mean drag.
    pub drag: Option<f64>,
    /// Root mean square of the lift; none where the full run's wake is steady.
    pub lift: Option<f64>,
    /// Frequency of the shedding, or of a solid's vibration; none where one of the two runs has none.
    pub frequency: Option<f64>,
    /// Where the full run's wake is steady: the lift's root mean square over the mean drag in this run.
    pub unsteadiness: Option<f64>,
    /// Replaced part of the time after the start-up; none of a plain solver.
    pub replaced: Option<f64>,
    /// Seconds that the surrogate worked for a second of what it replaced, without what the hand-overs took; none of a plain solver.
    #[serde(default)]
    pub pace: Option<f64>,
    /// Number of cells.
    pub cells: usize,
}

/// What the figures of flows and of solids are made of: errors up to each common time.
struct Errors<'a> {
    takeover: f64,
    times: &'a [f64],
    rmse: &'a [f64],
    hold_last: &'a [f64],
    surrogate: Option<&'a serde_json::Value>,
}

fn relative(v: [f64; 2]) -> Option<f64> {
    (v[0] != 0.0).then(|| v[1] / v[0] - 1.0)
}

impl Errors<'_> {
    /// The part of a score that flows and solids have in common; a stride lasts `stride` s where the surrogate does not say
    /// otherwise, a jump `strides`.
    fn score(&self, stride: f64, strides: f64) -> Score {
        let said = self.surrogate.and_then(|s| s["stride"].as_f64());
        let stride = said.unwrap_or(stride);
        let last = self.times.len() - 1;
        // The first stored time at or after the horizon.
        let at = |after: f64| {
            let reached = |t: &f64| *t >= self.takeover + after * (1.0 - 1e-6);
            self.times.iter().position(reached).unwrap_or(last)
        };
        let places = [at(stride), at(strides * stride), last];
        let ratio = |i: usize| (self.hold_last[i] > 0.0).then(|| self.rmse[i] / self.hold_last[i]);
        let figure = |key: &str| self.surrogate?[key].as_f64().filter(|v| *v > 0.0);
        Score {
            first: ratio(places[0]),
            jump: ratio(places[1]),
            end: ratio(last),
            horizons: places.map(|i| self.times[i] - self.takeover),
            errors: places.map(|i| self.rmse[i]),
            hold_last: places.map(|i| self.hold_last[i]),
            pace: figure("surrogate_seconds")
                .zip(figure("replaced_time"))
                .map(|(worked, replaced)| worked / replaced),
            ..Score::default()
        }
    }
}

/// The relative change of a frequency that both runs have.
fn frequency(pair: [Option<f64>; 2]) -> Option<f64> {
    match pair {
        [Some(a), Some(b)] => relative([a, b]),
        _ => None,
    }
}

impl Score {
    /// From a comparison of flows; a stride lasts `stride` s where the surrogate does not say otherwise, a jump `strides`.
    pub fn of_flow(c: &Comparison, stride: f64, strides: f64) -> Self {
        let steady = c.mean_drag.is_some() && c.lift_error.is_none();
        let errors = Errors {
            takeover: c.takeover,
            times: &c.times,
            rmse: &c.velocity_rmse,
            hold_last: &c.hold_last_rmse,
            surrogate: c.surrogate.as_ref(),
        };
        Score {
            drag: c.mean_drag.and_then(relative),
            lift: c.lift_rms.filter(|_| !steady).and_then(relative),
            frequency: frequency(c.frequency),
            unsteadiness: match (c.lift_rms, c.mean_drag) {
                (Some(lift), Some(drag)) if steady && drag[1] != 0.0 => Some(lift[1] / drag[1].abs()),
                _ => None,
            },
            replaced: c.replaced_fraction,
            cells: c.cells_b,
            ..errors.score(stride, strides)
        }
    }

    /// The same of solids.
    pub fn of_solid(m: &Motion, stride: f64, strides: f64) -> Self {
        let errors = Errors {
            takeover: m.takeover,
            times: &m.times,
            rmse: &m.displacement_rmse,
            hold_last: &m.hold_last_rmse,
            surrogate: m.surrogate.as_ref(),
        };
        let last = m.displacement_rmse.last();
        Score {
            displacement: last
                .filter(|_| m.displacement_rms > 0.0)
                .map(|e| e / m.displacement_rms),
            range: Some(m.displacement_error_of_range),
            cell: Some(m.point_error_max),
            reaction: m.reaction.as_ref().and_then(|r| r.error_rms),
            reaction_of_solver: m.reaction.as_ref().and_then(|r| r.error_rms_of_solver),
            reaction_max: m.reaction.as_ref().and_then(|r| r.error_max),
            reaction_left_out: m.reaction.as_ref().and_then(|r| r.left_out_text()),
            frequency: frequency(m.frequency),
            replaced: m.replaced_fraction,
            cells: m.cells,
            ..errors.score(stride, strides)
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
