//! Trainable M4GN models: training and inference on libtorch.
//!
//! The modules stand in the order of the data's way: configuration and request -> trajectories in memory ->
//! network -> one model step -> gradients on worker threads -> updates -> checkpoints, log, model file.

pub mod bodies;
pub mod capi;
pub mod checkpoint;
pub mod config;
pub mod contact;
pub mod fused;
pub mod inference;
pub mod journal;
pub mod learner;
pub mod network;
pub mod normaliser;
pub mod optimiser;
pub mod pool;
pub mod report;
pub mod request;
pub mod rollout;
pub mod samples;
pub mod trainer;
pub mod weights;
pub mod workload;
