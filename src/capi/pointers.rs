//! Texts from and to a host; meshes, slices and strings are those
//! of [`m4gn_mesh::ffi::host`].

use m4gn_base::Result;
pub use m4gn_mesh::ffi::host::*;
use std::ffi::c_char;

/// The settings of a call, a JSON object; null is an empty one.
///
/// # Safety
/// As [`optional_text`].
pub unsafe fn options<'a>(pointer: *const c_char) -> Result<&'a str> {
    // SAFETY: passed on to the caller.
    Ok(unsafe { optional_text("options", pointer) }?.unwrap_or("{}"))
}

/// One of our objects; null is none.
///
/// # Safety
/// As [`reference`].
pub unsafe fn optional_reference<'a, T>(what: &str, pointer: *const T) -> Result<Option<&'a T>> {
    match pointer.is_null() {
        true => Ok(None),
        // SAFETY: passed on to the caller.
        false => unsafe { reference(what, pointer) }.map(Some),
    }
}

/// The segment of each cell that the host gives; null is none.
///
/// # Safety
/// As [`slice`].
pub unsafe fn labels(pointer: *const i32, n_cells: usize) -> Result<Option<Vec<i32>>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: passed on to the caller.
    Ok(Some(unsafe { slice("cell_segment", pointer, n_cells)? }.to_vec()))
}

/// Writes as much of the text as fits, ended by a zero byte.
pub fn put_text(text: &str, place: &mut [c_char]) {
    let most = place.len().saturating_sub(1);
    let bytes = text.bytes().filter(|b| *b != 0).take(most).chain([0]);
    for (to, byte) in place.iter_mut().zip(bytes) {
        *to = byte as c_char;
    }
}
