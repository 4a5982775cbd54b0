//! Learning: gradients of a loss over model steps, from trajectories in memory or read frame by frame.
//!
//! The modules stand in the order of the data's way: trajectories -> one model step and its derivative -> gradients by a
//! [`Backend`], of which the native engine is one and libtorch (`torch/`) the other -> shared out to the ranks. Nothing here
//! reads or writes files.

mod backend;
mod config;
pub mod data_parallel;
mod example;
pub mod inputs;
mod native;
pub mod normaliser;
pub mod rollout;
pub mod samples;
#[cfg(test)]
mod tests;
mod workload;

pub use backend::{Backend, Batch, Example, Learned, Rollout};
pub use config::{BestOf, Decay, Restart, Schedule, TrainingConfig};
pub use native::{NativeBackend, share_out};
pub use workload::Workload;
