//! How many modes, and how they are solved for.

use super::problem::same_on_all_ranks;
use crate::parallel::Comm;
use crate::{Error, Result};
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ModalSolver {
    /// By size; see [`crate::modes`].
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
            _ => Err(Error::Input(format!(
                "modal solver '{word}': expected auto, direct or iterative"
            ))),
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
        ModalOptions {
            count: ModeCount::Fixed(n),
            solver: ModalSolver::Auto,
            petsc: String::new(),
        }
    }

    /// An input error unless all ranks have the same. Collective.
    pub(super) fn same_on_all_ranks(&self, comm: &Comm) -> Result<()> {
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
