//! `m4gn predict`: a model's rollouts as trajectories.

use super::running::Running;
use super::validate::{Progress, check_finite};
use m4gn_base::{Error, Result, lock, refuse};
use m4gn_model::Model;
use m4gn_workbench::predict;
use m4gn_workbench::validate::{name_file, trajectories};
use serde_json::json;
use std::path::PathBuf;

/// Roll a model out from the first frame of trajectories, and write what it predicts
///
/// The predictions are trajectories of the same schema, a stride of the model apart; 'm4gn convert' makes *.npz and files for ParaView of
/// them. Prints the errors, as far as the truth is recorded, beside those of persistence (the recorded frame one stride before) and
/// of hold first (the first frame). The same command again keeps what it has written, and goes on where it was ended.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model (*.safetensors)
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Trajectory (*.h5), or a folder of them
    #[arg(long, value_name = "PATH")]
    data: PathBuf,
    /// Where the prediction is written: *.h5, or a folder for a folder
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Steps [default: as many as are recorded]; beyond, what is prescribed stays as it is in the last frame
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    steps: Option<u64>,
    #[command(flatten)]
    running: Running,
    /// Write the errors to this file, step by step
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; rollouts that become non-finite are told after all are written.
pub fn run(args: Args) -> Result<()> {
    let _claimed = super::claim_outputs(
        [args.json.as_deref(), Some(&*args.out).filter(|_| !args.data.is_dir())],
        [Some(&*args.model), Some(&*args.data)],
    )?;
    let options = args.running.options()?;
    let model = Model::read(&args.model)?;
    let mut note = |text: String| eprintln!("{text}");
    let found = trajectories(&args.data, "all", &model.spec, &mut note)?;
    let folder = args.data.is_dir();
    refuse(args.out.extension().is_some_and(|e| e == "h5") == folder, Error::Input, || {
        let expected = if folder { "a folder" } else { "a name that ends in .h5" };
        format!("--out {}: expected {expected}; 'm4gn convert' makes other files of it", args.out.display())
    })?;
    let _folder = folder.then(|| lock::folder(&args.out)).transpose()?;
    let (mut figures, mut diverged) = (Vec::new(), Vec::new());
    for (trajectory, pace) in &found {
        let file = trajectory.path();
        let out = match folder {
            true => args.out.join(file.file_name().unwrap_or_default()),
            false => args.out.clone(),
        };
        let steps = args.steps.map(|n| n as usize);
        let progress = Progress::new(steps.unwrap_or(pace.steps))?;
        let done = predict::run(&model, trajectory, &options, (steps, &out), &mut || progress.advance());
        progress.note(file, done.as_ref().map_or(&[], |d| &d.outside));
        let done = name_file(done, file)?;
        progress.finish();
        println!(
            "{}: {} steps of {} s from {}",
            out.display(),
            done.steps,
            model.spec.stride,
            file.display()
        );
        println!("{}", done.table());
        diverged.extend(done.diverged.as_ref().map(|why| format!("{}, {why}", file.display())));
        let mut json = done.json();
        json["data"] = json!(file.to_string_lossy());
        json["out"] = json!(out.to_string_lossy());
        figures.push(json);
    }
    super::write_json(args.json.as_deref(), &json!({ "predictions": figures }))?;
    check_finite(&diverged, found.len())
}
