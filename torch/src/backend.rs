//! libtorch as a backend of the training.

use crate::device::to_host;
use crate::learner::{Job, Learner, Outcome};
use crate::pool::Pool;
use crate::samples::Sample;
use m4gn_base::{Error, Result};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::{Backend, Batch, Learned, Rollout};
use m4gn_model::ModelSpec;
use m4gn_train::Task;
use std::sync::Arc;
use tch::{Device, Tensor};

/// Worker threads with the data as tensors.
pub struct TorchBackend {
    pool: Pool,
    threads: usize,
    device: Device,
    spec: Arc<ModelSpec>,
}

impl TorchBackend {
    /// For a data set in memory.
    ///
    /// Errors: [`m4gn_base::Error::Input`] where threads cannot be started, or for noise of several sizes or that is not corrected;
    /// [`m4gn_base::Error::Model`] for a graph that the model does not know.
    pub fn new(task: &Task, device: Device) -> Result<Self> {
        let t = &task.config.training;
        for (key, found) in [("noise_spread", t.noise_spread), ("noise_correction", t.noise_correction)] {
            if found != 1.0 {
                return Err(Error::Input(format!(
                    "training.{key}: found {found}, and libtorch knows 1 alone; use --backend native, or leave it out"
                )));
            }
        }
        // One libtorch thread a worker: graphs are small, and the order of sums stays the same.
        tch::set_num_threads(1);
        let spec = Arc::new(task.spec.clone());
        let tensors = |samples: &[Arc<m4gn_learn::samples::Sample>]| -> Result<Vec<Sample>> {
            samples.iter().map(|s| Sample::new(s, &spec, device)).collect()
        };
        let (train, valid) = (tensors(&task.work.train)?, tensors(&task.work.valid)?);
        let threads = if device == Device::Cpu { task.threads } else { 1 };
        let config = Arc::new(task.config.clone());
        let learner = Learner::new(config, spec.clone(), train, valid, task.work.frames_a_step, device);
        Ok(TorchBackend { pool: Pool::new(learner, threads)?, threads, device, spec })
    }
}

impl Backend for TorchBackend {
    fn name(&self) -> String {
        format!("{} threads of libtorch on {:?}", self.threads, self.device)
    }

    fn learn(&mut self, weights: &[f32], normaliser: &Normaliser, batch: &Batch) -> Result<Learned> {
        let weights = Tensor::from_slice(weights).to_device(self.device);
        let job = |piece: &[m4gn_learn::Example]| Job::Learn {
            weights: weights.shallow_clone(),
            normaliser: normaliser.clone(),
            examples: piece.to_vec(),
            unroll: batch.unroll,
            accumulate: batch.accumulate,
            learn: batch.learn,
        };
        let jobs = batch.examples.chunks(batch.micro).map(job).collect();
        let mut gradients: Option<Tensor> = None;
        let predicted = self.spec.fields.iter().filter(|f| f.output != m4gn_model::Output::None);
        let mut losses = vec![0.0; predicted.count()];
        let mut moments = batch.accumulate.then(|| Normaliser::new(&self.spec));
        for outcome in self.pool.run(jobs)? {
            let Outcome::Learned { gradient, losses: piece, moments: seen, examples } = outcome else {
                continue;
            };
            let part = examples as f64 / batch.total as f64;
            if let (Some(moments), Some(seen)) = (&mut moments, seen) {
                moments.add(&seen);
            }
            losses.iter_mut().zip(&piece).for_each(|(sum, loss)| *sum += part * loss);
            if let Some(gradient) = gradient {
                let gradient = gradient * part;
                gradients = Some(match gradients {
                    Some(sum) => sum + gradient,
                    None => gradient,
                });
            }
        }
        Ok(Learned { gradient: gradients.map(|g| to_host(&g)), losses, moments })
    }

    fn roll_out(
        &mut self,
        weights: &[f32],
        normaliser: &Normaliser,
        plan: &[Rollout],
    ) -> Result<Vec<Vec<[f64; 2]>>> {
        let weights = Tensor::from_slice(weights).to_device(self.device);
        let job = |rollout: &Rollout| Job::Rollout {
            weights: weights.shallow_clone(),
            normaliser: normaliser.clone(),
            sample: rollout.sample,
            frame: rollout.frame,
            steps: rollout.steps,
        };
        let outcomes = self.pool.run(plan.iter().map(job).collect())?;
        let errors = outcomes.into_iter().map(|outcome| match outcome {
            Outcome::Rolled(errors) => errors,
            Outcome::Learned { .. } => Vec::new(),
        });
        Ok(errors.collect())
    }
}
