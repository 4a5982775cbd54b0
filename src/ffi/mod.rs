//! The only callers of foreign C: MPI handles, PETSc and SLEPc, the floating-point environment.
//!
//! What leaves this module is safe: every `unsafe` block says why its call is sound.
#![allow(unsafe_code)]

pub mod fpe;
pub mod mpi;
pub mod petsc;

/// Has [`crate::parallel::finalize`] called at the end of the process, or when this library is unloaded before.
pub fn finalize_at_exit() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    extern "C" fn run() {
        // A panic must not leave through C's exit.
        let _ = std::panic::catch_unwind(crate::parallel::finalize);
    }
    // SAFETY: `run` is a C function without arguments that does not unwind.
    ONCE.call_once(|| unsafe {
        libc::atexit(run);
    });
}
