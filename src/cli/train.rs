//! `m4gn train`: fits a model to a data set, in libm4gn_torch.so.

use crate::Result;
use crate::engine::torch::{NAME, TorchLibrary};
use std::path::PathBuf;

/// Train a model on recorded trajectories
///
/// Writes the best model so far to OUT, and beside it a checkpoint (.checkpoint) and a log (.csv). Ctrl-C saves
/// a checkpoint; --resume carries on exactly where it stopped.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of trajectories (*.h5), or one trajectory
    #[arg(long)]
    data: PathBuf,
    /// Training configuration (TOML)
    #[arg(long)]
    config: PathBuf,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// cpu, cuda or cuda:N
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Carry on from the checkpoint beside OUT, or start if there is none
    #[arg(long)]
    resume: bool,
    /// Worker threads; as many as cores and graphs in a batch allow by default
    #[arg(long)]
    threads: Option<usize>,
    /// Steps, in place of training.steps
    #[arg(long)]
    steps: Option<u64>,
    /// Seed, in place of training.seed
    #[arg(long)]
    seed: Option<u64>,
    /// Write the figures to this file
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let library = TorchLibrary::load(super::library_path(NAME)?)?;
    let stop = super::stop_flag()?;
    library.train(
        &serde_json::json!({
            "data": args.data,
            "config": args.config,
            "out": args.out,
            "device": args.device,
            "resume": args.resume,
            "threads": args.threads,
            "steps": args.steps,
            "seed": args.seed,
            "json": args.json,
        }),
        stop,
    )
}
