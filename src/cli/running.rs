//! How a command runs a network on recorded trajectories.

use m4gn_base::Result;
use m4gn_engine::PrecisionChoice;
use m4gn_model::Resolution;
use m4gn_step::{Backend, SessionOptions};

/// Options that commands have in common.
#[derive(Debug, clap::Args)]
pub struct Running {
    /// What runs the network: native, torch, torch:DEVICE
    #[arg(long, default_value = "native")]
    backend: String,
    /// Threads
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Of the native engine's products: model (bf16 for a model of fields at cells that was trained so, where that is faster), auto, fp32, bf16
    #[arg(long, default_value = "model")]
    precision: String,
    /// Mean distance of the network's nodes: auto (the model's own), off (a node a cell), or a length in m
    #[arg(long, default_value = "auto")]
    resolution: Resolution,
}

impl Running {
    /// The options of a session.
    ///
    /// # Errors
    /// For a backend or a precision that is none.
    pub fn options(&self) -> Result<SessionOptions> {
        Ok(SessionOptions {
            backend: Backend::parse(&self.backend)?,
            n_threads: self.threads,
            precision: PrecisionChoice::parse(&self.precision)?,
            resolution: self.resolution,
            ..SessionOptions::default()
        })
    }
}
