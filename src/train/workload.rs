//! The data set, in memory as far as there is room, and the model description that follows from it.

use super::config::Config;
use super::inputs;
use super::memory;
use super::report::Report;
use super::samples::{Components, Sample, describe, frames_a_step};
use super::widen;
use m4gn_data as dataset;
use m4gn_data::{Split, Trajectory};
use m4gn_mesh::NodeType;
use m4gn_mesh::{Error, Result};
use m4gn_model::{Extent, Model, ModelSpec, TrainedOn};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Trajectories to train on and to validate on.
#[derive(Debug)]
pub struct Workload {
    /// Of split `train`.
    pub train: Vec<Arc<Sample>>,
    /// The first of split `valid`; of `train` if there are none.
    pub valid: Vec<Arc<Sample>>,
    /// Data frames in one model step.
    pub frames_a_step: usize,
    /// File name and number of frames of each trajectory; a resumed training must find the same.
    pub names: Vec<String>,
}

/// Trajectories that hardly change weigh as if they changed by this share of the mean.
const LEAST_CHANGE: f64 = 0.05;

impl Workload {
    /// What the errors of each training trajectory are multiplied with in the loss, 1 in the mean:
    /// `(c + 0.05)^-balance`, where `c` is the mean square of the change of the first predicted field in a model step, over
    /// that of all trajectories. Errors grow with what changes, so without it the fastest flows decide what is learned.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn weights(&self, spec: &ModelSpec, balance: f64) -> Result<Vec<f64>> {
        let count = self.train.len();
        if balance == 0.0 {
            return Ok(vec![1.0; count]);
        }
        let changes = self.train.iter().map(|s| self.change(s, spec));
        let changes = changes.collect::<Result<Vec<f64>>>()?;
        let mean = changes.iter().sum::<f64>() / count as f64;
        if mean == 0.0 {
            return Ok(vec![1.0; count]);
        }
        let weights: Vec<f64> = changes
            .iter()
            .map(|c| (c / mean + LEAST_CHANGE).powf(-balance))
            .collect();
        let all = weights.iter().sum::<f64>() / count as f64;
        Ok(weights.iter().map(|w| w / all).collect())
    }

    /// Mean square of what the first predicted field changes by in a model step, over cells and at most 32 frames.
    fn change(&self, sample: &Sample, spec: &ModelSpec) -> Result<f64> {
        let c = Components::new(spec);
        let last = sample.n_frames - self.frames_a_step;
        let frames = (0..last).step_by(last.div_ceil(32).max(1));
        let changes = frames.map(|frame| {
            let (now, then) = (sample.frame(frame)?, sample.frame(frame + self.frames_a_step)?);
            Ok(c.mean_square(&now, &then, sample.n_cells()))
        });
        let changes = changes.collect::<Result<Vec<f64>>>()?;
        Ok(changes.iter().sum::<f64>() / changes.len().max(1) as f64)
    }

    /// Bytes of all frames, of those in memory, and the number of trajectories whose frames stay on disk.
    fn sizes(&self) -> (u64, u64, usize) {
        let mut samples: Vec<&Arc<Sample>> = self.train.iter().collect();
        // Without trajectories of split `valid` those of `train` stand in both lists.
        samples.extend(
            self.valid
                .iter()
                .filter(|v| !self.train.iter().any(|t| Arc::ptr_eq(t, v))),
        );
        let all = samples.iter().map(|s| s.frame_bytes()).sum();
        let (streamed, kept): (Vec<_>, Vec<_>) = samples.into_iter().partition(|s| s.is_streamed());
        (all, kept.iter().map(|s| s.frame_bytes()).sum(), streamed.len())
    }

    /// Reads all trajectories, their frames into memory as far as `room` bytes hold them.
    pub fn load(
        folder: &Path,
        config: &Config,
        from: Option<&Model>,
        room: u64,
        report: &Report,
        stop: &AtomicU8,
    ) -> Result<(Self, ModelSpec)> {
        let paths = dataset::list(folder)?;
        let mut train: Vec<Trajectory> = Vec::new();
        let mut valid = Vec::new();
        let mut types = Vec::new();
        for path in paths {
            let trajectory = Trajectory::open(&path)?;
            check_kind(&trajectory, config)?;
            types.extend(trajectory.node_types());
            match trajectory.split() {
                Split::Train => train.push(trajectory),
                Split::Valid if valid.len() < config.training.validation_rollouts => valid.push(trajectory),
                _ => {}
            }
        }
        let Some(first) = train.first() else {
            return Err(Error::file(
                folder,
                "no complete trajectory of split `train`: make some with `m4gn generate`",
            ));
        };
        let mut spec = describe(config, first)?;
        spec.node_types = NodeType::ALL.into_iter().filter(|t| types.contains(t)).collect();
        if let Some(model) = from {
            carry_on(&mut spec, model)?;
            // No weight depends on how the mesh is agglomerated and cut.
            let resolution = |spec: &ModelSpec| spec.resolution.map_or("off".into(), |m| format!("{m} m"));
            let segments = |spec: &ModelSpec| serde_json::json!(spec.segments).to_string();
            for (what, old, new) in [
                ("resolution", resolution(&model.spec), resolution(&spec)),
                ("segments", segments(&model.spec), segments(&spec)),
            ] {
                if old != new {
                    report.line(&format!(
                        "note: {what}: {old} in the model to start from, {new} in the configuration, which counts"
                    ));
                }
            }
        }
        let unreached = config.training.unreached();
        if config.training.steps > 0 && !unreached.is_empty() {
            report.line(&format!(
                "note: the training ends at step {}, and {}: shorten them as well, if that is not meant",
                config.training.steps,
                unreached.join("; ")
            ));
        }
        // Now, not when a model is exported, hours later.
        spec.check()?;
        check_memory(&spec)?;
        let frames = frames_a_step(first.times(), spec.stride, first.path())?;
        let needed = 1 + frames * config.training.longest_unroll();
        for trajectory in train.iter().chain(&valid) {
            check(trajectory, &spec, frames)?;
        }
        let described = |trajectory: &Trajectory| {
            let name = trajectory.path().file_name();
            let name = name.map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            format!("{name} {}", trajectory.times().len())
        };
        // As the last stretch of a hybrid run may be.
        let short = |trajectory: &Trajectory| trajectory.times().len() < needed;
        let left_out: Vec<String> = train
            .iter()
            .chain(&valid)
            .filter(|t| short(t))
            .map(described)
            .collect();
        train.retain(|t| !short(t));
        valid.retain(|t| !short(t));
        if let Some(first) = left_out.first() {
            let many = left_out.len();
            let note = format!(
                "{many} with fewer frames than the {needed} that training.unroll and model.stride need, the first of them \
                 (name, frames) {first}"
            );
            if train.is_empty() {
                return Err(Error::file(
                    folder,
                    format!("no trajectory to learn from but {note}"),
                ));
            }
            report.line(&format!("note: trajectories left out: {note}"));
        }
        let names: Vec<String> = train.iter().chain(&valid).map(described).collect();
        let total = train.len() + valid.len();
        report.begin_loading(total as u64);
        let mut left = room;
        let mut read = |list: &[Trajectory]| -> Result<Vec<Arc<Sample>>> {
            list.iter()
                .map(|trajectory| {
                    if stop.load(Ordering::Relaxed) != 0 {
                        return Err(Error::Interrupted(
                            "interrupted while the data were read; nothing was written".into(),
                        ));
                    }
                    let sample = Sample::read_within(trajectory, &spec, left)?;
                    if !sample.is_streamed() {
                        left -= sample.frame_bytes();
                    }
                    report.loaded();
                    Ok(Arc::new(sample))
                })
                .collect()
        };
        // Those that are trained on first: their frames are needed at each step.
        let (train, mut valid) = (read(&train)?, read(&valid)?);
        report.end();
        if valid.is_empty() {
            report.line("note: no trajectory of split `valid`: the best weights are chosen by errors on training trajectories");
            let count = config.training.validation_rollouts.max(1);
            valid = train.iter().take(count).cloned().collect();
        }
        let extents: Vec<Extent> = train.iter().filter_map(|sample| sample.extent.clone()).collect();
        spec.trained_on = TrainedOn::over(&extents, spec.stride);
        let work = Workload {
            train,
            valid,
            frames_a_step: frames,
            names,
        };
        let (all, kept, streamed) = work.sizes();
        report.line(&match streamed {
            0 => format!("frames: {} in memory", memory::size(all)),
            n => format!(
                "frames: {} in all, {} of {} trajectories in memory; {n} are read frame by frame when a sample needs them \
                 (--memory GB sets what frames may take, here {})",
                memory::size(all),
                memory::size(kept),
                total - n,
                memory::size(room)
            ),
        });
        Ok((work, spec))
    }
}

/// Takes over the description of a model that is to be trained further.
fn carry_on(spec: &mut ModelSpec, model: &Model) -> Result<()> {
    let old = &model.spec;
    let misfit = |what: &str, found: String, expected: String| {
        Error::Input(format!(
            "the model to start from has {what} {found}; configuration and data say {expected}: they must be the same"
        ))
    };
    if let Some(kind) = spec.node_types.iter().find(|t| !old.node_types.contains(t)) {
        let known: Vec<&str> = old.node_types.iter().map(|t| t.name()).collect();
        return Err(misfit(
            "the node types",
            known.join(", "),
            format!("{} as well", kind.name()),
        ));
    }
    spec.node_types = old.node_types.clone();
    if !inputs::follow(&old.fields, &spec.fields) {
        let fields = |spec: &ModelSpec| format!("{:?}", spec.fields);
        return Err(Error::Input(format!(
            "the model to start from has model.fields {}; configuration and data say {}: they must be the same; only inputs that are \
             not predicted may follow",
            fields(old),
            fields(spec)
        )));
    }
    if widen::factor(&old.architecture, &spec.architecture).is_none() {
        return Err(Error::Input(format!(
            "the model to start from has [model] and [macro] {:?}; configuration and data say {:?}: they must be the same; only width \
             and ffn_width may both be larger, the same whole number of times",
            old.architecture, spec.architecture
        )));
    }
    let pairs = [
        ("model.stride", old.stride.to_string(), spec.stride.to_string()),
        ("directions", old.dim.to_string(), spec.dim.to_string()),
    ];
    if let Some((what, found, expected)) = pairs.into_iter().find(|(_, found, expected)| found != expected) {
        return Err(misfit(what, found, expected));
    }
    match inputs::follow_contact(old.contact, spec.contact) {
        true => Ok(()),
        false => {
            let text = |contact| format!("{contact:?}");
            Err(misfit("[contact]", text(old.contact), text(spec.contact)))
        }
    }
}

/// Whether weights, gradient, moments and their packed copies fit into this machine.
fn check_memory(spec: &ModelSpec) -> Result<()> {
    let sizes = Model::tensor_sizes(spec);
    // Weights, two moments, average, best, gradient, and two packed copies.
    let needed = sizes
        .iter()
        .map(|n| n.saturating_mul(32))
        .fold(0usize, usize::saturating_add);
    let have = memory::whole().map_or(usize::MAX, |bytes| bytes as usize);
    if needed > have {
        return Err(Error::Input(format!(
            "the network of [model] and [macro] has {} million weights, which take {} GB to train; this machine has {} GB: \
             a smaller width, or fewer layers",
            needed / 32_000_000,
            needed / 1_000_000_000,
            have / 1_000_000_000
        )));
    }
    Ok(())
}

/// Whether the trajectory is of the kind, at cells or at points, that the configuration is for.
fn check_kind(trajectory: &Trajectory, config: &Config) -> Result<()> {
    let message = match (trajectory.body(), &config.contact) {
        (Some(_), None) => {
            "is a trajectory at points (a deforming body): give the configuration a table [contact] with a radius"
        }
        (None, Some(_)) => {
            "is a trajectory at cells: [contact] is for deforming bodies at points; leave the table out, or give a folder \
             with trajectories at points only"
        }
        _ => return Ok(()),
    };
    Err(Error::file(trajectory.path(), message))
}

/// Whether a trajectory has the fields, the directions and the frame interval that the first one promised.
fn check(trajectory: &Trajectory, spec: &ModelSpec, frames: usize) -> Result<()> {
    let (path, times) = (trajectory.path(), trajectory.times());
    let dim = trajectory.mesh().dim();
    if dim != spec.dim {
        return Err(Error::file(
            path,
            format!("{dim} solved directions, the first trajectory has {}", spec.dim),
        ));
    }
    for field in &spec.fields {
        let found = trajectory.field(&field.name)?;
        if (found.vector, found.dimensions) != (field.vector, field.dimensions) {
            return Err(Error::file(
                path,
                format!("no field `{}` of the kind in the first trajectory", field.name),
            ));
        }
    }
    if frames_a_step(times, spec.stride, path)? != frames {
        return Err(Error::file(
            path,
            "its frame interval differs from the first trajectory's",
        ));
    }
    Ok(())
}
