//! Reading trajectories. Whatever is in a file, the answer is values or an error that names the file.

use super::schema::{FieldMeta, Frame, Split, h5_error};
use super::source::{Opened, open_file};
use crate::mesh::Mesh;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// A whole recorded trajectory; frames are read on demand.
///
/// The file is opened for each read and not kept open, so that a data set of thousands of trajectories needs
/// no more file descriptors than one.
#[derive(Clone, Debug)]
pub struct Trajectory {
    path: PathBuf,
    mesh: Mesh,
    times: Vec<f64>,
    fields: Vec<FieldMeta>,
    provenance: serde_json::Value,
    split: Split,
}

impl Trajectory {
    /// Opens a file and checks that it is a whole trajectory of a known version with consistent sizes.
    ///
    /// # Errors
    /// [`Error::File`] when the file is missing, not HDF5, truncated, of another format or a newer version,
    /// incomplete, or inconsistent in itself.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::read(Opened::new(path.as_ref())?)
    }

    pub(super) fn read(opened: Opened) -> Result<Self> {
        let Opened {
            file,
            root,
            source,
            at_points,
        } = opened;
        if at_points {
            return Err(Error::file(
                source.path,
                "is a trajectory at points (a deforming body), expected one at cells (a flow)",
            ));
        }
        let (split, provenance) = source.origin(&root)?;
        let mesh = source.mesh(&file)?;
        let times = source.times(&file)?;
        let fields = source.fields(&file, &mesh, times.len())?;
        Ok(Trajectory {
            path: source.path.to_path_buf(),
            mesh,
            times,
            fields,
            provenance,
            split,
        })
    }

    /// The file it was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The undecomposed mesh, as one rank would see it.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Times of the frames, s, increasing.
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

    /// The field of this name.
    ///
    /// # Errors
    /// [`Error::File`] that lists the fields there are.
    pub fn field(&self, name: &str) -> Result<&FieldMeta> {
        self.fields.iter().find(|f| f.name == name).ok_or_else(|| {
            let names: Vec<_> = self.fields.iter().map(|f| f.name.as_str()).collect();
            Error::file(
                &self.path,
                format!("no field '{name}'; recorded are {}", names.join(", ")),
            )
        })
    }

    /// Values of one field at one frame.
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that is not there; [`Error::File`] for a damaged or vanished file.
    pub fn read_frame(&self, field: &str, frame: usize) -> Result<Frame> {
        let mut frames = self.read_frames(field, frame, 1, 1)?;
        frames
            .pop()
            .ok_or_else(|| Error::Internal("one frame asked for, none read".into()))
    }

    /// Values of one field at frames `first`, `first + step`, ... (`count` of them).
    ///
    /// # Errors
    /// As [`Trajectory::read_frame`].
    pub fn read_frames(&self, field: &str, first: usize, step: usize, count: usize) -> Result<Vec<Frame>> {
        let meta = self.field(field)?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let last = (count - 1).checked_mul(step).and_then(|n| n.checked_add(first));
        if last.is_none_or(|l| l >= self.times.len()) {
            return Err(Error::Input(format!(
                "{}: frames {first}, every {step}, {count} of them: the trajectory has {} frames",
                self.path.display(),
                self.times.len()
            )));
        }
        let c = meta.components(self.mesh.dim());
        let file = open_file(&self.path)?;
        let cells = self.open_field(&file, field, "cells", self.mesh.n_cells(), c)?;
        let boundary = self.open_field(&file, field, "boundary", self.mesh.boundary.len(), c)?;
        (0..count)
            .map(|i| {
                let frame = first + i * step;
                Ok(Frame {
                    cells: self.read_part(&cells, field, frame)?,
                    boundary: self.read_part(&boundary, field, frame)?,
                })
            })
            .collect()
    }

    /// Opens a dataset again; the file may have been replaced since [`Trajectory::open`].
    fn open_field(
        &self,
        file: &hdf5::File,
        field: &str,
        part: &str,
        rows: usize,
        c: usize,
    ) -> Result<hdf5::Dataset> {
        let name = format!("fields/{field}/{part}");
        let dataset = file
            .dataset(&name)
            .map_err(h5_error(&self.path, &format!("dataset /{name}")))?;
        let expected = [self.times.len(), rows, c];
        if dataset.shape() != expected {
            let message = format!(
                "dataset /{name} has shape {:?}, expected {expected:?}",
                dataset.shape()
            );
            return Err(Error::file(&self.path, message));
        }
        Ok(dataset)
    }

    fn read_part(&self, dataset: &hdf5::Dataset, field: &str, frame: usize) -> Result<Vec<f32>> {
        let values = dataset
            .read_slice::<f32, _, ndarray::Ix2>((frame, .., ..))
            .map_err(h5_error(
                &self.path,
                &format!("frame {frame} of {field} is damaged"),
            ))?;
        let values = values.into_raw_vec_and_offset().0;
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::file(
                &self.path,
                format!("frame {frame} of {field} holds a value that is not finite"),
            ));
        }
        Ok(values)
    }
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
            "holds no trajectories (*.h5); 'm4gn generate' or m4gnHarvest make them",
        ));
    }
    files.sort();
    Ok(files)
}
