//! Callers of foreign C: MPI handles, and the end of the process.
//!
//! What leaves this module is safe: every `unsafe` block says why its call is sound.
#![allow(unsafe_code)]

pub mod mpi;

/// Has what we started ended at the end of the process, or when this library is unloaded before.
///
/// Only where this process is all there is: several ranks end together by [`crate::finalize`]. A rank
/// that leaves early, on a panic, must not wait here for the others; mpirun then ends them.
pub fn finalize_at_exit() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    extern "C" fn run() {
        if mpi::world_size() == Some(1) {
            // A panic must not leave through C's exit.
            let _ = std::panic::catch_unwind(crate::finalize);
        }
    }
    // SAFETY: `run` is a C function without arguments that does not unwind.
    ONCE.call_once(|| unsafe {
        libc::atexit(run);
    });
}
