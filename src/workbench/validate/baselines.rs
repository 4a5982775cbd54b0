//! Predictions that need no trained model, which every table of models is read against: a list, a function each.

use super::prediction::{FieldErrors, Prediction};
use super::scene::Scene;
use m4gn_base::Result;
use m4gn_dmd::{FitSettings, OnlineDmd, Settings, Storage};
use m4gn_parallel::Comm;
use m4gn_state::Array;
use m4gn_train::errors::SquaredError;
use std::borrow::Cow;

/// The row of a baseline on a scene.
type Baseline = fn(&Scene) -> Result<Prediction>;

/// All of them, in the order of the tables.
const BASELINES: [Baseline; 4] = [persistence, extrapolation, dmd, hold_first];

/// The rows of all baselines.
///
/// # Errors
/// What the mesh metrics fail with.
pub(super) fn all(scene: &Scene) -> Result<Vec<Prediction>> {
    BASELINES.iter().map(|baseline| baseline(scene)).collect()
}

/// What is predicted of field `k` at the end of step `i + 1`.
type State<'a> = &'a dyn Fn(usize, usize) -> Cow<'a, [f64]>;

/// A row from what single steps and the rollout predict.
fn row(
    scene: &Scene,
    (key, name): (&'static str, &'static str),
    single: State,
    rollout: State,
) -> Prediction {
    let errors = |k: usize, state: State| -> Vec<SquaredError> {
        let error = |i| scene.error(k, &state(k, i), i + 1);
        (0..scene.pace.steps).map(error).collect()
    };
    let fields = (0..scene.tracks.len())
        .map(|k| FieldErrors { single: errors(k, single), rollout: errors(k, rollout) });
    Prediction { key, name, fields: fields.collect(), ..Prediction::default() }
}

/// The recorded frame one stride before, held.
fn persistence(scene: &Scene) -> Result<Prediction> {
    let last = |k, i| Cow::Borrowed(scene.truth(k, i));
    Ok(row(scene, ("persistence", "persistence"), &last, &last))
}

/// The line through the two recorded frames before. There is none in the first step, which does not count.
fn extrapolation(scene: &Scene) -> Result<Prediction> {
    let line = |k: usize, i: usize| {
        let pairs = scene.truth(k, i).iter().zip(scene.truth(k, i.saturating_sub(1)));
        Cow::Owned(pairs.map(|(a, b)| 2.0 * a - b).collect())
    };
    let mut row = row(scene, ("extrapolation", "extrapolation"), &line, &line);
    for errors in row.fields.iter_mut().flat_map(|f| [&mut f.single, &mut f.rollout]) {
        errors.iter_mut().take(1).for_each(|first| *first = SquaredError::default());
    }
    Ok(row)
}

/// A surrogate that is fitted to the frames before (higher-order dynamic mode decomposition), a stride ahead; where they are too few for
/// a fit, the last one is held. A rollout from the first frame has no history to be fitted to.
fn dmd(scene: &Scene) -> Result<Prediction> {
    let pace = scene.pace;
    let stride = pace.interval * pace.frames as f64;
    // A trajectory has no jumps, whose first states a longer window would leave behind.
    let fit = FitSettings { min_snapshots: 24, ..FitSettings::default() };
    let every = fit.hold_out;
    let settings = Settings { interval: stride, storage: Storage::Single, fit, held: 0, rest: Vec::new() };
    let fields =
        (0..scene.tracks.len()).map(|k| Array::solved(&k.to_string(), scene.width(k), scene.volumes()));
    let mut fitted = OnlineDmd::new(&Comm::serial(), fields.collect(), settings)?;
    let mut errors = vec![FieldErrors::default(); scene.tracks.len()];
    for i in 0..pace.steps {
        let state: Vec<&[f64]> = (0..scene.tracks.len()).map(|k| scene.truth(k, i)).collect();
        fitted.offer(i as f64 * stride, stride, &state)?;
        if i % every == 0 {
            fitted.fit();
        }
        let next = fitted.predict(1.0);
        for (k, errors) in errors.iter_mut().enumerate() {
            let mut found = state[k].to_vec();
            if let Some(next) = &next {
                fitted.field(k, next, &mut found);
            }
            errors.single.push(scene.error(k, &found, i + 1));
        }
    }
    Ok(Prediction {
        key: "dmd",
        name: "dmd, fitted to the frames before",
        fields: errors,
        ..Prediction::default()
    })
}

/// The first frame; of single steps, which start anew each time, persistence.
fn hold_first(scene: &Scene) -> Result<Prediction> {
    let (last, first) = (|k, i| Cow::Borrowed(scene.truth(k, i)), |k, _| Cow::Borrowed(scene.truth(k, 0)));
    let quality = (1..=scene.pace.steps).map(|frame| scene.quality(scene.truth(0, 0), frame));
    Ok(Prediction {
        quality: quality.collect::<Result<Option<Vec<_>>>>()?,
        phase_free: scene.phase_free(scene.truth(0, 0)),
        ..row(scene, ("hold_first", "hold first"), &last, &first)
    })
}
