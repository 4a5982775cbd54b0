//! One basis for each eigenspace, chosen by positions alone.

use super::frame::Frame;
use super::pair::Pair;
use m4gn_parallel::Comm;

/// Test functions tried at most, and at most for each vector of a space.
const CANDIDATES: (usize, usize) = (24, 8);

/// Below this fraction of the largest possible overlap a test function decides nothing: rounding would. Where too few
/// decide, the next fraction counts.
const DECISIVE: [f64; 4] = [1e-1, 3e-2, 1e-3, 1e-5];

/// The first two fractions are for spaces of more vectors than this: rounding grows with each that is taken off.
const FEW: usize = 4;

/// Replaces a basis of an eigenspace by one that does not depend on it, and scales it to phi^T M phi = `total`.
/// Collective.
///
/// The first mode is the projection of a fixed function of position onto the space, the second that of another
/// one made orthogonal to the first, and so on; functions that nearly vanish there are passed over. For a simple
/// eigenvalue this fixes the sign. The functions are smooth and live on the mesh's bounding box, so that similar
/// meshes get similar modes. With several unknowns a point, each has its own functions.
pub(super) fn choose_basis(frame: &Frame, block: usize, total: f64, comm: &Comm, space: &mut [Pair]) {
    let size = space.len();
    let total = total.sqrt();
    orthonormalise(comm, space);
    let n = space.first().map_or(0, |p| p.vector.len());
    // phi_i^T M g_j of the j-th test function. Most often the first few decide.
    let mut known: Vec<Vec<f64>> = Vec::new();
    let mut overlaps = |j: usize| -> Vec<f64> {
        if let Some(found) = known.get(j) {
            return found.clone();
        }
        let mut sums = vec![0.0; size];
        for point in 0..n / block {
            let g = test_function(frame, j, &frame.position(point));
            for c in 0..block {
                let g = g * component(j, c);
                for (sum, pair) in sums.iter_mut().zip(space.iter()) {
                    *sum += pair.weighted[point * block + c] * g;
                }
            }
        }
        comm.sum_f64(&mut sums);
        known.push(sums.clone());
        sums
    };

    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(size);
    for threshold in &DECISIVE[if size <= FEW { 2 } else { 0 }..] {
        for j in 0..CANDIDATES.0.max(CANDIDATES.1 * size) {
            if basis.len() < size {
                add_direction(&mut basis, size, &overlaps(j), threshold * total);
            }
        }
    }
    // Nothing decided: any completion is as good as another.
    for i in 0..size {
        let unit: Vec<f64> = (0..size).map(|k| if k == i { 1.0 } else { 0.0 }).collect();
        add_direction(&mut basis, size, &unit, 0.1 / size as f64);
    }
    let turn = |of: fn(&Pair) -> &Vec<f64>| -> Vec<Vec<f64>> {
        basis
            .iter()
            .map(|b| {
                let sum = |i: usize| space.iter().zip(b).map(|(p, w)| of(p)[i] * w).sum::<f64>();
                (0..n).map(|i| total * sum(i)).collect()
            })
            .collect()
    };
    let (vectors, weighted) = (turn(|p| &p.vector), turn(|p| &p.weighted));
    for ((pair, v), w) in space.iter_mut().zip(vectors).zip(weighted) {
        (pair.vector, pair.weighted) = (v, w);
    }
}

/// Appends the part of `candidate` orthogonal to the basis, normalised, if it is longer than `threshold`.
fn add_direction(basis: &mut Vec<Vec<f64>>, size: usize, candidate: &[f64], threshold: f64) {
    if basis.len() == size {
        return;
    }
    let mut rest = candidate.to_vec();
    for _ in 0..2 {
        for b in basis.iter() {
            let along: f64 = rest.iter().zip(b).map(|(x, y)| x * y).sum();
            rest.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
        }
    }
    let length = rest.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > threshold {
        rest.iter_mut().for_each(|x| *x /= length);
        basis.push(rest);
    }
}

/// M-orthonormal to rounding, whatever the solver's tolerance was.
fn orthonormalise(comm: &Comm, space: &mut [Pair]) {
    for i in 0..space.len() {
        let (before, rest) = space.split_at_mut(i);
        let pair = &mut rest[0];
        for b in before.iter() {
            pair.remove(inner(comm, pair, b), b);
        }
        let length = inner(comm, pair, pair).max(0.0).sqrt();
        if length > 0.0 {
            pair.scale(1.0 / length);
        }
    }
}

/// a^T M b, symmetric to rounding.
fn inner(comm: &Comm, a: &Pair, b: &Pair) -> f64 {
    let mut sum = [0.0];
    for i in 0..a.vector.len() {
        sum[0] += a.vector[i] * b.weighted[i] + b.vector[i] * a.weighted[i];
    }
    comm.sum_f64(&mut sum);
    0.5 * sum[0]
}

/// A smooth function without symmetry on the bounding box, different for each j, of magnitude about 1.
fn test_function(frame: &Frame, j: usize, x: &[f64; 3]) -> f64 {
    let mut g = 1.0;
    for (axis, &d) in frame.axes.iter().enumerate() {
        let extent = frame.extent.high[d] - frame.extent.low[d];
        if extent > 0.0 {
            let s = (x[d] - frame.extent.low[d]) / extent;
            let frequency = 0.9 + 1.3 * j as f64 + 0.377 * axis as f64 * (1.0 + j as f64);
            g *= (frequency * s + 0.31 + 0.73 * axis as f64 * (j as f64 + 0.5)).cos();
        }
    }
    g
}

/// Weight of unknown `c` of a point in test function j; 1 for the first.
fn component(j: usize, c: usize) -> f64 {
    (c as f64 * (1.1 + 0.83 * j as f64)).cos()
}
