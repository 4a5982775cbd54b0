//! Exports: whether what a mesh has stored fits the segments of a model.

use super::guard;
use super::model::ModelHandle;
use super::pointers::{self, MeshData};
use super::segments::{self, Asked, Request};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_parallel::Comm;
use std::ffi::c_char;

/// Why the labels are not the segments that the model and the entries of `options` describe, with the host's `places` for the
/// answer. Collective.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn misfit<P>(
    comm: i32,
    places: Result<P>,
    mesh: *const MeshData,
    model: *const ModelHandle,
    (options, cell_segment): (*const c_char, *const i32),
    record: *const c_char,
) -> Result<(Option<String>, P)> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<((P, Asked, String), String)> {
        let places = places?;
        // SAFETY: passed on to the caller.
        unsafe {
            let (asked, same) = segments::read(mesh, model, options, cell_segment)?;
            let record = pointers::optional_text("record", record)?.unwrap_or("").to_owned();
            if asked.2.labels.is_none() {
                return Err(Error::Input("cell_segment: expected labels, found a null pointer".into()));
            }
            Ok(((places, asked, record), same))
        }
    };
    guard::together("m4gn_segments_fit", &comm, read, |(places, (mesh, model, request), record)| {
        Ok((compare(&comm, &mesh, model, &request, record)?, places))
    })
}

/// Collective.
fn compare(
    comm: &Comm,
    mesh: &Mesh,
    model: Option<&ModelHandle>,
    request: &Request,
    record: String,
) -> Result<Option<String>> {
    let wanted = comm.agree(request.spec(model))?;
    // The root's: ranks that read their own file may differ.
    let mut text = record.into_bytes();
    comm.broadcast(&mut text);
    let record = String::from_utf8_lossy(&text);
    let only = match model.map(|handle| &handle.model.spec.architecture) {
        Some(architecture) if !architecture.needs().segments => return Ok(None),
        Some(_) => None,
        None => Some(request.segments.names()),
    };
    let labels = request.labels.as_deref().unwrap_or_default();
    Ok(m4gn_structure::misfit(mesh, labels, &record, &wanted, only.as_deref(), comm))
}

exports! {
    /// Whether stored segments are those that are wanted.
    fn m4gn_segments_fit(
        comm: i32,
        mesh: *const MeshData,
        model: *const ModelHandle,
        options: *const c_char,
        cell_segment: *const i32,
        record: *const c_char,
        fit: *mut i32,
        why: *mut c_char,
        why_size: i32,
    ) -> i32, or |status| status; {
        let places = || {
            let size = pointers::count("why_size", why_size)?;
            // SAFETY: the host's places, as the header says.
            unsafe { Ok((pointers::reference_mut("fit", fit)?, pointers::slice_mut("why", why, size)?)) }
        };
        // SAFETY: the host's pointers, as the header says.
        let (found, (fit, why)) = unsafe { misfit(comm, places(), mesh, model, (options, cell_segment), record)? };
        *fit = i32::from(found.is_none());
        pointers::put_text(&found.unwrap_or_default(), why);
        Ok(0)
    }
}
