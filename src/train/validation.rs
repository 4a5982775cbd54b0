//! A validation: rollouts of the validation trajectories, by which the best weights are chosen.

use super::log::Validation;
use super::report::Report;
use super::trainer::Trainer;
use m4gn_base::Result;
use m4gn_learn::Rollout;
use m4gn_learn::data_parallel::roll_out_together;

/// Recorded frames that RMSE-50 is over, in training as in `m4gn validate`.
pub const HORIZON: usize = 50;

impl Trainer<'_> {
    /// Rolls out the validation trajectories and keeps the weights if they are the best so far by the first predicted field. Of each of
    /// them the errors.
    pub(super) fn validate(&mut self, report: &Report) -> Result<Vec<Validation>> {
        let fields: Vec<String> = self.predicted().map(String::from).collect();
        let weights = self.optimiser.best_guess().to_vec();
        let stride = self.work.frames_a_step;
        let short = (HORIZON / stride).max(1);
        // (kind of rollout, job); the long ones first, so that the threads end together.
        let mut plan = Vec::new();
        for (sample, s) in self.work.valid.iter().enumerate() {
            let steps = (s.n_frames - 1) / stride;
            plan.push((2, sample, 0, steps));
            let short = short.min(steps);
            for part in 1..3 {
                plan.push((1, sample, (s.n_frames - 1 - short * stride) * part / 2, short));
            }
            for part in 0..8 {
                plan.push((0, sample, (s.n_frames - 1 - stride) * part / 7, 1));
            }
        }
        plan.sort_by_key(|p| std::cmp::Reverse(p.0));
        let rollouts: Vec<Rollout> =
            plan.iter().map(|&(_, sample, frame, steps)| Rollout { sample, frame, steps }).collect();
        let n = fields.len();
        let outcomes =
            roll_out_together(self.comm, &mut *self.backend, &weights, &self.normaliser, &rollouts, n)?;
        // Of each field sums of (model, persistence) squared errors and counts, of the three figures.
        let mut sums = vec![[[0.0; 3]; 3]; n];
        for (plan, errors) in plan.iter().zip(outcomes) {
            let mut add = |figure: usize, errors: &[[f64; 2]]| {
                for (i, [model, held]) in errors.iter().enumerate() {
                    let parts = [*model, *held, 1.0];
                    sums[i % n][figure].iter_mut().zip(parts).for_each(|(sum, x)| *sum += x);
                }
            };
            add(plan.0, &errors);
            if plan.0 == 2 {
                add(1, &errors[..(n * short).min(errors.len())]);
            }
        }
        let root = |[model, held, n]: [f64; 3]| [(model / n).sqrt(), (held / n).sqrt()];
        let of = |[one, horizon, all]: [[f64; 3]; 3]| Validation {
            rmse_1: root(one),
            rmse_horizon: root(horizon),
            rmse_all: root(all),
        };
        let all: Vec<Validation> = sums.into_iter().map(of).collect();
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
