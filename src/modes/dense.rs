//! Dense solution with faer: the plain reference, and the solver of tiny meshes.

use super::assemble::{self, System};
use super::{Modes, finish, whole_clusters};
use crate::ffi::petsc::Eigenpair;
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::parallel::Comm;
use crate::{Error, Result};
use faer::{Mat, Side};

/// The first `n` modes of an undecomposed mesh by a dense eigen-decomposition: n^3 work, n^2 memory.
///
/// The same modes as [`super::laplacian_modes`], which it serves to test.
pub fn reference(mesh: &Mesh, n: usize) -> Result<Modes> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    let system = assemble::assemble(mesh, &mut graph, &comm)?;
    if n == 0 || n >= system.n_global {
        return Err(Error::Input(format!(
            "{n} modes of {} cells: expected 1 to one fewer",
            system.n_global
        )));
    }
    let pairs = eigenpairs(&system, mesh, &comm)?;
    let count = whole_clusters(&pairs, n, system.scale, system.n_global).unwrap_or(n);
    Ok(finish(mesh, &system, &comm, pairs, count))
}

/// All eigenpairs, ascending; the root solves in the canonical numbering and tells the others. Collective.
pub(super) fn eigenpairs(system: &System, mesh: &Mesh, comm: &Comm) -> Result<Vec<Eigenpair>> {
    // Rows are numbered rank after rank: this list translates.
    let mut canonical: Vec<i64> = comm
        .gather(&mesh.cell_global)
        .into_iter()
        .flatten()
        .flatten()
        .collect();
    comm.broadcast(&mut canonical);
    let mut places = Vec::new();
    for i in 0..system.k.n() {
        for e in system.k.row[i] as usize..system.k.row[i + 1] as usize {
            places.extend([mesh.cell_global[i], canonical[system.k.column[e] as usize]]);
        }
    }
    let gathered = (
        comm.gather(&places),
        comm.gather(&system.k.value),
        comm.gather(&mesh.cell_global),
    );
    let volumes = comm.gather(&system.v);
    let n = system.n_global;
    let solved = match (gathered, volumes) {
        ((Some(places), Some(values), Some(cells)), Some(volumes)) => {
            let mut root_v = vec![0.0; n];
            for (&cell, &v) in cells.iter().flatten().zip(volumes.iter().flatten()) {
                root_v[cell as usize] = v.sqrt();
            }
            let places: Vec<i64> = places.into_iter().flatten().collect();
            solve(&places, values.into_iter().flatten(), &root_v)
        }
        _ => Ok(Vec::new()),
    };
    let mut flat = comm.agree(solved)?;
    comm.broadcast(&mut flat);
    Ok(flat
        .chunks_exact(n + 1)
        .map(|pair| {
            (
                pair[0],
                mesh.cell_global.iter().map(|&g| pair[1 + g as usize]).collect(),
            )
        })
        .collect())
}

/// Eigenpairs of V^-1/2 K V^-1/2, flattened: value, then phi = V^-1/2 y in canonical order.
fn solve(places: &[i64], values: impl Iterator<Item = f64>, root_v: &[f64]) -> Result<Vec<f64>> {
    let n = root_v.len();
    let mut a = Mat::<f64>::zeros(n, n);
    for (place, value) in places.chunks_exact(2).zip(values) {
        let (i, j) = (place[0] as usize, place[1] as usize);
        a[(i, j)] += value / (root_v[i] * root_v[j]);
    }
    let eigen = a.self_adjoint_eigen(Side::Lower).map_err(|e| {
        Error::Numerical(format!(
            "the dense eigen-decomposition of {n} cells failed: {e:?}"
        ))
    })?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let mut flat = Vec::with_capacity(n * (n + 1));
    for i in 0..n {
        flat.push(values[i]);
        flat.extend((0..n).map(|c| vectors[(c, i)] / root_v[c]));
    }
    Ok(flat)
}
