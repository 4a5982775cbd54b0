//! Callers of foreign C: the floating-point environment and signals.
//!
//! What leaves this module is safe: every `unsafe` block says why its call is sound.
#![allow(unsafe_code)]

pub mod fpe;

/// A file that grows past `ulimit -f` is then an error of writing, which has a message, and does not end the process.
/// For the command line only: a host's signals are its own.
pub fn refuse_file_size_signal() {
    // SAFETY: SIGXFSZ is a signal, and to ignore it needs no handler.
    unsafe {
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
    }
}

/// Asks a process of ours, that has not been waited for, to end (SIGTERM).
pub fn ask_to_end(process: u32) {
    // SAFETY: kill reads two numbers; the process is a child whose number is its own until it is waited for.
    unsafe {
        libc::kill(process as libc::pid_t, libc::SIGTERM);
    }
}
