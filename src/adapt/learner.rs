//! What learns: weights, frames, and the optimisation steps of a round.

use super::Settings;
use super::round::Split;
use super::window::Window;
use m4gn_base::Result;
use m4gn_engine::backward::{Layout, Optimiser, norm};
use m4gn_learn::NativeBackend;
use m4gn_learn::TrainingConfig;
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::samples::Sample;
use m4gn_learn::together::{learn_together, roll_out_together};
use m4gn_learn::{Backend, Batch, Example};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, ModelSpec, Output, Tensor};
use m4gn_parallel::Comm;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Most checks of the first round, and least steps between them; it ends after so many that brought nothing.
const CHECKS: u64 = 6;
const BETWEEN: u64 = 25;
const PATIENCE: u64 = 3;

/// Learning rate of later rounds, as a share of the first one's.
const LATER_RATE: f64 = 0.3;

/// What was learned so far.
#[derive(Clone, Debug)]
pub(super) struct Knowledge {
    /// The weights that are used, and how they came about.
    pub optimiser: Optimiser,
    /// Optimisation steps made.
    pub steps: u64,
    /// Wall time of them, s.
    pub seconds: f64,
}

impl Knowledge {
    /// Of weights that have learned nothing yet.
    pub fn of(optimiser: Optimiser) -> Self {
        Knowledge { optimiser, steps: 0, seconds: 0.0 }
    }
}

/// A model and the frames that it learns from.
#[derive(Debug)]
pub(super) struct Learner {
    pub settings: Settings,
    /// What the settings mean for this model.
    pub training: TrainingConfig,
    pub threads: usize,
    pub spec: ModelSpec,
    pub layout: Layout,
    /// Weights of the model's file, and its other tensors.
    pub shipped: Vec<f32>,
    pub others: BTreeMap<String, Tensor>,
    pub normaliser: Normaliser,
    /// The undecomposed mesh.
    pub whole: Mesh,
    /// Graph, segments and frames of the undecomposed mesh.
    pub sample: Arc<Sample>,
    pub window: Window,
    pub knowledge: Knowledge,
}

/// What the learning of a round did; the weights are the best ones, or those from before.
pub(super) struct Learned {
    pub steps: u64,
    /// Error of the rollouts with the weights from before.
    pub before: f64,
    /// With the best weights.
    pub after: f64,
    /// Why it ended early, for people.
    pub ended: &'static str,
}

impl Learned {
    /// For people.
    pub(super) fn note(&self, split: &Split, frames: usize, seconds: f64) -> String {
        let (steps, before, after) = (self.steps, self.before, self.after);
        let plural = |n: u64| if n == 1 { "" } else { "s" };
        let so = match after < before {
            true => "",
            false => ", so that the weights stay as they were",
        };
        format!(
            "adapted in {seconds:.1} s ({steps} step{} on {frames} frames): error of rollouts of {} stride{} on the \
             held-back frames {before:.3} -> {after:.3} of holding{so}{}",
            plural(steps),
            split.strides,
            plural(split.strides as u64),
            self.ended
        )
    }
}

impl Learner {
    /// Frames in memory.
    pub(super) fn frames(&self) -> usize {
        self.sample.n_frames
    }

    /// The model with the weights that are used, and where they are from.
    pub(super) fn model(&self) -> Model {
        let Knowledge { optimiser, steps, .. } = &self.knowledge;
        let mut tensors = self.layout.unflatten(&optimiser.weights);
        tensors.extend(self.others.clone());
        let mut spec = self.spec.clone();
        if *steps > 0 {
            spec.training = serde_json::json!({
                "adapted": { "settings": self.settings, "steps": steps, "version": env!("CARGO_PKG_VERSION") },
                "from": self.spec.training,
            });
        }
        Model { spec, tensors }
    }

    /// Optimisation steps, with checks in between. Collective.
    pub(super) fn learn(
        &mut self,
        comm: &Comm,
        backend: &mut NativeBackend,
        split: &Split,
        began: Instant,
    ) -> Result<Learned> {
        let before = self.score(comm, backend, split)?;
        let first = self.knowledge.steps == 0;
        let steps = if first { self.settings.steps } else { self.settings.steps_each };
        let interval = match first {
            true => steps.div_ceil(CHECKS).max(BETWEEN),
            false => steps,
        };
        let mut best = (before, self.knowledge.optimiser.clone());
        let (mut made, mut missed, mut ended) = (0, 0, "");
        while made < steps && ended.is_empty() {
            if self.late(comm, began) {
                ended = "; the budget is spent";
            } else if self.step(comm, backend, split, first.then_some(made))? {
                made += 1;
            } else {
                ended = "; it diverged, and the weights are the best ones before";
                break;
            }
            if made == steps || made.is_multiple_of(interval) || !ended.is_empty() {
                let score = self.score(comm, backend, split)?;
                missed = if score < best.0 { 0 } else { missed + 1 };
                if score < best.0 {
                    best = (score, self.knowledge.optimiser.clone());
                }
                if missed == PATIENCE && made < steps {
                    ended = "; more steps brought nothing";
                }
            }
        }
        let (after, optimiser) = best;
        self.knowledge.optimiser = optimiser;
        Ok(Learned { steps: made, before, after, ended })
    }

    /// Whether the budget of wall time is spent, by the first rank's clock. Collective.
    fn late(&self, comm: &Comm, began: Instant) -> bool {
        let Some(budget) = self.settings.budget else {
            return false;
        };
        let spent = self.knowledge.seconds + began.elapsed().as_secs_f64();
        let mut late = [i64::from(comm.is_root() && spent >= budget)];
        comm.max_i64(&mut late);
        late[0] != 0
    }

    /// One optimisation step; `at` is its number in a first round. False, and nothing done, if loss or gradient is not
    /// finite. Collective.
    fn step(
        &mut self,
        comm: &Comm,
        backend: &mut dyn Backend,
        split: &Split,
        at: Option<u64>,
    ) -> Result<bool> {
        let t = &self.training;
        // Random numbers belong to the step, so that a restart goes on with the same ones.
        let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
        rng.set_stream(self.knowledge.steps + 1);
        let examples = (0..t.batch_size).map(|_| {
            let [old, new] = &split.starts;
            // Later stretches are short, and of the flow as it is now: half of the examples are theirs.
            let starts = match (old.is_empty(), new.is_empty()) {
                (false, false) if rng.random::<bool>() => old,
                (false, true) => old,
                _ => new,
            };
            Example {
                sample: 0,
                frame: starts[rng.random_range(0..starts.len())],
                mirror: t.mirror && rng.random(),
                seed: rng.random(),
                weight: 1.0,
            }
        });
        let examples: Vec<Example> = examples.collect();
        let batch = Batch {
            examples: &examples,
            micro: t.micro_batch,
            total: t.batch_size,
            unroll: 1,
            accumulate: false,
            learn: true,
        };
        let learned =
            learn_together(comm, backend, &self.knowledge.optimiser.weights, &self.normaliser, &batch)?;
        let gradient = learned.gradient.unwrap_or_default();
        let length = norm(&gradient);
        if !(length.is_finite() && learned.losses.iter().all(|l| l.is_finite())) {
            return Ok(false);
        }
        let rate = match at {
            Some(at) => t.learning_rate_at(at),
            None => LATER_RATE * t.learning_rate,
        };
        self.knowledge.optimiser.update(&gradient, length, rate, t.gradient_clip, 0.0);
        self.knowledge.steps += 1;
        Ok(true)
    }

    /// Error of the rollouts over that of holding their first frames; infinite if one leaves the finite numbers. Collective.
    pub(super) fn score(&self, comm: &Comm, backend: &mut dyn Backend, split: &Split) -> Result<f64> {
        let (weights, normaliser) = (&self.knowledge.optimiser.weights, &self.normaliser);
        let fields = self.spec.fields.iter().filter(|f| f.output != Output::None).count();
        let outcomes = roll_out_together(comm, backend, weights, normaliser, &split.rollouts, fields)?;
        let (mut model, mut held) = (0.0, 0.0);
        // By the first predicted field.
        for [m, h] in outcomes.into_iter().flat_map(|errors| errors.into_iter().step_by(fields)) {
            model += m;
            held += h;
        }
        let score = (model / held.max(1e-30)).sqrt();
        Ok(if score.is_finite() { score } else { f64::INFINITY })
    }
}
