//! How many eigenvalues lie below a number, without computing one.

use super::eigen::Matrices;
use super::objects::Matrix;
use super::{c, check};
use m4gn_mesh::{Error, Result};

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
}
