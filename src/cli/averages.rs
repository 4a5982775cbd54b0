//! `m4gn averages`: the mean, the fluctuations and the frequency of a column, each with its uncertainty.

use crate::number::{above_zero, share};
use m4gn_averages::{Estimate, Goal, Tolerance, estimate, table};
use m4gn_base::{Error, Result, refuse};
use serde_json::json;
use std::path::PathBuf;

/// Say how well a mean, an rms and a frequency are known
///
/// Reads a column of a table over time, as OpenFOAM's function objects write it, finds where the transient ends, and prints the mean and
/// the rms of the fluctuations with their confidence intervals, which allow for the correlation of the rows. A mean is settled when it does
/// not drift, rests on enough independent samples, and is within the tolerance, if one is given.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Table (postProcessing/forceCoeffs/0/coefficient.dat), or, to join those of all restarts, its name without the folder of the time
    /// (postProcessing/forceCoeffs/coefficient.dat)
    table: PathBuf,
    /// Column by its name in the table's header: Cd, total_x; without one its number, 1 behind the time
    #[arg(long, value_name = "NAME")]
    column: String,
    /// Leave out what is before this time, s
    #[arg(long, value_name = "T", default_value_t = f64::NEG_INFINITY, hide_default_value = true, allow_negative_numbers = true)]
    start: f64,
    /// Probability that an interval holds the true value
    #[arg(long, value_name = "P", default_value_t = 0.95, value_parser = share)]
    confidence: f64,
    /// Largest half-width of the mean's interval when it is settled
    #[arg(long, value_name = "X", conflicts_with = "relative", value_parser = above_zero)]
    tolerance: Option<f64>,
    /// The same over the mean's magnitude
    #[arg(long, value_name = "X", value_parser = above_zero)]
    relative: Option<f64>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub fn run(args: Args) -> Result<()> {
    refuse(args.start.is_nan(), Error::Input, || "--start NaN: expected a time, s")?;
    let tables = table::files_of(&args.table)?;
    let _claimed = crate::claim_outputs([args.json.as_deref()], tables.iter().map(|t| Some(t.as_path())))?;
    let series = table::read(&args.table, &args.column)?.series(args.start);
    let found = estimate(&series, args.confidence).ok_or_else(|| {
        Error::file(
            &args.table,
            format!(
                "expected at least 16 rows of values whose squares are numbers, found {} rows{}",
                series.len(),
                if args.start.is_finite() { format!(" from time {} on", args.start) } else { String::new() }
            ),
        )
    })?;
    let tolerance = args.tolerance.map(Tolerance::Absolute).or(args.relative.map(Tolerance::Relative));
    let settled = match tolerance {
        None => found.mean_steady,
        mean => Goal { mean, rms: None }.met(&found),
    };
    print(&args.column, args.confidence, &found, settled);
    crate::write_json(args.json.as_deref(), &figures(&found, settled))
}

fn figures(found: &Estimate, settled: bool) -> serde_json::Value {
    json!({
        "mean": found.mean,
        "half_width": found.half_width,
        "rms": found.rms,
        "rms_half_width": found.rms_half_width,
        "frequency": found.frequency,
        "frequency_resolution": found.frequency_resolution,
        "transient_end": found.transient_end,
        "settled": settled,
        "independent_samples": found.independent_samples,
        "periods": found.periods,
        "rows": found.rows,
    })
}

fn print(name: &str, confidence: f64, found: &Estimate, settled: bool) {
    let percent = (1e6 * confidence).round() / 1e4;
    println!("{}", found.line(name, confidence));
    println!(
        "  rms of the fluctuations {} ({percent} %)",
        m4gn_averages::with_half_width(found.rms, found.rms_half_width)
    );
    if let (Some(frequency), Some(resolution)) = (found.frequency, found.frequency_resolution) {
        println!("  frequency {} 1/s", m4gn_averages::with_half_width(frequency, resolution));
    }
    println!("  {}", if settled { "settled" } else { "not settled" });
}
