//! One basis for each eigenspace, chosen by positions alone.

use super::assemble::System;
use crate::mesh::Mesh;
use crate::parallel::Comm;

/// Test functions tried at most.
const CANDIDATES: usize = 24;

/// Below this fraction of the largest possible overlap a test function decides nothing: rounding would.
const DECISIVE: f64 = 1e-3;

/// Replaces an orthonormal basis of an eigenspace by one that does not depend on it, and scales it to
/// sum V phi^2 = sum V. Collective.
///
/// The first mode is the projection of a fixed function of position onto the space, the second that of another
/// one made orthogonal to the first, and so on; functions that nearly vanish there are passed over. For a simple
/// eigenvalue this fixes the sign. The functions are smooth and live on the mesh's bounding box, so that similar
/// meshes get similar modes.
pub(super) fn choose_basis(mesh: &Mesh, system: &System, comm: &Comm, space: &mut [Vec<f64>]) {
    let size = space.len();
    let total = system.volume.sqrt();
    orthonormalise(system, comm, space);
    // Overlaps <phi_i, g_j>_V of all candidates in one reduction.
    let mut overlaps = vec![0.0; CANDIDATES * size];
    for (cell, x) in mesh.cell_centres.iter().enumerate() {
        for j in 0..CANDIDATES {
            let g = test_function(mesh, system, j, x) * system.v[cell];
            for (i, phi) in space.iter().enumerate() {
                overlaps[j * size + i] += phi[cell] * g;
            }
        }
    }
    comm.sum_f64(&mut overlaps);

    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(size);
    for threshold in [DECISIVE, 1e-2 * DECISIVE] {
        for candidate in overlaps.chunks_exact(size) {
            add_direction(&mut basis, size, candidate, threshold * total);
        }
    }
    // Nothing decided: any completion is as good as another.
    for i in 0..size {
        let unit: Vec<f64> = (0..size).map(|k| if k == i { 1.0 } else { 0.0 }).collect();
        add_direction(&mut basis, size, &unit, 0.1 / size as f64);
    }
    let n = system.v.len();
    let chosen: Vec<Vec<f64>> = basis
        .iter()
        .map(|b| {
            (0..n)
                .map(|cell| total * space.iter().zip(b).map(|(phi, w)| phi[cell] * w).sum::<f64>())
                .collect()
        })
        .collect();
    for (phi, new) in space.iter_mut().zip(chosen) {
        *phi = new;
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

/// V-orthonormal to rounding, whatever the solver's tolerance was.
fn orthonormalise(system: &System, comm: &Comm, space: &mut [Vec<f64>]) {
    for i in 0..space.len() {
        let (before, rest) = space.split_at_mut(i);
        let phi = &mut rest[0];
        for b in before.iter() {
            let along = inner(system, comm, phi, b);
            phi.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
        }
        let length = inner(system, comm, phi, phi).sqrt();
        if length > 0.0 {
            phi.iter_mut().for_each(|x| *x /= length);
        }
    }
}

fn inner(system: &System, comm: &Comm, a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [a
        .iter()
        .zip(b)
        .zip(&system.v)
        .map(|((x, y), v)| x * y * v)
        .sum::<f64>()];
    comm.sum_f64(&mut sum);
    sum[0]
}

/// A smooth function without symmetry on the bounding box, different for each j, of magnitude about 1.
fn test_function(mesh: &Mesh, system: &System, j: usize, x: &[f64; 3]) -> f64 {
    let mut g = 1.0;
    for (axis, &d) in mesh.directions.iter().enumerate() {
        let extent = system.high[d] - system.low[d];
        if extent > 0.0 {
            let s = (x[d] - system.low[d]) / extent;
            let frequency = 0.9 + 1.3 * j as f64 + 0.377 * axis as f64 * (1.0 + j as f64);
            g *= (frequency * s + 0.31 + 0.73 * axis as f64 * (j as f64 + 0.5)).cos();
        }
    }
    g
}
