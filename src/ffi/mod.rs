//! ffi
pub mod foam_bridge;
