//! PETSc and SLEPc behind the C interface of `m4gn_modes::eigen`: started once a process, errors turned into ours,
//! options, and the eigenproblem.
//!
//! PETSc is joined if it is up and ended only if we started it. Its signal handlers stay off (the host has its
//! own) and its errors neither print nor abort while one of our calls is running.

#![allow(unsafe_code)]

mod count;
mod database;
mod door;
mod eigen;
mod method;
mod objects;

/// What bindgen makes of `slepceps.h`.
mod c {
    #![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, dead_code, missing_docs)]
    #![allow(clippy::all, clippy::undocumented_unsafe_blocks)]
    include!(concat!(env!("OUT_DIR"), "/slepc.rs"));
}

use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::Mutex;

/// Whether SLEPc's lifetime is ours.
static STARTED: Mutex<bool> = Mutex::new(false);

thread_local! {
    /// Message of the first error since the last [`check`].
    static MESSAGE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Remembers PETSc's message and hands the code back; PETSc's own handler would print and abort.
unsafe extern "C" fn remember(
    _comm: mpi::ffi::MPI_Comm,
    _line: c_int,
    function: *const c_char,
    _file: *const c_char,
    code: c_int,
    _kind: c::PetscErrorType,
    message: *const c_char,
    _context: *mut c_void,
) -> c_int {
    let text = |p: *const c_char| match p.is_null() {
        true => String::new(),
        // SAFETY: PETSc passes null or a C string that lives during this call.
        false => unsafe { CStr::from_ptr(p) }.to_string_lossy().trim().replace('\n', " "),
    };
    // A thread that is ending has no message to keep.
    let _ = MESSAGE.try_with(|m| {
        let mut m = m.borrow_mut();
        if m.is_empty() {
            *m = format!("{}: {}", text(function), text(message));
        }
    });
    code
}

/// While it lives, PETSc's errors come back as codes.
struct Quiet;

impl Quiet {
    fn new() -> Self {
        // What was said while objects of an earlier failure were destroyed is none of this call's.
        MESSAGE.take();
        // SAFETY: the handler has the type that PETSc expects and needs no context.
        unsafe { c::PetscPushErrorHandler(Some(remember), std::ptr::null_mut()) };
        Quiet
    }
}

impl Drop for Quiet {
    fn drop(&mut self) {
        // SAFETY: pops what new pushed.
        unsafe { c::PetscPopErrorHandler() };
    }
}

/// Turns a PETSc code into a numerical error with PETSc's own message.
fn check(code: c::PetscErrorCode) -> Result<()> {
    if code == 0 {
        return Ok(());
    }
    let message = MESSAGE.with(|m| std::mem::take(&mut *m.borrow_mut()));
    Err(Error::Numerical(format!("PETSc error {code} ({message})")))
}

/// The communicator that PETSc objects of these ranks live on.
fn raw(comm: &Comm) -> mpi::ffi::MPI_Comm {
    match comm {
        // SAFETY: a constant set before main.
        Comm::Serial => unsafe { mpi::ffi::RSMPI_COMM_SELF },
        Comm::Mpi(m) => m.owned().raw(),
    }
}

/// Starts SLEPc if nobody has; MPI is up. Collective over `comm`.
///
/// PETSc's start waits for all ranks of `PETSC_COMM_WORLD`, so only ranks that come here may be in it: all ranks
/// of MPI (PETSc's default, which other guests expect) where `comm` has them all, else a duplicate of `comm`,
/// or this rank alone where others of `comm` have started PETSc before.
fn start(comm: &Comm) -> Result<()> {
    let mut started = STARTED.lock().unwrap_or_else(|e| e.into_inner());
    let (mut slepc_up, mut petsc_up): (c::PetscBool, c::PetscBool) = (0, 0);
    // SAFETY: may be called at any time; each writes one flag.
    unsafe {
        c::SlepcInitialized(&mut slepc_up);
        c::PetscInitialized(&mut petsc_up);
    }
    let up_somewhere = comm.any(petsc_up != 0);
    if slepc_up != 0 {
        return Ok(());
    }
    if petsc_up == 0 {
        // SAFETY: option values may be set before PETSc starts; the strings are C strings.
        let code = unsafe {
            c::PetscOptionsSetValue(std::ptr::null_mut(), c"-no_signal_handler".as_ptr(), c"1".as_ptr())
        };
        check(code)?;
        let alone = raw(&Comm::Serial);
        if up_somewhere {
            // SAFETY: read by PETSc's start below; MPI_COMM_SELF lives as long as MPI.
            unsafe { c::PETSC_COMM_WORLD = alone };
        } else if m4gn_parallel::ffi::mpi::world_size() != Some(comm.size()) {
            let mut copy = alone;
            // SAFETY: a live communicator; PETSc keeps the copy to the end of the process.
            unsafe {
                mpi::ffi::MPI_Comm_dup(raw(comm), &mut copy);
                c::PETSC_COMM_WORLD = copy;
            }
        }
    }
    // SAFETY: null arguments mean no command line, no options file of our own, no help text.
    let code = unsafe {
        c::SlepcInitialize(std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null(), std::ptr::null())
    };
    check(code)?;
    *started = true;
    Ok(())
}

/// Ends SLEPc and PETSc if we started them and MPI is still up.
fn finalize() {
    let mut started = STARTED.lock().unwrap_or_else(|e| e.into_inner());
    if std::mem::take(&mut *started) && !mpi::environment::is_finalized() {
        // SAFETY: started by us, not ended yet; no object of ours is alive between calls.
        unsafe { c::SlepcFinalize() };
    }
}
