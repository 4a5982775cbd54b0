//! Which vectors of another run of a solver are new.

use super::eigen::Found;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;

/// Eigenvalues closer than this, relatively, may be copies of one.
const NEAR: f64 = 1e-6;

/// A vector with less than this, relatively, outside the known ones is one of them.
const NEW: f64 = 1e-3;

/// Those of `run` whose vectors are independent of the known ones of the same eigenvalue. Collective.
pub(super) fn independent(comm: &Comm, known: &[Found], run: Vec<Found>) -> Result<Vec<Found>> {
    let mut new: Vec<Found> = Vec::new();
    for found in run {
        let size = found.value.hypot(found.imaginary);
        let near = |f: &&Found| {
            let off = (f.value - found.value).hypot(f.imaginary.abs() - found.imaginary.abs());
            off <= NEAR * size.max(f.value.hypot(f.imaginary))
        };
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for other in known.iter().chain(&new).filter(near) {
            let (rest, length) = outside(comm, &basis, other.vector.values()?);
            if length > NEW {
                basis.push(rest);
            }
        }
        if outside(comm, &basis, found.vector.values()?).1 > NEW {
            new.push(found);
        }
    }
    Ok(new)
}

/// The part of `x` outside an orthonormal basis, of length 1, and how much of x that is. Collective.
fn outside(comm: &Comm, basis: &[Vec<f64>], mut x: Vec<f64>) -> (Vec<f64>, f64) {
    let dot = |a: &[f64], b: &[f64]| {
        let mut sum = [a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>()];
        comm.sum_f64(&mut sum);
        sum[0]
    };
    let before = dot(&x, &x).sqrt();
    for _ in 0..2 {
        for b in basis {
            let along = dot(&x, b);
            x.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
        }
    }
    let length = dot(&x, &x).sqrt();
    if length > 0.0 {
        x.iter_mut().for_each(|x| *x /= length);
    }
    (x, if before > 0.0 { length / before } else { 0.0 })
}
