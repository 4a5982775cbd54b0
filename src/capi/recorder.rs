//! Exports: the recorder.

use super::guard;
use super::pointers::{self, MeshData};
use super::session::FieldInfo;
use m4gn_base::settings;
use m4gn_base::{Error, Result};
use m4gn_data::{FieldMeta, Recorder, Split, WriteOptions};
use m4gn_mesh::{Field, Mesh};
use m4gn_parallel::Comm;
use serde_json::{Map, Value};
use std::ffi::c_char;
use std::path::PathBuf;

settings! {
    /// What the host asks for, beside the fields.
    pub(super) struct RecorderOptions in "recorder" {
        /// Final name of the HDF5 file; written beside it first, renamed when whole.
        path: PathBuf;
        /// What the trajectory is for: `train`, `valid` or `test`.
        split: Split = Split::Train;
        /// Whether an existing file is replaced; else it is an error.
        overwrite: bool = false;
        /// Entries that are kept with the data, such as application and case (dictionary); those of the first rank count.
        provenance: Map<String, Value> = Map::new(), "none";
    }
}

/// `m4gn_recorder`
pub struct RecorderHandle {
    comm: Comm,
    recorder: Recorder,
    n_cells: usize,
    n_boundary: usize,
    fields: Vec<FieldMeta>,
    /// For [`guard::changed`].
    broken: bool,
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read(
    mesh: *const MeshData,
    options: *const c_char,
    fields: (*const FieldInfo, i32),
) -> Result<((Mesh, PathBuf, WriteOptions), String)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let mesh = pointers::mesh(pointers::reference("mesh", mesh)?)?;
        let options = RecorderOptions::parse(pointers::options(options)?)?;
        let fields = read_metas(fields)?;
        let same = format!("{}fields {fields:?}\n", options.shared()?);
        let write = WriteOptions {
            fields,
            provenance: options.provenance.into(),
            split: options.split,
            overwrite: options.overwrite,
        };
        Ok(((mesh, options.path, write), same))
    }
}

/// Collective.
fn open(comm: &Comm, (mesh, path, options): (Mesh, PathBuf, WriteOptions)) -> Result<RecorderHandle> {
    Ok(RecorderHandle {
        recorder: Recorder::create(comm, &mesh, &path, &options)?,
        fields: options.fields,
        n_cells: mesh.n_cells(),
        n_boundary: mesh.boundary.len(),
        broken: false,
        comm: comm.clone(),
    })
}

impl RecorderOptions {
    /// From the text of a JSON object.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let options: Self = settings::parse("recorder", text, &["provenance"])?;
        match options.path.as_os_str().is_empty() {
            true => {
                Err(Error::Input("recorder: path: expected the name of the file to write, found none".into()))
            }
            false => Ok(options),
        }
    }

    /// What every rank must be given alike: not the folder in which it sees the file, nor what it knows of its own.
    fn shared(&self) -> Result<String> {
        let alike = RecorderOptions {
            path: guard::file_name(&self.path).into(),
            provenance: Map::new(),
            ..self.clone()
        };
        settings::lines(&alike)
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read_metas((fields, n): (*const FieldInfo, i32)) -> Result<Vec<FieldMeta>> {
    // SAFETY: passed on to the caller.
    let fields = unsafe { pointers::slice("fields", fields, pointers::count("n_fields", n)?)? };
    if fields.is_empty() {
        return Err(Error::Input("n_fields: expected at least one field to record".into()));
    }
    let mut list: Vec<FieldMeta> = Vec::with_capacity(fields.len());
    for f in fields {
        // SAFETY: passed on to the caller.
        let name = unsafe { pointers::text("field name", f.name)? };
        let vector = match f.components {
            1 => false,
            3 => true,
            n => {
                return Err(Error::Input(format!("field '{name}': expected 1 or 3 components, found {n}")));
            }
        };
        list.push(FieldMeta { name: name.to_owned(), vector, dimensions: f.dimensions });
    }
    Ok(list)
}

impl RecorderHandle {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn values<'a>(
        fields: &'a [FieldMeta],
        (n_cells, n_boundary): (usize, usize),
        cells: *const *const f64,
        boundary: *const *const f64,
    ) -> Result<Vec<Field<'a>>> {
        let n = fields.len();
        // SAFETY: passed on to the caller.
        let (cells, boundary) =
            unsafe { (pointers::slice("cells", cells, n)?, pointers::slice("boundary", boundary, n)?) };
        let pairs = fields.iter().zip(cells.iter().zip(boundary));
        let one = |(field, (&cells, &boundary)): (&'a FieldMeta, (&*const f64, &*const f64))| {
            let components = if field.vector { 3 } else { 1 };
            // SAFETY: passed on to the caller.
            let (cells, boundary) = unsafe {
                (
                    pointers::slice(&field.name, cells, components * n_cells)?,
                    pointers::slice(&field.name, boundary, components * n_boundary)?,
                )
            };
            Ok(Field { name: &field.name, components, cells, boundary })
        };
        pairs.map(one).collect()
    }

    fn guarded(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<i32> {
        guard::changed("recorder", self, |h| &mut h.broken, |h| h.comm.clone().guarded(|| work(h)))
    }
}

exports! {
    /// Starts a recording.
    fn m4gn_recorder_new(
        comm: i32,
        mesh: *const MeshData,
        options: *const c_char,
        fields: *const FieldInfo,
        n_fields: i32,
        recorder: *mut *mut RecorderHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("recorder", recorder));
            let read = |_: &Comm| read(mesh, options, (fields, n_fields));
            guard::create("m4gn_recorder_new", comm, place, read, open)
        }
    }

    /// Appends a frame.
    fn m4gn_recorder_append(
        recorder: *mut RecorderHandle,
        time: f64,
        cells: *const *const f64,
        boundary: *const *const f64,
    ) -> i32, or |status| status; {
        // SAFETY: a recorder of ours, or null.
        let handle = unsafe { pointers::reference_mut("recorder", recorder)? };
        handle.guarded(|h| {
            let sizes = (h.n_cells, h.n_boundary);
            // SAFETY: the host's arrays, as the header says.
            let values = unsafe { RecorderHandle::values(&h.fields, sizes, cells, boundary) };
            let values = h.comm.agree_with(values, &format!("call m4gn_recorder_append\ntime {time:?}"))?;
            h.recorder.append(time, &values)
        })
    }

    /// Frames so far; -1 for a null recorder.
    fn m4gn_recorder_n_frames(recorder: *const RecorderHandle) -> i64, or |_| -1; {
        // SAFETY: a recorder of ours, or null.
        Ok(unsafe { pointers::reference("recorder", recorder)? }.recorder.n_frames() as i64)
    }

    /// Completes the file.
    fn m4gn_recorder_finish(recorder: *mut RecorderHandle) -> i32, or |status| status; {
        // SAFETY: a recorder of ours, or null.
        unsafe { pointers::reference_mut("recorder", recorder)? }.guarded(|h| h.recorder.finish())
    }
}
