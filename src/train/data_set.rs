//! The data set, in memory as far as there is room, and the model description that follows from it.

use super::config::Config;
use super::data_checks;
use super::memory;
use super::net2net;
use super::recorded::read_within;
use super::report::Report;
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result};
use m4gn_data as dataset;
use m4gn_data::{Split, Trajectory};
use m4gn_learn::Workload;
use m4gn_learn::inputs;
use m4gn_learn::samples::Sample;
use m4gn_mesh::NodeType;
use m4gn_model::{Extent, FieldSpec, Model, ModelSpec, SegmentSpec, TrainedOn};
use m4gn_parallel::Comm;
use m4gn_structure::obstacle_note;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// What a data set says before its frames are read.
struct Survey {
    spec: ModelSpec,
    frames_a_step: usize,
    train: Vec<Trajectory>,
    valid: Vec<Trajectory>,
}

/// The model that a configuration makes of a data set, without what its frames say.
///
/// # Errors
/// For all that a training refuses before it reads frames.
pub fn model_of(folder: &Path, config: &Config) -> Result<ModelSpec> {
    survey(folder, config, None, &Report::new(false)).map(|survey| survey.spec)
}

/// Opens all trajectories, and checks that they go with the configuration.
fn survey(folder: &Path, config: &Config, from: Option<&Model>, report: &Report) -> Result<Survey> {
    let paths = dataset::list(folder)?;
    let draft = config.draft()?;
    let mut train: Vec<Trajectory> = Vec::new();
    let mut valid = Vec::new();
    for path in paths {
        let trajectory = Trajectory::open(&path)?;
        check_kind(&trajectory, &draft)?;
        match trajectory.split() {
            Split::Train => train.push(trajectory),
            Split::Valid => valid.push(trajectory),
            _ => {}
        }
    }
    // A run that was killed may leave few frames, or one.
    let Some(longest) = train.iter().rev().max_by_key(|t| t.times().len()) else {
        return Err(Error::file(
            folder,
            "no complete trajectory of split `train`: make some with `m4gn generate`",
        ));
    };
    let mut spec = describe(draft, longest)?;
    let frames = frames_a_step(longest.times(), spec.stride, longest.path())?;
    let needed = 1 + frames * config.training.longest_unroll();
    let short = |trajectory: &Trajectory| trajectory.times().len() < needed;
    // Where none is long enough, that is what is said.
    let all_short = train.iter().all(short);
    let types: Vec<NodeType> =
        train.iter().filter(|t| all_short || !short(t)).flat_map(Trajectory::node_types).collect();
    spec.node_types = NodeType::ALL.into_iter().filter(|t| types.contains(t)).collect();
    if let Some(model) = from {
        carry_on(&mut spec, model)?;
        if config.training.steps == 0 {
            // The model stays as it is, and its ranges are those of its own nodes.
            spec.resolution = model.spec.resolution;
            spec.segments = model.spec.segments.clone();
        }
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
            "note: the schedule ends at step {}, and {}: shorten them as well, if that is not meant",
            config.training.steps,
            unreached.join("; ")
        ));
    }
    // Now, not when a model is exported, hours later.
    spec.check()?;
    check_memory(&spec)?;
    let left_out: Vec<String> = train.iter().chain(&valid).filter(|t| short(t)).map(described).collect();
    train.retain(|t| !short(t));
    valid.retain(|t| !short(t));
    valid.truncate(config.training.validation_rollouts);
    if let Some(first) = left_out.first() {
        let many = left_out.len();
        let note = format!(
            "{many} with fewer frames than the {needed} that training.unroll and model.stride need, the first of them \
             (name, frames) {first}"
        );
        if train.is_empty() {
            return Err(Error::file(folder, format!("no trajectory to learn from but {note}")));
        }
        report.line(&format!("note: trajectories left out: {note}"));
    }
    for trajectory in train.iter().chain(&valid) {
        check(trajectory, &spec, frames)?;
    }
    valid.iter().try_for_each(|trajectory| check_types(trajectory, &spec))?;
    Ok(Survey { spec, frames_a_step: frames, train, valid })
}

/// Name and number of frames.
fn described(trajectory: &Trajectory) -> String {
    let name = trajectory.path().file_name().unwrap_or_default().to_string_lossy();
    format!("{name} {}", trajectory.times().len())
}

/// Reads all trajectories, their frames into memory as far as `room` bytes hold them.
pub(super) fn load(
    folder: &Path,
    config: &Config,
    from: Option<&Model>,
    room: u64,
    report: &Report,
    stop: &AtomicU8,
) -> Result<(Workload, ModelSpec)> {
    let Survey { mut spec, frames_a_step, train, valid } = survey(folder, config, from, report)?;
    let mut names = Vec::new();
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
                let sample = read_within(trajectory, &spec, left)?;
                if !sample.is_streamed() {
                    left -= sample.frame_bytes();
                }
                let mut ends = Digest::default();
                for i in [0, sample.n_frames - 1] {
                    let bytes: Vec<u8> = sample.frame(i)?.iter().flat_map(|v| v.to_le_bytes()).collect();
                    ends.add("frame", &bytes);
                }
                names.push(format!("{} {:?} {}", described(trajectory), sample.extent, ends.text()));
                report.loaded();
                Ok(Arc::new(sample))
            })
            .collect()
    };
    // Those that are trained on first: their frames are needed at each step.
    let first = train[0].clone();
    let (train, mut valid) = (read(&train)?, read(&valid)?);
    report.end();
    let has_obstacle = spec.architecture.needs().segments && spec.segments.method.uses_obstacle();
    if has_obstacle && first.body().is_none() {
        let obstacle = obstacle_note(first.mesh(), &spec.segments.obstacles, &Comm::serial())?;
        report.line(&format!("the obstacle of {}: {obstacle}", described(&first)));
    }
    let learns = config.training.steps > 0;
    if learns && valid.is_empty() {
        report.line("note: no trajectory of split `valid`: the best weights are chosen by errors on training trajectories");
        valid = train.iter().take(config.training.validation_rollouts).cloned().collect();
    }
    let extents: Vec<Extent> = train.iter().filter_map(|sample| sample.extent.clone()).collect();
    spec.trained_on = TrainedOn::over(&extents, spec.stride);
    let work = Workload { train, valid, frames_a_step, names };
    if learns {
        data_checks::notes(&work, &spec, &config.training)?.iter().for_each(|note| report.line(note));
    }
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
        return Err(misfit("the node types", known.join(", "), format!("{} as well", kind.name())));
    }
    spec.node_types = old.node_types.clone();
    if !inputs::follow(&old.fields, &spec.fields) {
        let fields = |spec: &ModelSpec| serde_json::json!(spec.fields).to_string();
        return Err(Error::Input(format!(
            "the model to start from has model.fields {}; configuration and data say {}: they must be the same; only inputs that are \
             not predicted may follow",
            fields(old),
            fields(spec)
        )));
    }
    if net2net::factor(&old.architecture, &spec.architecture).is_none() {
        return Err(Error::Input(format!(
            "the model to start from has [model] and [macro] {}; configuration and data say {}: they must be the same; only width \
             and ffn_width may both be larger, the same whole number of times",
            serde_json::json!(old.architecture),
            serde_json::json!(spec.architecture)
        )));
    }
    let contact = |spec: &ModelSpec| spec.contact.map_or("none".into(), |c| serde_json::json!(c).to_string());
    let pairs = [
        ("model.stride", old.stride.to_string(), spec.stride.to_string()),
        ("directions", old.dim.to_string(), spec.dim.to_string()),
        ("[contact]", contact(old), contact(spec)),
    ];
    match pairs.into_iter().find(|(_, found, expected)| found != expected) {
        Some((what, found, expected)) => Err(misfit(what, found, expected)),
        None => Ok(()),
    }
}

/// Whether weights, gradient, moments and their packed copies fit into this machine.
fn check_memory(spec: &ModelSpec) -> Result<()> {
    let sizes = Model::tensor_sizes(spec);
    // Weights, two moments, average, best, gradient, and two packed copies.
    let needed = sizes.iter().map(|n| n.saturating_mul(32)).fold(0usize, usize::saturating_add);
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
fn check_kind(trajectory: &Trajectory, draft: &ModelSpec) -> Result<()> {
    let checked = m4gn_domain::check_kind(draft, trajectory.mesh());
    checked.map_err(|[_, data]| Error::file(trajectory.path(), data.asks_of_configuration()))
}

/// Whether a trajectory has the fields, the directions and the frame interval of the longest one.
fn check(trajectory: &Trajectory, spec: &ModelSpec, frames: usize) -> Result<()> {
    let (path, times) = (trajectory.path(), trajectory.times());
    let dim = trajectory.mesh().dim();
    if dim != spec.dim {
        return Err(Error::file(
            path,
            format!("{dim} solved directions, the longest trajectory has {}", spec.dim),
        ));
    }
    for field in &spec.fields {
        let found = trajectory.field(&field.name)?;
        if (found.vector, found.dimensions) != (field.vector, field.dimensions) {
            let kind = |vector: bool, dimensions: [i32; 7]| {
                format!("a {} of dimensions {dimensions:?}", if vector { "vector" } else { "scalar" })
            };
            return Err(Error::file(
                path,
                format!(
                    "field `{}` is {}, in the longest trajectory {}: take those of one kind out of the folder",
                    field.name,
                    kind(found.vector, found.dimensions),
                    kind(field.vector, field.dimensions)
                ),
            ));
        }
    }
    if frames_a_step(times, spec.stride, path)? != frames {
        return Err(Error::file(path, "its frame interval differs from the longest trajectory's"));
    }
    Ok(())
}

/// Whether training trajectories have all node types of one to validate on: what a model says of a type comes of weights that have met it.
fn check_types(trajectory: &Trajectory, spec: &ModelSpec) -> Result<()> {
    match trajectory.node_types().iter().find(|kind| !spec.node_types.contains(kind)) {
        None => Ok(()),
        Some(kind) => Err(Error::file(
            trajectory.path(),
            format!(
                "has the node type {}, which no training trajectory has: expected {}; make it one of split `train`, or take it out of \
                 the folder",
                kind.name(),
                spec.node_types.iter().map(|t| t.name()).collect::<Vec<_>>().join(", ")
            ),
        )),
    }
}

/// What the data say about a model: dimensions, fields, and whose modes its segments are made of.
fn describe(draft: ModelSpec, first: &Trajectory) -> Result<ModelSpec> {
    let mesh = first.mesh();
    let fields = draft.fields.iter().map(|wanted| {
        let found = first.field(&wanted.name)?;
        Ok(FieldSpec { vector: found.vector, dimensions: found.dimensions, ..wanted.clone() })
    });
    let fields = fields.collect::<Result<_>>()?;
    let operator = m4gn_domain::operator(mesh, &draft.segments)?;
    let segments = SegmentSpec { operator, ..draft.segments };
    Ok(ModelSpec { dim: mesh.dim(), fields, node_types: Vec::new(), segments, ..draft })
}

/// Frames in one model step: the stride over the frame interval, which must be a whole number.
fn frames_a_step(times: &[f64], stride: f64, path: &Path) -> Result<usize> {
    let Some((interval, uneven)) = dataset::interval(times) else {
        let count = times.len();
        return Err(Error::file(path, format!("{count} frames: at least two are needed to learn from")));
    };
    let (uneven, steps) = (uneven.is_some(), stride / interval);
    if uneven || steps < 0.5 || (steps - steps.round()).abs() > 1e-3 * steps {
        return Err(Error::file(
            path,
            format!(
                "frames every {interval:.6} s{}: model.stride = {stride} s must be a multiple of an even interval",
                if uneven { " on average, not evenly" } else { "" }
            ),
        ));
    }
    Ok(steps.round() as usize)
}
