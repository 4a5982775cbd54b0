//! `m4gn compare`: a hybrid run against the full run.

use crate::{
    Error, Result,
    compare::{self, Options},
    foam_case::FoamCase,
    report::{percent, write_file},
};
use std::path::PathBuf;

/// Compare two finished OpenFOAM runs of the same case: fields, forces, shedding frequency, wall time.
///
/// Reads the cases with OpenFOAM's own libraries: ASCII, binary, compressed; a decomposed run needs no reconstructPar.
/// Velocity errors count from the time at which the surrogate of CASE_B took over, over all common stored times.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of the full run, the reference.
    case_a: PathBuf,
    /// Folder of the hybrid run.
    case_b: PathBuf,
    /// Patch whose drag and lift are compared [default: cylinder, where there is one].
    #[arg(long)]
    patch: Option<String>,
    /// Reference speed of the force coefficients, m/s [default: mean inlet velocity].
    #[arg(long, value_name = "M/S")]
    speed: Option<f64>,
    /// Reference length, m [default: extent of the patch across the flow].
    #[arg(long, value_name = "M")]
    length: Option<f64>,
    /// Count errors from this time on, s [default: the takeover that m4gnSurrogate recorded in CASE_B].
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// Wall time of the full run, s [default: from its log.APPLICATION].
    #[arg(long, value_name = "S")]
    wall_a: Option<f64>,
    /// Wall time of the hybrid run, s [default: from its log.APPLICATION].
    #[arg(long, value_name = "S")]
    wall_b: Option<f64>,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report with plots and pictures, self-contained.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write the pictures of the velocity alone.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Times that are pictured.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pictures: usize,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let positive = [
        ("--speed", args.speed),
        ("--length", args.length),
        ("--wall-a", args.wall_a),
        ("--wall-b", args.wall_b),
    ];
    for (name, value) in positive {
        if let Some(v) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(Error::Input(format!("{name} {v}: expected a positive number")));
        }
    }
    let library = super::library_path("libm4gn_foam_bridge.so")?;
    let mut a = FoamCase::open(&library, &args.case_a)?;
    let mut b = FoamCase::open(&library, &args.case_b)?;
    let options = Options {
        patch: args.patch,
        speed: args.speed,
        length: args.length,
        takeover: args.from,
        wall_a: args.wall_a,
        wall_b: args.wall_b,
        snapshots: args.pictures,
    };
    let bar = super::progress_bar(0, "times");
    let result = compare::compare(&mut a, &mut b, &options, |done, of| {
        if let Some(bar) = &bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    });
    bar.iter().for_each(|b| b.finish_and_clear());
    let (comparison, snapshots) = result?;

    println!("full    {}", comparison.case_a);
    println!("hybrid  {}", comparison.case_b);
    let from = if comparison.surrogate.is_some() {
        "the surrogate took over at"
    } else {
        "no surrogate found; errors from"
    };
    println!(
        "{} cells, {} common times; {from} {} s\n",
        comparison.cells,
        comparison.times.len(),
        comparison.takeover
    );
    println!("{}", comparison.error_table());
    println!("{}", comparison.figure_table());
    if let Some(fraction) = comparison.replaced_fraction {
        println!(
            "  replaced {} of the simulated time after start-up",
            percent(Some(fraction))
        );
    }
    if comparison.reference.is_some() && comparison.frequency.contains(&None) {
        println!(
            "  no shedding frequency: the lift does not oscillate over at least 1.5 periods in both runs"
        );
    }

    let picture = match args.html.is_some() || args.png.is_some() {
        true => compare::picture(&a.polygons()?, &snapshots),
        false => None,
    };
    super::write_json(args.json.as_deref(), &comparison.json()?)?;
    if let Some(path) = &args.html {
        compare::report(&comparison, picture.as_ref())?.write(path)?;
    }
    if let Some(path) = &args.png {
        let raster = picture.as_ref().ok_or_else(|| {
            Error::Input(format!(
                "{}: there is no picture to write; pictures need a 2-D case and --pictures above 0",
                path.display()
            ))
        })?;
        write_file(path, &raster.png()?)?;
    }
    for path in [&args.json, &args.html, &args.png].into_iter().flatten() {
        println!("  wrote {}", path.display());
    }
    Ok(())
}
