//! Rollouts of recorded trajectories on the native engine.

use super::backend::Rollout;
use super::native::NativeBackend;
use m4gn_domain::{Components, Predict};
use m4gn_engine::{Engine, EngineOptions};
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use m4gn_model::Model;
use m4gn_step::Stepper;
use std::borrow::Cow;

/// How a rollout's state lags behind the recorded one, in the first predicted field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lag {
    /// Time by which the rollout is ahead, s.
    pub ahead: f64,
    /// Sum over cells and components of the square of the rate of change there: how much it tells.
    pub weight: f64,
}

/// What is done with the state after a model step: its number, the state, and the recorded one of that time.
type Visit<'a> = dyn FnMut(usize, &[f32], &[f32]) -> Result<()> + 'a;

impl NativeBackend<'_> {
    /// Errors of a rollout, as [`Backend::roll_out`](super::backend::Backend::roll_out) has them.
    pub(crate) fn roll_one(&self, model: &Model, rollout: &Rollout) -> Result<Vec<(f64, f64)>> {
        let sample = &self.work.valid[rollout.sample];
        let c = &self.components;
        let error = |a: &[f32], b: &[f32]| c.mean_square(a, b, sample.n_cells());
        let first = sample.frame(rollout.frame)?;
        let mut errors: Vec<(f64, f64)> = Vec::with_capacity(rollout.steps);
        self.roll(model, rollout, &mut |_, state, next| {
            errors.push((error(state, next), error(&first, next)));
            Ok(())
        })?;
        // There is no graph of a body that has flown apart; the error says so.
        errors.resize(rollout.steps, (f64::INFINITY, 1.0));
        Ok(errors)
    }

    /// By how much a rollout is ahead after some of its steps, of frames that are `interval` apart (s): the recorded state that is
    /// nearest to the rollout's, less than a stride before or after its time, and the rest of the error there along the rate
    /// of change.
    pub fn lags<const N: usize>(
        &self,
        model: &Model,
        rollout: &Rollout,
        after: [usize; N],
        interval: f64,
    ) -> Result<[Lag; N]> {
        let sample = &self.work.valid[rollout.sample];
        let (c, most) = (&self.components, self.work.frames_a_step as f64 - 1.0);
        let mut lags = [Lag::default(); N];
        self.roll(model, rollout, &mut |step, state, _| {
            for (lag, _) in lags.iter_mut().zip(after).filter(|(_, after)| *after == step) {
                let time = (rollout.frame + step * self.work.frames_a_step) as isize;
                let mut frames = 0;
                loop {
                    let frame = |i: isize| sample.frame((time + frames + i) as usize);
                    let (along, square) =
                        along_rate(c, sample.n_cells(), state, [&frame(-1)?, &frame(0)?, &frame(1)?]);
                    // Over two intervals
                    let rest = 2.0 * along / square;
                    let nearest = (frames as f64 + rest).round().clamp(-most, most) as isize;
                    let ahead = (frames as f64 + rest) * interval;
                    let further = (nearest - frames).signum();
                    *lag = Lag { ahead, weight: square / (2.0 * interval).powi(2) };
                    // Only on in the first direction, so that it ends.
                    if further == 0 || further * frames.signum() < 0 {
                        break;
                    }
                    frames += further;
                }
            }
            Ok(())
        })?;
        Ok(lags)
    }

    /// Shows the state after each model step. It ends early where a body leaves the finite numbers.
    fn roll(&self, model: &Model, rollout: &Rollout, visit: &mut Visit) -> Result<()> {
        let sample = &self.work.valid[rollout.sample];
        let (domain, comm) = (&*sample.domain, Comm::serial());
        let stride = self.work.frames_a_step;
        let frame = |step: usize| sample.state(rollout.frame + step * stride, false);
        let mut state = frame(0)?;
        let options = EngineOptions {
            precision: self.precision,
            edges_move: domain.moves(),
            ..EngineOptions::default()
        };
        let mut structure = Cow::Borrowed(&sample.structure);
        if domain.moves() {
            domain.set_edges(&comm, &mut state, &mut structure.to_mut().graph)?;
        }
        let engine = Engine::new(model, &structure, &options)?;
        let mut stepper = Stepper::new(domain, &structure, &self.spec, Box::new(engine));
        for step in 1..=rollout.steps {
            let next = frame(step)?;
            let outputs = stepper.predict(&comm, domain, &mut state, &next)?;
            state = domain.advance(&state, outputs, &next);
            visit(step, &state, &next)?;
            if domain.moves() && !state.iter().all(|v| v.is_finite()) {
                break;
            }
        }
        Ok(())
    }
}

/// With the difference of the frames after and before, over cells and components of the first predicted field: the sum of the
/// state's difference from the frame between times this, and of its square.
fn along_rate(c: &Components, cells: usize, state: &[f32], [before, now, after]: [&[f32]; 3]) -> (f64, f64) {
    let (mut along, mut square) = (0.0, 0.0);
    for cell in 0..cells {
        for i in c.headline().map(|i| cell * c.count + i) {
            let change = f64::from(after[i] - before[i]);
            along += f64::from(state[i] - now[i]) * change;
            square += change * change;
        }
    }
    (along, square)
}
