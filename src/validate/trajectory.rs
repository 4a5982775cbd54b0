//! A model on one recorded trajectory: single steps from every frame, and a rollout from the first.

use super::rmse::SquaredError;
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
    /// Speed at chosen steps: recorded and predicted `[cells]`, m/s.
    pub snapshots: Vec<(f64, Vec<f64>, Vec<f64>, Vec<f64>)>,
}

/// How the frames of a trajectory and the model's stride fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Time between frames, s.
    pub interval: f64,
    /// Frames a step.
    pub frames: usize,
    /// Steps that fit.
    pub steps: usize,
}

impl Pace {
    /// Of equidistant `times` and a model's `stride`, s.
    ///
    /// # Errors
    /// [`Error::Model`] when the times are not equidistant, the stride is no multiple of their interval, or there is
    /// not one step.
    pub fn new(times: &[f64], stride: f64) -> Result<Self> {
        let [first, .., last] = *times else {
            return Err(Error::Model(format!(
                "a step needs two frames, found {}",
                times.len()
            )));
        };
        let interval = (last - first) / (times.len() - 1) as f64;
        // Times are written with some digits only.
        let slack = 1e-3 * interval;
        if let Some(i) = times
            .windows(2)
            .position(|w| (w[1] - w[0] - interval).abs() > slack)
        {
            return Err(Error::Model(format!(
                "expected frames at equal intervals of {interval} s, found {} s and {} s one after the other",
                times[i],
                times[i + 1]
            )));
        }
        let frames = (stride / interval).round();
        if frames < 1.0 || (frames * interval - stride).abs() > slack * frames {
            return Err(Error::Model(format!(
                "the model steps {stride} s and the frames are {interval} s apart: the stride must be a multiple of the interval"
            )));
        }
        let frames = frames as usize;
        match (times.len() - 1) / frames {
            0 => Err(Error::Model(format!(
                "the model steps {stride} s, and the {} frames cover {} s only",
                times.len(),
                last - first
            ))),
            steps => Ok(Pace {
                interval,
                frames,
                steps,
            }),
        }
    }

    /// Steps that end within `time` from the first frame, s; at least one.
    pub fn steps_within(&self, time: f64) -> usize {
        let stride = self.interval * self.frames as f64;
        // Rounding must not cost a step.
        ((time / stride + 1e-3) as usize).max(1)
    }
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
            errors.snapshots.push((
                errors.times[i],
                speeds(&truth[i + 1]),
                speeds(&now),
                speeds(&difference),
            ));
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
    fn strides_and_frames() {
        let times: Vec<f64> = (0..11).map(|i| 1.0 + 0.01 * i as f64).collect();
        let pace = Pace::new(&times, 0.05).unwrap();
        assert_eq!((pace.frames, pace.steps), (5, 2));
        assert!((pace.interval - 0.01).abs() < 1e-12);
        assert_eq!(
            (
                pace.steps_within(0.15),
                pace.steps_within(0.149),
                pace.steps_within(0.01)
            ),
            (3, 2, 1)
        );
        let refused = |times: &[f64], stride: f64| Pace::new(times, stride).unwrap_err().to_string();
        assert!(refused(&times, 0.015).contains("multiple of the interval"));
        assert!(refused(&times, 0.004).contains("multiple of the interval"));
        assert!(refused(&times, 0.2).contains("cover"));
        assert!(refused(&[0.0], 0.1).contains("two frames"));
        assert!(refused(&[0.0, 0.1, 0.3], 0.1).contains("equal intervals"));
    }

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
