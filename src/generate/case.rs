//! OpenFOAM cases from nothing to a trajectory: files from templates, a cylinder's tools, the check of what was recorded.

use super::cylinder::{CaseFiles, RECORDING};
use super::process::Surroundings;
use super::queue::Case;
use crate::dataset::{Split, Trajectory};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Programs that a case needs, in the order of their use.
pub const PROGRAMS: [&str; 4] = ["gmsh", "gmshToFoam", "changeDictionary", "icoFoam"];

/// What there is to say about a trajectory that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Figures {
    /// Number of cells.
    pub cells: usize,
    /// Number of frames.
    pub frames: usize,
    /// Largest Courant number that the solver reported.
    pub courant: Option<f64>,
}

impl Case for CaseFiles {
    type Figures = Figures;

    fn index(&self) -> u64 {
        self.index
    }

    fn split(&self) -> Split {
        self.split
    }

    fn run(&self, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Figures)> {
        run(self, folder, tools)
    }

    fn compare(&self, existing: &Path) -> Result<(Split, Option<String>)> {
        let trajectory = Trajectory::open(existing)?;
        Ok((trajectory.split(), self.difference(trajectory.provenance())))
    }
}

fn run(files: &CaseFiles, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Figures)> {
    files.write(folder)?;
    tools.run(
        folder,
        "gmsh",
        &["-nt", "1", "-3", "-format", "msh2", "-o", "mesh.msh", "mesh.geo"],
    )?;
    tools.run(folder, "gmshToFoam", &["mesh.msh"])?;
    tools.run(folder, "changeDictionary", &["-constant"])?;
    tools.run(folder, "icoFoam", &[])?;

    let (path, trajectory) = recorded(folder, RECORDING, files.frames, "icoFoam")?;
    let figures = Figures {
        cells: trajectory.mesh().n_cells(),
        frames: trajectory.times().len(),
        courant: largest_courant(&folder.join("log.icoFoam")),
    };
    Ok((path, figures))
}

/// Writes the template's text to `folder/name`, each `@key@` replaced by its value.
///
/// # Errors
/// [`Error::File`] when it cannot be written.
pub(super) fn fill(folder: &Path, name: &str, template: &str, values: &[(&str, String)]) -> Result<()> {
    let path = folder.join(name);
    let failed = |e: std::io::Error| Error::file(&path, format!("cannot be written: {e}"));
    let mut text = template.to_string();
    for (key, value) in values {
        text = text.replace(&format!("@{key}@"), value);
    }
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent).map_err(failed)?;
    }
    std::fs::write(&path, text).map_err(failed)
}

/// The trajectory `folder/name` that `solver` left, which must have `frames` frames after its first.
///
/// # Errors
/// [`Error::File`] when there is none, or one of another length.
pub(super) fn recorded(
    folder: &Path,
    name: &str,
    frames: u32,
    solver: &str,
) -> Result<(PathBuf, Trajectory)> {
    let path = folder.join(name);
    if !path.is_file() {
        return Err(Error::file(
            folder.join(format!("log.{solver}")),
            format!(
                "{solver} ended without a recording: the function object m4gnHarvest (libm4gnFoam.so) did not run"
            ),
        ));
    }
    let trajectory = Trajectory::open(&path)?;
    let (found, expected) = (trajectory.times().len(), frames as usize + 1);
    if found != expected {
        return Err(Error::file(
            &path,
            format!("{found} frames were recorded, expected {expected}"),
        ));
    }
    Ok((path, trajectory))
}

/// Largest of the solver's "Courant Number mean: ... max: ..." lines.
fn largest_courant(log: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(log).ok()?;
    text.lines()
        .filter_map(|l| {
            l.strip_prefix("Courant Number")?
                .rsplit("max:")
                .next()?
                .trim()
                .parse()
                .ok()
        })
        .max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_courant_number_is_read_from_the_log() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("log");
        std::fs::write(
            &log,
            "Time = 1\nCourant Number mean: 0.1 max: 0.7\nCourant Number mean: 0.2 max: 0.65\n",
        )
        .unwrap();
        assert_eq!(largest_courant(&log), Some(0.7));
        assert_eq!(largest_courant(&dir.path().join("none")), None);
    }
}
