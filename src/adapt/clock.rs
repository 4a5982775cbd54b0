//! The surrogate's clock: how much more time its steps stand for than they say.
//!
//! What is left of a rollout's error after some strides is, in a flow that sheds vortices or a body that swings, mostly a lag: the
//! predicted state is the solver's of another time. The lag of a step grows over the first steps of a rollout, as its state comes
//! to the surrogate's own motion, and then hardly differs from step to step and from rollout to rollout of a case. So a few
//! rollouts over the solver's own frames tell it, and whoever steps on lets a jump take as much more time.

use super::learner::Learner;
use super::round::Split;
use m4gn_learn::NativeBackend;
use m4gn_learn::Rollout;
use m4gn_learn::rollout::Lag;
use m4gn_learn::together::{gather_shares, own_share};
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Rollouts that it is measured on, at most.
const ROLLOUTS: usize = 4;

/// Least frames of a stride: with fewer the rate of change between frames is not that at one of them.
const FRAMES_A_STRIDE: usize = 4;

/// Largest part of a stride that a stride may be off by; beyond, it is no matter of the clock.
const MOST: f64 = 0.2;

/// Time by which a model step brings the surrogate further than its stride, s; negative: less far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ahead {
    /// In a jump from a state of the solver's own: by the first half of the rollouts.
    pub first: f64,
    /// In later jumps: by whole rollouts. The solver's few steps before a jump bring the state back a part of the way to the
    /// solver's own motion.
    pub later: f64,
}

/// What rollouts told of the surrogate's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// Mean over the rollouts; 0 where they differ by more than that.
    pub ahead: Ahead,
    /// Standard deviation over the rollouts of what later jumps have.
    pub spread: f64,
    /// Rollouts.
    pub rollouts: usize,
    /// Model steps of each.
    pub strides: usize,
}

impl Clock {
    /// Of the lags after half of the strides and after all of them.
    fn new(lags: &[[Lag; 2]], strides: usize, stride: f64) -> Self {
        let rate = |lag: &Lag, strides: usize| (lag.ahead / strides as f64, lag.weight);
        let (first, _) = mean(lags.iter().map(|[half, _]| rate(half, strides / 2)), stride);
        let (later, spread) = mean(lags.iter().map(|[_, whole]| rate(whole, strides)), stride);
        Clock { ahead: Ahead { first, later }, spread, rollouts: lags.len(), strides }
    }

    /// For people.
    pub(super) fn note(&self, stride: f64) -> String {
        let percent = |time: f64| 100.0 * time.abs() / stride;
        let Ahead { first, later } = self.ahead;
        let what = match later {
            0.0 => "steps take the time that they say".to_string(),
            _ => format!(
                "a step takes {:.2} % {} time than the stride (standard deviation {:.2}; {:+.2} % in the first jump)",
                percent(later),
                if later > 0.0 { "more" } else { "less" },
                percent(self.spread),
                percent(first) * first.signum()
            ),
        };
        format!("the clock by {} rollouts of {} strides: {what}", self.rollouts, self.strides)
    }
}

/// Mean by weight, and standard deviation; a mean of 0 where it is less than the deviation, or more than a clock can be off.
fn mean(values: impl Iterator<Item = (f64, f64)> + Clone, stride: f64) -> (f64, f64) {
    let weight: f64 = values.clone().map(|(_, w)| w).sum();
    let mean = values.clone().map(|(v, w)| w * v).sum::<f64>() / weight;
    let spread = (values.clone().map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>() / weight).sqrt();
    match values.count() > 1 && mean.abs() >= spread && mean.abs() <= MOST * stride {
        true => (mean, spread),
        false => (0.0, if spread.is_finite() { spread } else { 0.0 }),
    }
}

impl Learner {
    /// The clock with the present weights, by rollouts of twice as many strides as the next jump has, or as fit; none where
    /// no frames tell it. Collective.
    pub(super) fn measure_clock(
        &self,
        comm: &Comm,
        backend: &NativeBackend,
        split: &Split,
    ) -> Result<Option<Clock>> {
        let (plan, n) = (&split.clock, split.frames_a_step);
        let Some(strides) = plan.first().map(|r| r.steps).filter(|_| n >= FRAMES_A_STRIDE) else {
            return Ok(None);
        };
        let own = own_share(comm, plan);
        let model = backend.model(&self.knowledge.optimiser.weights, &self.normaliser);
        let interval = self.spec.stride / n as f64;
        let found = backend
            .on_threads(own.len(), |i| backend.lags(&model, &own[i], [strides / 2, strides], interval));
        let numbers = |lags: [Lag; 2]| lags.iter().flat_map(|lag| [lag.ahead, lag.weight]).collect();
        let found = comm.agree(found)?.into_iter().map(numbers);
        let flat = gather_shares(comm, plan.iter().map(|_| 4), found);
        let lag = |f: &[f64]| Lag { ahead: f[0], weight: f[1] };
        let lags: Vec<[Lag; 2]> = flat.chunks_exact(4).map(|f| [lag(&f[..2]), lag(&f[2..])]).collect();
        Ok(Some(Clock::new(&lags, strides, self.spec.stride)))
    }
}

/// At most so many rollouts of twice so many strides, evenly apart over stretches of frames, each with a stride and a frame
/// behind its end. None where not even two strides fit.
pub(super) fn plan(stretches: &[Range<usize>], strides: usize, frames_a_step: usize) -> Vec<Rollout> {
    let longest = stretches.iter().map(|r| r.len().saturating_sub(2) / frames_a_step);
    let longest = longest.max().unwrap_or(0).saturating_sub(1);
    if longest < 2 {
        return Vec::new();
    }
    // With a third to spare, so that several rollouts begin at different frames.
    let steps = (2 * strides).clamp(2, (2 * longest / 3).max(2));
    let starts =
        stretches.iter().flat_map(|r| r.start..r.end.saturating_sub((steps + 1) * frames_a_step + 1));
    let starts: Vec<usize> = starts.collect();
    let count = starts.len().min(ROLLOUTS);
    (1..=count).map(|i| Rollout { sample: 0, frame: starts[i * (starts.len() - 1) / count], steps }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lags of ten strides: so many seconds a stride over the first half, and over all of them.
    fn lags(first: f64, later: f64, weight: f64) -> [Lag; 2] {
        let lag = |ahead| Lag { ahead, weight };
        [lag(5.0 * first), lag(10.0 * later)]
    }

    #[test]
    fn a_lag_is_told_by_rollouts_that_agree() {
        let clock = Clock::new(&[lags(0.001, 0.002, 1.0), lags(0.002, 0.006, 3.0)], 10, 0.05);
        let Ahead { first, later } = clock.ahead;
        assert!((first - 0.00175).abs() < 1e-12 && (later - 0.005).abs() < 1e-12, "{clock:?}");
        // 3/4 of 0.001 and 1/4 of 0.003, squares
        assert!((clock.spread - 3e-6f64.sqrt()).abs() < 1e-12, "{clock:?}");
        let note = clock.note(0.05);
        assert!(note.contains("10.00 % more") && note.contains("+3.50 % in the first"), "{note}");
        let slow = Clock::new(&[lags(-0.001, -0.0015, 1.0); 2], 10, 0.05);
        assert!(slow.note(0.05).contains("3.00 % less"), "{}", slow.note(0.05));
        assert!(slow.note(0.05).contains("-2.00 % in the first"), "{}", slow.note(0.05));
    }

    #[test]
    fn where_they_do_not_agree_the_clock_is_right() {
        for found in [
            vec![],
            vec![lags(0.001, 0.001, 1.0)],
            vec![lags(0.001, 0.002, 1.0), lags(-0.001, -0.002, 1.0)],
            // Nothing moves.
            vec![lags(f64::NAN, f64::NAN, 0.0); 3],
            // Further off than a clock can be.
            vec![lags(0.02, 0.02, 1.0); 3],
            vec![lags(f64::INFINITY, f64::INFINITY, 1.0); 3],
        ] {
            let clock = Clock::new(&found, 10, 0.05);
            assert_eq!(clock.ahead, Ahead::default(), "{found:?}");
            assert!(clock.spread.is_finite());
        }
        let note = Clock::new(&[], 10, 0.05).note(0.05);
        assert!(note.contains("the time that they say"), "{note}");
    }

    #[test]
    fn rollouts_end_a_stride_and_a_frame_before_a_stretch_does() {
        // Of four strides of four frames two are rolled out; the other stretch is too short.
        let found = plan(&[0..18, 18..25], 10, 4);
        let found: Vec<_> = found.iter().map(|r| (r.frame, r.steps)).collect();
        assert_eq!(found, [(1, 2), (2, 2), (3, 2), (4, 2)]);
        let one = |frames: usize| std::iter::once(0..frames).collect::<Vec<_>>();
        assert!(plan(&one(13), 10, 4).is_empty());
        let found = plan(&one(14), 10, 4);
        assert_eq!(found.iter().map(|r| (r.frame, r.steps)).collect::<Vec<_>>(), [(0, 2)]);
        let found = plan(&one(401), 10, 10);
        assert_eq!(found.last().map(|r| (r.frame, r.steps)), Some((189, 20)));
    }
}
