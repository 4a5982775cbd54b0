//! What every room stands on: the errors of all crates, whole files, locks on what is written for long, settings from text, the loader of the project's own
//! libraries.
//!
//! Nothing here knows meshes or ranks. [`plugin`] loads libraries; [`ffi`] has the floating-point environment and signals.

pub mod digest;
mod error;
pub mod ffi;
pub mod files;
pub mod lock;
mod names;
pub mod plugin;
pub mod settings;

pub use error::{Error, Result, listed, refuse, refuse_any};
