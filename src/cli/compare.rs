//! `m4gn compare`: a hybrid run against the full run.

use m4gn_mesh::{Error, Result};
use m4gn_report::{number, percent, write_file};
use m4gn_workbench::compare;
use m4gn_workbench::compare::displacement::Motion;
use m4gn_workbench::compare::reaction::Reaction;
use m4gn_workbench::compare::{Options, displacement};
use m4gn_workbench::foam_case::FoamCase;
use std::path::{Path, PathBuf};

/// Compare two finished OpenFOAM runs of the same case: fields, forces, shedding frequency, wall time.
///
/// Reads the cases with OpenFOAM's own libraries: ASCII, binary, compressed; a decomposed run needs no reconstructPar.
/// Of a case with a displacement D and no pressure p, the displacement, the motion of one cell, its frequency and the reaction
/// force on a patch are compared. Errors of the fields count from the time at which the surrogate of CASE_B took over, over all common stored times.
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
    follow: Option<String>,
    /// Reference speed of the force coefficients, m/s [default: mean inlet velocity].
    #[arg(long, value_name = "M/S")]
    speed: Option<f64>,
    /// Reference length, m [default: extent of the patch across the flow].
    #[arg(long, value_name = "M")]
    length: Option<f64>,
    /// Count errors from this time on, s [default: the takeover that m4gnSurrogate recorded in CASE_B].
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// Wall time of the full run, s [default: from its log.APPLICATION, in whole seconds].
    #[arg(long, value_name = "S")]
    wall_a: Option<f64>,
    /// Wall time of the hybrid run, s [default: from its log.APPLICATION, in whole seconds].
    #[arg(long, value_name = "S")]
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
    super::check_outputs([&args.json, &args.html, &args.png].map(|p| p.as_deref()))?;
    let mut a = FoamCase::open(&args.case_a)?;
    let mut b = FoamCase::open(&args.case_b)?;
    let options = Options {
        patch: args.patch,
        follow: args.follow,
        speed: args.speed,
        length: args.length,
        takeover: args.from,
        wall_a: args.wall_a,
        wall_b: args.wall_b,
        interpolate: args.interpolate,
        snapshots: args.pictures,
    };
    let bar = super::progress_bar(0, "times");
    let progress = |done: usize, of: usize| {
        if let Some(bar) = &bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    };
    if displacement::is_solid(&mut a)? {
        let given = [
            ("--speed", options.speed.is_some()),
            ("--length", options.length.is_some()),
            ("--png", args.png.is_some()),
            ("--interpolate", options.interpolate),
        ];
        if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
            return Err(Error::Input(format!(
                "{name}: of a displacement there are no coefficients, no pictures and no interpolation; leave it out"
            )));
        }
        let motion = displacement::compare(&mut a, &mut b, &options, progress);
        bar.iter().for_each(|b| b.finish_and_clear());
        return show_motion(&motion?, args.json.as_deref(), args.html.as_deref());
    }
    if let Some(patch) = &options.follow {
        return Err(Error::Input(format!(
            "--follow {patch}: cells are followed of a solid, and {} is a flow's; leave it out",
            a.description().path
        )));
    }
    let result = compare::compare(&mut a, &mut b, &options, progress);
    bar.iter().for_each(|b| b.finish_and_clear());
    let (comparison, snapshots) = result?;

    show_cases(
        [&comparison.case_a, &comparison.case_b],
        comparison.surrogate.is_some(),
        comparison.cells,
        comparison.times.len(),
        comparison.takeover,
    );
    println!("{}", comparison.error_table());
    comparison.field_tables().iter().for_each(|t| println!("{t}"));
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

/// What was compared.
fn show_cases(cases: [&str; 2], surrogate: bool, cells: usize, times: usize, takeover: f64) {
    println!("full    {}", cases[0]);
    println!("hybrid  {}", cases[1]);
    let from = match surrogate {
        true => "the surrogate took over at",
        false => "no surrogate found; errors from",
    };
    println!("{cells} cells, {times} common times; {from} {takeover} s\n");
}

/// Prints and writes the comparison of a solid.
fn show_motion(motion: &Motion, json: Option<&Path>, html: Option<&Path>) -> Result<()> {
    show_cases(
        [&motion.case_a, &motion.case_b],
        motion.surrogate.is_some(),
        motion.cells,
        motion.times.len(),
        motion.takeover,
    );
    println!("{}", motion.error_table());
    println!("{}", motion.figure_table());
    println!("  followed: {}", motion.point_text());
    if let Some(text) = motion.reaction.as_ref().and_then(Reaction::left_out_text) {
        println!("  {text}");
    }
    if let Some(periods) = motion.periods {
        println!("  over {} periods", number(periods, 3));
    } else {
        println!("  no frequency: the cell does not oscillate over at least 1.5 periods");
    }
    if let Some(fraction) = motion.replaced_fraction {
        println!(
            "  replaced {} of the simulated time after start-up",
            percent(Some(fraction))
        );
    }
    super::write_json(json, &motion.json()?)?;
    if let Some(path) = html {
        motion.report()?.write(path)?;
    }
    for path in [json, html].into_iter().flatten() {
        println!("  wrote {}", path.display());
    }
    Ok(())
}
