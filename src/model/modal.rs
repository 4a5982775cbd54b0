//! Modes of a mesh: how many, how they are solved for, and who can be asked for them.

use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_mesh::body::Body;
use m4gn_parallel::{Comm, same_on_all_ranks};
use serde::{Deserialize, Serialize};

/// The way to the eigenpairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ModalSolver {
    /// By size; see `m4gn_modes`.
    #[default]
    Auto,
    /// Shift-and-invert with a direct factorisation.
    Direct,
    /// Preconditioned by algebraic multigrid, without a factorisation.
    Iterative,
}

/// Options of a modal solution.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalOptions {
    /// How many modes; the cluster of the last one is taken whole.
    pub count: usize,
    /// The way to them.
    pub solver: ModalSolver,
}

impl Default for ModalOptions {
    /// Six modes, the paper's number for the cylinder flow.
    fn default() -> Self {
        ModalOptions::fixed(6)
    }
}

impl ModalOptions {
    /// The first `n` modes, all else by default.
    pub fn fixed(n: usize) -> Self {
        ModalOptions { count: n, solver: ModalSolver::Auto }
    }

    /// An input error unless all ranks have the same. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] naming what differs.
    pub fn same_on_all_ranks(&self, comm: &Comm) -> Result<()> {
        let options = [("number of modes", self.count as i64), ("modal solver", self.solver as i64)];
        same_on_all_ranks(comm, &options)
    }
}

/// Modes, by ascending eigenvalue.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Eigenvalues; of the Laplacian in 1/m^2.
    pub eigenvalues: Vec<f64>,
    /// For each mode its value for each of this rank's unknowns. Scaled to phi^T M phi = (sum of the entries of M) /
    /// block: the root mean square over the mesh, weighted by M, is 1 whatever the mesh's size; for the Laplacian
    /// sum over all ranks of V phi^2 = sum of V.
    pub vectors: Vec<Vec<f64>>,
}

/// Whoever computes modes when segments are made of them.
pub trait ModalSource {
    /// The first modes of a mesh, `count` of them and the whole cluster of the last: of its elastic body
    /// ([`Mesh::elastic`], eq. 5) if `elastic`, else of its Laplacian (eq. 6). Collective; all ranks fail together.
    ///
    /// Of elastic modes each solved component of the displacement is a vector of its own, with the mode's eigenvalue: a
    /// distance over all of them depends neither on signs nor on bases of repeated eigenvalues, which come whole.
    ///
    /// # Errors
    /// [`Error::Input`] if there are fewer modes than asked for, [`Error::Numerical`] if the solver fails.
    fn of_mesh(&self, mesh: &Mesh, elastic: bool, count: usize, comm: &Comm) -> Result<Modes>;

    /// The first elastic modes of a whole body, its handle held, as features of its points: three components a mode.
    /// Computed by this rank alone.
    ///
    /// # Errors
    /// [`Error::Input`] for a body without handle, a material out of range, more modes than unknowns.
    fn of_body(&self, body: &Body, count: usize) -> Result<Modes>;
}

/// No modes, for those who need none.
#[derive(Clone, Copy, Debug)]
pub struct NoModes;

impl ModalSource for NoModes {
    fn of_mesh(&self, _: &Mesh, _: bool, count: usize, _: &Comm) -> Result<Modes> {
        none(count)
    }

    fn of_body(&self, _: &Body, count: usize) -> Result<Modes> {
        none(count)
    }
}

fn none(count: usize) -> Result<Modes> {
    Err(Error::Internal(format!("{count} modes were asked for where none were expected")))
}
