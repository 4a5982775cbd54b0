//! Rollouts of recorded trajectories on the native engine.

use super::backend::Rollout;
use super::native::NativeBackend;
use m4gn_base::Result;
use m4gn_domain::Predict;
use m4gn_engine::{Engine, EngineOptions};
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_step::Stepper;
use std::borrow::Cow;

impl NativeBackend<'_> {
    /// Errors of a rollout, as [`Backend::roll_out`](super::backend::Backend::roll_out) has them.
    pub(crate) fn roll_one(&self, model: &Model, rollout: &Rollout) -> Result<Vec<[f64; 2]>> {
        let (sample, c) = (&self.work.valid[rollout.sample], &self.components);
        let (domain, comm) = (&*sample.domain, Comm::serial());
        let free: Vec<Vec<bool>> = c.predicted().map(|field| domain.free(field)).collect();
        let stride = self.work.frames_a_step;
        let frame = |step: usize| sample.state(rollout.frame + step * stride, false);
        let mut start = frame(0)?;
        let mut state = start.clone();
        let options = EngineOptions {
            precision: self.precision,
            edges_move: domain.moves(),
            ..EngineOptions::default()
        };
        let mut structure = Cow::Borrowed(&sample.structure);
        if domain.moves() {
            domain.set_edges(&comm, &mut state, structure.to_mut())?;
        }
        let engine = Engine::new(model, &structure, &options)?;
        let mut stepper = Stepper::new(domain, &structure, &self.spec, Box::new(engine));
        let mut errors: Vec<[f64; 2]> = Vec::new();
        for step in 1..=rollout.steps {
            let next = frame(step)?;
            // A body that has left the numbers has no edges.
            let lost = domain.moves() && !state.iter().all(|v| v.is_finite());
            if !lost {
                let outputs = stepper.predict(&comm, domain, &mut state, &next)?;
                state = domain.advance(&state, outputs, &next);
                domain.take_level_off(&mut state);
            }
            let both = |(field, free): (&[usize], &Vec<bool>)| {
                let free = || (0..free.len()).filter(|node| free[*node]);
                let [model, held] = [&state, &start].map(|from| c.mean_square(field, from, &next, free()));
                [if lost { f64::INFINITY } else { model }, held]
            };
            errors.extend(c.predicted().zip(&free).map(both));
            if rollout.single {
                state.clone_from(&next);
                start = next;
            }
        }
        Ok(errors)
    }
}
