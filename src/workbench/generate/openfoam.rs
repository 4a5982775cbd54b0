//! What OpenFOAM's tools need to run: programs in PATH, our libraries, a folder that OpenFOAM can work in.

use super::process::{Surroundings, find_program};
use m4gn_base::plugin::{find, folder_variable, places};
use m4gn_base::{Error, Result, listed, refuse};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU8;
use std::time::Duration;

/// Where Debian's package keeps OpenFOAM's `etc`.
const DEBIAN_OPENFOAM: &str = "/usr/share/openfoam";

/// Variables for the tools: OpenFOAM's folder, and our libraries for the function objects; one thread a program.
///
/// # Errors
/// [`Error::Input`] that names the programs that are missing; [`Error::File`] without libm4gnFoam.so.
pub fn environment(programs: &[&str]) -> Result<Vec<(String, OsString)>> {
    let missing = listed(programs.iter().filter(|p| !p.contains('/') && find_program(p).is_none()));
    refuse(!missing.is_empty(), Error::Input, || {
        format!(
            "{missing} not found in PATH: install OpenFOAM and gmsh (Debian: apt-get install openfoam gmsh), or source your \
             OpenFOAM's etc/bashrc; docs/how-to/build-solids4foam.md says where solids4Foam comes from"
        )
    })?;
    find(
        "libm4gnFoam.so",
        "./Allrun builds it, and the package m4gn-openfoam of your OpenFOAM's version has it",
    )?;
    let mut places: Vec<PathBuf> = places();
    places.extend(std::env::var_os("LD_LIBRARY_PATH").iter().flat_map(std::env::split_paths));
    let libraries = std::env::join_paths(places).map_err(|e| {
        Error::Input(format!("the folder of the libraries cannot be in LD_LIBRARY_PATH: {e}"))
    })?;
    let mut variables = one_thread();
    variables.push(("LD_LIBRARY_PATH".to_string(), libraries));
    if folder_variable("WM_PROJECT_DIR").is_none() {
        variables.push(("WM_PROJECT_DIR".to_string(), DEBIAN_OPENFOAM.into()));
    }
    Ok(variables)
}

/// Conditions of programs of a case that is any user's: a solver of more ranks than there are cores is slow, and not refused. Ranks are not bound to
/// cores unless the user's environment says so: several cases run at once, and Open MPI would bind the ranks of each to the same first ones.
///
/// # Errors
/// As [`environment`] of `foamDictionary`.
pub fn surroundings(stop: &'static AtomicU8, timeout: Duration) -> Result<Surroundings> {
    let mut environment = environment(&["foamDictionary"])?;
    environment.push(("OMPI_MCA_rmaps_base_oversubscribe".into(), "1".into()));
    // Of its versions to 4, and from 5 on
    let policies = [
        ("OMPI_MCA_hwloc_base_binding_policy", "none"),
        ("PRTE_MCA_hwloc_default_binding_policy", "none"),
        ("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe"),
    ];
    let unset = policies.into_iter().filter(|(name, _)| std::env::var_os(name).is_none());
    environment.extend(unset.map(|(name, policy)| (name.to_string(), policy.into())));
    Ok(Surroundings { stop, timeout, asks: false, environment })
}

/// A folder of its own, which goes with what is returned.
///
/// # Errors
/// [`Error::Input`] where there is no place for it.
pub fn scratch() -> Result<tempfile::TempDir> {
    tempfile::tempdir().map_err(|e| {
        Error::Input(format!(
            "there is no place for temporary files: {e}; TMPDIR says where copies of cases go"
        ))
    })
}

/// One thread a program: several cases run at once.
pub fn one_thread() -> Vec<(String, OsString)> {
    ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"].map(|name| (name.to_string(), "1".into())).to_vec()
}

/// The folder's full path, which OpenFOAM can only use without blanks and quotes.
///
/// # Errors
/// [`Error::File`] where OpenFOAM cannot use it.
pub fn plain_path(folder: &Path) -> Result<PathBuf> {
    let path = absolute(folder)?;
    let usable =
        path.to_str().is_some_and(|p| !p.contains(|c: char| c.is_whitespace() || "\"'\\${};".contains(c)));
    if !usable {
        return Err(Error::file(
            path,
            "OpenFOAM cannot work in folders with blanks, quotes or $ in their path: choose another",
        ));
    }
    Ok(path)
}

/// Whether a folder, which need not be there yet, is another one or lies in it, links followed.
pub fn lies_in(folder: &Path, other: &Path) -> bool {
    let Ok(other) = other.canonicalize() else { return false };
    let real = folder.ancestors().find_map(|existing| existing.canonicalize().ok());
    real.is_some_and(|real| real.starts_with(other))
}

/// The folder's full path.
///
/// # Errors
/// [`Error::File`] where it is none.
pub fn absolute(folder: &Path) -> Result<PathBuf> {
    std::path::absolute(folder).map_err(|e| Error::file(folder, format!("is no path: {e}")))
}
