//! Deforming plates and beams: a case is a request that the Python package `tools/m4gn_solids` answers.
//!
//! The package runs in an environment of its own, which `setup/solids.sh` makes outside the checkout. It draws the
//! parameters (again, where a draw has no quasi-static path), meshes with gmsh, simulates with FElupe and records.

use super::case::{put, whole};
use super::process::Surroundings;
use super::queue::{Case, other_number};
use m4gn_base::plugin::folder_variable;
use m4gn_base::{Error, Result, listed};
use m4gn_data::{Split, Trajectory};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// What is deformed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Hyperelastic plates with one to three holes: tetrahedra.
    DeformingPlate,
    /// Nearly incompressible neo-Hookean beams: wedges.
    DeformingBeam,
}

impl Family {
    /// Name on the command line and in provenance.
    pub fn name(self) -> &'static str {
        match self {
            Family::DeformingPlate => "deforming-plate",
            Family::DeformingBeam => "deforming-beam",
        }
    }

    /// Points of a body of the paper's sets, about.
    pub fn usual_points(self, large: bool) -> u32 {
        match (self, large) {
            (Family::DeformingPlate, _) => 1271,
            (Family::DeformingBeam, false) => 1542,
            (Family::DeformingBeam, true) => 4540,
        }
    }
}

/// Poisson's ratio of a body unless another one is asked for.
pub const POISSON: f64 = 0.4;

/// Everything that makes a case.
#[derive(Clone, Debug)]
pub struct Request {
    /// What is deformed.
    pub family: Family,
    /// Beams of twice the length.
    pub large: bool,
    /// Seed of the set.
    pub seed: u64,
    /// Number of the case in the set.
    pub index: u64,
    /// About how many points the body has; None: as many as in the paper.
    pub points: Option<u32>,
    /// Poisson's ratio of its material.
    pub poisson: f64,
    /// What the trajectory is for.
    pub split: Split,
    /// Frames after the first one.
    pub frames: u32,
    /// Time between frames, s; quasi-static, so that it only scales velocities.
    pub interval: f64,
    /// The command, for provenance.
    pub command: String,
    /// Python of the environment.
    pub python: String,
}

impl Request {
    fn write(&self, folder: &Path) -> Result<()> {
        let request = serde_json::json!({
            "family": self.family.name(), "large": self.large, "seed": self.seed, "index": self.index,
            "points": self.points, "poisson": self.poisson, "split": self.split, "frames": self.frames, "interval": self.interval,
            "command": self.command,
        });
        put(&folder.join("case.json"), request.to_string())
    }
}

impl Case for Request {
    /// The object of its `result.json`, as it is.
    type Figures = Map<String, Value>;

    fn index(&self) -> u64 {
        self.index
    }

    fn run(&self, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Map<String, Value>)> {
        self.write(folder)?;
        tools.run(folder, &[self.python.as_str(), "-m", "m4gn_solids"])?;
        let result = folder.join("result.json");
        let figures =
            std::fs::read_to_string(&result).map_err(Error::cannot("read", &result)).and_then(|text| {
                serde_json::from_str(&text)
                    .map_err(|e| Error::file(&result, format!("is not what was expected: {e}")))
            })?;
        let recorded = folder.join("trajectory.h5");
        whole(&recorded, self.frames)?;
        Ok((recorded, figures))
    }

    fn compare(&self, existing: &Path) -> Result<(Split, Option<String>)> {
        let trajectory = Trajectory::open(existing)?;
        let provenance = trajectory.provenance();
        let family = &provenance["family"];
        let points = &provenance["parameters"]["body"]["points"];
        let wanted = self.points.unwrap_or(self.family.usual_points(self.large));
        let difference = if family != self.family.name() {
            Some(format!("family {family} instead of \"{}\"", self.family.name()))
        } else if provenance["large"] != self.large {
            Some(format!("large {} instead of {}", provenance["large"], self.large))
        } else if *points != wanted {
            Some(format!("about {points} points instead of {wanted}"))
        } else {
            let mut provenance = provenance.clone();
            if provenance["poisson"].is_null() {
                // What all bodies had before it could be chosen.
                provenance["poisson"] = POISSON.into();
            }
            let numbers = [
                ("poisson", self.poisson),
                ("seed", self.seed as f64),
                ("index", self.index as f64),
                ("frames", f64::from(self.frames)),
                ("interval", self.interval),
            ];
            other_number(&provenance, &numbers)
        };
        Ok((trajectory.split(), difference))
    }
}

/// The Python with FElupe: the one that `M4GN_SOLIDS_PYTHON` names, or that `setup/solids.sh` made in the cache.
///
/// # Errors
/// [`Error::Input`] that says where it was looked for.
pub fn find_python() -> Result<String> {
    let cache = folder_variable("M4GN_CACHE")
        .or_else(|| Some(folder_variable("XDG_CACHE_HOME")?.join("m4gn")))
        .or_else(|| Some(folder_variable("HOME")?.join(".cache/m4gn")));
    let places: Vec<PathBuf> = folder_variable("M4GN_SOLIDS_PYTHON")
        .into_iter()
        .chain(cache.map(|c| c.join("solids/bin/python")))
        .collect();
    let found = places.iter().find(|p| p.is_file()).and_then(|p| p.to_str());
    found.map(str::to_string).ok_or_else(|| {
        Error::Input(format!(
            "the Python environment with FElupe is not there (looked for {}): 'setup/solids.sh' makes it, once, with \
             a network",
            listed(places.iter().map(|p| p.display()))
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Request {
        Request {
            family: Family::DeformingBeam,
            large: false,
            seed: 5,
            index: 2,
            points: None,
            poisson: 0.3,
            split: Split::Valid,
            frames: 3,
            interval: 0.5,
            command: "m4gn generate".into(),
            python: String::new(),
        }
    }

    #[test]
    fn the_request_says_everything() {
        let dir = tempfile::tempdir().unwrap();
        request().write(&dir.path().join("new")).unwrap();
        let text = std::fs::read_to_string(dir.path().join("new/case.json")).unwrap();
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        let expected = serde_json::json!({
            "family": "deforming-beam", "large": false, "seed": 5, "index": 2, "points": null, "poisson": 0.3,
            "split": "valid", "frames": 3, "interval": 0.5, "command": "m4gn generate",
        });
        assert_eq!(found, expected);
    }

    /// The trajectory of the tests was not generated: it differs, and says in what.
    #[test]
    fn other_trajectories_are_told_apart() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/solid.h5");
        let (split, difference) = request().compare(Path::new(file)).unwrap();
        assert_eq!(split, Split::Test);
        assert_eq!(difference.unwrap(), "family \"bar\" instead of \"deforming-beam\"");
        assert!(request().compare(Path::new("/nowhere.h5")).is_err());
    }
}
