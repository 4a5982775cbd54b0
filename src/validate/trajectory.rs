//! A model on one recorded trajectory: single steps from every frame, and a rollout from the first.

use super::{pace::Pace, rmse::SquaredError};
use crate::{
    Error, Result,
    dataset::{FieldMeta, Frame, Trajectory},
    model::{FieldSpec, Model, Output},
    parallel::Comm,
    step::{Field, FieldMut, Session, SessionOptions, copied_faces, impose_boundary},
};
use std::time::Instant;

/// Errors of the velocity over cells and solved components, step by step. Step i ends at frame `(i + 1) stride`.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// Of one step from the recorded frame before it.
    pub single: Vec<SquaredError>,
    /// Of the rollout from the first frame; shorter where it became non-finite.
    pub rollout: Vec<SquaredError>,
    /// Of the frame one stride before, held.
    pub persistence: Vec<SquaredError>,
    /// Of the first frame, held.
    pub hold_first: Vec<SquaredError>,
    /// Largest speed of the rollout over the largest recorded speed.
    pub speed_ratio: f64,
    /// Why the rollout ended early.
    pub diverged: Option<String>,
    /// Wall seconds of all steps, and their number.
    pub seconds: (f64, usize),
    /// Times of the steps' ends, from the first frame, s.
    pub times: Vec<f64>,
    /// The rollout at chosen steps, for pictures.
    pub snapshots: Vec<Snapshot>,
}

/// Speeds of the cells after a step of the rollout, m/s.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Time from the first frame, s.
    pub time: f64,
    /// |U| recorded.
    pub recorded: Vec<f64>,
    /// |U| predicted.
    pub predicted: Vec<f64>,
    /// |U predicted - U recorded|.
    pub difference: Vec<f64>,
}

/// Checks that the trajectory holds every field of the model as the model knows it.
pub fn check_fields(model: &Model, trajectory: &Trajectory) -> Result<()> {
    for spec in &model.spec.fields {
        let found = trajectory.fields().iter().find(|f| f.name == spec.name);
        let same = |f: &FieldMeta| f.vector == spec.vector && f.dimensions == spec.dimensions;
        let kind = |vector: bool| if vector { "vector" } else { "scalar" };
        match found {
            Some(f) if same(f) => {}
            Some(f) => {
                return Err(Error::Model(format!(
                    "field {}: the model knows a {} with dimensions {:?}, the data hold a {} with {:?}",
                    spec.name,
                    kind(spec.vector),
                    spec.dimensions,
                    kind(f.vector),
                    f.dimensions
                )));
            }
            None => {
                let names: Vec<&str> = trajectory.fields().iter().map(|f| f.name.as_str()).collect();
                return Err(Error::Model(format!(
                    "the model needs field {}, the data hold {}",
                    spec.name,
                    names.join(", ")
                )));
            }
        }
        if spec.input && spec.output == Output::None {
            return Err(Error::Model(format!(
                "the model reads {} and does not predict it: there is nothing to roll out with",
                spec.name
            )));
        }
    }
    Ok(())
}

/// The velocity among the predicted fields: `U`, or else the first vector.
pub fn velocity(model: &Model) -> Result<&FieldSpec> {
    let predicted = || {
        model
            .spec
            .fields
            .iter()
            .filter(|f| f.vector && f.output != Output::None)
    };
    predicted()
        .find(|f| f.name == "U")
        .or_else(|| predicted().next())
        .ok_or_else(|| {
            Error::Model("the model predicts no vector field, and errors are those of the velocity".into())
        })
}

/// A predicted field on one trajectory.
struct Track {
    spec: FieldSpec,
    /// Values a row as the session takes them: 3 or 1.
    width: usize,
    /// Recorded frames at the model's stride, rows of `width`.
    recorded: Vec<(Vec<f64>, Vec<f64>)>,
    /// Boundary faces that take their owner's value.
    copied: Vec<bool>,
    /// The state: cells and boundary faces.
    state: (Vec<f64>, Vec<f64>),
    /// Where the session writes.
    next: Vec<f64>,
}

impl Track {
    fn read(spec: &FieldSpec, trajectory: &Trajectory, pace: Pace) -> Result<Self> {
        let mesh = trajectory.mesh();
        let frames = trajectory.read_frames(&spec.name, 0, pace.frames, pace.steps + 1)?;
        let copied = copied_faces(
            mesh,
            spec.vector,
            frames.iter().map(|f| (&f.cells[..], &f.boundary[..])),
        );
        let recorded: Vec<_> = frames
            .into_iter()
            .map(|f| widen(f, spec.vector, &mesh.directions))
            .collect();
        if let Some(i) = recorded
            .iter()
            .position(|(c, b)| c.iter().chain(b).any(|v| !v.is_finite()))
        {
            let frame = i * pace.frames;
            return Err(Error::file(
                trajectory.path(),
                format!(
                    "{} holds values that are not finite in frame {frame}; record the trajectory again",
                    spec.name
                ),
            ));
        }
        let width = if spec.vector { 3 } else { 1 };
        Ok(Track {
            spec: spec.clone(),
            width,
            copied,
            state: recorded[0].clone(),
            next: recorded[0].0.clone(),
            recorded,
        })
    }

    fn field(&self) -> Field<'_> {
        Field {
            name: &self.spec.name,
            components: self.width,
            cells: &self.state.0,
            boundary: &self.state.1,
        }
    }
}

/// Components in the solved directions to rows of x, y, z.
fn widen(frame: Frame, vector: bool, directions: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let wide = |values: Vec<f32>| -> Vec<f64> {
        if !vector {
            return values.into_iter().map(f64::from).collect();
        }
        let mut rows = vec![0.0; values.len() / directions.len() * 3];
        for (row, value) in rows
            .chunks_exact_mut(3)
            .zip(values.chunks_exact(directions.len()))
        {
            directions
                .iter()
                .zip(value)
                .for_each(|(&d, &v)| row[d] = f64::from(v));
        }
        rows
    };
    (wide(frame.cells), wide(frame.boundary))
}

/// Runs the model on a trajectory; `progress` is called after each step, and ends the run with an error of its own.
pub fn run(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    snapshots: &[f64],
    mut progress: impl FnMut() -> Result<()>,
) -> Result<Errors> {
    check_fields(model, trajectory)?;
    let pace = Pace::new(trajectory.times(), model.spec.stride)?;
    let mesh = trajectory.mesh();
    let name = velocity(model)?.name.clone();
    let mut session = Session::new(Comm::serial(), mesh, model, options)?;
    let predicted = model.spec.fields.iter().filter(|f| f.output != Output::None);
    let mut tracks = predicted
        .map(|f| Track::read(f, trajectory, pace))
        .collect::<Result<Vec<_>>>()?;
    let u = tracks.iter().position(|t| t.spec.name == name).unwrap_or(0);
    let solved = |rows: &[f64]| -> Vec<f64> {
        rows.chunks_exact(3)
            .flat_map(|r| mesh.directions.iter().map(|&d| r[d]))
            .collect()
    };
    let truth: Vec<Vec<f64>> = tracks[u].recorded.iter().map(|r| solved(&r.0)).collect();
    let speed = |v: &[f64]| v.chunks_exact(mesh.dim()).map(norm).fold(0.0, f64::max);

    let mut errors = Errors::default();
    for i in 0..pace.steps {
        errors
            .times
            .push(trajectory.times()[(i + 1) * pace.frames] - trajectory.times()[0]);
        errors
            .persistence
            .push(SquaredError::between(&truth[i], &truth[i + 1]));
        errors
            .hold_first
            .push(SquaredError::between(&truth[0], &truth[i + 1]));
        tracks.iter_mut().for_each(|t| t.state.clone_from(&t.recorded[i]));
        step(&mut session, &mut tracks, &mut errors.seconds)?;
        errors
            .single
            .push(SquaredError::between(&solved(&tracks[u].next), &truth[i + 1]));
        progress()?;
    }

    tracks.iter_mut().for_each(|t| t.state.clone_from(&t.recorded[0]));
    let mut fastest = 0.0_f64;
    for i in 0..pace.steps {
        if let Err(e) = step(&mut session, &mut tracks, &mut errors.seconds) {
            match e {
                Error::Numerical(why) => errors.diverged = Some(format!("step {}: {why}", i + 1)),
                other => return Err(other),
            }
            break;
        }
        for t in &mut tracks {
            t.state.0.clone_from(&t.next);
            let prescribed = &t.recorded[i + 1].1;
            impose_boundary(mesh, t.width, &t.copied, &t.state.0, prescribed, &mut t.state.1);
        }
        let now = solved(&tracks[u].state.0);
        errors.rollout.push(SquaredError::between(&now, &truth[i + 1]));
        fastest = fastest.max(speed(&now));
        if snapshots
            .iter()
            .any(|s| ((s * pace.steps as f64).ceil() as usize).max(1) == i + 1)
        {
            let speeds = |v: &[f64]| v.chunks_exact(mesh.dim()).map(norm).collect();
            let difference: Vec<f64> = now.iter().zip(&truth[i + 1]).map(|(a, b)| a - b).collect();
            errors.snapshots.push(Snapshot {
                time: errors.times[i],
                recorded: speeds(&truth[i + 1]),
                predicted: speeds(&now),
                difference: speeds(&difference),
            });
        }
        progress()?;
    }
    let recorded = truth.iter().map(|v| speed(v)).fold(0.0, f64::max);
    errors.speed_ratio = if errors.diverged.is_some() {
        f64::INFINITY
    } else {
        fastest / recorded.max(f64::MIN_POSITIVE)
    };
    Ok(errors)
}

fn norm(u: &[f64]) -> f64 {
    u.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// One step from the tracks' states into their `next`.
fn step(session: &mut Session, tracks: &mut [Track], seconds: &mut (f64, usize)) -> Result<()> {
    let mut next: Vec<Vec<f64>> = tracks.iter_mut().map(|t| std::mem::take(&mut t.next)).collect();
    let began = Instant::now();
    let done = {
        // Fields that are predicted and not read are passed over by the session.
        let fields: Vec<Field> = tracks.iter().map(Track::field).collect();
        let places = tracks.iter().zip(&mut next);
        let mut out: Vec<FieldMut> = places
            .map(|(t, cells)| FieldMut {
                name: &t.spec.name,
                components: t.width,
                cells: &mut cells[..],
            })
            .collect();
        session.step(&fields, &mut out)
    };
    seconds.0 += began.elapsed().as_secs_f64();
    seconds.1 += 1;
    tracks.iter_mut().zip(next).for_each(|(t, n)| t.next = n);
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_dimensional_vectors_become_rows_of_three() {
        let frame = Frame {
            cells: vec![1.0, 2.0, 3.0, 4.0],
            boundary: vec![5.0, 6.0],
        };
        let (cells, boundary) = widen(frame, true, &[0, 2]);
        assert_eq!(
            (cells, boundary),
            (vec![1.0, 0.0, 2.0, 3.0, 0.0, 4.0], vec![5.0, 0.0, 6.0])
        );
    }
}
