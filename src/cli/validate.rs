//! `m4gn validate`: a model against recorded trajectories.

use crate::{
    Error, Result,
    dataset::{self, Split, Trajectory},
    engine::Precision,
    model::Model,
    report::number,
    step::{Backend, SessionOptions},
    validate::{self, Case, Pace},
};
use std::{path::PathBuf, sync::atomic::Ordering};

/// Roll a model out on recorded trajectories and print its errors beside those of holding fields
///
/// RMSE-1: one step of the model's stride from every frame at that stride; RMSE-50: the rollout over its first 50
/// frames (or --horizon); RMSE-all: over the whole trajectory. Persistence holds the recorded frame one stride before, hold first
/// the first frame.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model (*.safetensors)
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder of trajectories (*.h5), or one of them
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Trajectories to use
    #[arg(long, value_enum, default_value_t = Choice::All)]
    split: Choice,
    /// Time that RMSE-50 covers, s [default: 50 frames of the data]
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    /// What runs the network: native, torch, torch:DEVICE
    #[arg(long, default_value = "native")]
    backend: String,
    /// Threads
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Of the native engine's products: fp32, bf16
    #[arg(long, default_value = "fp32")]
    precision: String,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report with plots and pictures to this file, self-contained
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// Which trajectories.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Choice {
    Test,
    Valid,
    Train,
    All,
}

impl Choice {
    fn takes(self, split: Split) -> bool {
        match self {
            Choice::Test => split == Split::Test,
            Choice::Valid => split == Split::Valid,
            Choice::Train => split == Split::Train,
            Choice::All => true,
        }
    }
}

/// Parts of the rollout after which a picture is kept.
const SNAPSHOTS: [f64; 3] = [0.1, 0.4, 1.0];

/// Runs the command.
///
/// # Errors
/// When the model does not fit the data, a file cannot be read, or a rollout becomes non-finite (after the table).
pub fn run(args: Args) -> Result<()> {
    let options = SessionOptions {
        backend: Backend::parse(&args.backend)?,
        n_threads: args.threads,
        precision: Precision::parse(&args.precision)?,
        model_path: Some(args.model.clone()),
        ..SessionOptions::default()
    };
    if let Some(h) = args.horizon.filter(|h| !h.is_finite() || *h <= 0.0) {
        return Err(Error::Input(format!(
            "--horizon {h}: expected a positive time in s"
        )));
    }
    let model = Model::read(&args.model)?;
    let mut trajectories = Vec::new();
    for path in dataset::list(&args.data)? {
        let trajectory = Trajectory::open(&path)?;
        if args.split == Choice::All || args.split.takes(trajectory.split()) {
            let pace = fits(&model, &trajectory)?;
            trajectories.push((trajectory, pace));
        }
    }
    if trajectories.is_empty() {
        return Err(Error::Input(format!(
            "{}: no trajectory of this split",
            args.data.display()
        )));
    }
    let steps: usize = trajectories.iter().map(|(_, p)| 2 * p.steps).sum();
    let bar = super::progress_bar(steps as u64, "steps");
    let stop = super::stop_flag()?;
    let mut cases: Vec<Case> = Vec::new();
    let mut pictured = false;
    let total = trajectories.len();
    for (trajectory, pace) in trajectories {
        // One trajectory is pictured: the first of the split that counts.
        let picture = args.html.is_some() && !pictured && trajectory.split() == Split::Test;
        pictured |= picture;
        let chosen: &[f64] = if picture || (args.html.is_some() && cases.is_empty()) {
            &SNAPSHOTS
        } else {
            &[]
        };
        let errors = validate::trajectory::run(&model, &trajectory, &options, chosen, || {
            bar.iter().for_each(|b| b.inc(1));
            match stop.load(Ordering::Relaxed) {
                0 => Ok(()),
                _ => Err(Error::Interrupted("stopped; nothing was written".into())),
            }
        })?;
        let case = Case {
            path: trajectory.path().to_path_buf(),
            split: trajectory.split(),
            horizon: args.horizon.unwrap_or(validate::HORIZON as f64 * pace.interval),
            pace,
            errors,
        };
        if bar.is_none() {
            let f = case.model();
            let name = case.path.file_name().unwrap_or_default().to_string_lossy();
            println!(
                "{}/{total} {name} ({}): RMSE-1 {}, RMSE-50 {}, RMSE-all {}",
                cases.len() + 1,
                case.split.name(),
                number(f.rmse_1, 3),
                number(f.rmse_50, 3),
                number(f.rmse_all, 3)
            );
        }
        cases.push(case);
    }
    bar.iter().for_each(|b| b.finish_and_clear());

    println!();
    for summary in validate::summaries(&cases) {
        println!("{}", summary.table());
        println!(
            "  {} trajectories, {} ms a step, largest speed {} of the largest recorded\n",
            summary.count,
            number(summary.step_ms, 3),
            number(summary.speed_ratio, 3)
        );
    }
    super::write_json(args.json.as_deref(), &validate::json(&cases))?;
    if let Some(path) = &args.html {
        validate::report(&args.model.display().to_string(), &model.spec, &cases)?.write(path)?;
    }
    let diverged: Vec<&Case> = cases.iter().filter(|c| c.errors.diverged.is_some()).collect();
    match diverged.first() {
        None => Ok(()),
        Some(first) => Err(Error::Numerical(format!(
            "{} of {total} rollouts became non-finite; the first: {}, {}",
            diverged.len(),
            first.path.display(),
            first.errors.diverged.as_deref().unwrap_or("")
        ))),
    }
}

/// Whether the model can be run on the trajectory; the error names the file.
fn fits(model: &Model, trajectory: &Trajectory) -> Result<Pace> {
    let checked = validate::trajectory::check_fields(model, trajectory)
        .and_then(|()| validate::trajectory::velocity(model).map(|_| ()))
        .and_then(|()| Pace::new(trajectory.times(), model.spec.stride));
    checked.map_err(|e| match e {
        Error::Model(message) => Error::Model(format!(
            "the model does not fit {}: {message}",
            trajectory.path().display()
        )),
        other => other,
    })
}
