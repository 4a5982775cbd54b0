//! libtorch as a backend of the training.

use crate::learner::Learner;
use crate::samples::Sample;
use m4gn_base::{Error, Result};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::{Backend, Batch, Example, Learned, Rollout, share_out};
use m4gn_parallel::panic_text;
use m4gn_train::Task;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use tch::Device;

/// The data as tensors, once a thread: tensors that threads share are handles on the same memory.
pub struct TorchBackend {
    learners: Vec<Learner>,
    device: Device,
}

impl TorchBackend {
    /// For a data set in memory.
    ///
    /// Errors: [`m4gn_base::Error::Input`] for noise of several sizes; [`m4gn_base::Error::Model`] for a graph that the model does not know.
    pub fn new(task: &Task, device: Device) -> Result<Self> {
        let t = task.training;
        if t.noise_spread != 1.0 {
            return Err(Error::Input(format!(
                "training.noise_spread: found {}, and libtorch knows 1 alone; use --backend native, or leave it out",
                t.noise_spread
            )));
        }
        // One libtorch thread a worker: graphs are small, and the order of sums stays the same.
        tch::set_num_threads(1);
        let spec = Arc::new(task.spec.clone());
        let tensors = |samples: &[Arc<m4gn_learn::samples::Sample>]| -> Result<Vec<Sample>> {
            samples.iter().map(|s| Sample::new(s, &spec, device)).collect()
        };
        let (train, valid) = (tensors(&task.work.train)?, tensors(&task.work.valid)?);
        let threads = if device == Device::Cpu { task.threads } else { 1 };
        let learner = Learner::new(Arc::new(t.clone()), spec, train, valid, task.work.frames_a_step, device);
        let mut learners: Vec<Learner> = (1..threads).map(|_| learner.share()).collect();
        learners.push(learner);
        Ok(TorchBackend { learners, device })
    }
}

impl Backend for TorchBackend {
    fn name(&self) -> String {
        format!("{} threads of libtorch on {:?}", self.learners.len(), self.device)
    }

    fn learn(&mut self, weights: &[f32], normaliser: &Normaliser, batch: &Batch) -> Result<Learned> {
        let pieces: Vec<&[Example]> = batch.examples.chunks(batch.micro).collect();
        let learned = share_out(&mut self.learners, pieces.len(), |learner, i| {
            guarded(|| learner.learn(weights, normaliser, pieces[i], batch))
        });
        Ok(Learned::sum(self.learners[0].spec(), weights.len(), batch, learned?))
    }

    fn roll_out(
        &mut self,
        weights: &[f32],
        normaliser: &Normaliser,
        plan: &[Rollout],
    ) -> Result<Vec<Vec<[f64; 2]>>> {
        share_out(&mut self.learners, plan.len(), |learner, i| {
            guarded(|| tch::no_grad(|| learner.roll_out(weights, normaliser, &plan[i])))
        })
    }
}

/// libtorch's errors arrive as panics of tch; they become messages.
pub(crate) fn guarded<R>(work: impl FnOnce() -> Result<R>) -> Result<R> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(Error::Internal(message(&*panic))))
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic_text(panic);
    // libtorch appends its own C++ stack.
    text.split("Exception raised from").next().unwrap_or(text).trim().to_string()
}
