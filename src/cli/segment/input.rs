//! Where the mesh comes from, and where segments and modes go.

use crate::dataset::{self, Trajectory};
use crate::foam_case::{FoamCase, Stored};
use crate::mesh::{Mesh, NodeType};
use crate::model::{ModalOperator, Model, ModelSpec, SegmentMethod, SegmentSpec};
use crate::modes::{ModalOptions, ModalSolver, ModeCount};
use crate::report::{CellMap, PointCloud, write_file};
use crate::survey;
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Field of the segments; m4gnSurrogate reads it.
const SEGMENT: &str = "m4gnSegment";
/// Fields of the modes: m4gnMode1, m4gnMode2, ...
const MODE: &str = "m4gnMode";
/// What the notes of m4gn's own files begin with.
const MARK: &str = "m4gn";

/// An OpenFOAM case, or a recorded trajectory.
pub enum Input {
    /// Case.
    Case(FoamCase),
    /// Trajectory.
    Data(Trajectory),
}

impl Input {
    /// A folder with system/controlDict is a case; else a trajectory or a folder of them, whose first is taken.
    ///
    /// # Errors
    /// [`Error::Input`] for what is neither; what opening it fails with.
    pub fn open(path: &Path) -> Result<Self> {
        if path.join("system/controlDict").is_file() {
            let library = crate::cli::library_path("libm4gn_foam_bridge.so")?;
            return Ok(Input::Case(FoamCase::open(&library, path)?));
        }
        if !path.exists() {
            return Err(Error::file(
                path,
                "does not exist; expected the folder of an OpenFOAM case, a trajectory (*.h5) or a folder of them",
            ));
        }
        let files = dataset::list(path).map_err(|e| match e {
            Error::File { .. } if path.is_dir() => Error::file(
                path,
                "is neither an OpenFOAM case (there is no system/controlDict) nor a folder of trajectories (*.h5)",
            ),
            other => other,
        })?;
        Ok(Input::Data(Trajectory::open(&files[0])?))
    }

    /// For people.
    pub fn name(&self) -> String {
        match self {
            Input::Case(case) => case.description().path.clone(),
            Input::Data(trajectory) => trajectory.path().display().to_string(),
        }
    }

    /// The undecomposed mesh. `node_types` is for cases only.
    ///
    /// # Errors
    /// As [`FoamCase::mesh`]; [`Error::Input`] for node types of a trajectory, which has its own.
    pub fn mesh(&mut self, node_types: &[(String, NodeType)]) -> Result<Mesh> {
        match self {
            Input::Case(case) => case.mesh(node_types),
            Input::Data(trajectory) if node_types.is_empty() => Ok(trajectory.mesh().clone()),
            Input::Data(_) => Err(Error::Input(
                "--node-type is for cases: the node types of a trajectory were recorded with it".into(),
            )),
        }
    }

    /// Adds the modes of the elastic body to the mesh of a solid's case, if segments are to be made of them.
    ///
    /// # Errors
    /// What [`FoamCase::elastic_modes`] fails with.
    pub fn add_elastic_modes(&mut self, mesh: &mut Mesh, options: &survey::Options) -> Result<()> {
        let wanted = options.spec.operator != Some(ModalOperator::Laplacian);
        if let Input::Case(case) = self
            && wanted
        {
            let modal = ModalOptions {
                count: ModeCount::Fixed(options.spec.modes.max(1)),
                ..options.modal.clone()
            };
            mesh.elastic = case.elastic_modes(&modal)?;
        }
        Ok(())
    }

    /// The description of the model that the function object of a case names, if it names one.
    ///
    /// # Errors
    /// What reading the model fails with.
    pub fn model(&self) -> Result<Option<ModelSpec>> {
        let Some(name) = self
            .function_object()?
            .get("model")
            .and_then(Value::as_str)
            .map(PathBuf::from)
        else {
            return Ok(None);
        };
        // As the function object looks for it.
        let home = std::env::var_os("M4GN_HOME").map(PathBuf::from);
        let homes = home.iter().flat_map(|h| [h.join("models"), h.clone()]);
        let case = match self {
            Input::Case(case) => PathBuf::from(&case.description().path),
            Input::Data(_) => return Ok(None),
        };
        let found = std::iter::once(case)
            .chain(homes)
            .map(|f| f.join(&name))
            .find(|f| f.is_file());
        found.map(|file| Ok(Model::read(&file)?.spec)).transpose()
    }

    /// `spec` and `modal` with what the `segments` entry of a case's function object says.
    ///
    /// # Errors
    /// [`Error::Input`] for an entry that is no such number or word.
    pub fn dictionary(
        &self,
        mut spec: SegmentSpec,
        mut modal: ModalOptions,
    ) -> Result<(SegmentSpec, ModalOptions)> {
        let object = self.function_object()?;
        let Some(entries) = object.get("segments").and_then(Value::as_object) else {
            return Ok((spec, modal));
        };
        for (key, value) in entries {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_string);
            let wrong = |expected: &str| {
                Error::Input(format!(
                    "entry segments.{key} of the case's function object is {text}: expected {expected}"
                ))
            };
            let count = || {
                text.parse::<usize>()
                    .map_err(|_| wrong("a whole number, not negative"))
            };
            let number = || text.parse::<f64>().map_err(|_| wrong("a number"));
            match key.as_str() {
                "count" => spec.count = count()?,
                "modes" => spec.modes = count()?,
                "operator" => spec.operator = Some(ModalOperator::parse(&text)?),
                "energy" => spec.energy = Some(number()?),
                "tau" => spec.tau = number()?,
                "size" => spec.size = Some(number()?),
                "iterations" => spec.iterations = count()?,
                "overlap" => spec.overlap = count()?,
                "method" => spec.method = SegmentMethod::parse(&text)?,
                "connected" => {
                    spec.connected = match text.as_str() {
                        "yes" | "true" | "on" | "y" | "t" => true,
                        "no" | "false" | "off" | "n" | "f" | "none" => false,
                        _ => return Err(wrong("yes or no")),
                    }
                }
                "distanceScale" => spec.distance_scale = Some(number()?),
                "obstacles" => {
                    let names = text.trim_start_matches(|c: char| c.is_ascii_digit() || c == ' ');
                    let names = names.trim_matches(['(', ')', ' ']);
                    spec.obstacles = names.split_whitespace().map(str::to_string).collect();
                }
                "modalSolver" => modal.solver = ModalSolver::parse(&text)?,
                "petscOptions" => modal.petsc = text,
                // A run knows them all, and refuses others.
                _ => {}
            }
        }
        Ok((spec, modal))
    }

    fn function_object(&self) -> Result<Value> {
        match self {
            Input::Case(case) => serde_json::from_str(&case.description().function_object)
                .map_err(|e| Error::Internal(format!("dictionary of the function object: {e}"))),
            Input::Data(_) => Ok(Value::Null),
        }
    }

    /// The cells as a picture shows them; none in 3-D.
    ///
    /// # Errors
    /// OpenFOAM's message.
    pub fn map(&mut self, mesh: &Mesh, width: usize) -> Result<Option<CellMap>> {
        match self {
            Input::Case(case) => {
                let polygons = case.polygons()?;
                Ok(CellMap::from_polygons(&polygons.start, &polygons.points, width))
            }
            Input::Data(_) => Ok(CellMap::from_mesh(mesh, width)),
        }
    }

    /// Fails where [`Self::write`] would: before anything is computed.
    ///
    /// # Errors
    /// [`Error::File`] for fields of somebody else, unless they may be overwritten.
    pub fn check_fields(&mut self, modes: usize, overwrite: bool) -> Result<()> {
        let Input::Case(case) = self else { return Ok(()) };
        for name in names(modes) {
            if !overwrite && case.stored(&name, MARK)? == Stored::Foreign {
                return Err(Error::file(
                    case.start_folder().join(&name),
                    "is there already and was not written by m4gn: give --overwrite to replace it, --no-write to \
                     leave it, or move it away",
                ));
            }
        }
        Ok(())
    }

    /// Writes the segments and modes of the cells: as fields into the folder of a case's start time, or as points with
    /// values into `vtu`. Returns what was written, for people.
    ///
    /// # Errors
    /// When a file cannot be written; what was there is then still there.
    pub fn write(
        &mut self,
        mesh: &Mesh,
        labels: &[i32],
        modes: &[Vec<f64>],
        note: &str,
        vtu: &Path,
        overwrite: bool,
    ) -> Result<String> {
        // A cluster of eigenvalues may have brought more modes than were asked for.
        self.check_fields(modes.len(), overwrite)?;
        let values = std::iter::once(labels.iter().map(|&l| f64::from(l)).collect());
        let fields: Vec<(String, Vec<f64>)> = names(modes.len())
            .zip(values.chain(modes.iter().cloned()))
            .collect();
        match self {
            Input::Case(case) => {
                // Modes of an earlier run that had more of them.
                let mut stale = Vec::new();
                for i in modes.len() + 1.. {
                    let name = format!("{MODE}{i}");
                    match case.stored(&name, MARK)? {
                        Stored::Marked => stale.push(name),
                        _ => break,
                    }
                }
                case.write_fields(&fields, &format!("{MARK} segment: {note}"), &stale)?;
                let list: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
                Ok(format!(
                    "{} in {}",
                    list.join(", "),
                    case.start_folder().display()
                ))
            }
            Input::Data(_) => {
                let cloud = PointCloud {
                    points: &mesh.cell_centres,
                    fields: &fields,
                };
                write_file(vtu, cloud.vtu()?.as_bytes())?;
                Ok(vtu.display().to_string())
            }
        }
    }

    /// Whether a case has folders of a decomposition, which the fields are not written to.
    pub fn is_decomposed(&self) -> bool {
        match self {
            Input::Case(case) => Path::new(&case.description().path).join("processor0").is_dir(),
            Input::Data(_) => false,
        }
    }
}

fn names(modes: usize) -> impl Iterator<Item = String> {
    std::iter::once(SEGMENT.to_string()).chain((1..=modes).map(|i| format!("{MODE}{i}")))
}
