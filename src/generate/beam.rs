//! Free vibration of a clamped beam with OpenFOAM's solidDisplacementFoam: what is drawn, and the case.
//!
//! 0.6 m x 0.06 m in plane stress, E 1 MPa, nu 0.3, rho 1000 kg/m^3, clamped at one end and free elsewhere. The
//! motion begins as a mixture of the first three bending modes, each with an amplitude and a phase of its own.

use super::case::{fill, recorded};
use super::process::Surroundings;
use super::queue::{Case, other_number};
use crate::Result;
use crate::dataset::{Split, Trajectory};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Programs that a case needs, in the order of their use.
pub const PROGRAMS: [&str; 3] = ["blockMesh", "setExprFields", "solidDisplacementFoam"];

/// Time step of the solver, s. Euler's damping takes 8 % of the first mode's amplitude in five periods.
pub const DELTA_T: f64 = 1e-3;
/// Time between frames, s.
pub const INTERVAL: f64 = 0.01;
/// Time of the first frame, s: what the modes of a beam without shear leave of fast waves has decayed.
pub const FIRST: f64 = 0.02;
/// Largest tip displacement of each mode, m.
pub const AMPLITUDES: [f64; 3] = [0.025, 2e-3, 3e-4];
/// Roots of cos(b) cosh(b) = -1.
const ROOTS: [f64; 3] = [1.8751040687, 4.6940911330, 7.8547574382];

/// Angular frequencies of a beam without shear (Euler-Bernoulli), 1/s: `(b/L)^2 sqrt(E I/(rho A))`.
pub fn angular_frequencies() -> [f64; 3] {
    let (length, height, youngs, density) = (0.6f64, 0.06f64, 1e6f64, 1000f64);
    let stiffness = (youngs / density * height * height / 12.0).sqrt();
    ROOTS.map(|b| (b / length).powi(2) * stiffness)
}

/// What is drawn for one case; multiples of 1e-9, so that their text is exact.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Parameters {
    /// Amplitude of each mode at the tip, m.
    pub amplitude: [f64; 3],
    /// Phase of each mode at time 0, rad: the displacement is `amplitude cos(phase)`.
    pub phase: [f64; 3],
}

impl Parameters {
    /// Case `index` of the set `seed`: the same whatever else is drawn.
    pub fn draw(seed: u64, index: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(index);
        let mut uniform = |high: f64| (random.random_range(0.0..=high) * 1e9).round() / 1e9;
        Parameters {
            amplitude: AMPLITUDES.map(&mut uniform),
            phase: [TAU; 3].map(&mut uniform),
        }
    }

    /// Displacement of the tip in each mode at time 0 and one time step before it, m.
    pub fn start(&self) -> [[f64; 3]; 2] {
        let frequencies = angular_frequencies();
        [0.0, -DELTA_T].map(|time| {
            std::array::from_fn(|k| self.amplitude[k] * (frequencies[k] * time + self.phase[k]).cos())
        })
    }
}

/// Everything that makes a case's files.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamFiles {
    /// Seed of the set.
    pub seed: u64,
    /// Number of the case in the set.
    pub index: u64,
    /// What was drawn.
    pub parameters: Parameters,
    /// What the trajectory is for.
    pub split: Split,
    /// Frames after the first one.
    pub frames: u32,
    /// The command, for provenance.
    pub command: String,
}

/// The case's files as they are in openfoam/templates; `0/D` serves for `0/D_0` as well.
const TEMPLATES: [(&str, &str); 9] = [
    ("0/D", include_str!("../../openfoam/templates/vibratingBeam/0/D")),
    (
        "0/D_0",
        include_str!("../../openfoam/templates/vibratingBeam/0/D"),
    ),
    (
        "constant/mechanicalProperties",
        include_str!("../../openfoam/templates/vibratingBeam/constant/mechanicalProperties"),
    ),
    (
        "constant/thermalProperties",
        include_str!("../../openfoam/templates/vibratingBeam/constant/thermalProperties"),
    ),
    (
        "system/blockMeshDict",
        include_str!("../../openfoam/templates/vibratingBeam/system/blockMeshDict"),
    ),
    (
        "system/controlDict",
        include_str!("../../openfoam/templates/vibratingBeam/system/controlDict"),
    ),
    (
        "system/fvSchemes",
        include_str!("../../openfoam/templates/vibratingBeam/system/fvSchemes"),
    ),
    (
        "system/fvSolution",
        include_str!("../../openfoam/templates/vibratingBeam/system/fvSolution"),
    ),
    (
        "system/setExprFieldsDict",
        include_str!("../../openfoam/templates/vibratingBeam/system/setExprFieldsDict"),
    ),
];

/// Name of the recording inside the case.
const RECORDING: &str = "trajectory.h5";

/// What there is to say about a trajectory that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Figures {
    /// Number of cells.
    pub cells: usize,
    /// Number of frames.
    pub frames: usize,
}

impl BeamFiles {
    /// What the templates' `@name@` stand for in the file of this name.
    fn values(&self, file: &str) -> Vec<(&'static str, String)> {
        let [now, before] = self.parameters.start().map(|d| d.map(|v| format!("{v:.12e}")));
        let [d1, d2, d3] = now;
        let [o1, o2, o3] = before;
        vec![
            ("field", file.rsplit('/').next().unwrap_or(file).to_string()),
            ("d1", d1),
            ("d2", d2),
            ("d3", d3),
            ("o1", o1),
            ("o2", o2),
            ("o3", o3),
            ("deltaT", DELTA_T.to_string()),
            // Half a step off, so that rounding of the times does not matter
            ("timeStart", (FIRST - 0.5 * DELTA_T).to_string()),
            ("endTime", (FIRST + f64::from(self.frames) * INTERVAL).to_string()),
            ("writeInterval", (INTERVAL / DELTA_T).round().to_string()),
            ("file", RECORDING.to_string()),
            ("split", self.split.name().to_string()),
            ("provenance", self.provenance()),
        ]
    }

    /// Entries of the dictionary that m4gnHarvest keeps with the data.
    fn provenance(&self) -> String {
        let command = format!("            {:<15} \"{}\";", "command", self.command);
        let family = format!("            {:<15} vibrating-beam;", "family");
        let numbers = self
            .numbers()
            .map(|(key, value)| format!("            {key:<15} {value};"));
        [command, family]
            .into_iter()
            .chain(numbers)
            .collect::<Vec<_>>()
            .join("\n")
    }

    fn numbers(&self) -> [(&'static str, f64); 9] {
        let p = &self.parameters;
        [
            ("seed", self.seed as f64),
            ("index", self.index as f64),
            ("amplitude1", p.amplitude[0]),
            ("amplitude2", p.amplitude[1]),
            ("amplitude3", p.amplitude[2]),
            ("phase1", p.phase[0]),
            ("phase2", p.phase[1]),
            ("phase3", p.phase[2]),
            ("frames", f64::from(self.frames)),
        ]
    }

    /// Writes the case into a new folder.
    ///
    /// # Errors
    /// [`crate::Error::File`] when the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        TEMPLATES
            .iter()
            .try_for_each(|(name, template)| fill(folder, name, template, &self.values(name)))
    }
}

impl Case for BeamFiles {
    type Figures = Figures;

    fn index(&self) -> u64 {
        self.index
    }

    fn split(&self) -> Split {
        self.split
    }

    fn run(&self, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Figures)> {
        self.write(folder)?;
        for program in PROGRAMS {
            tools.run(folder, program, &[])?;
        }
        let (path, trajectory) = recorded(folder, RECORDING, self.frames, "solidDisplacementFoam")?;
        let figures = Figures {
            cells: trajectory.mesh().n_cells(),
            frames: trajectory.times().len(),
        };
        Ok((path, figures))
    }

    fn compare(&self, existing: &Path) -> Result<(Split, Option<String>)> {
        let trajectory = Trajectory::open(existing)?;
        Ok((
            trajectory.split(),
            other_number(trajectory.provenance(), &self.numbers()),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_mode_has_0_851_hertz_and_the_others_the_ratios_of_a_cantilever() {
        let f = angular_frequencies().map(|w| w / TAU);
        assert!((f[0] - 0.8513).abs() < 1e-4, "{f:?}");
        assert!(
            (f[1] / f[0] - 6.2669).abs() < 1e-3 && (f[2] / f[0] - 17.5475).abs() < 1e-3,
            "{f:?}"
        );
    }

    #[test]
    fn a_draw_is_a_place_on_each_modes_circle() {
        for index in 0..200 {
            let p = Parameters::draw(7, index);
            assert_eq!(p, Parameters::draw(7, index));
            let [now, before] = p.start();
            for k in 0..3 {
                let omega = angular_frequencies()[k];
                let rate = (now[k] - before[k]) / DELTA_T;
                // The backward difference is the rate half a step earlier
                let middle = -p.amplitude[k] * omega * (p.phase[k] - 0.5 * omega * DELTA_T).sin();
                assert!((rate - middle).abs() < 1e-3 * AMPLITUDES[k] * omega, "{p:?}");
                assert!(
                    p.amplitude[k] <= AMPLITUDES[k] && now[k].abs() <= p.amplitude[k],
                    "{p:?}"
                );
            }
        }
        assert_ne!(Parameters::draw(7, 0), Parameters::draw(7, 1));
        assert_ne!(Parameters::draw(7, 0), Parameters::draw(8, 0));
    }

    #[test]
    fn every_placeholder_is_filled() {
        let dir = tempfile::tempdir().unwrap();
        let case = BeamFiles {
            seed: 3,
            index: 4,
            parameters: Parameters::draw(3, 4),
            split: Split::Valid,
            frames: 128,
            command: "m4gn generate".into(),
        };
        case.write(dir.path()).unwrap();
        let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
        for (name, _) in TEMPLATES {
            assert!(!read(name).contains('@'), "{name}: {}", read(name));
        }
        assert!(read("0/D_0").contains("object      D_0;"));
        assert!(read("system/controlDict").contains("endTime         1.3;"));
    }
}
