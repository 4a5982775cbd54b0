//! Which vectors of another run of a solver are new.

use crate::modes::Pair;
use crate::parallel::Comm;

/// Eigenvalues closer than this, relatively, may be copies of one.
const NEAR: f64 = 1e-6;

/// A vector with less than this, relatively, outside the known ones is one of them.
const NEW: f64 = 1e-3;

/// The pairs of `found` whose vectors are independent of the known ones of the same eigenvalue. Collective.
pub(super) fn independent(comm: &Comm, known: &[Pair], found: Vec<Pair>) -> Vec<Pair> {
    let mut new: Vec<Pair> = Vec::new();
    for pair in found {
        let size = pair.value.hypot(pair.imaginary);
        let near = |p: &&Pair| {
            let off = (p.value - pair.value).hypot(p.imaginary.abs() - pair.imaginary.abs());
            off <= NEAR * size.max(p.value.hypot(p.imaginary))
        };
        let others: Vec<&Pair> = known.iter().chain(&new).filter(near).collect();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for other in others {
            let (rest, length) = outside(comm, &basis, &other.vector);
            if length > NEW {
                basis.push(rest);
            }
        }
        if outside(comm, &basis, &pair.vector).1 > NEW {
            new.push(pair);
        }
    }
    new
}

/// The part of `x` outside an orthonormal basis, of length 1, and how much of x that is. Collective.
fn outside(comm: &Comm, basis: &[Vec<f64>], x: &[f64]) -> (Vec<f64>, f64) {
    let dot = |a: &[f64], b: &[f64]| {
        let mut sum = [a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>()];
        comm.sum_f64(&mut sum);
        sum[0]
    };
    let before = dot(x, x).sqrt();
    let mut rest = x.to_vec();
    for _ in 0..2 {
        for b in basis {
            let along = dot(&rest, b);
            rest.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
        }
    }
    let length = dot(&rest, &rest).sqrt();
    if length > 0.0 {
        rest.iter_mut().for_each(|x| *x /= length);
    }
    (rest, if before > 0.0 { length / before } else { 0.0 })
}
