//! Laplacian modes of a mesh (Algorithm 1, fluid): K phi = lambda V phi with Dirichlet conditions (eq. 6).
//!
//! K is the solver's own finite-volume Laplacian (off-diagonal -c of each face, every boundary face a Dirichlet
//! one), V the cell volumes; eigenvalues are in 1/m^2, modes without unit. Two traps are closed here: the sign of
//! an eigenvector, and the basis of a repeated eigenvalue's space, are chosen by a rule that looks at positions
//! alone (`canonical.rs`), so that they depend neither on the ranks nor on the solver's start vector.

mod assemble;
mod canonical;
mod dense;

pub use assemble::Extent;
pub use dense::reference;

use crate::ffi::petsc::{Eigenpair, smallest_eigenpairs};
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::parallel::Comm;
use crate::{Error, Result};

/// Eigenvalues closer than this, relatively, are one repeated eigenvalue.
const CLUSTER: f64 = 1e-6;

/// Meshes of at most this many cells are solved densely: Krylov spaces are no smaller there.
const DENSE: usize = 100;

/// Modes of the Laplacian, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Eigenvalues, 1/m^2.
    pub eigenvalues: Vec<f64>,
    /// For each mode its value in each of this rank's cells; sum over all ranks of V phi^2 = sum of V.
    pub vectors: Vec<Vec<f64>>,
}

/// The first `n` Laplacian modes. Collective; all ranks fail together.
///
/// If the n-th eigenvalue is repeated, its whole cluster is returned: there may be more than `n` modes, never
/// fewer. Without Dirichlet boundaries (all cyclic) the first mode is the constant one with eigenvalue 0.
/// Errors: [`Error::Input`] if `n` is not below the number of cells, [`Error::Numerical`] if the solver fails.
pub fn laplacian_modes(mesh: &Mesh, graph: &mut Graph, comm: &Comm, n: usize) -> Result<Modes> {
    let system = assemble::assemble(mesh, graph, comm)?;
    if n >= system.n_global {
        return Err(Error::Input(format!(
            "{n} modes of {} cells: expected at most {}; set modes in the dictionary",
            system.n_global,
            system.n_global - 1
        )));
    }
    if n == 0 {
        return Ok(Modes {
            eigenvalues: Vec::new(),
            vectors: Vec::new(),
        });
    }
    let mut extra = 2;
    loop {
        let wanted = (n + extra).min(system.n_global);
        let pairs = match system.n_global <= DENSE {
            true => dense::eigenpairs(&system, mesh, comm)?,
            // Just below the spectrum: K may be singular, K - shift V never is.
            false => smallest_eigenpairs(comm, &system.k, &system.v, -0.01 * system.scale, wanted)?,
        };
        match whole_clusters(&pairs, n, system.scale, system.n_global) {
            Some(count) => return Ok(finish(mesh, &system, comm, pairs, count)),
            None => extra *= 2,
        }
    }
}

/// How many pairs make the first `n` with the cluster of the n-th whole; none if that cannot be seen yet.
fn whole_clusters(pairs: &[Eigenpair], n: usize, scale: f64, n_global: usize) -> Option<usize> {
    let mut count = n;
    while count < pairs.len() && same(pairs[count - 1].0, pairs[count].0, scale) {
        count += 1;
    }
    (count < pairs.len() || count == n_global).then_some(count)
}

fn same(a: f64, b: f64, scale: f64) -> bool {
    (b - a).abs() <= CLUSTER * a.abs().max(b.abs()).max(scale)
}

/// Chooses bases and signs, and scales.
fn finish(mesh: &Mesh, system: &assemble::System, comm: &Comm, pairs: Vec<Eigenpair>, count: usize) -> Modes {
    let (eigenvalues, mut vectors): (Vec<f64>, Vec<Vec<f64>>) = pairs.into_iter().take(count).unzip();
    let mut first = 0;
    while first < count {
        let mut end = first + 1;
        while end < count && same(eigenvalues[end - 1], eigenvalues[end], system.scale) {
            end += 1;
        }
        canonical::choose_basis(mesh, system, comm, &mut vectors[first..end]);
        first = end;
    }
    Modes { eigenvalues, vectors }
}

#[cfg(test)]
mod tests;
