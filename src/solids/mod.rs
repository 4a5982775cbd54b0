//! Deforming bodies: their elements, how good a predicted mesh is, and how deep an obstacle sinks in.
//!
//! [`elements`] knows the linear elements, [`quality`] the paper's mesh metrics (appendix C.2), [`gap`] the distance
//! between a body's skin and a rigid obstacle, [`projection`] pushes a body out of it, [`holding`] says what predicting
//! "nothing moves" scores on a trajectory.

pub mod elements;
pub mod gap;
pub mod holding;
pub mod part;
pub mod projection;
pub mod quality;
pub mod sample;
pub mod segments;
pub mod surface;

pub(crate) type Vector = [f64; 3];

pub(crate) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(crate) fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// Positions of points that moved from `rest` by `displacement`, m.
pub fn moved(rest: &[[f64; 3]], displacement: &[[f32; 3]]) -> Vec<[f64; 3]> {
    rest.iter()
        .zip(displacement)
        .map(|(x, u)| std::array::from_fn(|i| x[i] + f64::from(u[i])))
        .collect()
}
