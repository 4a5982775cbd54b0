//! Trainable M4GN models on libtorch: the backend `torch` of the training, and inference.
//!
//! The training itself, from the data to the model file, is `m4gn_train`; here is what computes: trajectories as tensors
//! -> network -> one model step -> gradients on worker threads.

pub mod backend;
pub mod capi;
pub mod contact;
pub mod device;
pub mod inference;
pub mod learner;
pub mod network;
pub mod normaliser;
pub mod processor;
pub mod rollout;
pub mod samples;
pub mod shared;
pub mod weights;
