//! One cylinder case from nothing to a trajectory: mesh, patches, solver, check.

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

    let recorded = folder.join(RECORDING);
    if !recorded.is_file() {
        return Err(Error::file(
            folder.join("log.icoFoam"),
            "icoFoam ended without a recording: the function object m4gnHarvest (libm4gnFoam.so) did not run",
        ));
    }
    let trajectory = Trajectory::open(&recorded)?;
    let (found, expected) = (trajectory.times().len(), files.frames as usize + 1);
    if found != expected {
        return Err(Error::file(
            &recorded,
            format!("{found} frames were recorded, expected {expected}"),
        ));
    }
    let figures = Figures {
        cells: trajectory.mesh().n_cells(),
        frames: found,
        courant: largest_courant(&folder.join("log.icoFoam")),
    };
    Ok((recorded, figures))
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
