//! Flow around a cylinder in a channel, as the CylinderFlow set of the paper: what is drawn, and the case's files.
//!
//! Channel 1.6 m x 0.41 m, one cell thick; parabolic inlet of centreline speed u0, no slip at walls and cylinder,
//! fixed pressure at the outlet; nu = 1e-3 m^2/s. The ranges are those of the set (Reynolds numbers of the mean
//! inlet speed and the diameter between 42 and 205, so that most but not all wakes shed vortices).

use crate::Result;
use crate::dataset::Split;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

/// Height of the channel, m.
pub const HEIGHT: f64 = 0.41;
/// Kinematic viscosity, m^2/s.
pub const NU: f64 = 1e-3;
/// Largest Courant number that the time step aims at.
const COURANT: f64 = 0.8;

/// Refinement of the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum MeshSize {
    /// About 900 triangles.
    Coarse,
    /// About 1750 triangles: 1900 points in the extruded mesh, 1900 graph nodes.
    Standard,
    /// About 3600 triangles: 1900 points in the plane.
    Fine,
}

impl MeshSize {
    /// Name on the command line and in provenance.
    pub fn name(self) -> &'static str {
        match self {
            MeshSize::Coarse => "coarse",
            MeshSize::Standard => "standard",
            MeshSize::Fine => "fine",
        }
    }

    /// Edge length at the ends of the channel, m; at the cylinder it is about a third.
    pub fn edge(self) -> f64 {
        match self {
            MeshSize::Coarse => 0.058,
            MeshSize::Standard => 0.0408,
            MeshSize::Fine => 0.0286,
        }
    }
}

/// What is drawn for one case; multiples of 1e-6, so that their text is exact.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Parameters {
    /// Centre of the cylinder, m.
    pub x: f64,
    /// Centre of the cylinder above the lower wall, m.
    pub y: f64,
    /// Radius, m.
    pub radius: f64,
    /// Inlet speed on the centreline, m/s.
    pub u0: f64,
}

impl Parameters {
    /// Case `index` of the set `seed`: the same whatever else is drawn.
    pub fn draw(seed: u64, index: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(index);
        let mut uniform = |low: f64, high: f64| (random.random_range(low..=high) * 1e6).round() / 1e6;
        Parameters {
            x: uniform(0.2, 0.45),
            y: uniform(0.13, 0.28),
            radius: uniform(0.035, 0.07),
            u0: uniform(0.9, 2.2),
        }
    }

    /// Reynolds number of the mean inlet speed and the diameter.
    pub fn reynolds(&self) -> f64 {
        2.0 / 3.0 * self.u0 * 2.0 * self.radius / NU
    }

    /// Solver steps in `interval` seconds, so that the Courant number stays below 0.8 and the step is a short decimal.
    pub fn steps(&self, mesh: MeshSize, interval: f64) -> u32 {
        // The fastest flow is beside the cylinder, where cells are smallest. With this factor the solver reported at
        // most 0.38 to 0.83 over the whole run of 110 cases on the standard mesh.
        let courant_per_second = 9.5 * self.u0 / mesh.edge() / (1.0 - 2.0 * self.radius / HEIGHT);
        let least = interval * courant_per_second / COURANT;
        let nice = [1, 2, 4, 5, 8, 10, 16, 20, 25, 32, 40, 50];
        nice.into_iter()
            .find(|&n| f64::from(n) >= least)
            .unwrap_or(least.ceil() as u32)
    }
}

/// Everything that makes a case's files.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseFiles {
    /// Seed of the set.
    pub seed: u64,
    /// Number of the case in the set.
    pub index: u64,
    /// What was drawn.
    pub parameters: Parameters,
    /// Refinement.
    pub mesh: MeshSize,
    /// What the trajectory is for.
    pub split: Split,
    /// Frames after the first one.
    pub frames: u32,
    /// Time between frames, s.
    pub interval: f64,
    /// Time of the first frame, s: the flow has left its impulsive start behind.
    pub spin_up: f64,
    /// The command, for provenance.
    pub command: String,
}

/// The case's files as they are in openfoam/templates.
const TEMPLATES: [(&str, &str); 8] = [
    (
        "mesh.geo",
        include_str!("../../openfoam/templates/cylinderFlow/mesh.geo"),
    ),
    ("0/U", include_str!("../../openfoam/templates/cylinderFlow/0/U")),
    ("0/p", include_str!("../../openfoam/templates/cylinderFlow/0/p")),
    (
        "constant/transportProperties",
        include_str!("../../openfoam/templates/cylinderFlow/constant/transportProperties"),
    ),
    (
        "system/controlDict",
        include_str!("../../openfoam/templates/cylinderFlow/system/controlDict"),
    ),
    (
        "system/fvSchemes",
        include_str!("../../openfoam/templates/cylinderFlow/system/fvSchemes"),
    ),
    (
        "system/fvSolution",
        include_str!("../../openfoam/templates/cylinderFlow/system/fvSolution"),
    ),
    (
        "system/changeDictionaryDict",
        include_str!("../../openfoam/templates/cylinderFlow/system/changeDictionaryDict"),
    ),
];

/// Name of the recording inside the case.
pub const RECORDING: &str = "trajectory.h5";

impl CaseFiles {
    /// What the templates' `@name@` stand for.
    fn values(&self) -> Vec<(&'static str, String)> {
        let p = &self.parameters;
        let steps = p.steps(self.mesh, self.interval);
        let dt = self.interval / f64::from(steps);
        vec![
            ("x", p.x.to_string()),
            ("y", p.y.to_string()),
            ("radius", p.radius.to_string()),
            ("size", self.mesh.edge().to_string()),
            ("nu", NU.to_string()),
            // u = 4 u0 y (H - y)/H^2
            ("linear", (4.0 * p.u0 / HEIGHT).to_string()),
            ("quadratic", (-4.0 * p.u0 / (HEIGHT * HEIGHT)).to_string()),
            ("deltaT", dt.to_string()),
            // Half a step off, so that rounding of the times does not matter
            ("timeStart", (self.spin_up - 0.5 * dt).to_string()),
            (
                "endTime",
                (self.spin_up + f64::from(self.frames) * self.interval).to_string(),
            ),
            ("writeInterval", steps.to_string()),
            ("file", RECORDING.to_string()),
            ("split", self.split.name().to_string()),
            ("provenance", self.provenance()),
        ]
    }

    /// Entries of the dictionary that m4gnHarvest keeps with the data.
    fn provenance(&self) -> String {
        let p = &self.parameters;
        let entries = [
            ("command", format!("\"{}\"", self.command)),
            ("family", "cylinder-flow".to_string()),
            ("seed", self.seed.to_string()),
            ("index", self.index.to_string()),
            ("mesh", self.mesh.name().to_string()),
            ("x", p.x.to_string()),
            ("y", p.y.to_string()),
            ("radius", p.radius.to_string()),
            ("u0", p.u0.to_string()),
            ("nu", NU.to_string()),
            ("reynolds", format!("{:.1}", p.reynolds())),
            ("frames", self.frames.to_string()),
            ("frameInterval", self.interval.to_string()),
            ("spinUp", self.spin_up.to_string()),
        ];
        let lines: Vec<String> = entries
            .iter()
            .map(|(key, value)| format!("            {key:<15} {value};"))
            .collect();
        lines.join("\n")
    }

    /// Writes the case into a new folder.
    ///
    /// # Errors
    /// [`crate::Error::File`] when the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let values = self.values();
        TEMPLATES
            .iter()
            .try_for_each(|(name, template)| super::case::fill(folder, name, template, &values))
    }

    /// Whether a recorded trajectory is this case's: the first entry of its provenance that differs.
    pub fn difference(&self, provenance: &serde_json::Value) -> Option<String> {
        let p = &self.parameters;
        let numbers = [
            ("seed", self.seed as f64),
            ("index", self.index as f64),
            ("x", p.x),
            ("y", p.y),
            ("radius", p.radius),
            ("u0", p.u0),
            ("frames", f64::from(self.frames)),
            ("frameInterval", self.interval),
            ("spinUp", self.spin_up),
        ];
        let mesh = &provenance["mesh"];
        if mesh != self.mesh.name() {
            return Some(format!("mesh {mesh} instead of \"{}\"", self.mesh.name()));
        }
        super::queue::other_number(provenance, &numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_in_range_and_depend_on_seed_and_index_only() {
        let mut all = std::collections::BTreeSet::new();
        for index in 0..2000 {
            let p = Parameters::draw(7, index);
            assert_eq!(p, Parameters::draw(7, index));
            assert!(
                (0.2..=0.45).contains(&p.x) && (0.9..=2.2).contains(&p.u0),
                "{p:?}"
            );
            // At least 5 cm between the cylinder and either wall
            assert!(p.y - p.radius >= 0.05 && HEIGHT - p.y - p.radius >= 0.05, "{p:?}");
            all.insert(p.x.to_bits());
        }
        assert!(all.len() > 1980, "{} different of 2000", all.len());
        assert_ne!(Parameters::draw(8, 0), Parameters::draw(7, 0));
    }

    #[test]
    fn faster_flow_and_finer_meshes_need_more_steps() {
        let p = |u0, radius| Parameters {
            x: 0.3,
            y: 0.2,
            radius,
            u0,
        };
        let slow = p(0.9, 0.035).steps(MeshSize::Coarse, 0.01);
        let fast = p(2.2, 0.07).steps(MeshSize::Standard, 0.01);
        assert!(slow >= 2 && slow < fast, "{slow} {fast}");
        assert!(fast < p(2.2, 0.07).steps(MeshSize::Fine, 0.01));
        assert!(p(2.2, 0.07).steps(MeshSize::Fine, 1.0) > 1000);
    }

    #[test]
    fn every_placeholder_is_filled() {
        let dir = tempfile::tempdir().unwrap();
        case().write(dir.path()).unwrap();
        for (name, _) in TEMPLATES {
            let text = std::fs::read_to_string(dir.path().join(name)).unwrap();
            let left = text
                .lines()
                .find(|l| !l.trim_start().starts_with("//") && l.contains('@'));
            assert_eq!(left, None, "{name}");
        }
        let control = std::fs::read_to_string(dir.path().join("system/controlDict")).unwrap();
        assert!(control.contains("endTime         7;"), "{control}");
    }

    #[test]
    fn another_case_is_told_from_this_one() {
        let case = case();
        let p = case.parameters;
        let mut provenance = serde_json::json!({
            "seed": 3, "index": 4, "mesh": "coarse", "x": p.x, "y": p.y, "radius": p.radius, "u0": p.u0,
            "frames": 600, "frameInterval": 0.01, "spinUp": 1,
        });
        assert_eq!(case.difference(&provenance), None);
        provenance["u0"] = 5.into();
        assert!(
            case.difference(&provenance)
                .unwrap()
                .starts_with("u0 5 instead of")
        );
        assert!(case.difference(&serde_json::Value::Null).is_some());
    }

    fn case() -> CaseFiles {
        CaseFiles {
            seed: 3,
            index: 4,
            parameters: Parameters::draw(3, 4),
            mesh: MeshSize::Coarse,
            split: Split::Valid,
            frames: 600,
            interval: 0.01,
            spin_up: 1.0,
            command: "m4gn generate".into(),
        }
    }
}
