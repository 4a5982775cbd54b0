//! Contact of deforming bodies with a rigid obstacle that moves as prescribed, and with one another.
//!
//! [`graph`] has the world edges between them, [`skins`] what of several bodies can touch, [`segments`] cuts a body into segments,
//! [`gap`] is the distance between a body's skin and the obstacle, [`projection`] pushes bodies out of it and of one another, and
//! [`quality`] has the paper's mesh metrics (appendix C.2).

pub mod gap;
pub mod graph;
mod inputs;
pub mod part;
pub mod projection;
pub mod quality;
pub mod sample;
pub mod segments;
pub mod skins;
