//! Callers of foreign C: meshes and solids as hosts hand them over.
//!
//! What leaves this module is safe: every `unsafe` block says why its call is sound.
#![allow(unsafe_code)]

pub mod host;
mod host_body;
mod host_solid;
