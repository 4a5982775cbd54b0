//! What a training starts from: configuration, data, a model, an earlier checkpoint.

use super::checkpoint::{Checkpoint, Progress};
use super::config::Config;
use super::data_set;
use super::memory;
use super::net2net;
use super::report::Report;
use super::request::Request;
use super::trainer::Trainer;
use m4gn_base::lock::Lock;
use m4gn_base::{Error, Result};
use m4gn_learn::Workload;
use m4gn_learn::inputs;
use m4gn_model::{Model, ModelSpec};
use m4gn_parallel::Comm;
use std::path::Path;
use std::sync::atomic::AtomicU8;

/// What a training reads before it starts.
pub(super) struct Loaded {
    pub config: Config,
    pub work: Workload,
    pub spec: ModelSpec,
    pub from: Option<Model>,
    pub earlier: Option<Checkpoint>,
    /// Model, checkpoint and log are this training's.
    pub _claimed: Vec<Lock>,
}

/// Reads all of it, and checks that it goes together.
pub(super) fn load(request: &Request, stop: &AtomicU8, comm: &Comm, report: &Report) -> Result<Loaded> {
    let config = request.config()?;
    let claimed = if comm.is_root() { request.claim_outputs()? } else { Vec::new() };
    let path = request.checkpoint();
    if path.exists() && (!request.resume || config.training.steps == 0) {
        return Err(Error::Input(format!(
            "{} holds an earlier training of this model: carry it on with --resume, or delete it, or give another --out",
            path.display()
        )));
    }
    if !request.resume && request.out.is_file() && request.from.as_ref() != Some(&request.out) {
        return Err(Error::file(&request.out, "is there already: give another --out, or delete it"));
    }
    let ranks = comm.size() as usize;
    if config.training.batch_size < ranks {
        return Err(Error::Input(format!(
            "training.batch_size: found {}, expected at least the number of ranks, {ranks}: each takes its share of a batch",
            config.training.batch_size
        )));
    }
    let earlier = match path.exists() {
        true => Some(Checkpoint::read(&path)?),
        false => None,
    };
    // A training that was started from a model goes on with that model's normalisers.
    let started = earlier.as_ref().and_then(|e| e.progress.from.as_ref());
    let from = match (&request.from, started) {
        (Some(path), _) => Some(Model::read(path)?),
        (None, Some(path)) => Some(Model::read(Path::new(path))?),
        (None, None) => None,
    };
    let room = memory::for_frames(request.memory, comm)?;
    let (work, spec) = data_set::load(&request.data, &config, from.as_ref(), room, report, stop)?;
    let from = from
        .map(|model| {
            let model = inputs::extend(model, &spec, &work)?;
            let factor = net2net::factor(&model.spec.architecture, &spec.architecture).unwrap_or(1);
            net2net::widen(model, factor, config.training.seed)
        })
        .transpose()?;
    Ok(Loaded { config, work, spec, from, earlier, _claimed: claimed })
}

impl Trainer<'_> {
    /// Takes up a checkpoint.
    pub(super) fn resume(&mut self, earlier: Checkpoint, report: &Report) -> Result<()> {
        let path = self.request.checkpoint();
        let misfit = |what: &str| {
            Error::file(
                &path,
                format!("made with another {what}: resume with what it was made with, or give another --out"),
            )
        };
        let (old, new) = (&earlier.progress.config, &self.progress.config);
        for name in ["model", "macro", "contact", "segments"] {
            if old[name] != new[name] {
                return Err(misfit(&format!("[{name}] table in the configuration")));
            }
        }
        let (old, new) = (&old["training"], &new["training"]);
        if earlier.progress.data != self.progress.data {
            let rollouts = "validation_rollouts";
            let same = old[rollouts] == new[rollouts];
            return Err(misfit(if same { "data set" } else { "training.validation_rollouts" }));
        }
        // Muon keeps no squares of gradients, by which Adam divides.
        if old["optimiser"] != new["optimiser"] {
            return Err(misfit("training.optimiser"));
        }
        if earlier.weights.len() != self.layout.len() {
            return Err(misfit("network"));
        }
        earlier.check(self.spec, self.layout.len(), &path)?;
        if earlier.progress.from.is_some() != self.frozen {
            return Err(misfit("start (--from)"));
        }
        let changed = changes(old, new);
        // More steps or minutes are what a training is usually carried on for.
        let told = |change: &&String| !change.starts_with("steps ") && !change.starts_with("max_minutes ");
        let notable: Vec<&str> = changed.iter().filter(told).map(String::as_str).collect();
        if !notable.is_empty() {
            report.line(&format!("note: [training] differs from the checkpoint's: {}", notable.join(", ")));
        }
        let t = &self.config.training;
        if t.ema_decay > 0.0 {
            self.optimiser.average = Some(earlier.average.unwrap_or_else(|| earlier.weights.clone()));
        }
        self.optimiser.weights = earlier.weights;
        self.optimiser.first = earlier.first;
        self.optimiser.second = earlier.second;
        self.optimiser.updates = earlier.progress.updates;
        self.normaliser = earlier.normaliser;
        self.best = earlier.best.zip(earlier.best_normaliser);
        self.resumed_seconds = earlier.progress.seconds;
        let config = std::mem::take(&mut self.progress.config);
        self.progress = Progress { config, seed: t.seed, ..earlier.progress };
        report.line(&format!("resumed at step {}", self.progress.step));
        Ok(())
    }
}

/// Keys of a table whose values differ, each with the value before and the one now.
fn changes(old: &serde_json::Value, new: &serde_json::Value) -> Vec<String> {
    let entries = |table: &serde_json::Value| table.as_object().cloned().unwrap_or_default();
    let (old, new) = (entries(old), entries(new));
    let text = |value: Option<&serde_json::Value>| match value {
        None | Some(serde_json::Value::Null) => "none".to_string(),
        Some(value) => value.to_string(),
    };
    let differ = new.iter().filter(|(key, value)| old.get(*key) != Some(*value));
    differ.map(|(key, value)| format!("{key} {} -> {}", text(old.get(key)), text(Some(value)))).collect()
}
