//! `m4gn verify`: the jumps of a finished run against its solver.

use super::{claim_outputs, counted, stop_flag, write_json};
use m4gn_base::{Error, Result};
use m4gn_workbench::verify::{self, Plan};
use std::path::PathBuf;
use std::time::Duration;

/// Recompute the jumps of a finished hybrid run with its plain solver, and compare
///
/// Each jump is recomputed from the last time that is written up to its begin, in a copy of the case, and compared at the last time that is written in
/// it. With writeJumps yes; in the dictionary of m4gnSurrogate these are its begin and its end. Errors are those of the run's own control. The case
/// stays as it is. Exit status 1: an error is above the tolerance, or nothing could be compared. See docs/how-to/verify-a-run.md.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of the run
    case: PathBuf,
    /// Largest error of a jump [default: the run's own tolerance]
    #[arg(long, value_name = "X", value_parser = crate::number::above_zero)]
    tolerance: Option<f64>,
    /// Make this folder: the case with the solver's own fields in place of the surrogate's
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Jumps at once
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=4096))]
    jobs: u64,
    /// Longest time for one program, s
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    timeout: u64,
    /// Write all figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub fn run(args: Args) -> Result<()> {
    let _claimed = claim_outputs([args.json.as_deref()], [Some(&*args.case)])?;
    let plan = Plan {
        case: args.case,
        tolerance: args.tolerance,
        keep: args.keep,
        jobs: args.jobs as usize,
        timeout: Duration::from_secs(args.timeout),
        stop: stop_flag()?,
    };
    let report = counted("jumps", |progress| verify::run(&plan, progress))?;
    println!("{}: {}, {} jumps\n", report.case, report.application, report.jumps.len());
    println!("{}", report.table());
    report.notes().iter().for_each(|line| println!("  {line}"));
    write_json(args.json.as_deref(), &report)?;
    [&args.json, &plan.keep].into_iter().flatten().for_each(|path| println!("  wrote {}", path.display()));
    match report.fault() {
        None => Ok(()),
        Some(fault) => Err(Error::Input(format!("{}: {fault}", report.case))),
    }
}
