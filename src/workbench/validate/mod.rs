//! Checks of trained models against recorded data, of flows at cells and of bodies at points alike.
//!
//! Errors are the paper's (Table 1): root mean squares of each predicted field over nodes and solved components, over the
//! steps up to a horizon, averaged over trajectories. Boundary values, held points and the obstacle's motion are prescribed
//! and do not count. The headline is the velocity `U`, or else the first predicted vector, or else the first field.
//!
//! - RMSE-1: one step of the model's stride, from every frame that is a multiple of the stride.
//! - RMSE-50: the rollout from the first frame, over the steps within its first 50 recorded frames ([`Pace::rmse_50`]),
//!   or a time given; it is printed with its time.
//! - RMSE-all: the same over the whole trajectory.
//!
//! Beside the model stand predictions that know nothing (`baselines`). Of a domain with elements there are mesh
//! metrics as well ([`m4gn_domain::body::quality`], means over the steps of the rollout) and, where an obstacle may touch it, gaps
//! (the smallest of all steps, in mean edges).

mod baselines;
pub mod pace;
mod prediction;
mod scene;
mod series;
mod shape;
mod summary;

pub use pace::Pace;
pub use prediction::{FieldErrors, Keep, Prediction};
pub use scene::{Scene, Step, StepContext, Values, predicted};
pub use series::write as write_series;
pub use summary::{Row, Summary, headline, json, summaries};

use m4gn_base::{Error, Result, listed};
use m4gn_data::{Split, Trajectory, list};
use m4gn_domain::Kind;
use m4gn_model::{FieldSpec, Model, ModelSpec};
use m4gn_step::{Field, FieldMut, Session, SessionOptions};
use m4gn_structure::diameter;
use std::path::{Path, PathBuf};

pub use m4gn_train::HORIZON;
pub use m4gn_train::errors::Figures;

/// Steps of a trajectory: the progress of [`run`] is called that often.
pub fn steps(pace: Pace) -> usize {
    2 * pace.steps
}

/// What a trajectory gave.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its file.
    pub path: PathBuf,
    /// What it is for.
    pub split: Split,
    /// Hops between the nodes of its mesh that are farthest apart.
    pub diameter: usize,
    /// Its frames and the model's stride.
    pub pace: Pace,
    /// Time that RMSE-50 covers, s from the first frame.
    pub horizon: f64,
    /// Names and units of the predicted fields, the headline first.
    pub fields: Vec<(String, String)>,
    /// Times of the steps' ends, from the first frame, s.
    pub times: Vec<f64>,
    /// The model's, then the predictions that know nothing.
    pub predictions: Vec<Prediction>,
    /// By how much the data vary in the second half of the steps, over their root mean square.
    pub variation: f64,
    /// Smallest gap of the data at the steps' ends, mean edges; empty where nothing may touch.
    pub data_gap: Vec<f64>,
    /// Processor time of the solver that made the data, s a frame, where it was recorded.
    pub solver: Option<f64>,
    /// Segment of each node, of the model's session; empty for networks without segments.
    pub node_segment: Vec<i32>,
    /// In which respects mesh and recorded states lie outside of what the model was trained on, for people.
    pub outside: Vec<String>,
}

impl Case {
    /// What a model's `prediction` on a scene gave, with those that know nothing.
    fn of(
        trajectory: &Trajectory,
        scene: &Scene,
        fields: &[FieldSpec],
        horizon: Option<f64>,
        prediction: Prediction,
    ) -> Result<Self> {
        let mut predictions = vec![prediction];
        predictions.extend(baselines::all(scene)?);
        let pace = scene.pace;
        let names = predicted(fields).into_iter();
        Ok(Case {
            path: trajectory.path().to_path_buf(),
            split: trajectory.split(),
            diameter: diameter_of(trajectory),
            pace,
            // Of what was rolled out, and no more
            horizon: horizon.unwrap_or(pace.rmse_50()).min(pace.duration()),
            fields: names.map(|f| (f.name.clone(), f.unit())).collect(),
            times: times(trajectory.times(), pace),
            predictions,
            variation: scene.variation(),
            data_gap: scene.data_gap()?,
            solver: seconds_a_frame(trajectory),
            node_segment: Vec::new(),
            outside: Vec::new(),
        })
    }

    /// Why a rollout ended early.
    pub fn diverged(&self) -> Option<&str> {
        self.predictions.iter().find_map(|p| p.diverged.as_deref())
    }

    /// The rollout whose states were kept.
    pub fn rollout(&self) -> Option<&Prediction> {
        self.predictions.iter().find(|p| !p.states.is_empty())
    }
}

/// Of cells and their faces, or of points and the edges of their elements.
fn diameter_of(trajectory: &Trajectory) -> usize {
    let mesh = trajectory.mesh();
    match trajectory.body() {
        Some(body) => diameter(body.positions.len(), &body.edges),
        None => {
            let faces = mesh.face_owner.iter().zip(&mesh.face_neighbour);
            diameter(mesh.n_cells(), &faces.map(|(&a, &b)| [a, b]).collect::<Vec<_>>())
        }
    }
}

/// Whether the model can be rolled out on the trajectory.
///
/// # Errors
/// [`Error::Model`] for a model of another kind of domain, of other directions or node types, for fields that are not there or of another kind, and as
/// [`Pace::new`].
pub fn fits(model: &ModelSpec, trajectory: &Trajectory) -> Result<Pace> {
    let misfit = |message: String| Err(Error::Model(message));
    if let Err(kinds) = m4gn_domain::check_kind(model, trajectory.mesh()) {
        let [model, data] = kinds.map(Kind::name);
        return misfit(format!("the model is of {model}, the data are {data}"));
    }
    let dimensions = |d: [i32; 7]| format!("[{}]", d.map(|d| d.to_string()).join(" "));
    let kind = |vector: bool| if vector { "vector" } else { "scalar" };
    m4gn_domain::fits(trajectory.mesh(), model)?;
    for spec in &model.fields {
        let Ok(found) = trajectory.field(&spec.name) else {
            let names = listed(trajectory.fields().iter().map(|f| &f.name));
            return misfit(format!("the model needs field {}, the data hold {names}", spec.name));
        };
        if (found.vector, found.dimensions) != (spec.vector, spec.dimensions) {
            return misfit(format!(
                "field {}: the model knows a {} with dimensions {}, the data hold a {} with {}",
                spec.name,
                kind(spec.vector),
                dimensions(spec.dimensions),
                kind(found.vector),
                dimensions(found.dimensions)
            ));
        }
    }
    if predicted(&model.fields).is_empty() {
        return misfit("the model predicts no field".into());
    }
    Pace::new(trajectory.times(), model.stride)
}

/// The trajectories of a split (or of `all`), which fit the model. Those that are shorter than a step of it, as a run that was killed
/// leaves them, are left out, and `note` is told.
///
/// # Errors
/// When a file cannot be read or does not fit, and when there is none.
pub fn trajectories(
    data: &Path,
    split: &str,
    model: &ModelSpec,
    note: &mut dyn FnMut(String),
) -> Result<Vec<(Trajectory, Pace)>> {
    let (mut trajectories, mut short) = (Vec::new(), Vec::new());
    for path in list(data)? {
        let trajectory = Trajectory::open(&path)?;
        if split != "all" && split != trajectory.split().name() {
            continue;
        }
        // What is wrong with a single file is said.
        if path != data && Pace::is_short(trajectory.times(), model.stride) {
            short.push(path);
            continue;
        }
        let pace = name_file(fits(model, &trajectory), &path)?;
        trajectories.push((trajectory, pace));
    }
    let left_out = short.first().map(|first| {
        let (many, stride) = (short.len(), model.stride);
        format!("{many} shorter than a step of the model, {stride} s, the first of them {}", first.display())
    });
    if trajectories.is_empty() {
        let but = left_out.map_or(String::new(), |short| format!(" but {short}"));
        return Err(Error::file(data, format!("holds no trajectory of split {split}{but}")));
    }
    left_out.into_iter().for_each(|short| note(format!("note: trajectories left out: {short}")));
    Ok(trajectories)
}

/// The error of a model that does not fit, or of a mesh that no session can be made of, names the file.
///
/// # Errors
/// The error given.
pub fn name_file<T>(checked: Result<T>, path: &Path) -> Result<T> {
    checked.map_err(|e| match e {
        Error::Model(message) => {
            Error::Model(format!("the model does not fit {}: {message}", path.display()))
        }
        Error::Mesh(message) => Error::file(path, message),
        other => other,
    })
}

/// Rolls the model out on a trajectory. `progress` is called after each step, and ends the run with an
/// error of its own; `horizon` is the time that RMSE-50 covers, s.
///
/// # Errors
/// As [`fits`], [`Session::new`] and [`Scene::predict`].
pub fn run(
    model: &Model,
    trajectory: &Trajectory,
    options: &SessionOptions,
    (horizon, keep): (Option<f64>, Keep),
    progress: &mut dyn FnMut() -> Result<()>,
) -> Result<Case> {
    let pace = fits(&model.spec, trajectory)?;
    let scene = Scene::read(trajectory, &model.spec.fields, pace)?;
    let mut session = scene.session(model, options)?;
    let node_segment = session.cell_segment().to_vec();
    let seen = if keep == Keep::Nothing && !node_segment.is_empty() { Keep::Shown } else { keep };
    let mut outside = Vec::new();
    let mut prediction = {
        let mut step = stepper(&mut session, trajectory, &mut outside);
        scene.predict(seen, &mut step, progress)?
    };
    prediction.over_segments = scene.over_segments(&prediction.states, &node_segment);
    if keep == Keep::Nothing {
        prediction.states.clear();
    }
    let case = Case::of(trajectory, &scene, &model.spec.fields, horizon, prediction)?;
    Ok(Case { node_segment, outside, ..case })
}

/// Steps of a session on a trajectory; `outside`: in which respects the states that they start from lie outside of what the model was
/// trained on, those of the state with the most of them.
pub fn stepper<'a>(
    session: &'a mut Session,
    trajectory: &Trajectory,
    outside: &'a mut Vec<String>,
) -> impl FnMut(&[Field], &mut [FieldMut], StepContext) -> Result<()> + 'a {
    let has_obstacle = trajectory.obstacle().is_some();
    move |fields, out, given| {
        if has_obstacle {
            session.set_obstacle(given.motion[0], given.motion[1])?;
        }
        let done = session.step(fields, out);
        if given.recorded {
            let found = session.outside();
            if found.len() > outside.len() {
                *outside = found;
            }
        }
        done
    }
}

/// Times of the steps' ends, from the first frame, s.
fn times(recorded: &[f64], pace: Pace) -> Vec<f64> {
    let ends = recorded.iter().skip(pace.frames).step_by(pace.frames);
    ends.map(|t| t - recorded[0]).collect()
}

/// Processor time of the solver that made the data, s a frame, where it was recorded.
fn seconds_a_frame(trajectory: &Trajectory) -> Option<f64> {
    let seconds = trajectory.provenance()["cpu_seconds"].as_f64()?;
    let frames = trajectory.times().len().checked_sub(1).filter(|n| *n > 0)?;
    Some(seconds / frames as f64)
}

#[cfg(test)]
mod points_tests;
#[cfg(test)]
mod tests;
