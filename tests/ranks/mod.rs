//! The way in and out of a test program that runs on several ranks and collects what failed.
// Each test program uses a part of it.
#![allow(dead_code)]

use m4gn_base::Result;
use m4gn_parallel::{Comm, finalize};
use std::process::ExitCode;

/// Runs the checks on all ranks, prints each rank's failures, and ends MPI: a failure anywhere is one everywhere.
pub fn run(name: &str, checks: impl FnOnce(&Comm) -> Result<Vec<String>>) -> ExitCode {
    let comm = match Comm::world() {
        Ok(comm) => comm,
        Err(e) => {
            eprintln!("{name}: {e}");
            return ExitCode::FAILURE;
        }
    };
    let failures = checks(&comm).unwrap_or_else(|e| vec![e.to_string()]);
    failures.iter().for_each(|f| eprintln!("{name}, rank {} of {}: {f}", comm.rank(), comm.size()));
    let failed = comm.any(!failures.is_empty());
    if comm.is_root() && !failed {
        println!("{name}: ok on {} ranks", comm.size());
    }
    drop(comm);
    finalize();
    if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Remembers what failed on this rank.
pub struct Checks {
    pub comm: Comm,
    pub failures: Vec<String>,
}

impl Checks {
    pub fn new(comm: &Comm) -> Self {
        Checks { comm: comm.clone(), failures: Vec::new() }
    }

    pub fn that(&mut self, holds: bool, what: impl Into<String>) {
        if !holds {
            self.failures.push(what.into());
        }
    }

    /// The value, or a failure that all ranks share: no rank goes on alone.
    pub fn value<T>(&mut self, result: Result<T>, what: &str) -> Option<T> {
        let agreed = self.comm.agree(result);
        agreed.map_err(|e| self.failures.push(format!("{what}: {e}"))).ok()
    }
}
