//! `m4gn calibrate`: how the errors of a model's rollouts grow, measured on recorded trajectories.

use crate::number::{count, share};
use crate::validate::{Progress, SPLITS};
use m4gn_base::{Error, Result};
use m4gn_model::{Calibration, Model, Resolution};
use m4gn_step::SessionOptions;
use m4gn_workbench::calibrate::{self, Rollout};
use m4gn_workbench::signal::median;
use m4gn_workbench::validate::{name_file, predicted, trajectories};
use serde_json::json;
use std::path::PathBuf;

/// Measure how a model's errors grow over a jump, for the error control of m4gnSurrogate
///
/// Rolls the model out from frames all along trajectories that no training has seen, and compares the errors after 1, 2, ... strides
/// with that of the stride before. The quantiles of the ratios are written into the model (--out): with them, and with a stride that
/// solver and surrogate both take, 'control { tolerance ...; }' of m4gnSurrogate chooses the length of its jumps. --check measures
/// instead how often the estimates of a calibrated model hold on other trajectories.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model (*.safetensors)
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder of trajectories (*.h5), or one of them
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Trajectories to use
    #[arg(long, default_value = "valid", value_parser = SPLITS)]
    split: String,
    /// Longest jump, strides of the model
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = count)]
    strides: usize,
    /// Rollouts on each trajectory, from frames evenly apart
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = count)]
    starts: usize,
    /// Share of the rollouts whose errors are not larger than the estimate [default: 0.95]
    #[arg(long, value_name = "SHARE", conflicts_with = "check", value_parser = share)]
    coverage: Option<f64>,
    /// Measure how often the model's own calibration holds here
    #[arg(long, conflicts_with = "out")]
    check: bool,
    #[arg(long, default_value = "auto", help = SessionOptions::table().help("resolution"))]
    resolution: Resolution,
    /// Threads
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Write the calibrated model to this file; it may be the same
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub fn run(args: Args) -> Result<()> {
    let data = Some(&*args.data);
    let _json = crate::claim_outputs([args.json.as_deref()], [data, Some(&*args.model)])?;
    let _out = crate::claim_outputs([args.out.as_deref()], [data])?;
    let mut model = Model::read(&args.model)?;
    let known = match (args.check, &model.spec.calibration) {
        (true, None) => {
            return Err(Error::Model(format!(
                "{}: the model has no calibration to check; make one without --check, and write it with --out",
                args.model.display()
            )));
        }
        (true, known) => known.clone(),
        (false, _) => None,
    };
    let strides = match &known {
        Some(c) => c.growth.iter().map(|g| g.factors.len()).min().unwrap_or(0).min(args.strides),
        None => args.strides,
    };
    let options =
        SessionOptions { n_threads: args.threads, resolution: args.resolution, ..SessionOptions::default() };
    let mut note = |text: String| eprintln!("{text}");
    let found = trajectories(&args.data, &args.split, &model.spec, &mut note)?;
    let (mut found, short): (Vec<_>, Vec<_>) = found.into_iter().partition(|(_, pace)| pace.steps > strides);
    match (found.is_empty(), short.first()) {
        // Then that is what is said of the first.
        (true, _) => found = short,
        (false, Some((first, _))) => eprintln!(
            "note: trajectories left out: {} of {strides} strides or fewer, the first of them {}",
            short.len(),
            first.path().display()
        ),
        (false, None) => {}
    }
    let progress = Progress::new(args.starts * found.len())?;
    let mut all: Vec<Vec<Rollout>> = Vec::new();
    for (i, (trajectory, _)) in found.iter().enumerate() {
        let tick = &mut || progress.advance();
        let mut outside = Vec::new();
        let lengths = (strides, args.starts);
        let rollouts = calibrate::rollouts(&model, trajectory, &options, lengths, &mut outside, tick);
        all.push(name_file(rollouts, trajectory.path())?);
        progress.note(trajectory.path(), &outside);
        progress.say(|| format!("{}/{} {}", i + 1, found.len(), trajectory.path().display()));
    }
    progress.finish();

    let asked = args.coverage.unwrap_or(0.95);
    let calibration = match &known {
        Some(known) => known.clone(),
        None => calibrate::calibration(&model, asked, &all)?,
    };
    let rollouts: Vec<Rollout> = all.iter().flatten().cloned().collect();
    let names: Vec<&str> = predicted(&model.spec.fields).iter().map(|f| f.name.as_str()).collect();
    let covered: Vec<Vec<Option<f64>>> =
        (0..names.len()).map(|k| calibrate::covered(&calibration, &model, k, &rollouts)).collect();
    print(&calibration, &rollouts, (&names, &covered), known.is_some(), found.len());
    let figures = json!({
        "calibration": calibration,
        "checked": known.is_some(),
        "trajectories": found.len(),
        "rollouts": rollouts.len(),
        "fields": names,
        "covered": covered,
    });
    crate::write_json(args.json.as_deref(), &figures)?;
    if known.is_none() && calibration.coverage < asked {
        println!(
            "note: {} trajectories cannot tell of more than {:.3}; a coverage of {asked} takes at least {}",
            calibration.trajectories,
            calibration.coverage,
            // Rounding must not ask for one more
            (asked / (1.0 - asked) * (1.0 - 1e-9)).ceil()
        );
    }
    if let Some(out) = &args.out {
        model.spec.calibration = Some(calibration);
        model.write(out)?;
        println!("written to {}", out.display());
    }
    Ok(())
}

/// The factors at some numbers of strides.
fn print(
    calibration: &Calibration,
    rollouts: &[Rollout],
    (names, covered): (&[&str], &[Vec<Option<f64>>]),
    checked: bool,
    trajectories: usize,
) {
    let count = rollouts.len();
    match checked {
        true => println!(
            "calibrated for a coverage of {} on {} rollouts of {} trajectories; checked on {count} of {trajectories}",
            calibration.coverage, calibration.rollouts, calibration.trajectories
        ),
        false => println!(
            "coverage {:.3} on {count} rollouts of {trajectories} trajectories",
            calibration.coverage
        ),
    }
    println!("error after n strides over that of the stride before:");
    println!("  field       n  median    factor  share within");
    for (k, name) in names.iter().enumerate() {
        let factors = calibration.factors(name).unwrap_or(&[]);
        let shown = [1, 2, 5, 10, 20, 40, 80];
        for n in shown.into_iter().filter(|n| *n <= factors.len()) {
            let median = median(rollouts.iter().filter_map(|r| r[k].growth(n - 1)));
            println!(
                "  {name:<8} {n:>4}  {:>6}  {:>8.2}  {:>13}",
                median.map_or("-".into(), |m| format!("{m:.2}")),
                factors[n - 1],
                covered[k][n - 1].map_or("-".into(), |share| format!("{:.1} %", 100.0 * share))
            );
        }
    }
}
