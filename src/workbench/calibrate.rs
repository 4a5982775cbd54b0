//! How the errors of a model's rollouts grow, measured on recorded data (`m4gn calibrate`); see [`m4gn_model::Calibration`].

use crate::validate::{Scene, fits, predicted, stepper};
use m4gn_base::{Error, Result};
use m4gn_data::Trajectory;
use m4gn_model::{Calibration, Model, RolloutErrors};
use m4gn_step::SessionOptions;

/// Errors of each predicted field in one rollout.
pub type Rollout = Vec<RolloutErrors>;

/// Rolls the model out over `strides` strides from frames all along the trajectory, at most `starts` of them, evenly apart. The first
/// stride of the trajectory is left out: what comes before a rollout is a stride of its own. `outside` as [`stepper`] has it; `progress` is called after each rollout,
/// and ends the run with an error of its own.
///
/// # Errors
/// [`Error::Input`] for a trajectory that is too short; as [`fits`] and [`Scene::session`].
pub fn rollouts(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    (strides, starts): (usize, usize),
    outside: &mut Vec<String>,
    progress: &mut dyn FnMut() -> Result<()>,
) -> Result<Vec<Rollout>> {
    let pace = fits(&model.spec, trajectory)?;
    let Some(last) = pace.steps.checked_sub(strides).filter(|last| *last > 0) else {
        return Err(Error::Input(format!(
            "{}: {} strides of the model, and rollouts of {strides} with a stride before them were asked for; ask for fewer",
            trajectory.path().display(),
            pace.steps
        )));
    };
    let scene = Scene::read(trajectory, &model.spec.fields, pace)?;
    let mut session = scene.session(model, options)?;
    let mut step = stepper(&mut session, trajectory, outside);
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
            found.iter_mut().for_each(|list| list.resize(steps, f64::INFINITY));
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
/// estimates, none where no rollout is as long; of other rollouts than it was made from, this is its true coverage.
pub fn covered(calibration: &Calibration, model: &Model, k: usize, rollouts: &[Rollout]) -> Vec<Option<f64>> {
    let name = &predicted(&model.spec.fields)[k].name;
    let factors = calibration.factors(name).unwrap_or(&[]).iter().enumerate();
    let share = |(i, factor): (usize, &f64)| {
        let ratios: Vec<f64> = rollouts.iter().filter_map(|r| r[k].growth(i)).collect();
        let within = ratios.iter().filter(|ratio| **ratio <= *factor).count();
        (!ratios.is_empty()).then(|| within as f64 / ratios.len() as f64)
    };
    factors.map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The calibration says three strides of U and of a field that the model does not predict; the rollouts have two.
    #[test]
    fn lengths_that_no_rollout_has_are_not_covered_or_not() {
        let spec = m4gn_samples::model::spec();
        let name = predicted(&spec.fields)[0].name.clone();
        let model = Model::random(spec, 1).unwrap();
        let growth = |field: String| m4gn_model::Growth { field, factors: vec![1.5, 1.5, 3.0] };
        let calibration =
            Calibration { growth: vec![growth("extra".into()), growth(name)], ..Calibration::default() };
        let errors = RolloutErrors { before: 1.0, after: vec![1.0, 2.0] };
        let found = covered(&calibration, &model, 0, &[vec![errors]]);
        assert_eq!(found, [Some(1.0), Some(0.0), None]);
    }
}
