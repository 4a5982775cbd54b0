//! A round of an adaptation: optimisation steps on the frames in memory, checked on those that are held back.

use super::clock;
use super::{Adaptation, Layers, Method, Mode};
use crate::backend::{Backend, Batch, Example, Rollout};
use crate::native::NativeBackend;
use crate::together::{learn_together, roll_out_together};
use crate::workload::Workload;
use m4gn_engine::backward::norm;
use m4gn_mesh::{Error, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Checks of the first round; it ends after this many that brought nothing.
const CHECKS: u64 = 6;
const PATIENCE: u64 = 3;

/// Rollouts of a check.
const ROLLOUTS: usize = 4;

/// Learning rate of later rounds, as a share of the first one's.
const LATER_RATE: f64 = 0.3;

/// What came of a round.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Whether the weights are others now.
    pub used: bool,
    /// Optimisation steps made, or regressions.
    pub steps: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Frames in memory.
    pub frames: usize,
    /// Model steps of the rollouts on the frames that were held back.
    pub strides: usize,
    /// Root mean square error of these rollouts over that of holding their first frame: with the weights before.
    pub before: f64,
    /// With the weights that are used now.
    pub after: f64,
    /// All of this, or why nothing was done, for people.
    pub note: String,
}

/// Frames to learn from, and rollouts to judge by.
pub(super) struct Split {
    pub frames_a_step: usize,
    /// First frames of examples: of the oldest stretch, and of all later ones.
    pub starts: [Vec<usize>; 2],
    /// The same with those that are held back.
    pub all: [Vec<usize>; 2],
    rollouts: Vec<Rollout>,
    strides: usize,
    /// Rollouts that tell the clock.
    pub clock: Vec<Rollout>,
    /// Whether the newest stretch is one of those that they are on.
    fresh: bool,
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
    fn note(&self, split: &Split, frames: usize, seconds: f64, method: Method) -> String {
        let (steps, before, after) = (self.steps, self.before, self.after);
        let what = match method {
            Method::Gradient => "step",
            Method::Ridge => "regression",
            Method::Clock => return format!("not adapted but timed in {seconds:.1} s on {frames} frames"),
        };
        let plural = |n: u64| if n == 1 { "" } else { "s" };
        let so = match after < before {
            true => "",
            false => ", so that the weights stay as they were",
        };
        format!(
            "adapted in {seconds:.1} s ({steps} {what}{} on {frames} frames): error of rollouts of {} stride{} on the \
             held-back frames {before:.3} -> {after:.3} of holding{so}{}",
            plural(steps),
            split.strides,
            plural(split.strides as u64),
            self.ended
        )
    }
}

impl Adaptation {
    /// Learns, and keeps the weights of the check that went best, or those from before. `strides` are the model steps of the
    /// next jump. Without enough frames nothing is done, and the outcome says so; after the one round of mode `before` there is
    /// nothing more to do. Collective; all ranks fail together, and
    /// the weights are then those from before.
    ///
    /// # Errors
    /// What the engine may fail with.
    pub fn run(&mut self, strides: usize) -> Result<Outcome> {
        if self.done {
            return Ok(Outcome::default());
        }
        let before = self.optimiser.clone();
        let result = self.round(strides);
        match &result {
            Ok(_) if self.settings.mode == Mode::Before => self.finish(),
            Ok(_) => {}
            Err(_) => self.optimiser = before,
        }
        result
    }

    fn round(&mut self, strides: usize) -> Result<Outcome> {
        let began = Instant::now();
        let frames = self.frames();
        let nothing = |note: &str| Outcome {
            frames,
            note: format!("not adapted: {note}"),
            ..Outcome::default()
        };
        let split = match self.split(strides) {
            Ok(split) => split,
            Err(why) => return Ok(nothing(&why)),
        };
        let sample = Arc::get_mut(&mut self.sample);
        let sample = sample.ok_or_else(|| Error::Internal("frames that are still being read".into()))?;
        sample.find_copies(&self.whole, &self.spec);
        let work = Workload {
            train: vec![self.sample.clone()],
            valid: vec![self.sample.clone()],
            frames_a_step: split.frames_a_step,
            names: Vec::new(),
        };
        let backend = NativeBackend::new(&self.training, &self.spec, &work, self.threads);
        let mut backend = self.comm.agree(backend)?;
        let learned = self.learn(&mut backend, &split, began)?;
        let used = learned.after < learned.before;
        if self.settings.clock() && (used || split.fresh || self.clock.is_none()) {
            self.clock = self.measure_clock(&backend, &split)?;
        }
        let seconds = began.elapsed().as_secs_f64();
        self.seconds += seconds;
        let mut note = learned.note(&split, frames, seconds, self.settings.method);
        if self.settings.clock() {
            let clock = self.clock.map(|clock| clock.note(self.spec.stride));
            note += "; ";
            note += &clock
                .unwrap_or_else(|| "the frames are too few, or too far apart, to tell the clock".into());
        }
        Ok(Outcome {
            used,
            steps: learned.steps,
            seconds,
            frames,
            strides: split.strides,
            before: learned.before,
            after: learned.after,
            note,
        })
    }

    /// Learns as the settings say. Collective.
    fn learn(&mut self, backend: &mut NativeBackend, split: &Split, began: Instant) -> Result<Learned> {
        let before = self.score(backend, split)?;
        match self.settings.method {
            Method::Gradient => self.descend(backend, split, before, began),
            Method::Ridge => self.fit(backend, split, before),
            Method::Clock => Ok(Learned {
                steps: 0,
                before,
                after: before,
                ended: "",
            }),
        }
    }

    /// Optimisation steps, with checks in between. Collective.
    fn descend(
        &mut self,
        backend: &mut NativeBackend,
        split: &Split,
        before: f64,
        began: Instant,
    ) -> Result<Learned> {
        let first = self.steps == 0;
        let steps = if first {
            self.settings.steps
        } else {
            self.settings.steps_each
        };
        let interval = if first { steps.div_ceil(CHECKS) } else { steps };
        let mut best = (before, self.optimiser.clone());
        let (mut made, mut missed, mut ended) = (0, 0, "");
        while made < steps && ended.is_empty() {
            if self.late(began) {
                ended = "; the budget is spent";
            } else if self.step(backend, split, first.then_some(made))? {
                made += 1;
            } else {
                ended = "; it diverged, and the weights are the best ones before";
                break;
            }
            if made == steps || made.is_multiple_of(interval) || !ended.is_empty() {
                let score = self.score(backend, split)?;
                missed = if score < best.0 { 0 } else { missed + 1 };
                if score < best.0 {
                    best = (score, self.optimiser.clone());
                }
                if missed == PATIENCE && made < steps {
                    ended = "; more steps brought nothing";
                }
            }
        }
        let (after, optimiser) = best;
        self.optimiser = optimiser;
        Ok(Learned {
            steps: made,
            before,
            after,
            ended,
        })
    }

    /// Whether the budget of wall time is spent, by the first rank's clock. Collective.
    fn late(&self, began: Instant) -> bool {
        let Some(budget) = self.settings.budget else {
            return false;
        };
        let spent = self.seconds + began.elapsed().as_secs_f64();
        let mut late = [i64::from(self.comm.is_root() && spent >= budget)];
        self.comm.max_i64(&mut late);
        late[0] != 0
    }

    /// One optimisation step; `at` is its number in a first round. False, and nothing done, if loss or gradient is not
    /// finite. Collective.
    fn step(&mut self, backend: &mut dyn Backend, split: &Split, at: Option<u64>) -> Result<bool> {
        let t = &self.training;
        // Random numbers belong to the step, so that a restart goes on with the same ones.
        let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
        rng.set_stream(self.steps + 1);
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
            unroll: self.settings.unroll,
            accumulate: false,
            learn: true,
        };
        let learned = learn_together(
            &self.comm,
            backend,
            &self.optimiser.weights,
            &self.normaliser,
            &batch,
        )?;
        let mut gradient = learned.gradient.unwrap_or_default();
        self.mask(&mut gradient);
        let length = norm(&gradient);
        if !(length.is_finite() && learned.losses.iter().all(|l| l.is_finite())) {
            return Ok(false);
        }
        let rate = match at {
            Some(at) => t.learning_rate_at(at),
            None => LATER_RATE * t.learning_rate,
        };
        self.optimiser
            .update(&gradient, length, rate, t.gradient_clip, 0.0);
        let pull = (rate * self.settings.pull).min(1.0) as f32;
        if pull > 0.0 {
            let pairs = self.optimiser.weights.iter_mut().zip(&self.shipped);
            pairs.for_each(|(weight, shipped)| *weight -= pull * (*weight - shipped));
        }
        self.steps += 1;
        Ok(true)
    }

    /// Clears the derivatives by weights that do not learn.
    fn mask(&self, gradient: &mut [f32]) {
        let last = format!("decoder.{}.", self.spec.architecture.hidden_layers);
        let learns = |name: &str| match self.settings.layers {
            Layers::All => true,
            Layers::Decoder => name.starts_with("decoder."),
            Layers::Last => name.starts_with(&last),
        };
        let mut rest = gradient;
        for (name, shape) in self.layout.entries() {
            let Some((own, after)) = rest.split_at_mut_checked(shape.iter().product()) else {
                return;
            };
            if !learns(name) {
                own.fill(0.0);
            }
            rest = after;
        }
    }

    /// Error of the rollouts over that of holding their first frames; infinite if one leaves the finite numbers. Collective.
    pub(super) fn score(&self, backend: &mut dyn Backend, split: &Split) -> Result<f64> {
        let (weights, normaliser) = (&self.optimiser.weights, &self.normaliser);
        let outcomes = roll_out_together(&self.comm, backend, weights, normaliser, &split.rollouts)?;
        let (mut model, mut held) = (0.0, 0.0);
        for (m, h) in outcomes.into_iter().flatten() {
            model += m;
            held += h;
        }
        let score = (model / held.max(1e-30)).sqrt();
        Ok(if score.is_finite() { score } else { f64::INFINITY })
    }

    /// Divides the frames. In a first round the last ones are held back; later the newest stretch of the solver, which no
    /// gradient has seen.
    fn split(&self, strides: usize) -> std::result::Result<Split, String> {
        let ranges = self.window.stretches();
        let (Some(n), Some(newest)) = (self.window.frames_a_stride(), ranges.last()) else {
            return Err("there are fewer than two frames of the solver".into());
        };
        let frames = self.frames();
        let tail = ((self.settings.held_back * frames as f64).round() as usize).max(n + 1);
        let behind = |cut: usize| {
            let steps = |r: &std::ops::Range<usize>| r.end.saturating_sub(cut.max(r.start) + 1) / n;
            ranges.iter().map(steps).max().unwrap_or(0)
        };
        let mut cut = match self.steps == 0 {
            true => frames.saturating_sub(tail),
            false => newest.start,
        };
        if behind(cut) == 0 {
            cut = newest.start;
        }
        let longest = behind(cut);
        let span = self.settings.unroll * n;
        let starts = |cut: usize| {
            let of = |r: &std::ops::Range<usize>| r.start..r.end.min(cut).saturating_sub(span).max(r.start);
            [&ranges[..1], &ranges[1..]].map(|ranges| ranges.iter().flat_map(of).collect::<Vec<_>>())
        };
        let [old, new] = starts(cut);
        if longest == 0 || old.is_empty() && new.is_empty() {
            return Err(format!(
                "the {frames} frames of the solver ({n} a stride) are too few to learn from some and judge by others: let the \
                 solver run longer alone, or start earlier"
            ));
        }
        let clock = clock::plan(&ranges, strides, n);
        // With a third to spare, so that several rollouts begin at different frames.
        let strides = strides.clamp(1, (2 * longest / 3).max(1));
        let held = ranges
            .iter()
            .flat_map(|r| cut.max(r.start)..r.end.saturating_sub(strides * n));
        let held: Vec<usize> = held.collect();
        let count = held.len().min(ROLLOUTS);
        let pick = |i: usize| match count {
            1 => held[0],
            _ => held[i * (held.len() - 1) / (count - 1)],
        };
        Ok(Split {
            frames_a_step: n,
            starts: [old, new],
            all: starts(frames),
            rollouts: (0..count)
                .map(|i| Rollout {
                    sample: 0,
                    frame: pick(i),
                    steps: strides,
                })
                .collect(),
            strides,
            fresh: clock.last().is_some_and(|r| r.frame >= newest.start),
            clock,
        })
    }
}
