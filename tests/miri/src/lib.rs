//! The engine's kernels and threads as a crate of their own, so that their unit tests can run under Miri, which
//! watches every access to memory and every race: `cargo +nightly miri test` in this folder. Miri has no AVX: it is the
//! portable path that runs.

/// What the kernels need of the core's errors.
#[derive(Debug)]
pub enum Error {
    /// As the core's.
    Input(String),
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Error::Input(message) = self;
        f.write_str(message)
    }
}

/// As the core's.
pub type Result<T> = std::result::Result<T, Error>;

extern crate self as m4gn_mesh;

#[allow(dead_code, unused_imports)]
#[path = "../../../src/engine/kernels/mod.rs"]
pub mod kernels;
#[allow(dead_code)]
#[path = "../../../src/engine/options.rs"]
pub mod options;
#[allow(dead_code)]
#[path = "../../../src/engine/pool.rs"]
pub mod pool;
