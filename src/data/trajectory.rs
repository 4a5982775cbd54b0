//! Reading trajectories. Whatever is in a file, the answer is values or an error that names the file.

use super::schema::{FieldMeta, Frame, Split, TRIANGLES, h5_error};
use super::source::{Source, open_file};
use m4gn_base::{Error, Result};
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::{CELL_SIZE, Mesh, NodeType};
use m4gn_model::{Level, has_level};
use m4gn_parallel::Comm;
use std::path::{Path, PathBuf};

/// Name of the field of a fluid's kinematic viscosity (m^2/s), and of its entry in the provenance, where it is the same everywhere.
const VISCOSITY: &str = "nu";

fn scalar(name: &str, dimensions: [i32; 7]) -> FieldMeta {
    FieldMeta { name: name.into(), vector: false, dimensions }
}

/// Fields at cells that are not recorded: the size of the cells, and the viscosity of a flow. Of a solid nu is Poisson's ratio.
fn implied_at_cells(fields: &[FieldMeta], provenance: &serde_json::Value) -> Vec<FieldMeta> {
    let flow = fields.iter().any(|f| f.name == "U") && provenance[VISCOSITY].is_number();
    let viscosity = flow.then(|| scalar(VISCOSITY, [0, 2, -1, 0, 0, 0, 0]));
    std::iter::once(scalar(CELL_SIZE, [0, 1, 0, 0, 0, 0, 0])).chain(viscosity).collect()
}

/// Values of a field.
pub(super) enum Values {
    /// At cells or points, and on the boundary, where there are any; of a pressure with the level that is taken off.
    Recorded([Option<hdf5::Dataset>; 2], Option<Level>),
    /// The same at all times: what the mesh or the provenance says.
    Implied(Frame),
}

impl Values {
    /// Those of a frame.
    pub(super) fn frame(&self, source: &Source, frame: usize) -> Result<Frame> {
        let rows =
            |part: &Option<hdf5::Dataset>| part.as_ref().map_or(Ok(Vec::new()), |p| source.frame(p, frame));
        match self {
            Values::Recorded([cells, boundary], level) => {
                let mut frame = Frame { cells: rows(cells)?, boundary: rows(boundary)? };
                if let Some(level) = level {
                    level.take_off(&mut frame.cells, &mut frame.boundary);
                }
                Ok(frame)
            }
            Values::Implied(values) => Ok(values.clone()),
        }
    }
}

/// A whole recorded trajectory; frames are read on demand.
///
/// The file is opened for each read and not kept open, so that a data set of thousands of trajectories needs
/// no more file descriptors than one.
#[derive(Clone, Debug)]
pub struct Trajectory {
    path: PathBuf,
    mesh: Mesh,
    body: Option<Body>,
    /// Types of the nodes that are predicted, or held.
    inside: Vec<NodeType>,
    times: Vec<f64>,
    fields: Vec<FieldMeta>,
    /// What the mesh or the provenance says, where it is not recorded.
    implied: Vec<FieldMeta>,
    provenance: serde_json::Value,
    split: Split,
    triangles: Vec<[i32; 3]>,
}

impl Trajectory {
    /// Opens a file and checks that it is a whole trajectory of this version with consistent sizes.
    ///
    /// # Errors
    /// [`Error::File`] when the file is missing, not HDF5, truncated, of another format or version,
    /// incomplete, or inconsistent in itself.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let file = open_file(path)?;
        let source = Source::new(path)?;
        let root = file.group("/").map_err(h5_error(path, "no root group"))?;
        source.check_whole(&root)?;
        source.check_self_contained(&root, true)?;
        let (split, provenance) = source.origin(&root)?;
        let body = source.body(&file)?;
        let fields = source.fields(&file)?;
        let (mesh, inside, mut implied) = match &body {
            Some(body) => (body.mesh(source.obstacle(&file, body)?.as_ref()), body.types.clone(), Vec::new()),
            None => (source.mesh(&file)?, vec![NodeType::Fluid], implied_at_cells(&fields, &provenance)),
        };
        implied.retain(|i| fields.iter().all(|f| f.name != i.name));
        let triangles = match file.link_exists(TRIANGLES) {
            true => source.label_rows(&file, TRIANGLES, mesh.cell_global.len())?,
            false => Vec::new(),
        };
        let trajectory = Trajectory {
            path: path.to_path_buf(),
            mesh,
            body,
            inside,
            times: source.times(&file)?,
            fields,
            implied,
            provenance,
            split,
            triangles,
        };
        for field in &trajectory.fields {
            trajectory.open_field(&source, &file, field)?;
        }
        if let Some(motion) = trajectory.open_motion(&source, &file)? {
            trajectory.motion(&source, &motion, trajectory.times.len() - 1)?;
        }
        Ok(trajectory)
    }

    /// The file it was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The undecomposed mesh, as one rank would see it; of a body at points with the obstacle.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The mesh of fields at cells.
    ///
    /// # Errors
    /// [`Error::File`] for a body at points, whose mesh has no cells.
    pub fn cells(&self) -> Result<&Mesh> {
        match self.body {
            None => Ok(&self.mesh),
            Some(_) => Err(Error::file(
                &self.path,
                "is a trajectory at points (a deforming body), expected one at cells (a flow)",
            )),
        }
    }

    /// The body at rest; none where the fields are at cells.
    pub fn body(&self) -> Option<&Body> {
        self.body.as_ref()
    }

    /// Triangles over the nodes, where these are points of a mesh of triangles.
    pub fn triangles(&self) -> &[[i32; 3]] {
        &self.triangles
    }

    /// The obstacle that may touch the body, where there is one.
    pub fn obstacle(&self) -> Option<&Obstacle> {
        self.mesh.obstacle.as_ref()
    }

    /// Types of the nodes of its graph, some of them more than once.
    pub fn node_types(&self) -> Vec<NodeType> {
        let faces = self.mesh.boundary.iter().map(|b| b.kind);
        let obstacle = self.obstacle().map(|_| NodeType::Obstacle);
        self.inside.iter().copied().chain(faces).chain(obstacle).collect()
    }

    /// Times of the frames, s, increasing; at least one.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Recorded fields.
    pub fn fields(&self) -> &[FieldMeta] {
        &self.fields
    }

    /// Where the trajectory came from: application, versions, parameters.
    pub fn provenance(&self) -> &serde_json::Value {
        &self.provenance
    }

    /// What the trajectory is for.
    pub fn split(&self) -> Split {
        self.split
    }

    /// The field of this name: one of the recorded ones, or, of flows, the size of the cells ([`Mesh::cell_sizes`], at the
    /// boundary that of the cell behind), which the mesh says, or the viscosity `nu` of the fluid, which the provenance says.
    ///
    /// # Errors
    /// [`Error::File`] that lists the fields there are.
    pub fn field(&self, name: &str) -> Result<&FieldMeta> {
        let mut known = self.fields.iter().chain(&self.implied);
        known.find(|f| f.name == name).ok_or_else(|| {
            let names: Vec<_> = self.fields.iter().map(|f| f.name.as_str()).collect();
            Error::file(&self.path, format!("no field '{name}'; recorded are {}", names.join(", ")))
        })
    }

    /// Values of one field at one frame; of a kinematic pressure without its level ([`Level`]).
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that is not there; [`Error::File`] for a damaged or vanished file.
    pub fn read_frame(&self, field: &str, frame: usize) -> Result<Frame> {
        let mut frames = self.read_frames(field, frame, 1, 1)?;
        frames.pop().ok_or_else(|| Error::Internal("one frame asked for, none read".into()))
    }

    /// Values of one field at frames `first`, `first + step`, ... (`count` of them).
    ///
    /// # Errors
    /// As [`Trajectory::read_frame`].
    pub fn read_frames(&self, field: &str, first: usize, step: usize, count: usize) -> Result<Vec<Frame>> {
        let frames = self.range(first, step, count)?;
        let (file, source) = (open_file(&self.path)?, Source::new(&self.path)?);
        let values = self.open_field(&source, &file, self.field(field)?)?;
        frames.map(|frame| values.frame(&source, frame)).collect()
    }

    /// Values of a recorded field at all frames as they were recorded: of a pressure with its level.
    ///
    /// # Errors
    /// As [`Trajectory::read_frame`].
    pub fn recorded_frames(&self, field: &str) -> Result<Vec<Frame>> {
        let (file, source) = (open_file(&self.path)?, Source::new(&self.path)?);
        let values = match self.open_field(&source, &file, self.field(field)?)? {
            Values::Recorded(parts, _) => Values::Recorded(parts, None),
            others => others,
        };
        (0..self.times.len()).map(|frame| values.frame(&source, frame)).collect()
    }

    /// Displacement of the obstacle's points `[Q]`, m, at frames `first`, `first + step`, ... (`count` of them); empty ones
    /// without obstacle.
    ///
    /// # Errors
    /// As [`Trajectory::read_frame`].
    pub fn read_motion(&self, first: usize, step: usize, count: usize) -> Result<Vec<Vec<[f32; 3]>>> {
        let frames = self.range(first, step, count)?;
        let (file, source) = (open_file(&self.path)?, Source::new(&self.path)?);
        match self.open_motion(&source, &file)? {
            None => Ok(vec![Vec::new(); count]),
            Some(motion) => frames.map(|frame| self.motion(&source, &motion, frame)).collect(),
        }
    }

    /// One frame of the obstacle's displacement, of a rigid body.
    fn motion(&self, source: &Source, motion: &hdf5::Dataset, frame: usize) -> Result<Vec<[f32; 3]>> {
        let displacement = source.frame(motion, frame)?.as_chunks().0.to_vec();
        let checked = self.obstacle().map_or(Ok(()), |o| o.check_motion(&displacement));
        checked.map_err(|e| source.wrong(&format!("frame {frame} of /obstacle/displacement"), &e))?;
        Ok(displacement)
    }

    fn range(&self, first: usize, step: usize, count: usize) -> Result<impl Iterator<Item = usize>> {
        let last = count.saturating_sub(1).checked_mul(step);
        let last = last.and_then(|n| n.checked_add(first));
        match last.is_some_and(|l| l < self.times.len()) || count == 0 {
            true => Ok((0..count).map(move |i| first + i * step)),
            false => Err(Error::Input(format!(
                "{}: frames {first}, every {step}, {count} of them: the trajectory has {} frames",
                self.path.display(),
                self.times.len()
            ))),
        }
    }

    /// Opens the values of a field at cells or points, and those on the boundary, where it has faces; the file may have
    /// been replaced since [`Trajectory::open`].
    pub(super) fn open_field(&self, source: &Source, file: &hdf5::File, field: &FieldMeta) -> Result<Values> {
        if self.implied.contains(field) {
            return Ok(Values::Implied(self.implied_values(&field.name)));
        }
        let open = |name: String, rows: usize| {
            let shape = [self.times.len(), rows, field.components(self.mesh.dim())];
            let opened = (rows > 0).then(|| source.frames(file, &name, shape));
            opened.transpose()
        };
        let values = [
            open(format!("fields/{}/cells", field.name), self.mesh.cell_global.len())?,
            open(format!("fields/{}/boundary", field.name), self.mesh.boundary.len())?,
        ];
        let levelled = self.body.is_none() && has_level(&field.name, field.vector, field.dimensions);
        Ok(Values::Recorded(values, levelled.then(|| Level::new(&self.mesh, &Comm::serial()))))
    }

    fn implied_values(&self, name: &str) -> Frame {
        let cells: Vec<f32> = match self.provenance[name].as_f64() {
            Some(value) if name == VISCOSITY => vec![value as f32; self.mesh.n_cells()],
            _ => self.mesh.cell_sizes().iter().map(|&s| s as f32).collect(),
        };
        let faces = self.mesh.boundary.iter();
        let boundary = faces.map(|b| cells[b.owner as usize]).collect();
        Frame { cells, boundary }
    }

    /// Opens the obstacle's displacement, where there is one.
    pub(super) fn open_motion(&self, source: &Source, file: &hdf5::File) -> Result<Option<hdf5::Dataset>> {
        let shape = |o: &Obstacle| [self.times.len(), o.positions.len(), 3];
        let opened = self.obstacle().map(|o| source.frames(file, "obstacle/displacement", shape(o)));
        opened.transpose()
    }
}

/// Mean time from frame to frame, s, and the first frame that does not come so long after the one before, to the digits that times are written
/// with; none of fewer than two frames.
pub fn interval(times: &[f64]) -> Option<(f64, Option<usize>)> {
    let [first, .., last] = *times else { return None };
    let mean = (last - first) / (times.len() - 1) as f64;
    let uneven = times.windows(2).position(|w| (w[1] - w[0] - mean).abs() > 1e-3 * mean);
    Some((mean, uneven.map(|i| i + 1)))
}

/// Trajectories of a folder (`*.h5`, sorted by name), or the one file given.
///
/// Files being recorded have other names and are never listed.
///
/// # Errors
/// [`Error::File`] when the path does not exist, cannot be read, or is a folder without trajectories.
pub fn list(path: &Path) -> Result<Vec<PathBuf>> {
    let unreadable = |e: std::io::Error| Error::file(path, format!("cannot be read: {e}"));
    if !path.metadata().map_err(unreadable)?.is_dir() {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut files = Vec::new();
    for entry in path.read_dir().map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let name = entry.file_name();
        let hidden = name.as_encoded_bytes().first() == Some(&b'.');
        let file = entry.path();
        if !hidden && file.extension().is_some_and(|e| e == "h5") && file.is_file() {
            files.push(file);
        }
    }
    if files.is_empty() {
        return Err(Error::file(
            path,
            "holds no trajectories (*.h5); 'm4gn generate' or m4gnRecorder make them",
        ));
    }
    files.sort();
    Ok(files)
}
