//! How many eigenvalues lie below a number, without computing one; and whether a mass has one below 0, without a factor.

use super::eigen::{ITERATIONS, Matrices};
use super::objects::{Matrix, Solver};
use super::{c, check, raw};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;

/// MUMPS's control parameters, by their numbers: ScaLAPACK, which counts no pivots, is kept out of the last front of
/// several ranks; null pivots are no error; room for pivots that are put off, in percent.
const CONTROLS: [(i32, i32); 3] = [(13, 1), (24, 1), (14, 50)];

impl Matrices {
    /// Eigenvalues below `sigma`: by Sylvester's law of inertia as many as K - sigma M has negative
    /// pivots. Its factor is made by MUMPS, whose pivoting is stable for indefinite matrices, and dropped. Collective.
    pub(super) fn below(&self, sigma: f64) -> Result<usize> {
        let (mut shifted, mut factor) = (Matrix::null(), Matrix::null());
        let (mut failed, mut negative) = (c::MatFactorError_MAT_FACTOR_NOERROR, 0);
        let (mut zero, mut positive) = (0, 0);
        // SAFETY: all objects are live; the struct is plain data that PETSc fills; MUMPS takes no ordering, so null.
        unsafe {
            check(c::MatDuplicate(self.k.0, c::MatDuplicateOption_MAT_COPY_VALUES, &mut shifted.0))?;
            check(c::MatAXPY(shifted.0, -sigma, self.m.0, self.structure()))?;
            shifted.announce_symmetry()?;
            let kind = c::MatFactorType_MAT_FACTOR_CHOLESKY;
            check(c::MatGetFactor(shifted.0, c"mumps".as_ptr(), kind, &mut factor.0))?;
            for (number, value) in CONTROLS {
                check(c::MatMumpsSetIcntl(factor.0, number, value))?;
            }
            let mut info = std::mem::zeroed();
            check(c::MatFactorInfoInitialize(&mut info))?;
            check(c::MatCholeskyFactorSymbolic(factor.0, shifted.0, std::ptr::null_mut(), &info))?;
            check(c::MatCholeskyFactorNumeric(factor.0, shifted.0, &info))?;
            check(c::MatFactorGetError(factor.0, &mut failed))?;
            if failed == c::MatFactorError_MAT_FACTOR_NOERROR {
                check(c::MatGetInertia(factor.0, &mut negative, &mut zero, &mut positive))?;
            }
        }
        if failed != c::MatFactorError_MAT_FACTOR_NOERROR || zero > 0 {
            return Err(Error::Numerical(format!(
                "the eigenvalues below {sigma:e} could not be counted, so that copies of a repeated one may be missing: \
                 K - ({sigma:e}) M has no factor in the memory that there is, or {zero} null pivots"
            )));
        }
        Ok(negative as usize)
    }

    /// Smallest eigenvalue, to some `tolerance`, of K - sigma M, or without a sigma of M, scaled to a unit diagonal. Of a mass of finite
    /// elements it is a few tenths whatever their sizes (Wathen, IMA J. Numer. Anal. 7, 1987), and of a pair that is definite not below 0: a
    /// small Krylov space sees the sign without a factor. Collective.
    pub(super) fn smallest(&self, comm: &Comm, sigma: Option<f64>, tolerance: f64) -> Result<f64> {
        let (mut scaled, mut eps, diagonal) = (Matrix::null(), Solver::null(), self.m.vector()?);
        let (of, copy) =
            (if sigma.is_some() { &self.k } else { &self.m }, c::MatDuplicateOption_MAT_COPY_VALUES);
        // SAFETY: all objects are live; no second matrix, vector or imaginary part is there.
        unsafe {
            check(c::MatDuplicate(of.0, copy, &mut scaled.0))?;
            if let Some(sigma) = sigma {
                check(c::MatAXPY(scaled.0, -sigma, self.m.0, self.structure()))?;
            }
            check(c::MatGetDiagonal(scaled.0, diagonal.0))?;
            check(c::VecSqrtAbs(diagonal.0))?;
            check(c::VecReciprocal(diagonal.0))?;
            check(c::MatDiagonalScale(scaled.0, diagonal.0, diagonal.0))?;
            scaled.announce_symmetry()?;
            check(c::EPSCreate(raw(comm), &mut eps.0))?;
            check(c::EPSSetOperators(eps.0, scaled.0, std::ptr::null_mut()))?;
            check(c::EPSSetProblemType(eps.0, c::EPSProblemType_EPS_HEP))?;
            check(c::EPSSetWhichEigenpairs(eps.0, c::EPSWhich_EPS_SMALLEST_REAL))?;
            check(c::EPSSetConvergenceTest(eps.0, c::EPSConv_EPS_CONV_ABS))?;
            check(c::EPSSetTolerances(eps.0, tolerance, ITERATIONS))?;
            check(c::EPSSetDimensions(eps.0, 1, c::PETSC_DEFAULT, c::PETSC_DEFAULT))?;
        }
        eps.first()?.ok_or_else(|| {
            let why = "it could not be told without a factor whether K and M are positive semi-definite; modalSolver direct makes one";
            Error::Numerical(why.into())
        })
    }
}
