//! What is done with models and trajectories outside of a solver: eleven tools, a module each.
//!
//! | module | tool | its way in |
//! | --- | --- | --- |
//! | [`check`] | whether a case fits | [`check::run`] |
//! | [`validate`], [`calibrate`] | a model on recorded trajectories, beside its baselines | [`validate::run`], [`calibrate::rollouts`] |
//! | [`compare`] | two runs of a case: fields, forces, motion, times | [`compare::compare`] |
//! | [`verify`] | the jumps of a run, recomputed by its solver | [`verify::run`] |
//! | [`hybrid`] | many cases, each with and without surrogate | [`hybrid::run`] |
//! | [`generate`] | training data | [`generate::queue::Queue::run`] |
//! | [`campaign`] | runs of a case over its parameters | [`campaign::run`] |
//! | [`study`] | networks on data sets, compared | [`study::run`] |
//! | [`suggest`] | a training configuration for a data set | [`suggest::suggest`] |
//! | [`bench`] | what a step costs | [`bench::Workload`], [`bench::Trial`] |
//!
//! They share [`errors`] of fields, [`signal`] (statistics), limit cycles and distances from them, digests of inputs, and [`foam_case`], OpenFOAM's cases.

pub mod bench;
pub mod calibrate;
pub mod campaign;
pub mod check;
pub mod compare;
mod cycle;
pub mod decisions;
pub mod errors;
#[cfg(test)]
mod fixtures;
mod foam_bridge;
pub mod foam_case;
pub mod generate;
pub mod hybrid;
mod phase;
pub mod predict;
pub mod signal;
pub mod study;
pub mod suggest;
mod user_case;
pub mod validate;
pub mod verify;
