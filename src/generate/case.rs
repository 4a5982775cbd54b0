//! One case from nothing to a trajectory: mesh, patches, solver, check, final name.

use super::cylinder::{CaseFiles, RECORDING};
use super::process::Surroundings;
use crate::dataset::Trajectory;
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Programs that a case needs, in the order of their use.
pub const PROGRAMS: [&str; 4] = ["gmsh", "gmshToFoam", "changeDictionary", "icoFoam"];

/// A trajectory that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Made {
    /// Its file.
    pub path: PathBuf,
    /// Number of cells.
    pub cells: usize,
    /// Number of frames.
    pub frames: usize,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Largest Courant number that the solver reported.
    pub courant: Option<f64>,
}

/// Makes the trajectory `target` in the case folder `folder`, which is removed afterwards unless `keep`.
///
/// # Errors
/// [`Error::Interrupted`] when the user stops (the folder is removed); otherwise [`Error::File`], and the folder
/// with its logs stays.
pub fn make(
    files: &CaseFiles,
    folder: &Path,
    target: &Path,
    keep: bool,
    tools: &Surroundings,
) -> Result<Made> {
    let start = Instant::now();
    let result = run(files, folder, target, tools);
    let interrupted = matches!(result, Err(Error::Interrupted(_)));
    if interrupted || (result.is_ok() && !keep) {
        let _ = std::fs::remove_dir_all(folder);
    }
    result.map(|made| Made {
        seconds: start.elapsed().as_secs_f64(),
        ..made
    })
}

fn run(files: &CaseFiles, folder: &Path, target: &Path, tools: &Surroundings) -> Result<Made> {
    if folder.exists() {
        std::fs::remove_dir_all(folder)
            .map_err(|e| Error::file(folder, format!("cannot be replaced: {e}")))?;
    }
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
    let bytes = recorded.metadata().map_or(0, |m| m.len());
    let cells = trajectory.mesh().n_cells();
    std::fs::rename(&recorded, target)
        .map_err(|e| Error::file(target, format!("cannot be given its final name: {e}")))?;
    let courant = largest_courant(&folder.join("log.icoFoam"));
    Ok(Made {
        path: target.to_path_buf(),
        cells,
        frames: found,
        bytes,
        seconds: 0.0,
        courant,
    })
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
