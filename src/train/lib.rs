//! Training: from recorded trajectories to a model file.
//!
//! The modules stand in the order of the data's way: request and configuration -> trajectories, in memory or on disk -> one model
//! step and its derivative -> gradients by a [`Backend`] -> updates -> checkpoints, log, model file. The loop is the same
//! for the native engine and for libtorch (`torch/`).

pub mod adapt;
mod advice;
mod backend;
pub mod checkpoint;
pub mod config;
mod copies;
mod example;
mod finish;
pub mod inputs;
mod journal;
mod memory;
mod native;
pub mod normaliser;
mod page;
mod ranges;
mod recorded;
mod regression;
mod report;
pub mod request;
mod rollout;
#[doc(hidden)]
pub mod sample;
pub mod samples;
mod smoother;
mod start;
pub mod state;
mod tensor_file;
#[cfg(test)]
mod tests;
mod together;
mod trainer;
mod validation;
mod widen;
mod workload;

pub use backend::{Backend, Batch, Example, Learned, Rollout};
pub use native::NativeBackend;
pub use request::Request;
pub use trainer::{Task, train};
pub use validation::HORIZON;
pub use workload::Workload;

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
