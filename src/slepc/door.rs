//! The C interface: raw arrays in, pairs out, no panic through it.

use crate::eigen::{Matrices, eigenpairs};
use m4gn_base::plugin::{keep_error, last_error};
use m4gn_base::{Error, Result};
use m4gn_modes::eigen::{LIBRARY, RawHost, RawProblem, RawRows, slice};
use m4gn_parallel::{Comm, panic_text};
use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// This rank's rows of a distributed square matrix; see `m4gn_modes::Rows`.
#[derive(Clone, Copy)]
pub(crate) struct Csr<'a> {
    pub(crate) row: &'a [usize],
    pub(crate) column: &'a [i64],
    pub(crate) value: &'a [f64],
}

impl<'a> Csr<'a> {
    /// # Safety
    /// The arrays have the lengths that are said and live as long as what comes back.
    unsafe fn new(raw: &RawRows) -> Self {
        // SAFETY: as promised.
        unsafe {
            Csr {
                row: slice(raw.row, raw.n + 1),
                column: slice(raw.column, raw.entries),
                value: slice(raw.value, raw.entries),
            }
        }
    }

    /// Rows of this rank.
    pub(crate) fn n(&self) -> usize {
        self.row.len().saturating_sub(1)
    }

    /// Of all rows on one rank: whether there is an entry (j, i) for each (i, j), whatever its value.
    pub(crate) fn has_symmetric_pattern(&self) -> bool {
        let sorted = |bounds: &[usize]| {
            let mut columns = self.column[bounds[0]..bounds[1]].to_vec();
            columns.sort_unstable();
            columns
        };
        let rows: Vec<Vec<i64>> = self.row.windows(2).map(sorted).collect();
        let mut numbered = (0..).zip(&rows);
        numbered.all(|(i, columns)| columns.iter().all(|&j| rows[j as usize].binary_search(&i).is_ok()))
    }
}

/// The right-hand matrix.
#[derive(Clone, Copy)]
pub(crate) enum Mass<'a> {
    Diagonal(&'a [f64]),
    Matrix(Csr<'a>),
}

/// What is asked of the solver.
pub(crate) struct Call<'a> {
    pub(crate) block: usize,
    pub(crate) stiffness: Csr<'a>,
    pub(crate) mass: Mass<'a>,
    pub(crate) shift: f64,
    pub(crate) wanted: usize,
    pub(crate) iterative: bool,
    host: RawHost,
}

impl Call<'_> {
    /// How many of these eigenvalues, nearest to the shift first, are taken; none: more have to be seen.
    pub(crate) fn taken(&self, values: &[f64]) -> Option<usize> {
        usize::try_from((self.host.taken)(self.host.context, values.as_ptr(), values.len())).ok()
    }

    /// The matrices are not read any more.
    pub(crate) fn copied(&self) {
        (self.host.copied)(self.host.context);
    }

    /// Hands a pair out.
    pub(crate) fn pair(&self, value: f64, vector: &[f64], weighted: &[f64]) {
        (self.host.pair)(self.host.context, value, vector.as_ptr(), weighted.as_ptr(), vector.len());
    }
}

/// Version of the interface.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_slepc_abi_version() -> u32 {
    LIBRARY.version
}

/// Message of this thread's last failure, valid until its next call.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_slepc_last_error() -> *const c_char {
    last_error()
}

/// Ends SLEPc and PETSc if they were started here and MPI is still up.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_slepc_finalize() {
    // There is nobody left to tell of a panic.
    let _ = catch_unwind(crate::finalize);
}

/// Eigenpairs nearest to a shift. Collective; all ranks fail together. Returns a status of `m4gn.h`.
///
/// # Safety
/// The pointers are what [`RawProblem`] and [`RawHost`] say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_slepc_eigenpairs(problem: *const RawProblem, host: *const RawHost) -> i32 {
    // SAFETY: passed on to the caller.
    let result = catch_unwind(AssertUnwindSafe(|| unsafe { solve(&*problem, *host) }));
    let error = match result {
        Ok(Ok(())) => return 0,
        Ok(Err(error)) => error,
        Err(panic) => Error::Internal(panic_text(&*panic).into()),
    };
    keep_error(&error.to_string());
    error.status()
}

/// # Safety
/// As [`m4gn_slepc_eigenpairs`].
unsafe fn solve(problem: &RawProblem, host: RawHost) -> Result<()> {
    let comm = Comm::from_fortran(problem.comm)?;
    // SAFETY: as promised by the caller.
    let call = unsafe {
        Call {
            block: problem.block,
            stiffness: Csr::new(&problem.stiffness),
            mass: match problem.mass_diagonal.is_null() {
                true => Mass::Matrix(Csr::new(&problem.mass)),
                false => Mass::Diagonal(slice(problem.mass_diagonal, problem.stiffness.n)),
            },
            shift: problem.shift,
            wanted: problem.wanted,
            iterative: problem.iterative,
            host,
        }
    };
    let matrices = Matrices::new(&comm, &call)?;
    call.copied();
    eigenpairs(&comm, &matrices, &call)
}
