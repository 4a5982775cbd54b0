//! A toy solver, a damped rotating vector, drives the ride through its branches; the errors of surrogates are known on paper.

mod control;
pub mod hosting;
mod observing;
mod replacing;
mod restarting;
pub mod trend;
