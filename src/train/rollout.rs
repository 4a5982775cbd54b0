//! Rollouts of validation trajectories on the native engine.

use super::backend::Rollout;
use super::native::NativeBackend;
use m4gn_engine::{Engine, EngineOptions, Forward};
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use m4gn_model::Model;

impl NativeBackend<'_> {
    /// Errors of a rollout on the engine, in fp32.
    pub(super) fn roll_one(&self, model: &Model, rollout: &Rollout) -> Result<Vec<(f64, f64)>> {
        let sample = &self.work.valid[rollout.sample];
        let comm = Comm::serial();
        let stage = self.spec.architecture.segment_transformer().is_some();
        let view = sample.view();
        let mut contact = sample.contact.clone();
        let frame = |step: usize| sample.frame(rollout.frame + step * self.work.frames_a_step);
        let first = frame(0)?;
        let mut state = first.to_vec();
        if let Some(contact) = &mut contact {
            contact.update(&comm, &state)?;
        }
        let graph = contact.as_ref().map_or(&sample.graph, |c| c.graph());
        let view = stage.then_some(&view);
        let mut engine = Engine::new(model, graph, view, &EngineOptions::default())?;
        let (mut inputs, mut outputs) = (Vec::new(), vec![0.0; sample.n_cells() * self.spec.n_outputs()]);
        let c = self.stepper.components();
        let error = |a: &[f32], b: &[f32]| c.mean_square(a, b, sample.n_cells());
        let mut errors: Vec<(f64, f64)> = Vec::with_capacity(rollout.steps);
        for step in 1..=rollout.steps {
            let next = &*frame(step)?;
            self.stepper.inputs(sample, &state, next, &mut inputs);
            engine.forward(&comm, &inputs, &mut outputs)?;
            state = self.stepper.advance(sample, &state, &outputs, next);
            errors.push((error(&state, next), error(&first, next)));
            if let (Some(contact), true) = (&mut contact, step < rollout.steps) {
                if !state.iter().all(|v| v.is_finite()) {
                    // There is no graph of a body that has flown apart; the error says so.
                    errors.resize(rollout.steps, (f64::INFINITY, 1.0));
                    break;
                }
                engine.set_edges(contact.update(&comm, &state)?)?;
            }
        }
        Ok(errors)
    }
}
