//! How a command runs a network on recorded trajectories.

use m4gn_base::{Result, settings};
use m4gn_model::Resolution;
use m4gn_step::{Backend, SessionOptions};

/// Options that commands have in common.
#[derive(Debug, clap::Args)]
pub struct Running {
    #[arg(long, default_value = "native", help = SessionOptions::table().help("backend"))]
    backend: String,
    /// Threads
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    #[arg(long, default_value = "model", help = SessionOptions::table().help("precision"))]
    precision: String,
    #[arg(long, default_value = "auto", help = SessionOptions::table().help("resolution"))]
    resolution: Resolution,
}

impl Running {
    /// The options of a session.
    pub fn options(&self) -> Result<SessionOptions> {
        Ok(SessionOptions {
            backend: Backend::parse(&self.backend)?,
            n_threads: self.threads,
            precision: settings::read("precision", &self.precision.as_str().into())?,
            resolution: self.resolution,
            ..SessionOptions::default()
        })
    }
}
