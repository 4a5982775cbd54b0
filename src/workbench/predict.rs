//! A model's rollout from the first frame of a trajectory, as a trajectory, with its errors beside those of knowing nothing.

use crate::validate::{Pace, Scene, Values, fits, stepper};
use m4gn_base::Result;
use m4gn_base::digest::Digest;
use m4gn_data::{FieldMeta, Trajectory, WriteOptions, Writer};
use m4gn_model::Model;
use m4gn_report::{Table, number};
use m4gn_step::SessionOptions;
use serde_json::{Value, json};
use std::path::Path;

/// Rows of the errors.
const ROWS: [&str; 3] = ["model", "persistence", "hold first"];

/// Errors of a field, root mean squares over the nodes.
#[derive(Clone, Debug)]
pub struct FieldErrors {
    /// Name and unit.
    pub name: String,
    /// Step by step, as far as the truth is recorded: of the model, of the recorded frame one stride before, of the first frame.
    pub rows: [Vec<f64>; 3],
}

/// What a rollout gave.
#[derive(Clone, Debug)]
pub struct Predicted {
    /// Steps that were taken.
    pub steps: usize,
    /// Errors of each predicted field.
    pub fields: Vec<FieldErrors>,
    /// Why the rollout ended early.
    pub diverged: Option<String>,
    /// In which respects the first frame lies outside of what the model was trained on, for people.
    pub outside: Vec<String>,
}

/// Rolls the model out from the first frame and writes the states to `out`, a stride apart. More `steps` than are recorded go on with
/// what is prescribed in the last frame; none: as many as are recorded. `progress` is called after each step. Of what an earlier call with the
/// same arguments has written there the errors are measured, and it stays.
///
/// # Errors
/// As [`fits`], [`Scene::session`] and [`Writer`]; those of `progress`. Nothing is written then. A rollout that becomes
/// non-finite is no error but noted, and what came before is written.
pub fn run(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    (steps, out): (Option<usize>, &Path),
    progress: &mut dyn FnMut() -> Result<()>,
) -> Result<Predicted> {
    let pace = fits(&model.spec, trajectory)?;
    let scene = Scene::read(trajectory, &model.spec.fields, pace)?;
    let all = steps.unwrap_or(pace.steps);
    let names = scene.fields().filter(|f| !f.is_given());
    let errors = |f: &m4gn_model::FieldSpec| FieldErrors {
        name: format!("{} ({})", f.name, f.unit()),
        rows: Default::default(),
    };
    let mut errors: Vec<FieldErrors> = names.map(errors).collect();
    let mut taken = 0;
    let mut measure = |i: usize, state: &[Values]| {
        for (k, field) in errors.iter_mut().enumerate().filter(|_| i < pace.steps) {
            let found = [&state[k].0[..], scene.truth(k, i), scene.truth(k, 0)];
            let add = |(row, found): (&mut Vec<f64>, &[f64])| row.push(scene.error(k, found, i + 1).rmse());
            field.rows.iter_mut().zip(found).for_each(add);
        }
        taken = i + 1;
        progress()
    };
    let made_from = made_from(model, trajectory, options, all)?;
    let is_same = |t: &Trajectory| t.provenance()["predicted"]["made_from"].as_str() == Some(&made_from[..]);
    let earlier = Trajectory::open(out).ok().filter(is_same);
    // One that became non-finite is shorter.
    if let Some(earlier) = earlier.as_ref().filter(|t| t.times().len() == all + 1) {
        let pace = Pace::new(earlier.times(), model.spec.stride)?;
        let kept = Scene::read(earlier, &model.spec.fields, pace)?;
        (0..all).try_for_each(|i| measure(i, &kept.state(i + 1)))?;
        return Ok(Predicted { steps: all, fields: errors, diverged: None, outside: Vec::new() });
    }
    let recorded = |name: &str| trajectory.fields().iter().any(|f| f.name == name);
    let kept: Vec<bool> = scene.fields().map(|f| recorded(&f.name)).collect();
    let fields = scene.fields().zip(&kept).filter(|f| *f.1).map(|(f, _)| FieldMeta {
        name: f.name.clone(),
        vector: f.vector,
        dimensions: f.dimensions,
    });
    let mut provenance = trajectory.provenance().clone();
    let from = trajectory.path().file_name().map(|n| n.to_string_lossy());
    provenance["predicted"] = json!({ "from": from, "stride": model.spec.stride, "made_from": made_from });
    let write = WriteOptions {
        fields: fields.collect(),
        provenance,
        split: trajectory.split(),
        overwrite: earlier.is_some(),
    };
    let mut writer = Writer::create_copy(out, trajectory.mesh(), &write)?;
    writer.set_triangles(trajectory.triangles())?;
    let mut append = |state: &[_], frame: usize| {
        let values = scene.frame(state, frame).into_iter().zip(&kept).filter(|v| *v.1).map(|v| v.0);
        let motion: Vec<[f32; 3]> = scene.motion(frame).iter().map(|u| u.map(|x| x as f32)).collect();
        let time = trajectory.times()[0] + frame as f64 * model.spec.stride;
        writer.append_moved(time, &values.collect::<Vec<_>>(), &motion)
    };
    append(&scene.state(0), 0)?;
    let mut outside = Vec::new();
    let mut session = scene.session(model, options)?;
    let mut step = stepper(&mut session, trajectory, &mut outside);
    let diverged = scene.roll((0, all), &mut step, &mut (0.0, 0), &mut |i, state| {
        append(state, i + 1)?;
        measure(i, state)
    })?;
    drop(step);
    writer.finish()?;
    Ok(Predicted { steps: taken, fields: errors, diverged, outside })
}

/// Tells a prediction from those of another model, of other data, in another way, or over other steps.
fn made_from(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    steps: usize,
) -> Result<String> {
    let mut digest = Digest::default();
    digest.add("model", &model.to_bytes()?);
    digest.add_file("data", trajectory.path())?;
    let way = SessionOptions { n_threads: 1, ..options.clone() };
    digest.add("way", format!("{way:?} {steps}").as_bytes());
    Ok(digest.text())
}

impl Predicted {
    /// Errors after the first step, over all steps whose truth is recorded, and after the last of them.
    pub fn table(&self) -> Table {
        let n = self.fields.first().map_or(0, |f| f.rows[0].len());
        let mut table =
            Table::new(["RMSE".to_string(), "step 1".into(), format!("steps 1 to {n}"), format!("step {n}")]);
        for field in self.fields.iter().filter(|_| n > 0) {
            for (name, row) in ROWS.iter().zip(&field.rows) {
                let mean = (row.iter().map(|e| e * e).sum::<f64>() / n as f64).sqrt();
                let figures = [row[0], mean, row[n - 1]].map(|e| number(e, 3));
                table.row([format!("{}, {name}", field.name)].into_iter().chain(figures));
            }
        }
        table
    }

    /// The errors, step by step.
    pub fn json(&self) -> Value {
        let field = |f: &FieldErrors| json!({ "field": f.name, "model": f.rows[0], "persistence": f.rows[1], "hold_first": f.rows[2] });
        json!({
            "steps": self.steps,
            "diverged": self.diverged,
            "rmse": self.fields.iter().map(field).collect::<Vec<_>>(),
        })
    }
}
