//! PETSc and SLEPc.

/// Ends SLEPc and PETSc if we started them.
pub fn finalize() {}
