//! What the tests of several rooms share: meshes, models, bodies and trajectories with answers known on paper. Nothing that ships
//! depends on it. A room whose own types a file here makes includes the file in its unit tests.

extern crate self as m4gn_samples;

pub mod bodies;
pub mod mesh;
pub mod model;
#[cfg(feature = "points")]
pub mod points;
#[cfg(feature = "training")]
pub mod training;
