//! Exports: whether what a mesh has stored fits the segments of a model, and what they need of it.

use super::door;
use super::raw::{self, MeshData};
use super::segments::{Request, no_count};
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::{ModalOperator, Model};
use m4gn_structure as segments;
use std::ffi::c_char;
use std::path::{Path, PathBuf};

/// Why the labels are not the segments that the model and the entries of `options` describe, with the host's `places` for the
/// answer. Collective.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn misfit<P>(
    comm: i32,
    places: Result<P>,
    mesh: *const MeshData,
    (options, cell_segment): (*const c_char, *const i32),
    record: *const c_char,
) -> Result<(Option<String>, P)> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<((P, Mesh, Request, String), String)> {
        let places = places?;
        // SAFETY: passed on to the caller.
        unsafe {
            let mesh = raw::mesh(raw::reference("mesh", mesh)?)?;
            let request = Request::read(options, cell_segment, mesh.n_cells())?;
            let record = raw::optional_text("record", record)?.unwrap_or("").to_owned();
            if request.labels.is_none() {
                return Err(Error::Input(
                    "cell_segment: expected labels, found a null pointer".into(),
                ));
            }
            let same = request.shared()?;
            Ok(((places, mesh, request, record), same))
        }
    };
    door::together(
        "m4gn_segments_fit",
        &comm,
        read,
        |(places, mesh, request, record)| Ok((compare(&comm, &mesh, &request, record)?, places)),
    )
}

/// Collective.
fn compare(comm: &Comm, mesh: &Mesh, request: &Request, record: String) -> Result<Option<String>> {
    let wanted = request.spec(comm)?;
    // The root's: ranks that read their own file may differ.
    let mut text = record.into_bytes();
    comm.broadcast(&mut text);
    let record = String::from_utf8_lossy(&text);
    let only = match &request.model {
        Some(path) if !has_segments(path, comm)? => return Ok(None),
        Some(_) => None,
        None => Some(request.segments.names()),
    };
    let labels = request.labels.as_deref().unwrap_or_default();
    Ok(segments::misfit(
        mesh,
        labels,
        &record,
        &wanted,
        only.as_deref(),
        comm,
    ))
}

/// Whether the model has a stage that works on segments. Collective.
fn has_segments(path: &Path, comm: &Comm) -> Result<bool> {
    let mut has = [0i64];
    let read = match comm.is_root() {
        true => Model::read(path).map(|model| {
            has[0] = i64::from(model.spec.architecture.needs().segments);
        }),
        false => Ok(()),
    };
    comm.agree(read)?;
    comm.max_i64(&mut has);
    Ok(has[0] != 0)
}

/// Elastic modes that a model's segments need. Collective.
fn elastic_modes(comm: i32, model: Result<PathBuf>) -> Result<i32> {
    let comm = Comm::from_fortran(comm)?;
    let read = || model.map(|path| (path.clone(), format!("model {}", door::file_name(&path))));
    door::together("m4gn_model_elastic_modes", &comm, read, |path| {
        count_elastic(&comm, &path)
    })
}

/// Collective.
fn count_elastic(comm: &Comm, path: &Path) -> Result<i32> {
    let mut count = [0i64];
    let read = match comm.is_root() {
        true => Model::read(path).map(|model| {
            let spec = &model.spec.segments;
            let elastic = spec.operator == Some(ModalOperator::Elastic) && spec.method.uses_modes();
            if elastic && model.spec.architecture.needs().segments {
                count[0] = spec.modes as i64;
            }
        }),
        false => Ok(()),
    };
    comm.agree(read)?;
    comm.max_i64(&mut count);
    i32::try_from(count[0]).map_err(|_| Error::Model(format!("segments.modes: {} is too large", count[0])))
}

exports! {
    /// Whether stored segments are those that are wanted.
    fn m4gn_segments_fit(
        comm: i32,
        mesh: *const MeshData,
        options: *const c_char,
        cell_segment: *const i32,
        record: *const c_char,
        fit: *mut i32,
        why: *mut c_char,
        why_size: i32,
    ) -> i32, or |status| status; {
        let places = || {
            let size = raw::count("why_size", why_size)?;
            // SAFETY: the host's places, as the header says.
            unsafe { Ok((raw::reference_mut("fit", fit)?, raw::slice_mut("why", why, size)?)) }
        };
        // SAFETY: the host's pointers, as the header says.
        let (found, (fit, why)) = unsafe { misfit(comm, places(), mesh, (options, cell_segment), record)? };
        *fit = i32::from(found.is_none());
        raw::put_text(&found.unwrap_or_default(), why);
        Ok(0)
    }

    /// Elastic modes that the mesh must have for a model.
    fn m4gn_model_elastic_modes(comm: i32, model: *const c_char) -> i32, or no_count; {
        // SAFETY: the host's string, or null.
        let path = unsafe { raw::text("model", model) }.map(PathBuf::from);
        elastic_modes(comm, path)
    }
}
