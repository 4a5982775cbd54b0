//! A toy solver, a damped rotating vector, drives the ride through its branches; what surrogates are off by is known on paper.

mod control;
mod hosting;
mod observing;
mod replacing;
mod restarting;
