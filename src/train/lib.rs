//! Training: from recorded trajectories to a model file.
//!
//! The way of the data: request and configuration -> trajectories, in memory or on disk -> gradients by a
//! [`Backend`](m4gn_learn::Backend) -> updates -> checkpoints, log, model file. The loop is the same for the native engine and for
//! libtorch (`torch/`).

pub mod checkpoint;
pub mod config;
mod data_checks;
mod data_set;
pub mod delta;
mod diagnostics;
pub mod errors;
mod finish;
mod log;
mod memory;
mod net2net;
pub mod recorded;
mod report;
pub mod request;
mod start;
#[cfg(test)]
mod tests;
mod trainer;
mod validation;

#[cfg(test)]
extern crate self as m4gn_train;
#[cfg(test)]
#[path = "../../tests/samples/training.rs"]
pub mod sample;

pub use data_set::model_of;
pub use errors::HORIZON;
pub use request::Request;
pub use trainer::{Task, train};

use m4gn_base::Result;
use m4gn_learn::NativeBackend;
use m4gn_parallel::Comm;
use std::sync::atomic::AtomicU8;

/// Trains as asked on the native engine.
///
/// # Errors
/// As [`train`].
pub fn train_native(request: &Request, stop: &AtomicU8, comm: &Comm) -> Result<serde_json::Value> {
    train(request, stop, comm, |task| {
        let backend = NativeBackend::new(task.training, task.spec, task.work, task.threads)?;
        Ok(Box::new(backend))
    })
}
