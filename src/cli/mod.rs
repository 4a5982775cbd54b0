//! The command line `m4gn`: a table of commands, each in a file of its own.

mod torch_library;
pub mod train;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Micro-meso-macro mesh graph networks for OpenFOAM solvers
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Train(train::Args),
}

/// Runs the program; returns its exit status.
pub fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Train(args) => train::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("m4gn: {error}");
            ExitCode::from(1)
        }
    }
}

/// Where a library of this program is: beside it, in `../../lib` of it, or in `$M4GN_HOME/lib`.
pub fn library_path(name: &str) -> PathBuf {
    let folder = std::env::current_exe().ok().and_then(|p| p.parent().map(PathBuf::from)).unwrap_or_default();
    let home = std::env::var_os("M4GN_HOME").map(|h| PathBuf::from(h).join("lib"));
    let tried: Vec<PathBuf> =
        [Some(folder.clone()), Some(folder.join("../../lib")), home].into_iter().flatten().map(|f| f.join(name)).collect();
    tried.iter().find(|p| p.is_file()).or(tried.first()).cloned().unwrap_or_else(|| name.into())
}
