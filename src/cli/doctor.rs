//! `m4gn doctor`: what is there, what is missing, and how to mend it.

use crate::Result;

/// Where Debian's package keeps OpenFOAM's `etc`.
pub const DEBIAN_OPENFOAM: &str = "/usr/share/openfoam";

/// Check the installation
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// When something needed is missing.
pub fn run(_: Args) -> Result<()> {
    Ok(())
}
