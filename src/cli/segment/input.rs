//! Where the mesh comes from, and where segments and modes go.

use m4gn_base::plugin::{folder_variable, homes};
use m4gn_base::settings;
use m4gn_base::{Error, Result, listed};
use m4gn_data as dataset;
use m4gn_data::Trajectory;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::modal::ModalOptions;
use m4gn_model::{ModalOperator, Model, ModelSpec, SegmentEntries, SegmentSpec};
use m4gn_report::{Grid, write_file};
use m4gn_workbench::foam_case::FoamCase;
use m4gn_workbench::foam_case::Stored as Origin;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Field of the segments; m4gnSurrogate reads it.
const SEGMENT: &str = "m4gnSegment";
/// Fields of the modes: m4gnMode1, m4gnMode2, ...
const MODE: &str = "m4gnMode";
/// What the notes of m4gn's own files begin with.
const MARK: &str = "m4gn";

/// Entries of `segments` that are the function object's own, and nothing of the description.
const OF_THE_FUNCTION_OBJECT: [&str; 4] = ["model", "stored", "material", "freeBody"];

/// What is read of a case's function object.
#[derive(Default, serde::Deserialize)]
#[serde(default)]
struct OfTheCase {
    segments: SegmentEntries,
}

/// What is written.
pub struct Stored<'a> {
    /// Segment of each cell.
    pub labels: &'a [i32],
    /// Modes in the cells.
    pub modes: &'a [Vec<f64>],
    /// For people who read the files' headers.
    pub note: &'a str,
    /// How the segments were made, for the runs that read them.
    pub record: &'a str,
}

/// An OpenFOAM case, or a recorded trajectory.
pub enum Input {
    /// Case.
    Case(Box<FoamCase>),
    /// Trajectory.
    Data(Box<Trajectory>),
}

impl Input {
    /// A folder with system/controlDict is a case; else a trajectory or a folder of them, whose first is taken.
    pub fn open(path: &Path) -> Result<Self> {
        if path.join("system/controlDict").is_file() {
            return Ok(Input::Case(Box::new(FoamCase::open(path)?)));
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
        let trajectory = Trajectory::open(&files[0])?;
        trajectory.cells()?;
        Ok(Input::Data(Box::new(trajectory)))
    }

    /// For people.
    pub fn name(&self) -> String {
        match self {
            Input::Case(case) => case.description().path.clone(),
            Input::Data(trajectory) => trajectory.path().display().to_string(),
        }
    }

    /// The undecomposed mesh. `node_types` is for cases only.
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
    pub fn add_elastic_modes(&mut self, mesh: &mut Mesh, spec: &SegmentSpec) -> Result<()> {
        let wanted = spec.operator != Some(ModalOperator::Laplacian);
        if let Input::Case(case) = self
            && wanted
        {
            let modal = ModalOptions { count: spec.modes.max(1), ..spec.modal() };
            mesh.elastic = case.elastic_modes(&modal)?;
        }
        Ok(())
    }

    /// The description of the model that the function object of a case names, if it names one.
    pub fn model(&self) -> Result<Option<ModelSpec>> {
        let Some(name) = self.function_object().get("model").and_then(Value::as_str).map(PathBuf::from)
        else {
            return Ok(None);
        };
        // As the function object looks for it: M4GN_HOME, where that is set, is the only home
        let homes = folder_variable("M4GN_HOME").map_or_else(homes, |home| vec![home]);
        let homes = homes.into_iter().flat_map(|home| [home.join("models"), home]);
        let case = match self {
            Input::Case(case) => PathBuf::from(&case.description().path),
            Input::Data(_) => return Ok(None),
        };
        let found = std::iter::once(case).chain(homes).map(|f| f.join(&name)).find(|f| f.is_file());
        found.map(|file| Ok(Model::read(&file)?.spec)).transpose()
    }

    /// What the `segments` entry of a case's function object says differently from its model.
    pub fn dictionary(&self) -> Result<SegmentEntries> {
        let mut entries = self.function_object();
        entries.retain(|key, _| key == "segments");
        if let Some(Value::Object(segments)) = entries.get_mut("segments") {
            segments.retain(|key, _| !OF_THE_FUNCTION_OBJECT.contains(&key.as_str()));
        }
        let text = Value::Object(entries).to_string();
        Ok(settings::parse::<OfTheCase>("the case's function object", &text, &[])?.segments)
    }

    /// Entries of the case's function object; none of a trajectory.
    fn function_object(&self) -> Map<String, Value> {
        match self {
            Input::Case(case) => case.description().function_object.clone(),
            Input::Data(_) => Map::new(),
        }
    }

    /// Fails where [`Self::write`] would: before anything is computed.
    pub fn check_fields(&mut self, modes: usize, overwrite: bool) -> Result<()> {
        let Input::Case(case) = self else { return Ok(()) };
        for name in names(modes) {
            if !overwrite && case.stored(&name, MARK)? == Origin::Foreign {
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
    /// values into `vtu`. Returns what was written, for people. What was there stays where a file cannot be written.
    pub fn write(
        &mut self,
        mesh: &Mesh,
        stored: &Stored,
        vtu: Option<&Path>,
        overwrite: bool,
    ) -> Result<String> {
        let (labels, modes, note) = (stored.labels, stored.modes, stored.note);
        // A cluster of eigenvalues may have brought more modes than were asked for.
        self.check_fields(modes.len(), overwrite)?;
        let values = std::iter::once(labels.iter().map(|&l| f64::from(l)).collect());
        let fields: Vec<(String, Vec<f64>)> =
            names(modes.len()).zip(values.chain(modes.iter().cloned())).collect();
        match self {
            Input::Case(case) => {
                // Modes of an earlier run that had more of them.
                let mut stale = Vec::new();
                for i in modes.len() + 1.. {
                    let name = format!("{MODE}{i}");
                    match case.stored(&name, MARK)? {
                        Origin::Marked => stale.push(name),
                        _ => break,
                    }
                }
                case.write_fields(
                    &fields,
                    &format!("{MARK} segment: {note}; after remeshing remove this file"),
                    &stale,
                    stored.record,
                )?;
                let names = listed(fields.iter().map(|(name, _)| name));
                Ok(format!("{names} in {}", case.start_folder().display()))
            }
            Input::Data(_) => {
                let vtu =
                    vtu.ok_or_else(|| Error::Internal("segments of a trajectory without a file".into()))?;
                let shown: Vec<_> = fields.iter().map(|(name, values)| (&name[..], 1, &values[..])).collect();
                let text = Grid::of_points(mesh.cell_centres.len()).vtu(&mesh.cell_centres, &shown)?;
                write_file(vtu, text.as_bytes())?;
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
