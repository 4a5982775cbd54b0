//! `m4gn validate`: a model against recorded trajectories.

mod bodies;
mod flows;

use crate::{
    Error, Result,
    dataset::{self, Recorded, Split},
    engine::Precision,
    model::Model,
    step::{Backend, SessionOptions},
};
use std::{path::PathBuf, sync::atomic::Ordering};

/// Roll a model out on recorded trajectories and print its errors beside those of holding fields
///
/// RMSE-1: one step of the model's stride from every frame at that stride; RMSE-50: the rollout over its first 50
/// frames, of a body its first 50 steps (or --horizon); RMSE-all: over the whole trajectory. Persistence holds the recorded
/// frame one stride before, hold first the first frame. Of a body at points also the paper's mesh metrics and the worst gap to
/// the obstacle, with and without contact projection.
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
    /// Time that RMSE-50 covers, s [default: 50 frames of the data, of a body 50 steps of the model]
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    /// Of a body: rollouts with contact projection after each step, without it, or both [default: both]
    #[arg(long, value_enum)]
    projection: Option<Projecting>,
    /// Of a body: the projection keeps it out of itself as well
    #[arg(long)]
    self_contact: bool,
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
    /// Of a body: write the rollout on one trajectory for ParaView into this folder: truth.pvd, prediction.pvd, obstacle.pvd
    #[arg(long, value_name = "DIR")]
    vtu: Option<PathBuf>,
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

/// Which rollouts of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Projecting {
    On,
    Off,
    Both,
}

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
    match model.spec.contact {
        Some(_) => bodies::run(&args, &model, &options),
        None => flows::run(&args, &model, &options),
    }
}

impl Args {
    /// The trajectories of the split that was asked for, as `take` has them.
    fn trajectories<T>(&self, take: impl Fn(Recorded) -> Result<T>) -> Result<Vec<T>> {
        let mut trajectories = Vec::new();
        for path in dataset::list(&self.data)? {
            let recorded = Recorded::open(&path)?;
            if self.split.takes(recorded.split()) {
                trajectories.push(take(recorded)?);
            }
        }
        if trajectories.is_empty() {
            return Err(Error::Input(format!(
                "{}: no trajectory of this split",
                self.data.display()
            )));
        }
        Ok(trajectories)
    }
}

/// Steps done so far, and whether to stop.
struct Progress {
    bar: Option<indicatif::ProgressBar>,
    stop: &'static std::sync::atomic::AtomicU8,
}

impl Progress {
    fn new(steps: usize) -> Result<Self> {
        Ok(Progress {
            bar: super::progress_bar(steps as u64, "steps"),
            stop: super::stop_flag()?,
        })
    }

    /// One step more.
    fn advance(&self) -> Result<()> {
        self.bar.iter().for_each(|b| b.inc(1));
        match self.stop.load(Ordering::Relaxed) {
            0 => Ok(()),
            _ => Err(Error::Interrupted("stopped; nothing was written".into())),
        }
    }

    /// A line where there is no bar.
    fn say(&self, line: impl Fn() -> String) {
        if self.bar.is_none() {
            println!("{}", line());
        }
    }

    fn finish(self) {
        self.bar.iter().for_each(|b| b.finish_and_clear());
        println!();
    }
}

/// The error of a model that does not fit names the file.
fn name_file<T>(checked: Result<T>, path: &std::path::Path) -> Result<T> {
    checked.map_err(|e| match e {
        Error::Model(message) => {
            Error::Model(format!("the model does not fit {}: {message}", path.display()))
        }
        other => other,
    })
}

/// The error that ends the command when rollouts became non-finite.
fn finite(diverged: &[(&std::path::Path, &str)], total: usize) -> Result<()> {
    match diverged.first() {
        None => Ok(()),
        Some((path, why)) => Err(Error::Numerical(format!(
            "{} of {total} rollouts became non-finite; the first: {}, {why}",
            diverged.len(),
            path.display(),
        ))),
    }
}
