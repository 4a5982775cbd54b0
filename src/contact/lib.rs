//! Contact of deforming bodies with a rigid obstacle that moves as prescribed.
//!
//! [`graph`] has the world edges between both, [`segments`] cuts a body into segments, [`gap`] is the distance between a
//! body's skin and the obstacle, [`projection`] pushes a body out of it, and [`quality`] has the paper's mesh metrics
//! (appendix C.2).

pub mod gap;
pub mod graph;
mod inputs;
pub mod part;
pub mod projection;
pub mod quality;
pub mod sample;
pub mod segments;
