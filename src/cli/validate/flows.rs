//! Models of flows against trajectories at cells.

use super::{Args, Progress};
use crate::{
    Error, Result,
    dataset::{Recorded, Split, Trajectory},
    model::Model,
    report::number,
    step::SessionOptions,
    validate::{self, Case, Pace},
};

/// Parts of the rollout after which a picture is kept.
const SNAPSHOTS: [f64; 3] = [0.1, 0.4, 1.0];

pub(super) fn run(args: &Args, model: &Model, options: &SessionOptions) -> Result<()> {
    for (given, option) in [
        (args.projection.is_some(), "--projection"),
        (args.self_contact, "--self-contact"),
        (args.vtu.is_some(), "--vtu"),
    ] {
        if given {
            return Err(Error::Input(format!(
                "{option}: the model is of a flow at cells; this is for models of bodies at points"
            )));
        }
    }
    let trajectories = args.trajectories(|recorded| match recorded {
        Recorded::Cells(trajectory) => {
            let pace = super::name_file(fits(model, &trajectory), trajectory.path())?;
            Ok((trajectory, pace))
        }
        Recorded::Points(t) => Err(Error::Model(format!(
            "the model is of fields at cells (a flow), and {} is of a body at points",
            t.path().display()
        ))),
    })?;
    let progress = Progress::new(trajectories.iter().map(|(_, p)| 2 * p.steps).sum())?;
    let mut cases: Vec<Case> = Vec::new();
    let field = validate::trajectory::velocity(model)?;
    let field = (field.name.clone(), field.unit());
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
        let errors = validate::trajectory::run(model, &trajectory, options, chosen, || progress.advance())?;
        let case = Case {
            field: field.clone(),
            path: trajectory.path().to_path_buf(),
            split: trajectory.split(),
            horizon: args.horizon.unwrap_or(validate::HORIZON as f64 * pace.interval),
            pace,
            errors,
        };
        progress.say(|| {
            let f = case.model();
            let name = case.path.file_name().unwrap_or_default().to_string_lossy();
            format!(
                "{}/{total} {name} ({}): RMSE-1 {}, RMSE-50 {}, RMSE-all {}",
                cases.len() + 1,
                case.split.name(),
                number(f.rmse_1, 3),
                number(f.rmse_50, 3),
                number(f.rmse_all, 3)
            )
        });
        cases.push(case);
    }
    progress.finish();

    for summary in validate::summaries(&cases) {
        println!("{}", summary.table());
        println!(
            "  {} trajectories, {} ms a step, largest speed {} of the largest recorded\n",
            summary.count,
            number(summary.step_ms, 3),
            number(summary.speed_ratio, 3)
        );
    }
    crate::cli::write_json(args.json.as_deref(), &validate::json(&cases))?;
    if let Some(path) = &args.html {
        validate::report(&args.model.display().to_string(), &model.spec, &cases)?.write(path)?;
    }
    let diverged = cases.iter();
    let diverged: Vec<_> = diverged
        .filter_map(|c| Some((c.path.as_path(), c.errors.diverged.as_deref()?)))
        .collect();
    super::finite(&diverged, total)
}

/// Whether the model can be run on the trajectory.
fn fits(model: &Model, trajectory: &Trajectory) -> Result<Pace> {
    validate::trajectory::check_fields(model, trajectory)?;
    validate::trajectory::velocity(model)?;
    Pace::new(trajectory.times(), model.spec.stride)
}
