//! What is done with models and trajectories outside of a solver: validation, comparison of runs, surveys of segments,
//! generators of training data, hybrid runs of many cases, benchmarks, and what the reports of all of them say.

pub mod bench;
pub mod calibrate;
pub mod compare;
mod digest;
pub mod errors;
mod foam_bridge;
pub mod foam_case;
pub mod generate;
pub mod holding;
pub mod hybrid;
pub mod signal;
pub mod survey;
pub mod validate;
