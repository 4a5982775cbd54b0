//! Models of bodies against trajectories at points.

use super::{Args, Progress, Projecting};
use crate::{
    Error, Result,
    dataset::{Recorded, SolidTrajectory, Split},
    model::Model,
    parallel::Comm,
    report::number,
    solids::projection::ProjectionOptions,
    step::{BodySession, SessionOptions},
    validate::{
        Pace,
        bodies::{self, Case, Plan, rollout},
    },
};

pub(super) fn run(args: &Args, model: &Model, options: &SessionOptions) -> Result<()> {
    let choice = args.projection.unwrap_or(Projecting::Both);
    if args.self_contact && choice == Projecting::Off {
        return Err(Error::Input(
            "--self-contact is an option of the projection: leave out --projection off".into(),
        ));
    }
    let projection = (choice != Projecting::Off).then(|| ProjectionOptions {
        self_contact: args.self_contact,
        ..ProjectionOptions::default()
    });
    let trajectories = args.trajectories(|recorded| match recorded {
        Recorded::Points(trajectory) => {
            let pace = super::name_file(
                Pace::new(trajectory.times(), model.spec.stride),
                trajectory.path(),
            )?;
            Ok((trajectory, pace))
        }
        Recorded::Cells(t) => Err(Error::Model(format!(
            "the model is of bodies at points, and {} is of fields at cells (a flow)",
            t.path().display()
        ))),
    })?;
    // One trajectory is pictured: the first of the split that counts.
    let shown = trajectories.iter().position(|(t, _)| t.split() == Split::Test);
    let shown = shown.unwrap_or(0);
    let plan = |number: usize, pace: Pace| Plan {
        pace,
        plain: choice != Projecting::On,
        projection,
        keep: number == shown && (args.html.is_some() || args.vtu.is_some()),
    };
    let steps = trajectories.iter().enumerate();
    let progress = Progress::new(steps.map(|(i, (_, p))| plan(i, *p).steps()).sum())?;
    let total = trajectories.len();
    let mut cases: Vec<Case> = Vec::new();
    for (i, (trajectory, pace)) in trajectories.iter().enumerate() {
        let mut session = BodySession::new(
            Comm::serial(),
            model,
            trajectory.body(),
            trajectory.obstacle(),
            options,
        )?;
        let mut step = |u: &mut [[f64; 3]], obstacle: [&[[f64; 3]]; 2]| session.step(u, obstacle);
        let plan = plan(i, *pace);
        let errors = rollout::run(trajectory, &plan, &mut step, || progress.advance())?;
        let case = Case {
            path: trajectory.path().to_path_buf(),
            split: trajectory.split(),
            horizon: args
                .horizon
                .unwrap_or(bodies::HORIZON as f64 * pace.frames as f64 * pace.interval),
            pace: *pace,
            errors,
            solver: seconds_a_frame(trajectory),
        };
        progress.say(|| {
            let rows = case.rows();
            let row = &rows[0];
            let name = case.path.file_name().unwrap_or_default().to_string_lossy();
            let gaps: Vec<String> = rows
                .iter()
                .filter_map(|r| Some(format!("{} {:+.3}", r.name, r.gap?)))
                .collect();
            format!(
                "{}/{total} {name} ({}): RMSE-1 {}, RMSE-50 {}, RMSE-all {}, worst gap of {} cells",
                i + 1,
                case.split.name(),
                number(row.figures.rmse_1, 3),
                number(row.figures.rmse_50, 3),
                number(row.figures.rmse_all, 3),
                gaps.join(", ")
            )
        });
        cases.push(case);
    }
    progress.finish();

    for summary in bodies::summaries(&cases) {
        println!("{}", summary.table());
        println!("  {}\n", summary.line());
    }
    crate::cli::write_json(args.json.as_deref(), &bodies::json(&cases))?;
    if let Some(path) = &args.html {
        bodies::report(&args.model.display().to_string(), &model.spec, &cases)?.write(path)?;
    }
    if let Some(folder) = &args.vtu {
        bodies::write_series(folder, &cases[shown])?;
    }
    let diverged = cases.iter();
    let diverged: Vec<_> = diverged
        .filter_map(|c| Some((c.path.as_path(), c.diverged()?)))
        .collect();
    super::finite(&diverged, total)
}

/// Processor time of the solver that made the data, s a frame, where it was recorded.
fn seconds_a_frame(trajectory: &SolidTrajectory) -> Option<f64> {
    let seconds = trajectory.provenance()["cpu_seconds"].as_f64()?;
    let frames = trajectory.times().len().checked_sub(1).filter(|n| *n > 0)?;
    Some(seconds / frames as f64)
}
