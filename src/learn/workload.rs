//! The trajectories of a training.

use super::samples::Sample;
use m4gn_base::Result;
use m4gn_domain::Components;
use m4gn_model::ModelSpec;
use std::sync::Arc;

/// Trajectories to train on and to validate on.
#[derive(Debug)]
pub struct Workload {
    /// Of split `train`.
    pub train: Vec<Arc<Sample>>,
    /// The first of split `valid`; of `train` if there are none.
    pub valid: Vec<Arc<Sample>>,
    /// Data frames in one model step.
    pub frames_a_step: usize,
    /// File name, number of frames, what these span, and a digest of the first and the last, of each trajectory; a resumed training must find the same.
    pub names: Vec<String>,
}

/// Trajectories that hardly change weigh as if they changed by this share of the mean.
const LEAST_CHANGE: f64 = 0.05;

impl Workload {
    /// What the errors of each training trajectory are multiplied with in the loss, 1 in the mean:
    /// `(c + 0.05)^-balance`, where `c` is the mean square of the change of the first predicted field in a model step, over
    /// that of all trajectories. Errors grow with what changes, so without it the fastest flows decide what is learned.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn weights(&self, spec: &ModelSpec, balance: f64) -> Result<Vec<f64>> {
        let count = self.train.len();
        if balance == 0.0 {
            return Ok(vec![1.0; count]);
        }
        let changes = self.train.iter().map(|s| self.change(s, spec));
        let changes = changes.collect::<Result<Vec<f64>>>()?;
        let mean = changes.iter().sum::<f64>() / count as f64;
        if mean == 0.0 {
            return Ok(vec![1.0; count]);
        }
        let weights: Vec<f64> = changes.iter().map(|c| (c / mean + LEAST_CHANGE).powf(-balance)).collect();
        let all = weights.iter().sum::<f64>() / count as f64;
        Ok(weights.iter().map(|w| w / all).collect())
    }

    /// Mean square of what the first predicted field changes by in a model step, over cells and at most 32 frames.
    fn change(&self, sample: &Sample, spec: &ModelSpec) -> Result<f64> {
        let c = Components::new(spec);
        let last = sample.n_frames - self.frames_a_step;
        let frames = (0..last).step_by(last.div_ceil(32).max(1));
        let changes = frames.map(|frame| {
            let (now, then) = (sample.frame(frame)?, sample.frame(frame + self.frames_a_step)?);
            Ok(c.mean_square(c.headline(), &now, &then, 0..sample.n_cells()))
        });
        let changes = changes.collect::<Result<Vec<f64>>>()?;
        Ok(changes.iter().sum::<f64>() / changes.len().max(1) as f64)
    }

    /// Bytes of all frames, of those in memory, and the number of trajectories whose frames stay on disk.
    pub fn sizes(&self) -> (u64, u64, usize) {
        let mut samples: Vec<&Arc<Sample>> = self.train.iter().collect();
        // Without trajectories of split `valid` those of `train` stand in both lists.
        samples.extend(self.valid.iter().filter(|v| !self.train.iter().any(|t| Arc::ptr_eq(t, v))));
        let all = samples.iter().map(|s| s.frame_bytes()).sum();
        let (streamed, kept): (Vec<_>, Vec<_>) = samples.into_iter().partition(|s| s.is_streamed());
        (all, kept.iter().map(|s| s.frame_bytes()).sum(), streamed.len())
    }
}
