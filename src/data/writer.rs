//! Writing one trajectory from one process: beside the final name first, renamed when whole.

use super::layout::{Rows, mesh_bytes, number, text, write_mesh, write_triangles};
use super::schema::{FORMAT, FieldMeta, Frame, LONG, NAME, Split, VERSION, h5_error, quiet};
use super::space::reserve;
use super::superblock::clear_open_mark;
use hdf5::Dataset;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Mesh;
use ndarray::ArrayView1;
use rustix::fs::FlockOperation;
use rustix::io::Errno;
use std::ffi::OsString;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// What is written beside the mesh and the values.
#[derive(Clone, Debug)]
pub struct WriteOptions {
    /// Fields, in the order in which [`Writer::append`] takes them.
    pub fields: Vec<FieldMeta>,
    /// JSON object: application, versions, parameters.
    pub provenance: serde_json::Value,
    /// What the trajectory is for.
    pub split: Split,
    /// Whether an existing file may be replaced (when the new one is whole).
    pub overwrite: bool,
}

/// A trajectory being written. Dropped before [`Writer::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    partial: PathBuf,
    overwrite: bool,
    /// None once finished or failed.
    open: Option<Open>,
    n_frames: usize,
    last_time: f64,
}

#[derive(Debug)]
struct Open {
    file: hdf5::File,
    times: Dataset,
    fields: Vec<FieldSets>,
    /// The displacement of an obstacle's points.
    motion: Rows,
    /// A second handle on the file, through which space is reserved before HDF5 writes.
    space: std::fs::File,
    /// Uncompressed size of a frame of all fields, bytes.
    frame_bytes: u64,
}

#[derive(Debug)]
struct FieldSets {
    name: String,
    cells: Rows,
    boundary: Rows,
}

/// Room kept for HDF5's own tables beside a frame's values, bytes.
const TABLES: u64 = 1 << 20;

impl Writer {
    /// Starts a file with this (undecomposed) mesh, of cells or of a body; `mesh.cell_global` must be 0..N in order. The whole frames that
    /// a killed recording of `a.h5` has left become `a-killed.h5`.
    ///
    /// # Errors
    /// [`Error::File`] when the file exists and may not be replaced, or cannot be made; [`Error::Input`] for
    /// field names that cannot be stored.
    pub fn create(path: impl AsRef<Path>, mesh: &Mesh, options: &WriteOptions) -> Result<Self> {
        Self::begin(path.as_ref(), mesh, options, keep_killed)
    }

    /// As [`Writer::create`], of frames that are there elsewhere: what a killed program has left is removed. Among trajectories to learn from it
    /// would be a second one of the same frames.
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create_copy(path: &Path, mesh: &Mesh, options: &WriteOptions) -> Result<Self> {
        Self::begin(path, mesh, options, |partial, _| remove(partial))
    }

    fn begin(
        path: &Path,
        mesh: &Mesh,
        options: &WriteOptions,
        left: fn(&Path, &Path) -> Result<()>,
    ) -> Result<Self> {
        quiet();
        let name = path.file_name().ok_or_else(|| {
            Error::file(path, "is not the name of a file; expected a path that ends in .h5")
        })?;
        for (i, field) in options.fields.iter().enumerate() {
            field.check()?;
            refuse(options.fields[..i].iter().any(|f| f.name == field.name), Error::Input, || {
                format!("field '{}' appears twice", field.name)
            })?;
        }
        check_absent(path, options.overwrite)?;
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(Error::cannot("made", folder))?;
        }
        let mut partial = OsString::from(".");
        partial.push(name);
        partial.push(".partial");
        let partial = path.with_file_name(partial);
        let mut writer = Writer {
            path: path.to_path_buf(),
            partial,
            overwrite: options.overwrite,
            open: None,
            n_frames: 0,
            last_time: f64::NEG_INFINITY,
        };
        // Without HDF5 in between, so that the message is the system's own (permissions, full disk).
        let space = claim(&writer.partial, &writer.path, left)?;
        let result = mesh_bytes(mesh)
            .and_then(|bytes| reserve(&space, &writer.path, 0, bytes + TABLES))
            .and_then(|()| writer.start(space, mesh, options));
        match result {
            Ok(()) => Ok(writer),
            Err(e) => Err(writer.fail(e)),
        }
    }

    fn start(&mut self, space: std::fs::File, mesh: &Mesh, options: &WriteOptions) -> Result<()> {
        let path = self.path.as_path();
        let file = hdf5::FileBuilder::new()
            .with_fapl(|p| p.file_locking(false).libver_v110())
            .create(&self.partial)
            .map_err(h5_error(path, "cannot be made"))?;
        text::<NAME>(path, &file, "format", FORMAT)?;
        number(path, &file, "version", VERSION)?;
        text::<NAME>(path, &file, "split", options.split.name())?;
        let provenance = options.provenance.to_string();
        match provenance.len() {
            0..=2000 => text::<2000>(path, &file, "provenance", &provenance)?,
            _ => text::<LONG>(path, &file, "provenance", &provenance)?,
        }
        write_mesh(path, &file, mesh)?;
        let error = || h5_error(path, "cannot make the datasets");
        let times = file
            .new_dataset::<f64>()
            .shape((0..,))
            .chunk((1024,))
            .fletcher32()
            .create("times")
            .map_err(error())?;
        let group = file.create_group("fields").map_err(error())?;
        let (n, b) = (mesh.cell_global.len(), mesh.boundary.len());
        let mut fields = Vec::with_capacity(options.fields.len());
        for meta in &options.fields {
            let at = group.create_group(&meta.name).map_err(error())?;
            number(path, &at, "vector", u32::from(meta.vector))?;
            at.new_attr_builder()
                .with_data(ArrayView1::from(&meta.dimensions[..]))
                .create("dimensions")
                .map_err(error())?;
            let c = meta.components(mesh.dim());
            fields.push(FieldSets {
                name: meta.name.clone(),
                cells: Rows::new(&at, "cells", n, c).map_err(error())?,
                boundary: Rows::new(&at, "boundary", b, c).map_err(error())?,
            });
        }
        let motion = match &mesh.obstacle {
            Some(obstacle) => {
                let group = file.group("obstacle").map_err(error())?;
                Rows::new(&group, "displacement", obstacle.positions.len(), 3).map_err(error())?
            }
            None => Rows::default(),
        };
        file.flush().map_err(error())?;
        let values: usize = fields.iter().map(|f| f.cells.size() + f.boundary.size()).sum();
        let frame_bytes = 4 * (values + motion.size()) as u64;
        self.open = Some(Open { file, times, fields, motion, space, frame_bytes });
        Ok(())
    }

    /// Says which triangles the nodes are the points of, before the first frame.
    ///
    /// # Errors
    /// [`Error::File`] when the disk fails: the file is given up.
    pub fn set_triangles(&mut self, triangles: &[[i32; 3]]) -> Result<()> {
        let open = self.open.as_ref().ok_or_else(|| closed(&self.path))?;
        if triangles.is_empty() {
            return Ok(());
        }
        let written = write_triangles(&open.file, triangles);
        written.map_err(h5_error(&self.path, "the triangles cannot be written")).map_err(|e| self.fail(e))
    }

    /// Appends a frame: one [`Frame`] a field, in the order of [`WriteOptions::fields`].
    ///
    /// # Errors
    /// [`Error::Input`] for wrong lengths or a time that does not increase and [`Error::Numerical`] for
    /// values that are not finite: the file is as it was. [`Error::File`] when the disk is full or fails:
    /// the file is given up and nothing of it is left.
    pub fn append(&mut self, time: f64, frames: &[Frame]) -> Result<()> {
        self.append_moved(time, frames, &[])
    }

    /// As [`Writer::append`], with the displacement of an obstacle's points `[Q]`, m.
    ///
    /// # Errors
    /// As [`Writer::append`].
    pub fn append_moved(&mut self, time: f64, frames: &[Frame], motion: &[[f32; 3]]) -> Result<()> {
        let open = self.open.as_ref().ok_or_else(|| closed(&self.path))?;
        refuse(!time.is_finite() || time <= self.last_time, Error::Input, || {
            format!("frame at {time} s after one at {} s: times must increase", self.last_time)
        })?;
        open.check(time, frames, motion)?;
        match open.append(&self.path, self.n_frames, time, (frames, motion)) {
            Ok(()) => {
                self.n_frames += 1;
                self.last_time = time;
                Ok(())
            }
            Err(e) => Err(self.fail(e)),
        }
    }

    /// Number of frames so far.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Marks the file complete, brings it to the disk and gives it its final name.
    ///
    /// # Errors
    /// [`Error::File`] when the disk is full or fails, or when there is no frame; nothing is left then.
    pub fn finish(&mut self) -> Result<()> {
        let open = self.open.take().ok_or_else(|| closed(&self.path))?;
        let result = if self.n_frames == 0 {
            drop(open);
            Err(Error::file(&self.path, "no frame was recorded: check the time span of the recording"))
        } else {
            open.finish(&self.path).and_then(|()| self.rename())
        };
        result.map_err(|e| self.fail(e))
    }

    fn rename(&self) -> Result<()> {
        check_absent(&self.path, self.overwrite)?;
        let failed =
            |e: std::io::Error| Error::file(&self.path, format!("cannot be given its final name: {e}"));
        std::fs::rename(&self.partial, &self.path).map_err(failed)?;
        // The new name is only safe once the folder itself is on the disk; some file systems cannot do this.
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _ = std::fs::File::open(folder).and_then(|f| f.sync_all());
        Ok(())
    }

    /// Gives the file up: closes it, removes what there is, and passes the error on.
    fn fail(&mut self, error: Error) -> Error {
        self.open = None;
        let _ = std::fs::remove_file(&self.partial);
        error
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.open.take().is_some() {
            let _ = std::fs::remove_file(&self.partial);
        }
    }
}

impl Open {
    fn check(&self, time: f64, frames: &[Frame], motion: &[[f32; 3]]) -> Result<()> {
        let points = self.motion.rows;
        refuse(motion.len() != points, Error::Input, || {
            format!("displacement of {} points of an obstacle given, expected {points}", motion.len())
        })?;
        refuse(frames.len() != self.fields.len(), Error::Input, || {
            format!("{} fields given, {} declared", frames.len(), self.fields.len())
        })?;
        for (field, frame) in self.fields.iter().zip(frames) {
            let name = &field.name;
            let (n, b) = (field.cells.size(), field.boundary.size());
            if frame.cells.len() != n || frame.boundary.len() != b {
                return Err(Error::Input(format!(
                    "field {name}: {} cell and {} boundary values given, expected {n} and {b}",
                    frame.cells.len(),
                    frame.boundary.len()
                )));
            }
            if frame.cells.iter().chain(&frame.boundary).any(|v| !v.is_finite()) {
                return Err(Error::Numerical(format!(
                    "field {name} holds a value that is not finite at {time} s: the solver has diverged"
                )));
            }
        }
        Ok(())
    }

    fn append(
        &self,
        path: &Path,
        index: usize,
        time: f64,
        (frames, motion): (&[Frame], &[[f32; 3]]),
    ) -> Result<()> {
        reserve(&self.space, path, self.file.size(), self.frame_bytes + TABLES)?;
        let write = || -> hdf5::Result<()> {
            self.times.resize((index + 1,))?;
            self.times.write_slice(&[time], (index..index + 1,))?;
            for (field, frame) in self.fields.iter().zip(frames) {
                field.cells.append(index, &frame.cells)?;
                field.boundary.append(index, &frame.boundary)?;
            }
            self.motion.append(index, motion.as_flattened())?;
            // Flushed, so that every byte HDF5 has taken is in the space reserved above.
            self.file.flush()
        };
        write().map_err(h5_error(path, "a frame cannot be written"))
    }

    fn finish(self, path: &Path) -> Result<()> {
        reserve(&self.space, path, self.file.size(), TABLES)?;
        number(path, &self.file, "complete", 1)?;
        let failed = || h5_error(path, "cannot be closed");
        self.file.flush().map_err(failed())?;
        let size = self.file.size();
        drop((self.times, self.fields, self.motion));
        self.file.close().map_err(failed())?;
        // Gives back what was reserved; HDF5 has written up to `size`.
        self.space
            .set_len(size)
            .and_then(|()| self.space.sync_all())
            .map_err(Error::cannot("brought to the disk", path))
    }
}

/// Opens the file beside the final name for this recording alone. `left` takes away one that a killed run left behind; one that another
/// recording holds stays as it is.
fn claim(partial: &Path, path: &Path, left: fn(&Path, &Path) -> Result<()>) -> Result<std::fs::File> {
    let failed = |e: std::io::Error| Error::file(partial, format!("cannot be written: {e}"));
    loop {
        let mut options = std::fs::OpenOptions::new();
        let file =
            options.read(true).write(true).create(true).truncate(false).open(partial).map_err(failed)?;
        match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                return Err(Error::file(
                    partial,
                    "is being written by another recording: give each a name of its own, or wait for its end",
                ));
            }
            // A file system without locks: one recording a name is then up to the user.
            Err(Errno::NOLCK | Errno::OPNOTSUPP | Errno::NOSYS) => {}
            Err(e) => return Err(failed(e.into())),
        }
        // Another one may have given it its final name between opening and locking: that file is not ours.
        let own = file.metadata().map_err(failed)?;
        if partial.metadata().is_ok_and(|m| (m.dev(), m.ino()) == (own.dev(), own.ino())) {
            if own.len() == 0 {
                return Ok(file);
            }
            left(partial, path)?;
        }
    }
}

/// What a killed recording of `a.h5` has left becomes `a-killed.h5` (`a-killed-2.h5`, ...), a recording of its whole frames; what
/// has no whole frame, or cannot be read, is removed.
fn keep_killed(partial: &Path, path: &Path) -> Result<()> {
    let failed = |e: std::io::Error| Error::file(partial, format!("cannot be kept under another name: {e}"));
    if complete(partial).is_err() {
        return remove(partial);
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut kept = path.with_file_name(format!("{stem}-killed.h5"));
    let mut number = 2;
    while kept.exists() {
        kept = path.with_file_name(format!("{stem}-killed-{number}.h5"));
        number += 1;
    }
    std::fs::rename(partial, kept).map_err(failed)
}

fn remove(partial: &Path) -> Result<()> {
    let failed = |e: std::io::Error| Error::file(partial, format!("cannot be removed: {e}"));
    std::fs::remove_file(partial).map_err(failed)
}

/// Makes a recording of the whole frames of a file that was not finished.
fn complete(partial: &Path) -> hdf5::Result<()> {
    clear_open_mark(partial).map_err(|e| hdf5::Error::Internal(e.to_string()))?;
    let file = hdf5::FileBuilder::new().with_fapl(|p| p.file_locking(false)).open_rw(partial)?;
    let times = file.dataset("times")?;
    let mut values = Vec::new();
    for field in file.group("fields")?.groups()? {
        values.extend(field.datasets()?);
    }
    values.extend(file.dataset("obstacle/displacement").ok());
    let frames = |d: &Dataset| d.shape()[0];
    let whole = values.iter().map(frames).fold(frames(&times), usize::min);
    if whole == 0 {
        return Err(hdf5::Error::Internal("no frame".into()));
    }
    times.resize((whole,))?;
    for dataset in &values {
        let shape = dataset.shape();
        dataset.resize((whole, shape[1], shape[2]))?;
    }
    // It has it where the process ended before the file had its final name.
    if file.attr("complete").is_err() {
        file.new_attr::<u32>().create("complete")?.write_scalar(&1u32)?;
    }
    file.flush()
}

fn closed(path: &Path) -> Error {
    Error::file(path, "the recording is finished or was given up after an error")
}

fn check_absent(path: &Path, overwrite: bool) -> Result<()> {
    if path.is_dir() {
        return Err(Error::file(path, "is a folder; expected the name of a file to write"));
    }
    if !overwrite && path.exists() {
        return Err(Error::file(path, "exists already: remove it, or choose another name"));
    }
    Ok(())
}
