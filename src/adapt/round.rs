//! A round of an adaptation: optimisation steps on the frames in memory, checked on those that are held back.

use super::learner::Learner;
use super::{Adaptation, Mode};
use m4gn_base::{Error, Result};
use m4gn_learn::NativeBackend;
use m4gn_learn::Rollout;
use m4gn_learn::Workload;
use m4gn_parallel::Comm;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Rollouts of a check.
const ROLLOUTS: usize = 4;

/// What came of a round.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Whether the weights are others now.
    pub used: bool,
    /// Optimisation steps made.
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
    pub rollouts: Vec<Rollout>,
    pub strides: usize,
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
        let mut outcome = Outcome { frames: self.frames(), ..Outcome::default() };
        match self.learner.split(strides) {
            Err(why) => outcome.note = format!("not adapted: {why}"),
            Ok(split) => {
                self.learner.prepare()?;
                let before = self.learner.knowledge.clone();
                let result = self.learner.round(&self.comm, &split);
                if result.is_err() {
                    self.learner.knowledge = before;
                }
                outcome = result?;
            }
        }
        if self.learner.settings.mode == Mode::Before {
            self.finish();
        }
        Ok(outcome)
    }
}

impl Learner {
    /// Makes the frames ready to be learned from.
    fn prepare(&mut self) -> Result<()> {
        let sample = Arc::get_mut(&mut self.sample);
        let sample = sample.ok_or_else(|| Error::Internal("frames that are still being read".into()))?;
        sample.settle_boundary();
        Ok(())
    }

    /// Learns; the knowledge is of no use where it fails. Collective.
    fn round(&mut self, comm: &Comm, split: &Split) -> Result<Outcome> {
        let began = Instant::now();
        let frames = self.frames();
        let work = Workload {
            train: vec![self.sample.clone()],
            valid: vec![self.sample.clone()],
            frames_a_step: split.frames_a_step,
            names: Vec::new(),
        };
        let backend = NativeBackend::new(&self.training, &self.spec, &work, self.threads);
        let mut backend = comm.agree(backend)?;
        let learned = self.learn(comm, &mut backend, split, began)?;
        let used = learned.after < learned.before;
        let seconds = began.elapsed().as_secs_f64();
        self.knowledge.seconds += seconds;
        let note = learned.note(split, frames, seconds);
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

    /// Divides the frames. In a first round the last ones are held back; later the newest stretch of the solver, which no
    /// gradient has seen.
    fn split(&self, strides: usize) -> std::result::Result<Split, String> {
        let ranges = self.window.stretches();
        let Some(n) = self.window.frames_a_stride() else {
            return Err("there are fewer than two frames of the solver".into());
        };
        let Some(newest) = ranges.last() else {
            return Err("there are fewer than two frames of the solver".into());
        };
        let frames = self.frames();
        let tail = ((self.settings.held_back * frames as f64).round() as usize).max(n + 1);
        let behind = |cut: usize| {
            let steps = |r: &std::ops::Range<usize>| r.end.saturating_sub(cut.max(r.start) + 1) / n;
            ranges.iter().map(steps).max().unwrap_or(0)
        };
        let mut cut = match self.knowledge.steps == 0 {
            true => frames.saturating_sub(tail),
            false => newest.start,
        };
        if behind(cut) == 0 {
            cut = newest.start;
        }
        let longest = behind(cut);
        let starts = |cut: usize| {
            let of = |r: &std::ops::Range<usize>| r.start..r.end.min(cut).saturating_sub(n).max(r.start);
            [&ranges[..1], &ranges[1..]].map(|ranges| ranges.iter().flat_map(of).collect::<Vec<_>>())
        };
        let [old, new] = starts(cut);
        if longest == 0 || old.is_empty() && new.is_empty() {
            return Err(format!(
                "the {frames} frames of the solver ({n} a stride) are too few to learn from some and judge by others: let the \
                 solver run longer alone, or start earlier"
            ));
        }
        // With a third to spare, so that several rollouts begin at different frames.
        let strides = strides.clamp(1, (2 * longest / 3).max(1));
        let held = ranges.iter().flat_map(|r| cut.max(r.start)..r.end.saturating_sub(strides * n));
        let held: Vec<usize> = held.collect();
        let count = held.len().min(ROLLOUTS);
        let pick = |i: usize| match count {
            1 => held[0],
            _ => held[i * (held.len() - 1) / (count - 1)],
        };
        Ok(Split {
            frames_a_step: n,
            starts: [old, new],
            rollouts: (0..count).map(|i| Rollout { sample: 0, frame: pick(i), steps: strides }).collect(),
            strides,
        })
    }
}
