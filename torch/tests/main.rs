//! The networks on libtorch against the engine, and trainings on libtorch.

mod gradients;
mod parity;
mod training;
