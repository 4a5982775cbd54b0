//! M4GN (micro-meso-macro mesh graph network) as a guest of OpenFOAM solvers.
//!
//! The modules stand in the order of the data's way:
//! mesh and fields -> graph -> modes -> segments -> model -> step -> fields back.
//! `capi` holds the only exported symbols, `ffi` the only callers of foreign C.

pub mod bench;
pub mod capi;
pub mod cli;
pub mod compare;
pub mod dataset;
pub mod engine;
pub mod error;
pub mod fem;
pub mod ffi;
pub mod foam_case;
pub mod generate;
pub mod graph;
pub mod mesh;
pub mod model;
pub mod modes;
pub mod parallel;
pub mod report;
pub mod segments;
pub mod solids;
pub mod step;
pub mod survey;
pub mod validate;

pub use error::{Error, Result};
