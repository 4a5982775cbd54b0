//! The data set in memory, and the model description that follows from it.

use crate::bodies;
use crate::config::Config;
use crate::report::Report;
use crate::samples::{Sample, describe, frames_a_step};
use m4gn::dataset::{self, Recorded, Split, Trajectory};
use m4gn::mesh::NodeType;
use m4gn::model::ModelSpec;
use m4gn::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};
use tch::Device;

/// Trajectories to train on and to validate on.
pub struct Workload {
    /// Of split `train`.
    pub train: Vec<Sample>,
    /// The first of split `valid`; of `train` if there are none.
    pub valid: Vec<Sample>,
    /// Data frames in one model step.
    pub frames_a_step: usize,
    /// File name and number of frames of each trajectory; a resumed training must find the same.
    pub names: Vec<String>,
}

impl Workload {
    /// Reads all trajectories.
    pub fn load(
        folder: &Path,
        config: &Config,
        device: Device,
        report: &Report,
        stop: &AtomicU8,
    ) -> Result<(Self, ModelSpec)> {
        let paths = dataset::list(folder)?;
        let mut train: Vec<(PathBuf, Recorded)> = Vec::new();
        let mut valid = Vec::new();
        let mut types = Vec::new();
        for path in paths {
            let trajectory = Recorded::open(&path)?;
            types.extend(node_types(&trajectory));
            match trajectory.split() {
                Split::Train => train.push((path, trajectory)),
                Split::Valid if valid.len() < config.training.validation_rollouts => {
                    valid.push((path, trajectory))
                }
                _ => {}
            }
        }
        let Some((path, first)) = train.first() else {
            return Err(Error::file(
                folder,
                "no complete trajectory of split `train`: make some with `m4gn generate`",
            ));
        };
        let mut spec = match first {
            Recorded::Cells(first) => describe(config, first, path)?,
            Recorded::Points(_) => bodies::describe(config),
        };
        spec.node_types = NodeType::ALL.into_iter().filter(|t| types.contains(t)).collect();
        let frames = frames_a_step(first.times(), spec.stride, path)?;
        let needed = 1 + frames * config.training.longest_unroll();
        let mut names = Vec::new();
        for (path, trajectory) in train.iter().chain(&valid) {
            match trajectory {
                Recorded::Cells(t) => check(path, t, &spec)?,
                Recorded::Points(_) => check_points(path, &spec)?,
            }
            check_times(path, trajectory.times(), &spec, frames, needed)?;
            let name = path
                .file_name()
                .map(|n| n.to_string_lossy().into_owned())
                .unwrap_or_default();
            names.push(format!("{name} {}", trajectory.times().len()));
        }
        let total = train.len() + valid.len();
        report.begin_loading(total as u64);
        let read = |list: Vec<(PathBuf, Recorded)>| -> Result<Vec<Sample>> {
            list.into_iter()
                .map(|(path, trajectory)| {
                    if stop.load(Ordering::Relaxed) != 0 {
                        return Err(Error::Interrupted(
                            "interrupted while the data were read; nothing was written".into(),
                        ));
                    }
                    let sample = match &trajectory {
                        Recorded::Cells(t) => Sample::read(t, &path, &spec, device),
                        Recorded::Points(t) => bodies::read(t, &path, &spec, device),
                    };
                    report.loaded();
                    sample
                })
                .collect()
        };
        let train = read(train)?;
        let mut valid = read(valid)?;
        report.end();
        if valid.is_empty() {
            report.line("note: no trajectory of split `valid`: the best weights are chosen by errors on training trajectories");
            valid = train
                .iter()
                .take(config.training.validation_rollouts.max(1))
                .map(Sample::share)
                .collect();
        }
        Ok((
            Workload {
                train,
                valid,
                frames_a_step: frames,
                names,
            },
            spec,
        ))
    }
}

/// Types of a trajectory's nodes.
fn node_types(trajectory: &Recorded) -> Vec<NodeType> {
    match trajectory {
        Recorded::Cells(t) => {
            let faces = t.mesh().boundary.iter().map(|b| b.kind);
            std::iter::once(NodeType::Fluid).chain(faces).collect()
        }
        Recorded::Points(t) => bodies::node_types(t),
    }
}

/// Whether bodies at points are what the configuration is for.
fn check_points(path: &Path, spec: &ModelSpec) -> Result<()> {
    match spec.contact {
        Some(_) => Ok(()),
        None => Err(Error::file(
            path,
            "is a trajectory at points (a deforming body): give the configuration a table [contact] with a radius",
        )),
    }
}

/// Whether a trajectory at cells has the fields and directions that the first one promised.
fn check(path: &Path, trajectory: &Trajectory, spec: &ModelSpec) -> Result<()> {
    if spec.contact.is_some() {
        return Err(Error::file(
            path,
            "is a trajectory at cells: [contact] is for deforming bodies at points; leave the table out, or give a folder \
             with trajectories at points only",
        ));
    }
    if trajectory.mesh().dim() != spec.dim {
        return Err(Error::file(
            path,
            format!(
                "{} solved directions, the first trajectory has {}",
                trajectory.mesh().dim(),
                spec.dim
            ),
        ));
    }
    for field in &spec.fields {
        let fits = trajectory
            .fields()
            .iter()
            .any(|f| f.name == field.name && f.vector == field.vector && f.dimensions == field.dimensions);
        if !fits {
            return Err(Error::file(
                path,
                format!("no field `{}` of the kind in the first trajectory", field.name),
            ));
        }
    }
    Ok(())
}

/// Whether the frames are as far apart as the first trajectory's, and enough.
fn check_times(path: &Path, times: &[f64], spec: &ModelSpec, frames: usize, needed: usize) -> Result<()> {
    if frames_a_step(times, spec.stride, path)? != frames {
        return Err(Error::file(
            path,
            "its frame interval differs from the first trajectory's",
        ));
    }
    let found = times.len();
    if found < needed {
        return Err(Error::file(
            path,
            format!("{found} frames; training.unroll and model.stride need at least {needed}"),
        ));
    }
    Ok(())
}
