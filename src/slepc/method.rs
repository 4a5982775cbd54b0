//! How the shifted systems are solved.

use super::door::Call;
use super::eigen::Matrices;
use super::{c, check};
use m4gn_base::Result;
use m4gn_parallel::Comm;
use std::ffi::CStr;

/// A solver of (K - shift M) x = b.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    /// Factorisation by this package.
    Factor {
        /// PETSc's name of the package.
        package: &'static CStr,
    },
    /// Conjugate gradients preconditioned by algebraic multigrid.
    Multigrid,
}

const PETSC: Method = Method::Factor { package: c"petsc" };
const CHOLMOD: Method = Method::Factor { package: c"cholmod" };
const MUMPS: Method = Method::Factor { package: c"mumps" };

impl Method {
    /// What is tried, one after the other.
    pub(super) fn of(comm: &Comm, matrices: &Matrices, request: &Call) -> &'static [Method] {
        let plane = m4gn_modes::is_plane(matrices.unknowns, matrices.entries, request.block);
        match (request.iterative, comm.size()) {
            (true, _) => &[Method::Multigrid],
            // K - shift M is positive definite, so Cholesky; MUMPS, which pivots, is the second chance where rounding
            // has spoilt that.
            // On one rank PETSc's own factors are the quickest of plane meshes; CHOLMOD's supernodes win in space.
            // The ordering of PETSc's never ends where the entries of a symmetric matrix do not lie symmetrically, as
            // those of one from which zeros were dropped.
            (false, 1) if plane && matrices.symmetric_pattern => &[PETSC, MUMPS],
            (false, 1) => &[CHOLMOD, MUMPS],
            (false, _) => &[MUMPS],
        }
    }

    /// Whether a factor of K - sigma M may be made, whose pivots count the eigenvalues below sigma.
    pub(super) fn factors(self) -> bool {
        matches!(self, Method::Factor { .. })
    }

    /// Relative residual at which an eigenpair counts as converged: far below the quantum that SLIC sees (1e-7). The
    /// Rayleigh quotient squares it for the eigenvalue.
    pub(super) fn tolerance(self) -> f64 {
        match self {
            Method::Factor { .. } => 1e-11,
            Method::Multigrid => 1e-9,
        }
    }

    /// Options that hold unless others are given.
    pub(super) fn defaults(self) -> &'static [(&'static CStr, &'static CStr)] {
        match self {
            Method::Factor { .. } => &[],
            Method::Multigrid => &[
                (c"-m4gn_st_pc_hypre_type", c"boomeramg"),
                (c"-m4gn_st_pc_hypre_boomeramg_coarsen_type", c"HMIS"),
                (c"-m4gn_st_pc_hypre_boomeramg_interp_type", c"ext+i"),
                (c"-m4gn_st_pc_hypre_boomeramg_P_max", c"4"),
            ],
        }
    }

    /// Sets the linear solver up so.
    ///
    /// # Safety
    /// `ksp` is a live solver.
    pub(super) unsafe fn set(self, ksp: c::KSP) -> Result<()> {
        let mut pc = std::ptr::null_mut();
        // SAFETY: as promised by the caller; PC is borrowed from it; the strings are C strings.
        unsafe {
            check(c::KSPGetPC(ksp, &mut pc))?;
            match self {
                Method::Factor { package } => {
                    check(c::KSPSetType(ksp, c"preonly".as_ptr()))?;
                    check(c::PCSetType(pc, c"cholesky".as_ptr()))?;
                    check(c::PCFactorSetMatSolverType(pc, package.as_ptr()))?;
                    if package == c"petsc" {
                        // Nested dissection; PETSc's default for Cholesky is no reordering, which fills in.
                        check(c::PCFactorSetMatOrderingType(pc, c"nd".as_ptr()))?;
                    }
                }
                Method::Multigrid => {
                    check(c::KSPSetType(ksp, c"cg".as_ptr()))?;
                    let default = f64::from(c::PETSC_DEFAULT);
                    check(c::KSPSetTolerances(ksp, 1e-10, default, default, 500))?;
                    check(c::PCSetType(pc, c"hypre".as_ptr()))?;
                }
            }
        }
        Ok(())
    }
}
