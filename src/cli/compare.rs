//! `m4gn compare`: a hybrid run against the full run.

use crate::number::above_zero;
use m4gn_base::Result;
use m4gn_workbench::compare::{self, Options};
use m4gn_workbench::foam_case::FoamCase;
use std::path::PathBuf;

/// Compare two finished OpenFOAM runs of the same case: fields, forces, shedding frequency, wall time.
///
/// Reads the cases with OpenFOAM's own libraries: ASCII, binary, compressed; a decomposed run needs no reconstructPar, unless it is collated.
/// Of a case with a displacement D and no pressure p it compares the displacement, the stress sigma where both runs have it at all times,
/// the motion of one cell, its frequency and the reaction force on a patch. Errors of the fields count from the time at which the
/// surrogate of CASE_B took over, over all common stored times.
/// First come the times of the whole runs, with start-up and loading, over the simulated time that the logs of both
/// have, then those after the takeover; a log without 'End' counts for nothing. Where there is no velocity U, the temperature T
/// is compared in its place.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of the full run, the reference.
    case_a: PathBuf,
    /// Folder of the hybrid run.
    case_b: PathBuf,
    /// Patch whose drag and lift are compared [default: cylinder, where there is one]; of a solid, whose reaction force is,
    /// the integral of the stored stress sigma [default: none].
    #[arg(long)]
    patch: Option<String>,
    /// Of a solid, the patch beside whose centre a cell is followed [default: the cell that moves most].
    #[arg(long, value_name = "PATCH")]
    probe_patch: Option<String>,
    /// Count errors from this time on, s [default: the takeover that m4gnSurrogate recorded in CASE_B].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Wall time of the full run, s [default: from its log.APPLICATION, in whole seconds].
    #[arg(long, value_name = "S", value_parser = above_zero)]
    wall_a: Option<f64>,
    /// Wall time of the hybrid run, s [default: from its log.APPLICATION, in whole seconds].
    #[arg(long, value_name = "S", value_parser = above_zero)]
    wall_b: Option<f64>,
    /// CASE_B may have another mesh: its values are interpolated linearly onto the cells of CASE_A.
    #[arg(long)]
    interpolate: bool,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report with plots and pictures, self-contained.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// Times that are pictured.
const PICTURES: usize = 3;

pub fn run(args: Args) -> Result<()> {
    let _claimed = super::claim_outputs(
        [&args.json, &args.html].map(|p| p.as_deref()),
        [Some(&*args.case_a), Some(&*args.case_b)],
    )?;
    let mut a = FoamCase::open(&args.case_a)?;
    let mut b = FoamCase::open(&args.case_b)?;
    let options = Options {
        patch: args.patch,
        follow: args.probe_patch,
        takeover: args.from,
        wall_a: args.wall_a,
        wall_b: args.wall_b,
        interpolate: args.interpolate,
        snapshots: if args.html.is_some() { PICTURES } else { 0 },
    };
    let compared =
        |progress: &mut dyn FnMut(usize, usize)| compare::compare(&mut a, &mut b, &options, progress);
    let (comparison, snapshots) = super::counted("times", compared)?;
    println!("full    {}", comparison.case_a);
    println!("hybrid  {}", comparison.case_b);
    println!(
        "{} cells, {} common times; {} {} s\n",
        comparison.cells,
        comparison.times.len(),
        match (args.from, &comparison.surrogate) {
            (Some(_), _) => "errors from",
            (None, Some(_)) => "the surrogate took over at",
            (None, None) => "no surrogate found; errors from",
        },
        comparison.takeover
    );
    println!("{}", comparison.cost.table());
    comparison.error_tables().iter().for_each(|t| println!("{t}"));
    comparison.figure_table().iter().for_each(|t| println!("{t}"));
    comparison.notes().iter().for_each(|line| println!("  {line}"));

    super::write_json(args.json.as_deref(), &comparison.json()?)?;
    if let Some(path) = &args.html {
        comparison.report(&a.polygons()?, &snapshots)?.write(path)?;
    }
    for path in [&args.json, &args.html].into_iter().flatten() {
        println!("  wrote {}", path.display());
    }
    Ok(())
}
