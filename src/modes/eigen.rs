//! Large eigenproblems, by PETSc and SLEPc in `libm4gn_slepc.so`: loaded when modes are computed and not before, for
//! they bring some hundred libraries with them.
//!
//! Its C interface, version [`LIBRARY`]`.version`:
//!
//! ```c
//! uint32_t    m4gn_slepc_abi_version(void);
//! const char *m4gn_slepc_last_error(void);          /* of this thread, valid until its next call */
//! int32_t     m4gn_slepc_eigenpairs(const RawProblem *problem, const RawHost *host);   /* collective */
//! void        m4gn_slepc_finalize(void);            /* before MPI ends */
//! ```
#![allow(unsafe_code)]

use crate::pair::Pair;
use crate::{Mass, Problem, Request, Rows};
use m4gn_base::plugin::{Description, Plugin};
use m4gn_base::{Error, Result, refuse};
use m4gn_model::modal::ModalSolver;
use m4gn_parallel::Comm;
use std::borrow::Cow;
use std::ffi::c_void;
use std::sync::OnceLock;

/// The library.
pub const LIBRARY: Description = Description {
    file: "libm4gn_slepc.so",
    prefix: "m4gn_slepc",
    version: 3,
    remedy: "It computes modes with PETSc and SLEPc (Debian: libslepc-real, libpetsc-real) and is built by \
             setup/build.sh; runs with stored segments, or with segments of METIS alone, need none",
    global: false,
};

/// This rank's rows of a matrix, as [`Rows`].
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawRows {
    /// Rows.
    pub n: usize,
    /// Entries.
    pub entries: usize,
    /// `[n + 1]`.
    pub row: *const usize,
    /// `[entries]`.
    pub column: *const i64,
    /// `[entries]`.
    pub value: *const f64,
}

/// What is asked.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawProblem {
    /// As [`Comm::fortran`]; MPI is up also for a rank alone.
    pub comm: i32,
    /// Unknowns a point.
    pub block: usize,
    /// K.
    pub stiffness: RawRows,
    /// M where it is no diagonal matrix.
    pub mass: RawRows,
    /// M's diagonal; null: `mass` counts.
    pub mass_diagonal: *const f64,
    /// Below the eigenvalues wanted.
    pub shift: f64,
    /// Pairs wanted at first.
    pub wanted: usize,
    /// Whether no factorisation is made.
    pub iterative: bool,
}

/// What the library calls while it works.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawHost {
    /// First argument of all calls.
    pub context: *mut c_void,
    /// The matrices have been copied and are not read any more.
    pub copied: extern "C" fn(*mut c_void),
    /// [`Request::taken`] of so many eigenvalues; -1: more have to be seen.
    pub taken: extern "C" fn(*mut c_void, *const f64, usize) -> i64,
    /// A pair: eigenvalue, vector, M times the vector, their length.
    pub pair: extern "C" fn(*mut c_void, f64, *const f64, *const f64, usize),
}

/// Type of `m4gn_slepc_eigenpairs`.
pub type Eigenpairs = unsafe extern "C" fn(*const RawProblem, *const RawHost) -> i32;

/// The library, loaded once a process.
pub(crate) fn library() -> Result<&'static Plugin> {
    static LOADED: OnceLock<Result<Plugin>> = OnceLock::new();
    LOADED.get_or_init(|| LIBRARY.load()).as_ref().map_err(Clone::clone)
}

/// The state of a call that the library's calls back work on.
struct Host<'a> {
    request: &'a Request<'a>,
    release: &'a mut dyn FnMut(),
    pairs: Vec<Pair>,
}

/// Eigenpairs by ascending distance from the shift, those that are taken and a few more. `release` is called when the
/// matrices are not read any more. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::File`] where the library is not found; [`Error::Input`] for more than PETSc counts; what the library reports.
pub(crate) fn eigenpairs(comm: &Comm, problem: &mut Cow<Problem>, request: &Request) -> Result<Vec<Pair>> {
    let prepared = library().and_then(|library| {
        // SAFETY: the type is that of the interface.
        let call = unsafe { library.function::<Eigenpairs>("m4gn_slepc_eigenpairs")? };
        Ok((library, call))
    });
    let (library, call) = comm.agree(prepared)?;
    // PETSc needs MPI on a rank alone too, and whoever starts MPI ends it.
    comm.agree(m4gn_parallel::start())?;
    announce_end();
    let mut sizes = [problem.stiffness.n() as i64, problem.stiffness.column.len() as i64];
    let entries = sizes[1].max(problem.mass.values().len() as i64);
    comm.sum_i64(&mut sizes);
    comm.agree(countable(sizes[0], entries))?;
    let raw = RawProblem {
        comm: comm.fortran(),
        block: request.block,
        stiffness: raw_rows(&problem.stiffness),
        mass: match &problem.mass {
            Mass::Matrix(rows) => raw_rows(rows),
            Mass::Diagonal(_) => raw_rows(&Rows::default()),
        },
        mass_diagonal: match &problem.mass {
            Mass::Diagonal(values) => values.as_ptr(),
            Mass::Matrix(_) => std::ptr::null(),
        },
        shift: request.shift,
        wanted: request.wanted,
        iterative: match request.options.solver {
            ModalSolver::Auto => crate::prefers_iterative(sizes[0], sizes[1], request.block),
            way => way == ModalSolver::Iterative,
        },
    };
    // A factor needs the room of a matrix that is owned.
    let mut release = || {
        if let Cow::Owned(problem) = problem {
            problem.stiffness = Rows::default();
        }
    };
    let mut host = Host { request, release: &mut release, pairs: Vec::new() };
    let calls = RawHost { context: (&raw mut host).cast(), copied, taken, pair };
    // SAFETY: all pointers live through the call, but those of the stiffness, which live until `copied` is called.
    let status = unsafe { call(&raw, &calls) };
    library.check(status)?;
    Ok(host.pairs)
}

/// Whether PETSc's 32-bit integers count the unknowns of all ranks, and the entries of a matrix on this one.
fn countable(unknowns: i64, entries: i64) -> Result<()> {
    let most = i64::from(i32::MAX);
    refuse(unknowns > most || entries > most, Error::Input, || {
        format!(
            "modes of {unknowns} unknowns, with {entries} entries of K or M on one rank: PETSc's integers count to {most}; \
             use more ranks where the entries are too many, else the method metis, which needs no modes"
        )
    })
}

/// Has PETSc ended before MPI.
fn announce_end() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        m4gn_parallel::before_finalize(|| {
            if let Ok(library) = library()
                // SAFETY: the type is that of the interface.
                && let Ok(end) = unsafe { library.function::<unsafe extern "C" fn()>("m4gn_slepc_finalize") }
            {
                // SAFETY: takes nothing and may be called at any time.
                unsafe { end() };
            }
        });
    });
}

fn raw_rows(rows: &Rows) -> RawRows {
    RawRows {
        n: rows.n(),
        entries: rows.column.len(),
        row: rows.row.as_ptr(),
        column: rows.column.as_ptr(),
        value: rows.value.as_ptr(),
    }
}

extern "C" fn copied(context: *mut c_void) {
    // SAFETY: the context is the Host of the call that is running, used by nobody else meanwhile.
    let host = unsafe { &mut *context.cast::<Host>() };
    (host.release)();
}

extern "C" fn taken(context: *mut c_void, values: *const f64, n: usize) -> i64 {
    // SAFETY: as above; `n` values live through this call.
    let (host, values) = unsafe { (&*context.cast::<Host>(), slice(values, n)) };
    (host.request.taken)(values).map_or(-1, |n| n as i64)
}

extern "C" fn pair(context: *mut c_void, value: f64, x: *const f64, mx: *const f64, n: usize) {
    // SAFETY: as above, for both vectors.
    let (host, vector, weighted) =
        unsafe { (&mut *context.cast::<Host>(), slice(x, n).to_vec(), slice(mx, n).to_vec()) };
    host.pairs.push(Pair { value, vector, weighted });
}

/// # Safety
/// `n` values at `data`, or none.
pub unsafe fn slice<'a, T>(data: *const T, n: usize) -> &'a [T] {
    match n {
        0 => &[],
        // SAFETY: as promised.
        _ => unsafe { std::slice::from_raw_parts(data, n) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_petsc_counts_is_refused() {
        let most = i64::from(i32::MAX);
        countable(most, most).unwrap();
        for (unknowns, entries) in [(most + 1, 7), (7, most + 1)] {
            m4gn_samples::fails(countable(unknowns, entries), &["2147483648", "use more ranks"]);
        }
    }
}
