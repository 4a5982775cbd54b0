//! What can be known of a study before its first training, which may be days before its last.

use super::{Data, Network, Plan, Test};
use crate::generate::process::Surroundings;
use crate::validate::trajectories;
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_model::{Model, ModelSpec};
use m4gn_train::config::Config;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What the checks found out.
#[derive(Debug, Default)]
pub(super) struct Checked {
    /// Configuration and number of weights of each network on each data set.
    pub(super) configs: BTreeMap<(String, String), (String, u64)>,
    /// Digest of the content of each data set.
    pub(super) data: BTreeMap<PathBuf, String>,
}

/// Checks each configuration against its data sets: that there are trajectories to learn from and to test on, with the fields, directions, node types and
/// times that the network needs; that its backend is there; and reads the content of all data.
///
/// # Errors
/// What is wrong, with the network, the entry or the file; [`Error::Interrupted`] when the user stops.
pub(super) fn all(plan: &Plan, tools: &Surroundings) -> Result<Checked> {
    backend(plan)?;
    let mut checked = Checked::default();
    for (data, network, _) in plan.cells() {
        let key = (data.name.clone(), network.name.clone());
        if checked.configs.contains_key(&key) {
            continue;
        }
        let named = |e: Error| match e {
            Error::Interrupted(e) => Error::Interrupted(e),
            e => Error::Input(format!("network \"{}\" on \"{}\": {e}", network.name, data.name)),
        };
        let text = plan.config(data, network).map_err(named)?;
        let spec = one(data, network, &text).map_err(named)?;
        let weights = Model::tensor_sizes(&spec).iter().map(|n| *n as u64).sum();
        checked.configs.insert(key, (text, weights));
    }
    for path in plan.data.iter().flat_map(|d| [&d.train].into_iter().chain(d.test.iter().map(|t| &t.data))) {
        if !checked.data.contains_key(path) {
            let digest = content(path, tools)?;
            checked.data.insert(path.clone(), digest);
        }
    }
    Ok(checked)
}

/// A network on a data set and its tests.
fn one(data: &Data, network: &Network, text: &str) -> Result<ModelSpec> {
    let spec = m4gn_train::model_of(&data.train, &Config::parse(text)?)?;
    for &count in &network.segments {
        if !spec.architecture.needs().segments {
            return Err(Error::Input(format!("segments = [{count}]: it is a network without segments")));
        }
        let mut segments = spec.segments.clone();
        (segments.count, segments.size) = (count, None);
        segments.check()?;
    }
    for Test { data, split, .. } in data.tests().iter() {
        for (trajectory, _) in trajectories(data, split, &spec, &mut |_| ())? {
            let nodes = trajectory.mesh().cell_global.len();
            refuse_any(network.segments.iter().find(|n| **n > nodes), Error::Input, |count| {
                let path = trajectory.path().display();
                format!("segments = [{count}]: expected at most the cells or points of {path}, {nodes}")
            })?;
        }
    }
    Ok(spec)
}

/// Whether what is to compute is there.
fn backend(plan: &Plan) -> Result<()> {
    let device = plan.device.as_deref().unwrap_or("cpu");
    match (plan.backend.as_deref(), device) {
        (Some("native") | None, "cpu") => Ok(()),
        (Some("torch") | None, _) => m4gn_engine::torch::library().map(drop),
        (Some("native"), _) => {
            Err(Error::Input(format!("device = \"{device}\": the native backend runs on cpu")))
        }
        (Some(other), _) => Err(Error::Input(format!("backend = \"{other}\": expected native or torch"))),
    }
}

/// A digest of the names and the contents of a data set's files.
fn content(data: &Path, tools: &Surroundings) -> Result<String> {
    let mut digest = Digest::default();
    for file in m4gn_data::list(data)? {
        refuse(tools.stopped(), Error::Interrupted, || "stopped by the user; nothing was trained")?;
        digest.add_file(&file.file_name().unwrap_or_default().to_string_lossy(), &file)?;
    }
    Ok(digest.text())
}

/// Whether there is room for so many bytes.
///
/// # Errors
/// [`Error::File`] where there is less.
pub(super) fn disk(folder: &Path, bytes: impl Iterator<Item = u64>) -> Result<()> {
    let needed = bytes.fold(0, u64::saturating_add);
    // Where it cannot be asked, the first file that does not fit says so.
    let Ok(about) = rustix::fs::statvfs(folder) else { return Ok(()) };
    let free = about.f_bavail.saturating_mul(about.f_frsize);
    if needed <= free {
        return Ok(());
    }
    let [needed, free] = [needed, free].map(|b| m4gn_report::number(b as f64 * 1e-9, 3));
    Err(Error::file(
        folder,
        format!("models and checkpoints of the study take {needed} GB, {free} GB are free"),
    ))
}
