//! The figures of one run against the full run.

use crate::compare::{Comparison, change};
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
    /// Error of the last field from the full run's cycle, wherever in it, over that of holding; none where the full run has no cycle.
    pub phase_free: Option<f64>,
    /// Times of the three, s after the takeover.
    pub horizons: [f64; 3],
    /// Errors at the three, RMSE over the stored times up to there, m/s (m of a displacement).
    pub errors: [f64; 3],
    /// Those of holding.
    pub hold_last: [f64; 3],
    /// Of a solid: the displacement's error over the whole run, over its root mean square.
    pub displacement: Option<f64>,
    /// The same of the stress `sigma`; none where a run has none of its own at some time.
    pub stress: Option<f64>,
    /// Of a solid: the largest over the stored times of the root mean square over cells of the displacement's error, over the
    /// full run's largest displacement.
    pub range: Option<f64>,
    /// Of a solid: the largest error of the cell that moves most, over its largest displacement.
    pub cell: Option<f64>,
    /// Of a solid: root mean square of the error of the reaction force on the patch, over that of the force.
    pub reaction: Option<f64>,
    /// The same at the times of the solver alone, outside of jumps.
    pub reaction_of_solver: Option<f64>,
    /// Of a solid: the largest error of the reaction force, over the largest force.
    pub reaction_max: Option<f64>,
    /// Of a solid: root mean square of the error of the reaction force, over the range of the full run's force.
    pub reaction_of_range: Option<f64>,
    /// The same at the times of the surrogate, in jumps.
    pub reaction_of_range_of_surrogate: Option<f64>,
    /// Of a solid: times at which the reaction force was not compared, and why, in words; none where it was at all.
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
    pub pace: Option<f64>,
    /// Processor seconds of the full run for a second behind the takeover of this one.
    pub solver_pace: Option<f64>,
    /// Of runs that end where they know: the largest error of a figure, over the full run's.
    pub answer: Option<f64>,
    /// Share of the figures whose interval does not meet the full run's.
    pub outside: Option<f64>,
    /// When such a run ended, s.
    pub ended: Option<f64>,
    /// Number of cells; 0 where fields are not compared.
    pub cells: usize,
}

impl Score {
    /// From a comparison; a stride lasts `stride` s where the surrogate does not say otherwise, a jump `strides`.
    pub fn of(c: &Comparison, stride: f64, strides: f64) -> Self {
        let said = c.surrogate.as_ref().and_then(|s| s["stride"].as_f64());
        let stride = said.unwrap_or(stride);
        let (errors, last) = (&c.headline, c.times.len() - 1);
        // The first stored time at or after the horizon.
        let at = |after: f64| {
            let reached = |t: &f64| *t >= c.takeover + after * (1.0 - 1e-6);
            c.times.iter().position(reached).unwrap_or(last)
        };
        let places = [at(stride), at(strides * stride), last];
        let (rmse, hold) = (&errors.rmse, &errors.hold_last_rmse);
        let ratio = |i: usize| (hold[i] > 0.0).then(|| rmse[i] / hold[i]);
        let figure = |key: &str| c.surrogate.as_ref()?[key].as_f64().filter(|v| *v > 0.0);
        let mut score = Score {
            first: ratio(places[0]),
            jump: ratio(places[1]),
            end: ratio(last),
            phase_free: c.phase_free.filter(|_| hold[last] > 0.0).map(|p| p.error / hold[last]),
            horizons: places.map(|i| c.times[i] - c.takeover),
            errors: places.map(|i| rmse[i]),
            hold_last: places.map(|i| hold[i]),
            pace: figure("surrogate_seconds")
                .zip(figure("replaced_time"))
                .map(|(worked, replaced)| worked / replaced),
            replaced: c.replaced_fraction,
            cells: c.cells_b,
            ..Score::default()
        };
        if let Some(forces) = &c.forces {
            let steady = forces.lift_error.is_none();
            let [drag, lift] = [forces.mean_drag, forces.lift_rms];
            score.drag = change(drag);
            score.lift = change(lift).filter(|_| !steady);
            score.frequency = change(forces.frequency);
            score.unsteadiness =
                drag[1].zip(lift[1]).filter(|(drag, _)| steady && *drag != 0.0).map(|(d, l)| l / d.abs());
        }
        if let Some(motion) = &c.motion {
            score.displacement = (errors.rms > 0.0).then(|| rmse[last] / errors.rms);
            score.stress = c.fields.get("sigma").filter(|s| s.rms > 0.0).map(|s| s.rmse[last] / s.rms);
            score.range = Some(motion.displacement_error_of_range);
            score.cell = Some(motion.point_error_max);
            score.frequency = change(motion.frequency);
        }
        if let Some(reaction) = &c.reaction {
            score.reaction = reaction.error_rms;
            score.reaction_of_solver = reaction.error_rms_of_solver;
            score.reaction_max = reaction.error_max;
            score.reaction_of_range = reaction.error_of_range;
            score.reaction_of_range_of_surrogate = reaction.error_of_range_of_surrogate;
            score.reaction_left_out = reaction.left_out_text();
        }
        score
    }
}
