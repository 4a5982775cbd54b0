//! How the errors of a model's rollouts grow, measured on recorded data (`m4gn calibrate`); see [`m4gn_model::Calibration`].

use crate::validate::{Scene, fits, predicted, stepper};
use m4gn_data::Trajectory;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::{Calibration, Model, RolloutErrors};
use m4gn_step::{Session, SessionOptions};

/// Errors of each predicted field in one rollout.
pub type Rollout = Vec<RolloutErrors>;

/// Rolls the model out over `strides` strides from frames all along the trajectory, at most `starts` of them, evenly apart. The first
/// stride of the trajectory is left out: what comes before a rollout is a stride of its own. `progress` is called after each rollout,
/// and ends the run with an error of its own.
///
/// # Errors
/// [`Error::Input`] for a trajectory that is too short; as [`fits`] and [`Session::new`].
pub fn rollouts(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    (strides, starts): (usize, usize),
    progress: &mut dyn FnMut() -> Result<()>,
) -> Result<Vec<Rollout>> {
    let pace = fits(model, trajectory)?;
    let Some(last) = pace.steps.checked_sub(strides).filter(|last| *last > 0) else {
        return Err(Error::Input(format!(
            "{}: {} strides of the model, and rollouts of {strides} with a stride before them were asked for; ask for fewer",
            trajectory.path().display(),
            pace.steps
        )));
    };
    let scene = Scene::read(trajectory, &model.spec.fields, pace)?;
    let mut session = Session::new(Comm::serial(), trajectory.mesh(), model, options)?;
    let mut step = stepper(&mut session, trajectory);
    let fields = predicted(&model.spec.fields).len();
    let count = starts.min(last);
    let mut all = Vec::with_capacity(count);
    for i in 0..count {
        // From 1 to the last one
        let start = 1 + i * (last - 1) / (count - 1).max(1);
        let mut errors = |first: usize, steps: usize| -> Result<Vec<Vec<f64>>> {
            let mut found = vec![Vec::with_capacity(steps); fields];
            scene.roll((first, steps), &mut step, &mut (0.0, 0), &mut |at, state| {
                for (k, list) in found.iter_mut().enumerate() {
                    list.push(scene.error(k, &state[k].0, at + 1).rmse());
                }
                Ok(())
            })?;
            // After a state that is not finite
            found
                .iter_mut()
                .for_each(|list| list.resize(steps, f64::INFINITY));
            Ok(found)
        };
        let before = errors(start - 1, 1)?;
        let after = errors(start, strides)?;
        let pairs = before.into_iter().zip(after);
        let errors = |(b, after): (Vec<f64>, Vec<f64>)| RolloutErrors { before: b[0], after };
        all.push(pairs.map(errors).collect());
        progress()?;
    }
    Ok(all)
}

/// Whether a part of the change over the stride before may go on: of bodies, unless their model reads it itself.
pub fn carries(model: &Model) -> bool {
    model.spec.contact.is_some() && !model.spec.has_history()
}

/// Of a model of bodies whose calibration has no part that goes on yet, on one trajectory: what [`Calibration::best_carried`] takes.
///
/// # Errors
/// [`Error::Input`] for a trajectory without a body; as [`fits`] and [`Session::new`].
pub fn carried(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    progress: &mut dyn FnMut() -> Result<()>,
) -> Result<[f64; 3]> {
    let pace = fits(model, trajectory)?;
    let scene = Scene::read(trajectory, &model.spec.fields, pace)?;
    let shape = scene.shape().ok_or_else(|| {
        Error::Input(format!(
            "{}: a mesh without elements; expected a body",
            trajectory.path().display()
        ))
    })?;
    let mut session = Session::new(Comm::serial(), trajectory.mesh(), model, options)?;
    let mut step = stepper(&mut session, trajectory);
    let mut sums = [0.0; 3];
    for i in 1..pace.steps {
        let [before, now, after] = [i - 1, i, i + 1].map(|frame| scene.truth(0, frame));
        scene.roll((i, 1), &mut step, &mut (0.0, 0), &mut |_, state| {
            for k in shape.free.iter().flat_map(|&p| 3 * p..3 * p + 3) {
                let last = now[k] - before[k];
                let lacks = after[k] - now[k] - last;
                let differs = state[0].0[k] - now[k] - last;
                sums[0] += lacks * lacks;
                sums[1] += lacks * differs;
                sums[2] += differs * differs;
            }
            progress()
        })?;
    }
    Ok(sums)
}

/// Of the rollouts on all trajectories.
///
/// # Errors
/// As [`Calibration::new`].
pub fn calibration(model: &Model, coverage: f64, trajectories: &[Vec<Rollout>]) -> Result<Calibration> {
    let names = predicted(&model.spec.fields).into_iter().enumerate();
    let of = |k: usize| {
        let groups = trajectories.iter();
        groups.map(move |group| group.iter().map(|r| r[k].clone()).collect())
    };
    let fields = names.map(|(k, field)| (field.name.clone(), of(k).collect()));
    Calibration::new(coverage, fields.collect())
}

/// Share of the rollouts whose error of predicted field `k` after each number of strides is not larger than the calibration
/// estimates; of other rollouts than it was made from, this is its true coverage.
pub fn covered(calibration: &Calibration, model: &Model, k: usize, rollouts: &[Rollout]) -> Vec<f64> {
    let name = &predicted(&model.spec.fields)[k].name;
    let factors = calibration.factors(name).unwrap_or(&[]).iter().enumerate();
    let share = |(i, factor): (usize, &f64)| {
        let within = |r: &&Rollout| r[k].growth(i).is_some_and(|ratio| ratio <= *factor);
        rollouts.iter().filter(within).count() as f64 / rollouts.len().max(1) as f64
    };
    factors.map(share).collect()
}
