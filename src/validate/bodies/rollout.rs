//! A stepper on one recorded trajectory of a body: single steps from every frame, and rollouts from the first.

use crate::dataset::{PointType, SolidTrajectory};
use crate::solids::gap::Samples;
use crate::solids::holding::cell_size;
use crate::solids::projection::{Projection, ProjectionOptions};
use crate::solids::quality::{Comparison, Quality};
use crate::validate::{Pace, rmse::SquaredError};
use crate::{Error, Result};
use std::time::Instant;

type Vector = [f64; 3];

/// Takes the displacement `[N]` of a body, m, one stride on; the obstacle's `[Q]` is given before and after.
pub type Step<'a> = dyn FnMut(&mut [Vector], [&[Vector]; 2]) -> Result<()> + 'a;

/// What is done with a trajectory.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Its frames and the stride.
    pub pace: Pace,
    /// Whether there is a rollout without contact projection.
    pub plain: bool,
    /// Contact projection after each step, in a rollout of its own.
    pub projection: Option<ProjectionOptions>,
    /// Whether the rollouts are kept.
    pub keep: bool,
}

impl Plan {
    /// Steps of a trajectory: `progress` is called that often.
    pub fn steps(&self) -> usize {
        self.pace.steps * (1 + usize::from(self.plain) + usize::from(self.projection.is_some()))
    }
}

/// One way to predict, step by step. Step i ends at frame `(i + 1) stride`.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Errors of one step from the recorded frame before it.
    pub single: Vec<SquaredError>,
    /// Errors of the rollout from the first frame; shorter where it became non-finite.
    pub rollout: Vec<SquaredError>,
    /// Mesh metrics of the rollout.
    pub quality: Vec<Quality>,
    /// Smallest gap to the obstacle in the rollout, mean edges; empty without obstacle.
    pub gap: Vec<f64>,
    /// Displacements of the rollout, where they are kept.
    pub kept: Vec<Vec<Vector>>,
    /// Why the rollout ended early.
    pub diverged: Option<String>,
}

/// What a trajectory gave. Errors are those of the displacement over free points and components, m.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// Times of the steps' ends, from the first frame, s.
    pub times: Vec<f64>,
    /// The stepper as it is.
    pub model: Option<Track>,
    /// The stepper with its contact projected after each step.
    pub projected: Option<Track>,
    /// The recorded frame one stride before, held.
    pub persistence: Vec<SquaredError>,
    /// The line through the two recorded frames before; through the first one alone at first.
    pub extrapolation: Vec<SquaredError>,
    /// The first frame, held.
    pub hold_first: Vec<SquaredError>,
    /// Mesh metrics of the first frame, held.
    pub hold_first_quality: Vec<Quality>,
    /// Smallest gap of the data at the steps' ends.
    pub gap: Vec<f64>,
    /// Wall seconds of all steps without projections, and their number.
    pub seconds: (f64, usize),
    /// Wall seconds of all projections, and their number.
    pub projecting: (f64, usize),
}

/// What does not change on the way.
struct Scene<'a> {
    trajectory: &'a SolidTrajectory,
    truth: Vec<Vec<Vector>>,
    /// Displacement of the obstacle.
    motion: Vec<Vec<Vector>>,
    free: Vec<usize>,
    samples: Samples,
    comparison: Comparison<'a>,
    cell: f64,
}

impl<'a> Scene<'a> {
    fn read(trajectory: &'a SolidTrajectory, pace: Pace) -> Result<Self> {
        let body = trajectory.body();
        let wide = |v: &[[f32; 3]]| -> Vec<Vector> { v.iter().map(|u| u.map(f64::from)).collect() };
        let frames = trajectory.read_frames(0, pace.frames, pace.steps + 1)?;
        let is_free = |p: &usize| body.types[*p] == PointType::Body;
        let scene = Scene {
            truth: frames.iter().map(|f| wide(&f.displacement)).collect(),
            motion: frames.iter().map(|f| wide(&f.obstacle)).collect(),
            free: (0..body.positions.len()).filter(is_free).collect(),
            samples: Samples::new(&body.elements, |p| !is_free(&(p as usize))),
            comparison: Comparison::new(&body.elements),
            cell: cell_size(&body.positions, &body.edges),
            trajectory,
        };
        let all = scene.truth.iter().chain(&scene.motion);
        if all.flatten().flatten().any(|v| !v.is_finite()) {
            return Err(Error::file(
                trajectory.path(),
                "holds displacements that are not finite; record the trajectory again",
            ));
        }
        Ok(scene)
    }

    fn error(&self, found: &[Vector], frame: usize) -> SquaredError {
        let free = |u: &[Vector]| -> Vec<f64> { self.free.iter().flat_map(|&p| u[p]).collect() };
        SquaredError::between(&free(found), &free(&self.truth[frame]))
    }

    fn places(&self, displacement: &[Vector]) -> Vec<Vector> {
        add(&self.trajectory.body().positions, displacement)
    }

    fn quality(&self, found: &[Vector], frame: usize) -> Result<Quality> {
        self.comparison
            .quality(&self.places(&self.truth[frame]), &self.places(found))
    }

    fn gap(&self, found: &[Vector], frame: usize) -> Result<Option<f64>> {
        let Some(o) = self.trajectory.obstacle() else {
            return Ok(None);
        };
        let place = add(&o.positions, &self.motion[frame]);
        let gap = self
            .samples
            .worst(&self.places(found), &place, &o.triangles, self.cell)?;
        Ok(gap.map(|g| g.cells))
    }

    /// One step from `u` at a frame.
    fn step(
        &self,
        step: &mut Step,
        u: &mut [Vector],
        frame: usize,
        seconds: &mut (f64, usize),
    ) -> Result<()> {
        let began = Instant::now();
        let done = step(u, [&self.motion[frame], &self.motion[frame + 1]]);
        seconds.0 += began.elapsed().as_secs_f64();
        seconds.1 += 1;
        done?;
        // What no solver would take on, a projection and a search tree need not either.
        match u.iter().position(|u| u.iter().any(|v| v.abs() > FARTHEST)) {
            Some(p) => Err(Error::Numerical(format!(
                "point {p} is displaced by {:?} m",
                u[p]
            ))),
            None => Ok(()),
        }
    }
}

/// A displacement beyond which a rollout counts as non-finite, m.
const FARTHEST: f64 = 1e6;

/// Runs `step` on a trajectory; `progress` is called after each step, and ends the run with an error of its own.
///
/// # Errors
/// When frames cannot be read, a single step fails, or the projection refuses the trajectory. A rollout that becomes
/// non-finite is no error but noted.
pub fn run(
    trajectory: &SolidTrajectory,
    plan: &Plan,
    step: &mut Step,
    mut progress: impl FnMut() -> Result<()>,
) -> Result<Errors> {
    let pace = plan.pace;
    let scene = Scene::read(trajectory, pace)?;
    let projection = plan.projection.as_ref().map(|options| {
        Projection::new(trajectory.body(), trajectory.obstacle(), options).map_err(|e| match e {
            Error::Mesh(why) => Error::file(trajectory.path(), why),
            other => other,
        })
    });
    let mut projection = projection.transpose()?;
    let mut errors = Errors {
        model: plan.plain.then(Track::default),
        projected: projection.is_some().then(Track::default),
        ..Errors::default()
    };
    let project = |p: &mut Projection, u: &mut Vec<Vector>, frame: usize, time: &mut (f64, usize)| {
        let began = Instant::now();
        let done = p.apply(u, &scene.motion[frame]);
        time.0 += began.elapsed().as_secs_f64();
        time.1 += 1;
        done
    };

    for i in 0..pace.steps {
        let end = i + 1;
        let times = trajectory.times();
        errors.times.push(times[end * pace.frames] - times[0]);
        let truth = &scene.truth;
        errors.persistence.push(scene.error(&truth[i], end));
        errors.hold_first.push(scene.error(&truth[0], end));
        errors.hold_first_quality.push(scene.quality(&truth[0], end)?);
        let line = |(a, b): (&Vector, &Vector)| std::array::from_fn(|k| 2.0 * a[k] - b[k]);
        let line: Vec<Vector> = truth[i]
            .iter()
            .zip(&truth[i.saturating_sub(1)])
            .map(line)
            .collect();
        errors.extrapolation.push(scene.error(&line, end));
        errors.gap.extend(scene.gap(&truth[end], end)?);

        let mut u = truth[i].clone();
        scene.step(step, &mut u, i, &mut errors.seconds)?;
        if let Some(track) = &mut errors.model {
            track.single.push(scene.error(&u, end));
        }
        if let (Some(track), Some(p)) = (&mut errors.projected, &mut projection) {
            project(p, &mut u, end, &mut errors.projecting)?;
            track.single.push(scene.error(&u, end));
        }
        progress()?;
    }

    let tracks = [(&mut errors.model, false), (&mut errors.projected, true)];
    for (track, projected) in tracks {
        let Some(track) = track else { continue };
        let mut u = scene.truth[0].clone();
        for i in 0..pace.steps {
            let mut done = scene.step(step, &mut u, i, &mut errors.seconds);
            if let Some(p) = projection.as_mut().filter(|_| projected && done.is_ok()) {
                done = project(p, &mut u, i + 1, &mut errors.projecting).map(|_| ());
            }
            match done {
                Ok(()) => {}
                Err(Error::Numerical(why)) => {
                    track.diverged = Some(format!("step {}: {why}", i + 1));
                    break;
                }
                Err(other) => return Err(other),
            }
            track.rollout.push(scene.error(&u, i + 1));
            track.quality.push(scene.quality(&u, i + 1)?);
            track.gap.extend(scene.gap(&u, i + 1)?);
            if plan.keep {
                track.kept.push(u.clone());
            }
            progress()?;
        }
    }
    Ok(errors)
}

fn add(a: &[Vector], b: &[Vector]) -> Vec<Vector> {
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| std::array::from_fn(|i| a[i] + b[i])).collect()
}
