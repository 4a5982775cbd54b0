//! compare
pub mod signal;
