//! The command line `m4gn`.

pub mod compare;

use crate::{Error, Result};
use clap::{Parser, Subcommand};
use std::{path::PathBuf, process::ExitCode};

/// M4GN surrogates for OpenFOAM.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Compare(compare::Args),
}

/// Runs the command line: 0 done, 1 failed, 2 bad usage.
pub fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Compare(args) => compare::run(args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::FAILURE
        }
    }
}

/// Where a library of ours is: beside the executable, in `lib/` two folders above it, or in `M4GN_HOME/lib`.
pub fn library_path(name: &str) -> Result<PathBuf> {
    let exe = std::env::current_exe().and_then(|p| p.canonicalize()).ok();
    let dir = exe.as_deref().and_then(|p| p.parent());
    let mut places: Vec<PathBuf> = dir
        .into_iter()
        .flat_map(|d| [d.join(name), d.join("../../lib").join(name)])
        .collect();
    places.extend(std::env::var_os("M4GN_HOME").map(|home| PathBuf::from(home).join("lib").join(name)));
    places.iter().find(|p| p.is_file()).cloned().ok_or_else(|| {
        let tried: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
        Error::Input(format!(
            "{name} was not found (tried {}). Build it with setup/build.sh",
            tried.join(", ")
        ))
    })
}
