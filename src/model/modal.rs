//! Modes of a mesh: how many, how they are solved for, and who can be asked for them.

use m4gn_mesh::Mesh;
use m4gn_mesh::body::Body;
use m4gn_mesh::parallel::{Comm, same_on_all_ranks};
use m4gn_mesh::{Error, Result};
use serde::{Deserialize, Serialize};
use std::hash::{DefaultHasher, Hash, Hasher};

/// How many modes are taken. Either way the cluster of the last one is taken whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ModeCount {
    /// The first so many.
    Fixed(usize),
    /// As many as hold this share of what the first `most` modes hold.
    ///
    /// Each mode counts with 1 / lambda: the mean square displacement that equal forcing (or equal thermal energy)
    /// gives it, and the eigenvalues of the inverse of (K, M). The smallest m is taken with
    /// sum_{i<=m} 1/lambda_i >= share * sum_{i<=most} 1/lambda_i. The reference is what was computed, not the trace
    /// of the inverse: the answer depends on `most` too. Modes of eigenvalue 0 (rigid motions, constants) hold
    /// no energy in this sense; they are taken and counted in neither sum.
    Energy {
        /// Share, above 0 and at most 1.
        share: f64,
        /// Modes that are computed to choose from; cut to one fewer than the unknowns.
        most: usize,
    },
}

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

impl ModalSolver {
    /// From a dictionary's word: `auto`, `direct`, `iterative`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other word.
    pub fn parse(word: &str) -> Result<Self> {
        match word {
            "auto" => Ok(ModalSolver::Auto),
            "direct" => Ok(ModalSolver::Direct),
            "iterative" => Ok(ModalSolver::Iterative),
            _ => Err(Error::Input(format!("modal solver '{word}': expected auto, direct or iterative"))),
        }
    }
}

/// Options of a modal solution.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalOptions {
    /// How many modes.
    pub count: ModeCount,
    /// The way to them.
    pub solver: ModalSolver,
    /// PETSc and SLEPc options as on a command line, under the prefix `m4gn_`: `-m4gn_eps_tol 1e-9
    /// -m4gn_st_pc_factor_mat_solver_type mumps`. They are set for the time of the solution.
    pub petsc: String,
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
        ModalOptions { count: ModeCount::Fixed(n), solver: ModalSolver::Auto, petsc: String::new() }
    }

    /// An input error unless all ranks have the same. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] naming what differs.
    pub fn same_on_all_ranks(&self, comm: &Comm) -> Result<()> {
        let (n, share) = match self.count {
            ModeCount::Fixed(n) => (n, 0.0),
            ModeCount::Energy { share, most } => (most, share),
        };
        let mut petsc = DefaultHasher::new();
        self.petsc.hash(&mut petsc);
        same_on_all_ranks(
            comm,
            &[
                ("number of modes", n as i64),
                ("share of the energy", (f64::to_bits(share) >> 2) as i64),
                ("modal solver", self.solver as i64),
                ("PETSc options", (petsc.finish() >> 2) as i64),
            ],
        )
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
    fn of_mesh(&self, mesh: &Mesh, elastic: bool, count: ModeCount, comm: &Comm) -> Result<Modes>;

    /// The first elastic modes of a whole body, its handle held, as features of its points: three components a mode.
    /// Computed by this rank alone.
    ///
    /// # Errors
    /// [`Error::Input`] for a body without handle, a material out of range, more modes than unknowns.
    fn of_body(&self, body: &Body, count: ModeCount) -> Result<Modes>;
}

/// No modes, for those who need none.
#[derive(Clone, Copy, Debug)]
pub struct NoModes;

impl ModalSource for NoModes {
    fn of_mesh(&self, _: &Mesh, _: bool, count: ModeCount, _: &Comm) -> Result<Modes> {
        none(count)
    }

    fn of_body(&self, _: &Body, count: ModeCount) -> Result<Modes> {
        none(count)
    }
}

fn none(count: ModeCount) -> Result<Modes> {
    Err(Error::Internal(format!("{count:?} modes were asked for where none were expected")))
}
