//! The command line `m4gn`: exit status 0 done, 1 failed, 2 bad usage; errors are one paragraph on stderr.

pub mod bench;
pub mod compare;
pub mod doctor;
pub mod generate;
pub mod info;
mod output;
pub mod segment;
mod stop;
pub mod train;
pub mod validate;

pub use output::{progress_bar, write_json};
pub use stop::stop_flag;

use crate::{Error, Result};
use clap::{Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// M4GN surrogates for OpenFOAM
///
/// Data are recorded by the function object m4gnHarvest or made by 'm4gn generate'; the function object
/// m4gnSurrogate takes over time steps of a solver.
#[derive(Debug, Parser)]
#[command(name = "m4gn", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Generate(generate::Args),
    Info(info::Args),
    Train(train::Args),
    Validate(validate::Args),
    Compare(compare::Args),
    Bench(bench::Args),
    Segment(segment::Args),
    Doctor(doctor::Args),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    // Bad usage ends here with status 2.
    let cli = Cli::parse();
    let done = match cli.command {
        Command::Generate(args) => generate::run(args),
        Command::Info(args) => info::run(args),
        Command::Train(args) => train::run(args),
        Command::Validate(args) => validate::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Segment(args) => segment::run(args),
        Command::Doctor(args) => doctor::run(args),
    };
    let status = match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("m4gn: {e}");
            ExitCode::FAILURE
        }
    };
    crate::parallel::finalize();
    status
}

/// Places where the libraries that belong to this program are looked for, in this order: its own folder, `lib` of
/// the checkout it was built in, `lib` of `M4GN_HOME`.
pub fn library_places() -> Vec<PathBuf> {
    let mut places = Vec::new();
    if let Some(folder) = std::env::current_exe()
        .ok()
        .and_then(|p| p.canonicalize().ok()?.parent().map(PathBuf::from))
    {
        let checkout = folder.join("../../lib");
        places.push(folder);
        places.push(checkout.canonicalize().unwrap_or(checkout));
    }
    places.extend(std::env::var_os("M4GN_HOME").map(|home| PathBuf::from(home).join("lib")));
    places
}

/// The library of this file name.
///
/// # Errors
/// [`Error::Input`] that lists the places where it is not.
pub fn library_path(name: &str) -> Result<PathBuf> {
    let places = library_places();
    places.iter().map(|p| p.join(name)).find(|p| p.is_file()).ok_or_else(|| {
        let tried: Vec<_> = places.iter().map(|p| p.display().to_string()).collect();
        Error::Input(format!(
            "{name} was not found in {}. './Allrun' builds it; set M4GN_HOME to the checkout if this program was moved",
            tried.join(", ")
        ))
    })
}
