//! Exports: the recorder.

use super::raw::{self, FieldData, MeshData};
use super::session::read_fields;
use crate::dataset::{FieldMeta, FieldValues, Recorder, Split, WriteOptions};
use crate::mesh::Mesh;
use crate::parallel::Comm;
use crate::{Error, Result};
use std::ffi::c_char;
use std::path::PathBuf;

/// `m4gn_recorder_field`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RecorderField {
    pub name: *const c_char,
    pub components: i32,
    pub dimensions: [i32; 7],
}

/// `m4gn_recorder_options`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RecorderOptions {
    pub path: *const c_char,
    pub n_fields: i32,
    pub fields: *const RecorderField,
    pub provenance: *const c_char,
    pub split: *const c_char,
    pub overwrite: i32,
}

/// `m4gn_recorder`
pub struct RecorderHandle {
    comm: Comm,
    recorder: Recorder,
    n_cells: usize,
    n_boundary: usize,
    /// Set while a call runs: one that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(comm: i32, mesh: *const MeshData, options: *const RecorderOptions) -> Result<RecorderHandle> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<(Mesh, PathBuf, WriteOptions)> {
        // SAFETY: passed on to the caller.
        unsafe {
            let mesh = raw::mesh(raw::reference("mesh", mesh)?)?;
            let (path, options) = raw::reference("options", options)?.read()?;
            Ok((mesh, path, options))
        }
    };
    let (mesh, path, options) = comm.agree(read())?;
    mesh.check(&comm)?;
    let recorder = Recorder::create(&comm, &mesh, &path, &options)?;
    let (n_cells, n_boundary) = (mesh.n_cells(), mesh.boundary.len());
    Ok(RecorderHandle {
        comm,
        recorder,
        n_cells,
        n_boundary,
        broken: false,
    })
}

impl RecorderOptions {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn read(&self) -> Result<(PathBuf, WriteOptions)> {
        // SAFETY: passed on to the caller.
        let (path, fields, provenance, split) = unsafe {
            (
                raw::text("path", self.path)?,
                raw::slice("fields", self.fields, raw::count("n_fields", self.n_fields)?)?,
                raw::optional_text("provenance", self.provenance)?,
                raw::optional_text("split", self.split)?,
            )
        };
        if fields.is_empty() {
            return Err(Error::Input(
                "n_fields: expected at least one field to record".into(),
            ));
        }
        let mut list: Vec<FieldMeta> = Vec::with_capacity(fields.len());
        for f in fields {
            // SAFETY: passed on to the caller.
            let name = unsafe { raw::text("field name", f.name)? };
            if list.iter().any(|other| other.name == name) {
                return Err(Error::Input(format!("field '{name}' appears twice")));
            }
            let vector = match f.components {
                1 => false,
                3 => true,
                n => {
                    return Err(Error::Input(format!(
                        "field '{name}': expected 1 or 3 components, found {n}"
                    )));
                }
            };
            list.push(FieldMeta {
                name: name.to_owned(),
                vector,
                dimensions: f.dimensions,
            });
        }
        let provenance: serde_json::Value = serde_json::from_str(provenance.unwrap_or("{}"))
            .map_err(|e| Error::Input(format!("provenance: expected a JSON object: {e}")))?;
        if !provenance.is_object() {
            return Err(Error::Input("provenance: expected a JSON object".into()));
        }
        let options = WriteOptions {
            fields: list,
            provenance,
            split: split.map_or(Ok(Split::Train), str::parse)?,
            overwrite: self.overwrite != 0,
        };
        Ok((PathBuf::from(path), options))
    }
}

impl RecorderHandle {
    fn guarded(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<i32> {
        if std::mem::replace(&mut self.broken, true) {
            return Err(Error::Internal(
                "the recorder broke in an earlier call and can only be freed".into(),
            ));
        }
        let result = work(self);
        self.broken = matches!(result, Err(Error::Internal(_)));
        result.map(|()| 0)
    }
}

exports! {
    /// Starts a recording.
    fn m4gn_recorder_new(
        comm: i32,
        mesh: *const MeshData,
        options: *const RecorderOptions,
        recorder: *mut *mut RecorderHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let recorder = raw::reference_mut("recorder", recorder)?;
            *recorder = std::ptr::null_mut();
            *recorder = Box::into_raw(Box::new(new(comm, mesh, options)?));
        }
        Ok(0)
    }

    /// Appends a frame.
    fn m4gn_recorder_append(
        recorder: *mut RecorderHandle,
        time: f64,
        fields: *const FieldData,
        n_fields: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a recorder of ours, or null.
        let handle = unsafe { raw::reference_mut("recorder", recorder)? };
        handle.guarded(|h| {
            // SAFETY: the host's arrays, as the header says.
            let values = unsafe { read_fields((fields, n_fields), h.n_cells, h.n_boundary) };
            let values: Vec<FieldValues> = h
                .comm
                .agree(values)?
                .iter()
                .map(|f| FieldValues { name: f.name, components: f.components, cells: f.cells, boundary: f.boundary })
                .collect();
            h.recorder.append(time, &values)
        })
    }

    /// Frames so far; -1 for a null recorder.
    fn m4gn_recorder_n_frames(recorder: *const RecorderHandle) -> i64, or |_| -1; {
        // SAFETY: a recorder of ours, or null.
        Ok(unsafe { raw::reference("recorder", recorder)? }.recorder.n_frames() as i64)
    }

    /// Completes the file.
    fn m4gn_recorder_finish(recorder: *mut RecorderHandle) -> i32, or |status| status; {
        // SAFETY: a recorder of ours, or null.
        unsafe { raw::reference_mut("recorder", recorder)? }.guarded(|h| h.recorder.finish())
    }

    /// Frees a recorder; null is none.
    fn m4gn_recorder_free(recorder: *mut RecorderHandle) -> (), or |_| (); {
        if !recorder.is_null() {
            // SAFETY: made by m4gn_recorder_new and freed once.
            drop(unsafe { Box::from_raw(recorder) });
        }
        Ok(())
    }
}
