//! Training: from recorded trajectories to a model file.
//!
//! The way of the data: request and configuration -> trajectories, in memory or on disk -> gradients by a
//! [`Backend`](m4gn_learn::Backend) -> updates -> checkpoints, log, model file. The loop is the same for the native engine and for
//! libtorch (`torch/`).

mod advice;
pub mod checkpoint;
pub mod config;
mod data_set;
pub mod delta;
mod finish;
mod journal;
mod memory;
mod ranges;
pub mod recorded;
mod report;
pub mod request;
mod start;
#[cfg(test)]
mod tests;
mod trainer;
mod validation;
mod widen;
mod worth;

#[cfg(test)]
extern crate self as m4gn_train;
#[cfg(test)]
#[path = "../../tests/samples/training.rs"]
pub mod sample;

pub use request::Request;
pub use trainer::{Task, train};
pub use validation::HORIZON;

use m4gn_learn::NativeBackend;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use std::sync::atomic::AtomicU8;

/// Trains as asked on the native engine.
///
/// # Errors
/// As [`train`].
pub fn train_native(request: &Request, stop: &AtomicU8, comm: &Comm) -> Result<serde_json::Value> {
    train(request, stop, comm, |task| {
        let backend = NativeBackend::new(&task.config.training, task.spec, task.work, task.threads)?;
        Ok(Box::new(backend))
    })
}
