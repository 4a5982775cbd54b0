//! `m4gn tutorial`: the cases of openfoam/tutorials, run where the user is.

use m4gn_base::{Error, Result, plugin, refuse};
use m4gn_workbench::generate::openfoam::absolute;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

/// Run a tutorial: cylinder
///
/// The cases, their logs and the comparisons are in DIR/NAME. Needs OpenFOAM and gmsh.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Its name
    #[arg(value_name = "NAME")]
    name: String,
    /// Folder for the cases
    #[arg(long, value_name = "DIR", default_value = "run")]
    out: PathBuf,
    /// Options of the tutorial, behind --; --help lists them
    #[arg(last = true, value_name = "OPTION")]
    options: Vec<OsString>,
}

pub fn run(args: Args) -> Result<()> {
    let (folders, names) = plugin::shipped("openfoam/tutorials", "Allrun");
    let script = folders.iter().map(|f| f.join(&args.name).join("Allrun")).find(|f| f.is_file());
    let Some(script) = script.filter(|_| !args.name.contains('/')) else {
        return Err(Error::Input(format!("'{}' is no tutorial: expected {}", args.name, names.join(", "))));
    };
    let status = Command::new(&script)
        .args(&args.options)
        .env("M4GN_RUN", absolute(&args.out)?)
        .status()
        .map_err(Error::cannot("run", &script))?;
    refuse(!status.success(), Error::Input, || format!("tutorial {}: {status}, as told above", args.name))
}
