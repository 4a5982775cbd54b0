//! A validation: rollouts of the validation trajectories, by which the best weights are chosen, measured as `m4gn validate` does.

use super::errors::{Figures, HORIZON, SquaredError};
use super::log::Validation;
use super::report::Report;
use super::trainer::Trainer;
use m4gn_base::Result;
use m4gn_learn::Rollout;
use m4gn_learn::data_parallel::roll_out_together;

impl Trainer<'_> {
    /// Rolls out the validation trajectories and keeps the weights if they are the best so far by the first predicted field. Of each of
    /// them the errors.
    pub(super) fn validate(&mut self, report: &Report) -> Result<Vec<Validation>> {
        let fields: Vec<String> = self.predicted().map(String::from).collect();
        let weights = self.optimiser.best_guess().to_vec();
        let stride = self.work.frames_a_step;
        // Of each trajectory the rollout from the first frame, then single steps from each frame at the stride.
        let steps: Vec<usize> = self.work.valid.iter().map(|s| (s.n_frames - 1) / stride).collect();
        let rollouts = |(sample, &steps): (usize, &usize)| {
            [false, true].map(|single| Rollout { sample, frame: 0, steps, single })
        };
        let plan: Vec<Rollout> = steps.iter().enumerate().flat_map(rollouts).collect();
        let n = fields.len();
        let outcomes =
            roll_out_together(self.comm, &mut *self.backend, &weights, &self.normaliser, &plan, n)?;
        // Of field k the figures of the model, or of the frame that is held, each the mean over the trajectories.
        let mean = |k: usize, whose: usize| {
            let errors = |all: &[[f64; 2]]| -> Vec<SquaredError> {
                all.iter().skip(k).step_by(n).map(|both| SquaredError::of_mean(both[whose])).collect()
            };
            let pairs = outcomes.as_chunks::<2>().0.iter().zip(&steps);
            let figures = |([rollout, single], &steps): (&[Vec<_>; 2], &usize)| {
                Figures::of(&errors(single), &errors(rollout), [(HORIZON / stride).max(1), steps], false)
            };
            Figures::mean(pairs.map(figures).collect::<Vec<_>>().iter())
        };
        let of = |k: usize| {
            let [model, held] = [mean(k, 0), mean(k, 1)];
            Validation {
                rmse_1: [model.rmse_1, held.rmse_1],
                rmse_horizon: [model.rmse_50, held.rmse_50],
                rmse_all: [model.rmse_all, held.rmse_all],
            }
        };
        let all: Vec<Validation> = (0..n).map(of).collect();
        let validation = all[0];
        let earlier = self.progress.best.as_ref().map(|(_, earlier)| earlier);
        let better = validation.replaces(earlier, self.config.training.best_of);
        if better {
            self.progress.best = Some((self.progress.step, validation));
            self.best = Some((weights, self.normaliser.clone()));
            let exported = if self.comm.is_root() { self.export() } else { Ok(()) };
            self.comm.agree(exported)?;
        }
        report.validation(self.progress.step, &fields, &all, better);
        Ok(all)
    }
}
