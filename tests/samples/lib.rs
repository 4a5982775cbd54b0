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

/// Distance of two vectors, relative to the length of the second.
pub fn distance(a: &[f32], b: &[f32]) -> f64 {
    let square = |x: f64| x * x;
    let apart: f64 = a.iter().zip(b).map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    let size: f64 = b.iter().map(|b| square(f64::from(*b))).sum();
    (apart / size).sqrt()
}

/// What is tried must fail, with all of these words in its message.
///
/// # Panics
/// Where it does not.
#[track_caller]
pub fn fails<T>(tried: Result<T, impl std::fmt::Display>, words: &[&str]) {
    let Err(error) = tried else { panic!("nothing failed, expected {words:?}") };
    let said = error.to_string();
    for word in words {
        assert!(said.contains(word), "expected '{word}' in '{said}'");
    }
}
