//! `m4gn validate`: a model against recorded trajectories.

use super::running::Running;
use m4gn_base::{Error, Result, lock, refuse, refuse_any};
use m4gn_data::Split;
use m4gn_model::Model;
use m4gn_report::number;
use m4gn_workbench::validate::{self, Case, Keep, name_file};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Roll a model out on recorded trajectories and print its errors beside those of holding fields
///
/// RMSE-1: one step of the model's stride from every frame at that stride; RMSE-50: the rollout over its first 50 recorded
/// frames (or --horizon), printed with its time; RMSE-all: over the whole trajectory. Persistence holds the recorded
/// frame one stride before, extrapolation is the line through the two frames before, dmd a decomposition that is fitted to the frames before (single steps
/// alone: a rollout has no history to be fitted to), hold first the first frame. Where the data end in a
/// cycle, phase-free is the error of the last step but for a shift in time. Of a body at points
/// also the paper's mesh metrics and the worst gap to the obstacle.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model (*.safetensors)
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder of trajectories (*.h5), or one of them
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Trajectories to use
    #[arg(long, default_value = "all", value_parser = SPLITS)]
    split: String,
    /// Time that RMSE-50 covers, s [default: 50 frames of the data]
    #[arg(long, value_name = "S", value_parser = crate::number::above_zero)]
    horizon: Option<f64>,
    #[command(flatten)]
    running: Running,
    /// Number of segments, in place of the model's own
    #[arg(long, value_name = "N")]
    segments: Option<usize>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Of a body: write the rollout on one trajectory for ParaView into this folder: truth.pvd, prediction.pvd, obstacle.pvd
    #[arg(long, value_name = "DIR")]
    vtu: Option<PathBuf>,
}

/// Which trajectories: to report on, to choose settings on, to train on, or each of them.
pub const SPLITS: [&str; 4] = ["test", "valid", "train", "all"];

/// Runs the command; rollouts that become non-finite are told after the table.
pub fn run(args: Args) -> Result<()> {
    let options = args.running.options()?;
    let _claimed = crate::claim_outputs([args.json.as_deref()], [Some(&*args.model), Some(&*args.data)])?;
    let mut model = Model::read(&args.model)?;
    if let Some(count) = args.segments {
        refuse(!model.spec.architecture.needs().segments, Error::Input, || {
            format!("--segments {count}: {} is a network without segments", args.model.display())
        })?;
        (model.spec.segments.count, model.spec.segments.size) = (count, None);
        model.spec.segments.check()?;
    }
    if args.vtu.is_some() && !m4gn_domain::moves(&model.spec) {
        return Err(Error::Input(
            "--vtu: the model is of a flow at cells; this is for models of bodies at points".into(),
        ));
    }
    let _series = args.vtu.as_deref().map(lock::folder).transpose()?;
    let mut note = |text: String| eprintln!("{text}");
    let trajectories = validate::trajectories(&args.data, &args.split, &model.spec, &mut note)?;
    // Of one trajectory, the first of the split that counts.
    let shown = trajectories.iter().position(|(t, _)| t.split() == Split::Test);
    let shown = shown.unwrap_or(0);
    let total = trajectories.len();
    let progress = Progress::new(trajectories.iter().map(|(_, p)| validate::steps(*p)).sum())?;
    let mut cases: Vec<Case> = Vec::new();
    for (i, (trajectory, _)) in trajectories.iter().enumerate() {
        let keep = if args.vtu.is_some() && i == shown { Keep::All } else { Keep::Nothing };
        let mut advance = || progress.advance();
        let case = validate::run(&model, trajectory, &options, (args.horizon, keep), &mut advance);
        let case = name_file(case, trajectory.path())?;
        progress.say(|| format!("{}/{total} {}", i + 1, line(&case)));
        progress.note(trajectory.path(), &case.outside);
        cases.push(case);
    }
    progress.finish();

    for summary in validate::summaries(&cases) {
        summary.tables().iter().for_each(|t| println!("{t}"));
        println!("  {}\n", summary.line());
    }
    crate::write_json(args.json.as_deref(), &validate::json(&cases))?;
    if let Some(folder) = &args.vtu {
        validate::write_series(folder, &cases[shown])?;
    }
    let diverged = cases.iter().filter_map(|c| Some(format!("{}, {}", c.path.display(), c.diverged()?)));
    check_finite(&diverged.collect::<Vec<_>>(), total)
}

/// Fails where rollouts, of so many, became non-finite: each a file and why.
pub fn check_finite(diverged: &[String], of: usize) -> Result<()> {
    refuse_any(diverged.first(), Error::Numerical, |first| {
        format!("{} of {of} rollouts became non-finite; the first: {first}", diverged.len())
    })
}

/// The headline figures of the model on a trajectory, in a line.
fn line(case: &Case) -> String {
    let rows = case.rows();
    let figures = rows[0].figures[0];
    let mut text = format!(
        "{} ({}): RMSE-1 {}, RMSE-50 ({} s) {}, RMSE-all {}",
        case.path.file_name().unwrap_or_default().to_string_lossy(),
        case.split.name(),
        number(figures.rmse_1, 3),
        number(case.horizon, 3),
        number(figures.rmse_50, 3),
        number(figures.rmse_all, 3)
    );
    if let Some(gap) = rows[0].gap {
        text += &format!(", worst gap {gap:+.3} cells");
    }
    text
}

/// Steps done so far, and whether to stop.
pub struct Progress {
    bar: Option<indicatif::ProgressBar>,
    stop: &'static std::sync::atomic::AtomicU8,
}

impl Progress {
    /// Of so many steps.
    pub fn new(steps: usize) -> Result<Self> {
        Ok(Progress { bar: super::progress_bar(steps as u64, "steps"), stop: super::stop_flag()? })
    }

    /// One step more; fails after Ctrl-C.
    pub fn advance(&self) -> Result<()> {
        self.bar.iter().for_each(|b| b.inc(1));
        match self.stop.load(Ordering::Relaxed) {
            0 => Ok(()),
            _ => Err(Error::Interrupted("stopped; no figures were written".into())),
        }
    }

    /// A line where there is no bar.
    pub fn say(&self, line: impl Fn() -> String) {
        if self.bar.is_none() {
            println!("{}", line());
        }
    }

    /// Says in which respects a trajectory lies outside of what the model was trained on.
    pub fn note(&self, path: &Path, outside: &[String]) {
        let say = || {
            for what in outside {
                eprintln!("note: {}: {what}", path.display());
            }
        };
        match &self.bar {
            Some(bar) => bar.suspend(say),
            None => say(),
        }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.iter().for_each(|b| b.finish_and_clear());
        println!();
    }
}
