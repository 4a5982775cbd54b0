//! Starting and ending MPI, only where nobody else has.

use m4gn_base::{Error, Result};
use mpi::environment::{Threading, Universe, initialize_with_threading, is_finalized, is_initialized};
use std::sync::Mutex;

/// MPI's lifetime, if it is ours.
static UNIVERSE: Mutex<Option<Universe>> = Mutex::new(None);

/// Starts MPI if nobody has; it then ends with [`finalize`], or, on a single rank, with the process.
///
/// Fails if MPI has already been finalised in this process: MPI cannot be started twice.
pub fn start() -> Result<()> {
    if is_initialized() {
        if is_finalized() {
            return Err(Error::Input(
                "MPI has been finalised in this process and cannot be started again: do the work before MPI_Finalize"
                    .into(),
            ));
        }
        return Ok(());
    }
    let mut universe = UNIVERSE.lock().unwrap_or_else(|e| e.into_inner());
    if let Some((u, _)) = initialize_with_threading(Threading::Serialized) {
        *universe = Some(u);
        crate::ffi::finalize_at_exit();
    }
    Ok(())
}

/// What must end before MPI ends, such as PETSc.
static BEFORE: Mutex<Vec<fn()>> = Mutex::new(Vec::new());

/// Has `end` called once, by [`finalize`], before MPI ends.
pub fn before_finalize(end: fn()) {
    BEFORE.lock().unwrap_or_else(|e| e.into_inner()).push(end);
    crate::ffi::finalize_at_exit();
}

/// Ends MPI, and what was announced to [`before_finalize`], as far as we started them. Collective over all ranks; a
/// program on several ranks calls this last, on a single rank it happens by itself.
///
/// Every communicator of ours must have been dropped, or be dropped afterwards (then it is not freed).
pub fn finalize() {
    let before = std::mem::take(&mut *BEFORE.lock().unwrap_or_else(|e| e.into_inner()));
    before.into_iter().for_each(|end| end());
    let universe = UNIVERSE.lock().unwrap_or_else(|e| e.into_inner()).take();
    if !is_finalized() {
        drop(universe);
    } else {
        std::mem::forget(universe);
    }
}
