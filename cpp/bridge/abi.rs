//! The C interface that m4gn loads, version 8. Statuses: 0 fine, 1 failed; the message is `m4gn_foam_last_error()`.
//!
//! Everything is said with four calls on an open case: `m4gn_foam_describe` gives a JSON object, `m4gn_foam_query`
//! answers a JSON request with numbers, `m4gn_foam_mesh` hands out the structs of `m4gn.h`, and `m4gn_foam_write` writes
//! fields. A thread that opens a case must also use and close it:
//! OpenFOAM is not thread-safe.
#![allow(unsafe_code)]

use crate::foam::{self, FoamCase};
use cxx::UniquePtr;
use serde::Deserialize;
use std::{
    cell::RefCell,
    error::Error,
    ffi::{CStr, CString, c_char},
    panic::{AssertUnwindSafe, catch_unwind},
};

/// Version of this interface; m4gn refuses a library of another.
const ABI_VERSION: u32 = 8;

/// An open case and what it was last asked.
pub struct Case {
    foam: UniquePtr<FoamCase>,
    json: CString,
    data: Vec<f64>,
}

/// What can be asked. Times are indices into `times` of the description.
#[derive(Deserialize)]
#[serde(tag = "query", rename_all = "snake_case", deny_unknown_fields)]
enum Query {
    /// `[n x 3]` m.
    CellCentres,
    /// The n + 1 places where the points of each cell begin, then the x, y pairs; empty where the case is not 2-D.
    Polygons,
    /// 1 if the field is stored at that time, else 0.
    HasField { name: String, time: usize },
    /// `[n]`
    Scalar { name: String, time: usize },
    /// `[n x 3]`
    Vector { name: String, time: usize },
    /// Pressure part, viscous part: `[6]` m^4/s^2.
    Force { patch: String, time: usize },
    /// Flux, area, integral of U: `[5]`
    Flow { patch: String, time: usize },
    /// Stress of a solid at its cells, all nine components `[n x 9]`; empty where there is no `sigma` of that time.
    Stress { time: usize },
    /// Force on a patch of a solid, N: 0 and the vector `[4]`, or why there is none `[1]`: 1 no `sigma` is stored, 2 it was
    /// not advanced by the surrogate, 3 it is over the density, 4 the mesh moves with the body.
    Reaction { patch: String, time: usize },
    /// A field in the folder of the start time: 0 there is none, 1 the note in its header begins with `mark`, 2 it
    /// does not.
    StartField { name: String, mark: String },
    /// Takes the cells' values of the fields in the folder of the start time from those in other time folders of this mesh: their sum by the
    /// weights, each scaled by a ratio of velocities where a field has neither mass nor temperature in its dimensions. How many were taken.
    TakeStart { sources: Vec<String>, weights: Vec<f64>, ratios: Vec<f64> },
    /// Integrals of the products of the vector fields in such folders with those in the others, a row after the other.
    Products { folders: Vec<String> },
}

/// What [`m4gn_foam_write`] does.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Write {
    /// Names of the volScalarFields, written to the folder of the start time: all or none.
    fields: Vec<String>,
    /// Note in their headers.
    note: String,
    /// Fields in that folder to remove afterwards.
    remove: Vec<String>,
    /// How the segments among the fields were made, stored with them; empty: none are.
    segment_record: String,
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Runs `f`; its error, or a panic, becomes status 1 and the last error's message.
fn guarded(f: impl FnOnce() -> Result<(), Box<dyn Error>>) -> i32 {
    let message = match catch_unwind(AssertUnwindSafe(f)) {
        Ok(Ok(())) => return 0,
        Ok(Err(error)) => error.to_string(),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text =
                text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message");
            format!("internal error of the OpenFOAM bridge: {text}")
        }
    };
    LAST_ERROR.with_borrow_mut(|last| *last = CString::new(message.replace('\0', " ")).unwrap_or_default());
    1
}

/// # Safety
/// `text` is null or a C string that lives through the call.
unsafe fn utf8<'a>(text: *const c_char) -> Result<&'a str, String> {
    if text.is_null() {
        return Err("expected a string, found a null pointer".into());
    }
    // SAFETY: not null, and a C string by this function's contract.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| "expected UTF-8 text".into())
}

/// Version of the interface that this library was built with.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_foam_abi_version() -> u32 {
    ABI_VERSION
}

/// Message of the last failure on this thread; valid until the next call.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_foam_last_error() -> *const c_char {
    LAST_ERROR.with_borrow(|last| last.as_ptr())
}

/// Opens the case in folder `path`; `*case` is null on failure.
///
/// # Safety
/// `path` is a C string, `case` points to a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_open(path: *const c_char, case: *mut *mut Case) -> i32 {
    guarded(|| {
        if case.is_null() {
            return Err("expected a place for the case, found a null pointer".into());
        }
        // SAFETY: not null, and valid for a write by this function's contract.
        unsafe { *case = std::ptr::null_mut() };
        // SAFETY: this function's contract.
        let path = unsafe { utf8(path) }?;
        let foam = foam::open_case(path)?;
        let opened = Box::new(Case { foam, json: CString::default(), data: Vec::new() });
        // SAFETY: as above.
        unsafe { *case = Box::into_raw(opened) };
        Ok(())
    })
}

/// Closes a case; null is allowed.
///
/// # Safety
/// `case` comes from [`m4gn_foam_open`] and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_close(case: *mut Case) {
    guarded(|| {
        if !case.is_null() {
            // SAFETY: made by Box::into_raw in m4gn_foam_open and given back once.
            drop(unsafe { Box::from_raw(case) });
        }
        Ok(())
    });
}

/// `*json` is set to a description of the case as a JSON object, valid until the next call on this case.
///
/// # Safety
/// `case` comes from [`m4gn_foam_open`], `json` points to a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_describe(case: *mut Case, json: *mut *const c_char) -> i32 {
    guarded(|| {
        // SAFETY: null or an open case that nobody else uses during the call, by this function's contract.
        let case = unsafe { case.as_mut() }.ok_or("expected an open case, found a null pointer")?;
        let text = case.foam.describe()?;
        case.json = CString::new(text)?;
        if json.is_null() {
            return Err("expected a place for the description, found a null pointer".into());
        }
        // SAFETY: not null, and valid for a write by this function's contract.
        unsafe { *json = case.json.as_ptr() };
        Ok(())
    })
}

/// Answers a [`Query`] given as JSON: `*data` points to `*count` doubles, valid until the next call on this case.
///
/// # Safety
/// `case` comes from [`m4gn_foam_open`], `request` is a C string, `data` and `count` point to places for the answer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_query(
    case: *mut Case,
    request: *const c_char,
    data: *mut *const f64,
    count: *mut usize,
) -> i32 {
    guarded(|| {
        // SAFETY: null or an open case that nobody else uses during the call, by this function's contract.
        let case = unsafe { case.as_mut() }.ok_or("expected an open case, found a null pointer")?;
        // SAFETY: this function's contract.
        let request = unsafe { utf8(request) }?;
        let query = serde_json::from_str(request).map_err(|e| format!("query {request}: {e}"))?;
        case.data = answer(&mut case.foam, query)?;
        if data.is_null() || count.is_null() {
            return Err("expected places for the answer, found a null pointer".into());
        }
        // SAFETY: not null, and valid for writes by this function's contract.
        unsafe {
            *data = case.data.as_ptr();
            *count = case.data.len();
        }
        Ok(())
    })
}

/// The mesh as the case's function object would hand it to `libm4gn.so`, and, of a solid whose material is known, its elastic
/// body, else null. `node_types`: a JSON list of pairs, patch or group and node type, which go before those of the case's
/// function object. Both structs are valid until the next such call on this case.
///
/// # Safety
/// `case` comes from [`m4gn_foam_open`], `node_types` is a C string, `mesh` and `body` point to places for pointers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_mesh(
    case: *mut Case,
    node_types: *const c_char,
    mesh: *mut *const foam::m4gn_mesh_data,
    body: *mut *const foam::m4gn_solid,
) -> i32 {
    guarded(|| {
        // SAFETY: null or an open case that nobody else uses during the call, by this function's contract.
        let case = unsafe { case.as_mut() }.ok_or("expected an open case, found a null pointer")?;
        // SAFETY: this function's contract.
        let request = unsafe { utf8(node_types) }?;
        let pairs: Vec<(String, String)> =
            serde_json::from_str(request).map_err(|e| format!("node types {request}: {e}"))?;
        let (keys, types) = pairs.into_iter().unzip();
        case.foam.pin_mut().set_node_types(&keys, &types)?;
        if mesh.is_null() || body.is_null() {
            return Err("expected places for the mesh and the body, found a null pointer".into());
        }
        // SAFETY: not null, and valid for writes by this function's contract.
        unsafe {
            *mesh = case.foam.mesh();
            *body = case.foam.body();
        }
        Ok(())
    })
}

/// Writes what a [`Write`] given as JSON says; `data` holds `count` doubles, the cells of one field after the other.
///
/// # Safety
/// `case` comes from [`m4gn_foam_open`], `request` is a C string, `data` points to `count` doubles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_foam_write(
    case: *mut Case,
    request: *const c_char,
    data: *const f64,
    count: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: null or an open case that nobody else uses during the call, by this function's contract.
        let case = unsafe { case.as_mut() }.ok_or("expected an open case, found a null pointer")?;
        // SAFETY: this function's contract.
        let request = unsafe { utf8(request) }?;
        let write: Write = serde_json::from_str(request).map_err(|e| format!("write {request}: {e}"))?;
        let values = match (data.is_null(), count) {
            (_, 0) => &[],
            (true, _) => return Err("expected values, found a null pointer".into()),
            // SAFETY: not null, and `count` doubles by this function's contract.
            (false, _) => unsafe { std::slice::from_raw_parts(data, count) },
        };
        case.foam.write_start_fields(&write.fields, &write.note, values, &write.segment_record)?;
        Ok(write.remove.iter().try_for_each(|name| case.foam.remove_start_field(name))?)
    })
}

fn answer(case: &mut UniquePtr<FoamCase>, query: Query) -> Result<Vec<f64>, cxx::Exception> {
    let case = case.pin_mut();
    Ok(match query {
        Query::CellCentres => case.cell_centres()?,
        Query::Polygons => case.polygons()?,
        Query::HasField { name, time } => vec![f64::from(u8::from(case.has_field(&name, time)?))],
        Query::Scalar { name, time } => case.scalar_field(&name, time)?,
        Query::Vector { name, time } => case.vector_field(&name, time)?,
        Query::Force { patch, time } => case.force(&patch, time)?,
        Query::Flow { patch, time } => case.flow(&patch, time)?,
        Query::Stress { time } => case.stress(time)?,
        Query::Reaction { patch, time } => case.reaction(&patch, time)?,
        Query::TakeStart { sources, weights, ratios } => {
            vec![case.take_start(&sources, &weights, &ratios)? as f64]
        }
        Query::Products { folders } => case.products(&folders)?,
        Query::StartField { name, mark } => {
            let note = case.start_note(&name)?;
            vec![match (note.is_empty(), note.starts_with(&mark)) {
                (true, _) => 0.0,
                (_, true) => 1.0,
                (_, false) => 2.0,
            }]
        }
    })
}
