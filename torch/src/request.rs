//! What the command line asks for, as it crosses the C interface.

use crate::config::Config;
use m4gn::{Error, Result};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use tch::Device;

/// `m4gn train`'s arguments.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Folder of trajectories, or one.
    pub data: PathBuf,
    /// TOML file.
    pub config: PathBuf,
    /// Model file to write.
    pub out: PathBuf,
    /// `cpu`, `cuda`, `cuda:0`.
    #[serde(default)]
    pub device: Option<String>,
    /// Carry on from the checkpoint beside `out`.
    #[serde(default)]
    pub resume: bool,
    /// Worker threads.
    #[serde(default)]
    pub threads: Option<usize>,
    /// Overrides `training.steps`.
    #[serde(default)]
    pub steps: Option<u64>,
    /// Overrides `training.seed`.
    #[serde(default)]
    pub seed: Option<u64>,
    /// File for the figures.
    #[serde(default)]
    pub json: Option<PathBuf>,
}

impl Request {
    /// The configuration with the overrides.
    pub fn config(&self) -> Result<Config> {
        let mut config = Config::read(&self.config)?;
        if let Some(steps) = self.steps {
            if steps == 0 {
                return Err(Error::Input("--steps 0: expected at least 1".into()));
            }
            config.training.steps = steps;
        }
        if let Some(seed) = self.seed {
            config.training.seed = seed;
        }
        Ok(config)
    }

    /// The device asked for, if this libtorch has it.
    pub fn device(&self) -> Result<Device> {
        parse_device(self.device.as_deref().unwrap_or("cpu"))
    }

    /// Worker threads: as asked, else one a core up to the pieces of a batch.
    pub fn threads(&self, pieces: usize, device: Device) -> usize {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let most = if device == Device::Cpu { pieces } else { 1 };
        self.threads.unwrap_or(cores).clamp(1, most.max(1))
    }

    /// The checkpoint beside the model file.
    pub fn checkpoint(&self) -> PathBuf {
        beside(&self.out, "checkpoint")
    }

    /// The log beside the model file.
    pub fn log(&self) -> PathBuf {
        beside(&self.out, "csv")
    }
}

/// `cpu`, `cuda` or `cuda:N`.
pub fn parse_device(name: &str) -> Result<Device> {
    let device = match name.split_once(':') {
        None if name == "cpu" => Device::Cpu,
        None if name == "cuda" => Device::Cuda(0),
        Some(("cuda", n)) if n.parse::<usize>().is_ok() => Device::Cuda(n.parse().unwrap_or(0)),
        _ => {
            return Err(Error::Input(format!(
                "device `{name}`: expected cpu, cuda or cuda:N"
            )));
        }
    };
    if let Device::Cuda(n) = device {
        let found = if tch::Cuda::is_available() {
            tch::Cuda::device_count()
        } else {
            0
        };
        if n as i64 >= found {
            return Err(Error::Input(format!(
                "device `{name}`: this libtorch sees {found} CUDA devices; use --device cpu, or a libtorch with CUDA (LIBTORCH) on a machine with a GPU"
            )));
        }
    }
    Ok(device)
}

fn beside(out: &Path, extension: &str) -> PathBuf {
    out.with_extension(extension)
}
