//! The command line `m4gn`: exit status 0 done, 1 failed, 2 bad usage; errors are one paragraph on stderr.
//! Each command is a module with its `Args`, and `run`, which fails with that paragraph.

// First, since its macros print in all the others.
#[macro_use]
mod output;

mod averages;
mod bench;
mod calibrate;
mod campaign;
mod check;
mod compare;
mod convert;
mod generate;
mod hybrid;
mod info;
mod number;
mod predict;
mod running;
mod segment;
mod shell;
mod stop;
mod study;
mod suggest;
mod train;
mod tutorial;
mod validate;
mod verify;

pub use output::{claim_outputs, counted, progress_bar, write_json};
pub use stop::stop_flag;

use clap::{Parser, Subcommand};
use m4gn_base::{Error, Result};
use std::process::ExitCode;

/// M4GN surrogates for OpenFOAM
///
/// Data are recorded by the function object m4gnRecorder or made by 'm4gn generate'; the function object
/// m4gnSurrogate takes over time steps of a solver.
#[derive(Debug, Parser)]
#[command(name = "m4gn", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Check(check::Args),
    Generate(generate::Args),
    Info(info::Args),
    Suggest(suggest::Args),
    Train(train::Args),
    Validate(validate::Args),
    Predict(predict::Args),
    Averages(averages::Args),
    Calibrate(calibrate::Args),
    Convert(convert::Args),
    Compare(compare::Args),
    Verify(verify::Args),
    Hybrid(hybrid::Args),
    Campaign(campaign::Args),
    Study(study::Args),
    Bench(bench::Args),
    Segment(segment::Args),
    Tutorial(tutorial::Args),
    #[command(hide = true)]
    ShellFiles(shell::Args),
}

/// Runs the command line of this process.
fn main() -> ExitCode {
    m4gn_base::ffi::refuse_file_size_signal();
    // Bad usage ends here with status 2.
    let cli = Cli::parse();
    let done = match cli.command {
        Command::Check(args) => check::run(args),
        Command::Generate(args) => generate::run(args),
        Command::Info(args) => info::run(args),
        Command::Suggest(args) => suggest::run(args),
        Command::Train(args) => utf8_arguments().and_then(|()| train::run(args)),
        Command::Validate(args) => validate::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Averages(args) => averages::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Convert(args) => convert::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Verify(args) => verify::run(args),
        Command::Hybrid(args) => hybrid::run(args),
        Command::Campaign(args) => campaign::run(args),
        Command::Study(args) => study::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Segment(args) => segment::run(args),
        Command::Tutorial(args) => tutorial::run(args),
        Command::ShellFiles(args) => shell::run(args),
    };
    let status = match done.and_then(|()| output::printed()) {
        Ok(()) => ExitCode::SUCCESS,
        // That rank says it.
        Err(Error::OtherRank { .. }) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("m4gn: {e}");
            ExitCode::FAILURE
        }
    };
    m4gn_parallel::finalize();
    status
}

/// Training hands its paths on as JSON, which has no others.
fn utf8_arguments() -> Result<()> {
    match std::env::args_os().find(|a| a.to_str().is_none()) {
        None => Ok(()),
        Some(argument) => Err(Error::Input(format!(
            "argument '{}': expected UTF-8; give the file a name in UTF-8",
            argument.to_string_lossy()
        ))),
    }
}
