//! A recorded trajectory as predictions are scored on it: single steps from every frame, and rollouts from the first.

use super::prediction::{FieldErrors, Keep, Prediction};
use super::{pace::Pace, shape::Shape};
use crate::phase::Orbit;
use m4gn_base::{Error, Result};
use m4gn_data::{Frame, Trajectory};
use m4gn_domain::Boundary;
use m4gn_domain::body::quality::Quality;
use m4gn_mesh::Mesh;
use m4gn_mesh::vector::Vector;
use m4gn_model::{FieldSpec, Level, Model, Output};
use m4gn_parallel::Comm;
use m4gn_step::{Field, FieldMut, Session, SessionOptions};
use m4gn_train::errors::SquaredError;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Instant;

/// What a step is given beside the fields.
#[derive(Clone, Copy)]
pub struct StepContext<'a> {
    /// Displacement of the obstacle's points at the start and at the end of the step, m; empty without obstacle.
    pub motion: [&'a [Vector]; 2],
    /// Whether the step starts from a recorded frame, and not from the result of the last one.
    pub recorded: bool,
}

/// Takes all fields one stride on, from the first into the second.
pub type Step<'a> = dyn FnMut(&[Field], &mut [FieldMut], StepContext) -> Result<()> + 'a;

/// Values of a field: rows of 1 or 3 at the nodes, and at the boundary faces.
pub type Values = (Vec<f64>, Vec<f64>);

/// A field of the model on the trajectory.
pub(super) struct Track {
    spec: FieldSpec,
    /// Values a row as a session takes them: 3 or 1.
    width: usize,
    /// Recorded frames at the stride, rows of `width`: nodes, and boundary faces.
    recorded: Vec<Values>,
    boundary: Boundary,
    /// Nodes whose values are not prescribed; none where all are such.
    free: Option<Vec<usize>>,
}

/// A trajectory's recorded frames at a stride.
pub struct Scene<'a> {
    mesh: &'a Mesh,
    /// How the frames and the stride fit.
    pub(super) pace: Pace,
    /// The predicted fields, the headline first.
    pub(super) tracks: Vec<Track>,
    /// Fields that the model reads and does not predict: in a rollout they are as recorded.
    given: Vec<Track>,
    /// Displacement of the obstacle's points, m; empty without obstacle.
    motion: Vec<Vec<Vector>>,
    /// Where the level of a predicted pressure is read, which its flow does not know: recorded frames are without it, and so are predicted ones.
    level: Level,
    shape: Option<Shape<'a>>,
    /// The cycle that the recorded frames of the headline field end in, where they do; found when it is asked for.
    orbit: OnceLock<Option<Orbit>>,
}

/// The predicted fields, the headline first: `U`, or else the first vector, or else the first one.
pub fn predicted(fields: &[FieldSpec]) -> Vec<&FieldSpec> {
    let mut found: Vec<&FieldSpec> = fields.iter().filter(|f| f.output != Output::None).collect();
    let headline = found.iter().position(|f| f.vector && f.name == "U");
    if let Some(i) = headline.or_else(|| found.iter().position(|f| f.vector)) {
        found[..=i].rotate_right(1);
    }
    found
}

impl<'a> Scene<'a> {
    /// Reads the frames of the model's fields.
    ///
    /// # Errors
    /// [`Error::File`] for a field that is not there, or frames that cannot be read.
    pub fn read(trajectory: &'a Trajectory, fields: &[FieldSpec], pace: Pace) -> Result<Self> {
        let mesh = trajectory.mesh();
        let track = |spec: &FieldSpec| {
            let frames = trajectory.read_frames(&spec.name, 0, pace.frames, pace.steps + 1)?;
            let mut boundary = Boundary::new(mesh, std::slice::from_ref(spec), mesh.dim());
            // On the scale that networks see, as a training looks at it.
            let seen = |values: &[f32]| -> Vec<f32> {
                values.iter().map(|&v| spec.seen(f64::from(v)) as f32).collect()
            };
            for frame in &frames {
                boundary.see_field(0, &seen(&frame.cells), &seen(&frame.boundary));
            }
            boundary.settle();
            let wide = |values: &[f32]| widen(values, spec.vector, &mesh.directions);
            let n = mesh.cell_global.len();
            let free: Vec<usize> = (0..n).filter(|&node| !boundary.is_held(node, 0)).collect();
            Ok(Track {
                free: (free.len() < n).then_some(free),
                spec: spec.clone(),
                width: if spec.vector { 3 } else { 1 },
                recorded: frames.iter().map(|f| (wide(&f.cells), wide(&f.boundary))).collect(),
                boundary,
            })
        };
        let motion = trajectory.read_motion(0, pace.frames, pace.steps + 1)?;
        let wide = |frame: Vec<[f32; 3]>| frame.into_iter().map(|u| u.map(f64::from)).collect();
        Ok(Scene {
            mesh,
            pace,
            tracks: predicted(fields).into_iter().map(track).collect::<Result<_>>()?,
            given: fields.iter().filter(|f| f.is_given()).map(track).collect::<Result<_>>()?,
            motion: motion.into_iter().map(wide).collect(),
            level: Level::new(mesh, &Comm::serial()),
            shape: Shape::new(trajectory),
            orbit: OnceLock::new(),
        })
    }

    /// A session of a model, which has seen the recorded states.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn session(&self, model: &Model, options: &SessionOptions) -> Result<Session> {
        let mut session = Session::new(Comm::serial(), self.mesh, model, options)?;
        for frame in 0..=self.pace.steps {
            let states = self.tracks.iter().map(|t| (t, at(&t.recorded, frame)));
            let fields = states.map(|(t, (cells, boundary))| Field {
                name: &t.spec.name,
                components: t.width,
                cells,
                boundary,
            });
            session.see(&fields.collect::<Vec<_>>());
        }
        Ok(session)
    }

    /// Names and the dimensions of all fields that are written of a state: those that are predicted, then those that are recorded and read.
    pub fn fields(&self) -> impl Iterator<Item = &FieldSpec> {
        self.tracks.iter().chain(&self.given).map(|t| &t.spec)
    }

    /// A state of the predicted fields at the end of step `frame` (0: the first frame), and what is given then, in the solved directions.
    pub fn frame(&self, state: &[Values], frame: usize) -> Vec<Frame> {
        let given = self.given.iter().map(|t| (t, at(&t.recorded, frame)));
        let narrow = |track: &Track, rows: &[f64]| -> Vec<f32> {
            let rows = rows.chunks_exact(track.width);
            match track.spec.vector {
                true => rows.flat_map(|r| self.mesh.directions.iter().map(|&d| r[d] as f32)).collect(),
                false => rows.map(|r| r[0] as f32).collect(),
            }
        };
        let all = self.tracks.iter().zip(state).chain(given);
        all.map(|(t, v)| Frame { cells: narrow(t, &v.0), boundary: narrow(t, &v.1) }).collect()
    }

    /// The recorded state of the predicted fields at the end of step `frame`.
    pub fn state(&self, frame: usize) -> Vec<Values> {
        self.tracks.iter().map(|t| at(&t.recorded, frame).clone()).collect()
    }

    /// Recorded values of predicted field `k` at the nodes at the end of step `frame`; 0: the first frame.
    pub fn truth(&self, k: usize, frame: usize) -> &[f64] {
        &self.tracks[k].recorded[frame].0
    }

    /// Displacement of the obstacle's points at the end of step `frame`, m.
    pub fn motion(&self, frame: usize) -> &[Vector] {
        at::<Vec<Vector>>(&self.motion, frame)
    }

    /// Error of predicted field `k` over the nodes that count and the solved components.
    pub fn error(&self, k: usize, found: &[f64], frame: usize) -> SquaredError {
        SquaredError::between(&self.that_count(k, found), &self.that_count(k, self.truth(k, frame)))
    }

    /// Values of predicted field `k` at the nodes that count, in the solved components.
    fn that_count(&self, k: usize, values: &[f64]) -> Vec<f64> {
        let track = &self.tracks[k];
        let components: &[usize] = if track.spec.vector { &self.mesh.directions } else { &[0] };
        let row = |p: usize| components.iter().map(move |&d| values[track.width * p + d]);
        match self.shape.as_ref().map_or(track.free.as_ref(), |s| Some(&s.free)) {
            Some(free) => free.iter().flat_map(|&p| row(p)).collect(),
            None => (0..values.len() / track.width).flat_map(row).collect(),
        }
    }

    /// By how much the recorded headline field varies behind its start-up: root mean square over the second half of the steps of what differs
    /// from the mean over them, over that of the field; 0 of a field that is 0.
    pub(super) fn variation(&self) -> f64 {
        // Of a single step as well there are two frames
        let late =
            || (self.pace.steps / 2..=self.pace.steps).map(move |i| self.that_count(0, self.truth(0, i)));
        let (mut sums, mut squares, mut n) = (Vec::<f64>::new(), 0.0f64, 0.0f64);
        for field in late() {
            sums.resize(field.len(), 0.0);
            sums.iter_mut().zip(&field).for_each(|(s, v)| *s += v);
            squares += field.iter().map(|v| v * v).sum::<f64>();
            n += 1.0;
        }
        let apart = |field: Vec<f64>| field.iter().zip(&sums).map(|(v, s)| (v - s / n).powi(2)).sum::<f64>();
        if squares > 0.0 { (late().map(apart).sum::<f64>() / squares).sqrt() } else { 0.0 }
    }

    /// How far a state of the headline field is from the cycle that the recorded frames end in, at whatever phase: root mean square over
    /// the nodes that count. None: they end in none.
    pub(super) fn phase_free(&self, found: &[f64]) -> Option<f64> {
        let of_frames = || {
            let stride = self.pace.interval * self.pace.frames as f64;
            let times: Vec<f64> = (0..=self.pace.steps).map(|i| stride * i as f64).collect();
            Orbit::of_run(&times, &|i| self.that_count(0, self.truth(0, i)))
        };
        let orbit = self.orbit.get_or_init(of_frames).as_ref()?;
        Some(orbit.nearest(&self.that_count(0, found)).error)
    }

    /// RMSE of the headline field in `kept` states, by the step that they are behind, over the nodes of each segment (the data of the
    /// paper's Figure 6); of those of [`Keep::Shown`].
    pub(super) fn over_segments(
        &self,
        kept: &BTreeMap<usize, Vec<f64>>,
        node_segment: &[i32],
    ) -> BTreeMap<usize, Vec<f64>> {
        let Some(last) = node_segment.iter().max() else { return BTreeMap::new() };
        let of_step = |(&step, found): (&usize, &Vec<f64>)| {
            let mut sums = vec![SquaredError::default(); *last as usize + 1];
            let width = self.width(0);
            let rows = found.chunks_exact(width).zip(self.truth(0, step).chunks_exact(width));
            let counts = |node: &usize| !self.tracks[0].boundary.is_held(*node, 0);
            let nodes = node_segment.iter().zip(rows).enumerate().filter(|(node, _)| counts(node));
            for (_, (&segment, (found, truth))) in nodes {
                sums[segment as usize].add(match width {
                    3 => SquaredError::of_solved(found, truth, self.mesh.dim()),
                    _ => SquaredError::between(found, truth),
                });
            }
            (step, sums.iter().map(SquaredError::rmse).collect())
        };
        kept.iter().filter(|(step, _)| Keep::Shown.takes(**step, self.pace.steps)).map(of_step).collect()
    }

    /// Values a row of predicted field `k`.
    pub(super) fn width(&self, k: usize) -> usize {
        self.tracks[k].width
    }

    /// Weight of each node in sums over the domain: the volume of a cell, 1 of a body's point.
    pub(super) fn volumes(&self) -> Vec<f64> {
        let nodes = self.truth(0, 0).len() / self.width(0);
        match &self.shape {
            None if self.mesh.cell_volumes.len() == nodes => self.mesh.cell_volumes.clone(),
            _ => vec![1.0; nodes],
        }
    }

    pub(super) fn quality(&self, found: &[f64], frame: usize) -> Result<Option<Quality>> {
        let shape = self.shape.as_ref();
        shape.map(|s| s.quality(self.truth(0, frame), found)).transpose()
    }

    fn gap(&self, found: &[f64], frame: usize) -> Result<Option<f64>> {
        let Some(shape) = &self.shape else { return Ok(None) };
        Ok(shape.gap(found, &self.motion[frame])?.map(|g| g.cells))
    }

    /// Smallest gap of the data at the steps' ends, mean edges; empty where nothing may touch.
    ///
    /// # Errors
    /// When the obstacle is no closed surface.
    pub fn data_gap(&self) -> Result<Vec<f64>> {
        let gap = |frame| self.gap(self.truth(0, frame), frame).transpose();
        (1..=self.pace.steps).filter_map(gap).collect()
    }

    /// Scores what `step`, a model's, predicts. `progress` is called after each step, and ends the run with an error of its own.
    ///
    /// # Errors
    /// When a single step fails. A rollout that becomes non-finite is no error but noted.
    pub fn predict(
        &self,
        keep: Keep,
        step: &mut Step,
        progress: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Prediction> {
        let steps = self.pace.steps;
        let mut p = Prediction {
            key: "model",
            name: "model",
            fields: vec![FieldErrors::default(); self.tracks.len()],
            quality: self.shape.as_ref().map(|_| Vec::new()),
            ..Prediction::default()
        };
        for i in 0..steps {
            let mut state = self.state(i);
            self.step(step, (i, true), &mut state, &mut p.seconds)?;
            for (k, errors) in p.fields.iter_mut().enumerate() {
                errors.single.push(self.error(k, &state[k].0, i + 1));
            }
            progress()?;
        }

        let mut largest = 0.0f64;
        let mut seconds = (0.0, 0);
        p.diverged = self.roll((0, steps), step, &mut seconds, &mut |i, state| {
            for (k, errors) in p.fields.iter_mut().enumerate() {
                errors.rollout.push(self.error(k, &state[k].0, i + 1));
            }
            let headline = &state[0].0;
            largest = largest.max(self.largest(headline));
            if let (Some(all), Some(quality)) = (&mut p.quality, self.quality(headline, i + 1)?) {
                all.push(quality);
            }
            p.gap.extend(self.gap(headline, i + 1)?);
            if i + 1 == steps {
                p.phase_free = self.phase_free(headline);
            }
            if keep.takes(i + 1, steps) {
                p.states.insert(i + 1, headline.clone());
            }
            progress()
        })?;
        if p.diverged.is_some() {
            p.phase_free = self.phase_free(self.truth(0, steps)).map(|_| f64::INFINITY);
        }
        p.seconds.0 += seconds.0;
        p.seconds.1 += seconds.1;
        let recorded = (0..=steps).map(|i| self.largest(self.truth(0, i))).fold(0.0, f64::max);
        p.largest = match p.diverged {
            Some(_) => Some(f64::INFINITY),
            // A recording at rest makes no scale.
            None => (recorded > 0.0).then_some(largest / recorded),
        };
        Ok(p)
    }

    /// Rolls on over so many steps from the recorded state at the start of step `first`, and shows the state at the end of each
    /// step, with its number. What is prescribed stays as it is in the last recorded frame, where there are more steps than frames. Why the rollout ended early, where it became non-finite.
    ///
    /// # Errors
    /// When a step fails otherwise, and those of `visit`.
    pub fn roll(
        &self,
        (first, steps): (usize, usize),
        step: &mut Step,
        seconds: &mut (f64, usize),
        visit: &mut dyn FnMut(usize, &[Values]) -> Result<()>,
    ) -> Result<Option<String>> {
        let mut state = self.state(first);
        for i in first..first + steps {
            match self.step(step, (i, i == first), &mut state, seconds) {
                Ok(()) => {}
                Err(Error::Numerical(why)) => return Ok(Some(format!("step {}: {why}", i + 1))),
                Err(other) => return Err(other),
            }
            visit(i, &state)?;
        }
        Ok(None)
    }

    /// Largest value of the headline field, of a vector its length.
    fn largest(&self, values: &[f64]) -> f64 {
        let rows = values.chunks_exact(self.tracks[0].width);
        rows.map(|r| r.iter().map(|v| v * v).sum::<f64>().sqrt()).fold(0.0, f64::max)
    }

    /// Takes a state over step `i`, from its start to its end; whether it is the recorded one.
    fn step(
        &self,
        step: &mut Step,
        (i, recorded): (usize, bool),
        state: &mut [Values],
        seconds: &mut (f64, usize),
    ) -> Result<()> {
        let mut next: Vec<Vec<f64>> = state.iter().map(|s| s.0.clone()).collect();
        let given = self.given.iter().map(|t| (t, at(&t.recorded, i)));
        let states = self.tracks.iter().zip(&*state).chain(given);
        let fields: Vec<Field> = states
            .map(|(t, s)| Field { name: &t.spec.name, components: t.width, cells: &s.0, boundary: &s.1 })
            .collect();
        let places = self.tracks.iter().zip(&mut next);
        let mut out: Vec<FieldMut> =
            places.map(|(t, cells)| FieldMut { name: &t.spec.name, components: t.width, cells }).collect();
        let given = StepContext { motion: [self.motion(i), self.motion(i + 1)], recorded };
        let began = Instant::now();
        let done = step(&fields, &mut out, given);
        seconds.0 += began.elapsed().as_secs_f64();
        seconds.1 += 1;
        done?;
        for ((track, next), (nodes, boundary)) in self.tracks.iter().zip(next).zip(state) {
            *nodes = next;
            let (held, prescribed) = at(&track.recorded, i + 1);
            for (_, point) in track.boundary.held_points(0) {
                let row = point * track.width..(point + 1) * track.width;
                nodes[row.clone()].copy_from_slice(&held[row]);
            }
            track.boundary.impose(0, track.width, nodes, prescribed, boundary);
            if track.spec.has_level() {
                let level = self.level.of(nodes, boundary, &Comm::serial());
                nodes.iter_mut().chain(boundary).for_each(|p| *p -= level);
            }
        }
        Ok(())
    }
}

/// What is recorded at a frame; the last one where there are fewer.
fn at<T>(recorded: &[T], frame: usize) -> &T {
    &recorded[frame.min(recorded.len() - 1)]
}

/// Recorded values of a field at the nodes at one frame, rows as a session takes them.
///
/// # Errors
/// As [`Trajectory::read_frame`].
pub(super) fn recorded(trajectory: &Trajectory, field: &str, frame: usize) -> Result<Vec<f64>> {
    let vector = trajectory.field(field)?.vector;
    let values = trajectory.read_frame(field, frame)?.cells;
    Ok(widen(&values, vector, &trajectory.mesh().directions))
}

/// Components in the solved directions to rows of x, y, z.
fn widen(values: &[f32], vector: bool, directions: &[usize]) -> Vec<f64> {
    if !vector {
        return values.iter().map(|&v| f64::from(v)).collect();
    }
    let mut rows = vec![0.0; values.len() / directions.len() * 3];
    let pairs = rows.chunks_exact_mut(3).zip(values.chunks_exact(directions.len()));
    for (row, value) in pairs {
        let components = directions.iter().zip(value);
        components.for_each(|(&d, &v)| row[d] = f64::from(v));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_dimensional_vectors_become_rows_of_three() {
        let rows = widen(&[1.0, 2.0, 3.0, 4.0], true, &[0, 2]);
        assert_eq!(rows, [1.0, 0.0, 2.0, 3.0, 0.0, 4.0]);
    }

    #[test]
    fn the_headline_is_the_velocity_or_the_first_vector() {
        let mut fields = m4gn_samples::model::spec().fields;
        let names = |fields: &[FieldSpec]| -> Vec<String> {
            predicted(fields).iter().map(|f| f.name.clone()).collect()
        };
        fields.reverse();
        assert_eq!(names(&fields), ["U", "p"]);
        fields[1].output = Output::None;
        assert_eq!(names(&fields), ["p"]);
        fields[0].output = Output::None;
        assert!(names(&fields).is_empty());
    }
}
