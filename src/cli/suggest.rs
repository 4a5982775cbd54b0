//! `m4gn suggest`: a training configuration for a data set.

use super::claim_outputs;
use m4gn_base::files::write_whole;
use m4gn_base::{Error, Result};
use std::path::PathBuf;

/// Write a training configuration for a data set: fields, stride and noise from its frames, width from the time that there is
///
/// The file says where what depends on the data comes from, and is a start: change what you know better. A training by it takes its minutes.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of trajectories (*.h5), or one trajectory
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Time of the training, minutes
    #[arg(long, value_name = "M", default_value_t = 60.0, value_parser = crate::number::above_zero)]
    minutes: f64,
    /// Configuration (*.toml) to write, which must not be there yet
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub fn run(args: Args) -> Result<()> {
    let _claimed = claim_outputs([Some(&*args.out)], [Some(&*args.data)])?;
    // It may have been edited since it was suggested
    if args.out.exists() {
        return Err(Error::file(&args.out, "is there already: give another --out, or delete it"));
    }
    let suggestion = m4gn_workbench::suggest::suggest(&args.data, args.minutes)?;
    for line in &suggestion.seen {
        println!("{line}");
    }
    write_whole(&args.out, suggestion.text.as_bytes())?;
    println!("m4gn train --data {:?} --config {:?} --out MODEL.safetensors", args.data, args.out);
    Ok(())
}
