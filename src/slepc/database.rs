//! Options in PETSc's database for the time of a solution. Others than ours come from `PETSC_OPTIONS`, which PETSc reads itself.

use super::{c, check};
use m4gn_base::Result;
use std::ffi::CStr;

/// Prefix of our solvers' options.
pub(super) const PREFIX: &CStr = c"m4gn_";

/// Options that are in the database while this lives.
pub(super) struct Options(Vec<&'static CStr>);

impl Options {
    /// Puts those into the database that nobody else has set.
    pub(super) fn new(defaults: &[(&'static CStr, &'static CStr)]) -> Result<Self> {
        let mut options = Options(Vec::new());
        for &(name, value) in defaults {
            let null = std::ptr::null_mut();
            let mut given = c::PetscBool_PETSC_FALSE;
            // SAFETY: C strings that PETSc copies; one flag is written.
            unsafe {
                check(c::PetscOptionsHasName(null, std::ptr::null(), name.as_ptr(), &mut given))?;
                if given == c::PetscBool_PETSC_FALSE {
                    check(c::PetscOptionsSetValue(null, name.as_ptr(), value.as_ptr()))?;
                    options.0.push(name);
                }
            }
        }
        Ok(options)
    }
}

impl Drop for Options {
    fn drop(&mut self) {
        for name in &self.0 {
            // SAFETY: a C string; clearing what is not there is allowed.
            unsafe { c::PetscOptionsClearValue(std::ptr::null_mut(), name.as_ptr()) };
        }
    }
}
