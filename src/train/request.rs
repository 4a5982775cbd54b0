//! What the command line asks for, as it crosses the C interface.

use super::config::Config;
use m4gn_base::lock::{self, Lock};
use m4gn_base::{Error, Result, files};
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// `m4gn train`'s arguments.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Folder of trajectories, or one.
    pub data: PathBuf,
    /// TOML file.
    pub config: PathBuf,
    /// Model file to write.
    pub out: PathBuf,
    /// `cpu`, `cuda`, `cuda:0`.
    pub device: Option<String>,
    /// Model to start from.
    pub from: Option<PathBuf>,
    /// Carry on from the checkpoint beside `out`.
    #[serde(default)]
    pub resume: bool,
    /// Worker threads.
    pub threads: Option<usize>,
    /// GB that the frames of each rank may take; half of what is free, shared by the machine's ranks, where it is not given.
    pub memory: Option<f64>,
    /// Overrides `training.steps`; 0 with `from`: no training, but the ranges of the data in a copy of the model.
    pub steps: Option<u64>,
    /// Overrides `training.seed`.
    pub seed: Option<u64>,
    /// File for the figures.
    pub json: Option<PathBuf>,
}

impl Request {
    /// The configuration with the overrides.
    pub fn config(&self) -> Result<Config> {
        let mut config = Config::read(&self.config)?;
        if let Some(steps) = self.steps {
            if steps == 0 && self.from.is_none() {
                return Err(Error::Input(
                    "--steps 0: expected at least 1; with --from MODEL, 0 writes the ranges of --data into a copy of the model"
                        .into(),
                ));
            }
            config.training.steps = steps;
        }
        if let Some(seed) = self.seed {
            config.training.seed = seed;
        }
        Ok(config)
    }

    /// Makes the folder of the model, checkpoint and log, and claims these files ([`lock::outputs`]), before anything is read.
    ///
    /// # Errors
    /// [`Error::File`] naming the file that could not be written, or that another program writes.
    pub fn claim_outputs(&self) -> Result<Vec<Lock>> {
        if let Some(folder) = self.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)
                .map_err(|e| Error::file(folder, format!("the folder of --out cannot be made: {e}")))?;
        }
        // Models of other endings have the same checkpoint and log.
        let (checkpoint, log) = (self.checkpoint(), self.log());
        let inputs = [&self.data, &self.config].map(PathBuf::as_path);
        let mut claimed = lock::outputs([&self.out, &checkpoint, &log].map(PathBuf::as_path), inputs)?;
        // A model may be trained further in its own place.
        let inputs = inputs.into_iter().chain(self.from.as_deref());
        claimed.extend(lock::outputs(self.json.as_deref(), inputs)?);
        Ok(claimed)
    }

    /// Writes the figures of the end, where that was asked for. Collective: the first rank writes.
    pub(super) fn write_json(&self, comm: &Comm, figures: &serde_json::Value) -> Result<()> {
        comm.agree(match self.json.as_ref().filter(|_| comm.is_root()) {
            Some(path) => files::write_whole(path, format!("{figures:#}\n").as_bytes()),
            None => Ok(()),
        })
    }

    /// Worker threads: as asked, else one a core up to the pieces of work.
    pub fn threads(&self, pieces: usize) -> usize {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        self.threads.unwrap_or(cores).clamp(1, pieces.clamp(1, 1024))
    }

    /// The checkpoint beside the model file.
    pub fn checkpoint(&self) -> PathBuf {
        self.out.with_extension("checkpoint")
    }

    /// The log beside the model file.
    pub fn log(&self) -> PathBuf {
        self.out.with_extension("csv")
    }
}
