//! `m4gn study`: networks on data sets with several seeds, compared in one report.

use super::stop_flag;
use m4gn_base::{Error, Result};
use m4gn_workbench::study::{Plan, run as study};
use std::path::PathBuf;

/// Train networks on data sets with several seeds, at equal updates or equal time, and compare them in one report
///
/// FILE names data and networks (docs/how-to/compare-networks.md). Each training and validation is a process of its own, one after the other. Finished ones are kept in
/// DIR, and the same command goes on where it was stopped. The report (study.md, study.json in DIR) has persistence, hold first,
/// extrapolation and a dmd fit beside the networks. One that fails is reported, and the others go on; exit status 1 then.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to study (*.toml)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Folder for trainings and report
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command; trainings that failed are told after the report.
pub fn run(args: Args) -> Result<()> {
    let plan = Plan::read(&args.file)?;
    let report = study(&plan, &args.out, stop_flag()?, &mut |line| println!("{line}"))?;
    println!("\n{}", report.text());
    match report.failures {
        0 => Ok(()),
        n => Err(Error::Input(format!("{n} of {} failed, as told above", plan.cells().len()))),
    }
}
