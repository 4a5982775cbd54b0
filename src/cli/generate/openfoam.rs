//! What OpenFOAM's tools need to run for a data set.

use super::super::{library_path, library_places};
use super::{absolute, one_thread};
use crate::generate::process::find_program;
use crate::{Error, Result};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What the tools need: OpenFOAM's folder, and our libraries for the function object.
pub(super) fn environment(programs: &[&str]) -> Result<Vec<(String, OsString)>> {
    let missing: Vec<&str> = programs
        .iter()
        .copied()
        .filter(|p| find_program(p).is_none())
        .collect();
    if !missing.is_empty() {
        return Err(Error::Input(format!(
            "{} not found in PATH: install OpenFOAM and gmsh (Debian: apt-get install openfoam gmsh), or source your \
             OpenFOAM's etc/bashrc; 'm4gn doctor' says more",
            missing.join(", ")
        )));
    }
    library_path("libm4gnFoam.so")?;
    let mut places: Vec<PathBuf> = library_places();
    places.extend(
        std::env::var_os("LD_LIBRARY_PATH")
            .iter()
            .flat_map(std::env::split_paths),
    );
    let libraries = std::env::join_paths(places).map_err(|e| {
        Error::Input(format!(
            "the folder of the libraries cannot be in LD_LIBRARY_PATH: {e}"
        ))
    })?;
    let mut variables = one_thread();
    variables.push(("LD_LIBRARY_PATH".to_string(), libraries));
    if std::env::var_os("WM_PROJECT_DIR").is_none_or(|v| v.is_empty()) {
        variables.push((
            "WM_PROJECT_DIR".to_string(),
            super::super::doctor::DEBIAN_OPENFOAM.into(),
        ));
    }
    Ok(variables)
}

/// The folder's full path, which OpenFOAM can only use without blanks and quotes.
pub(super) fn plain_path(folder: &Path) -> Result<PathBuf> {
    let path = absolute(folder)?;
    let usable = path
        .to_str()
        .is_some_and(|p| !p.contains(|c: char| c.is_whitespace() || "\"'\\${};".contains(c)));
    if !usable {
        return Err(Error::file(
            path,
            "OpenFOAM cannot work in folders with blanks, quotes or $ in their path: choose another",
        ));
    }
    Ok(path)
}
