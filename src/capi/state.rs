//! The arrays of a host's state.

use super::pointers;
use m4gn_base::{Error, Result};
use m4gn_state::{Array, Layout, Place, Role, Values};
use std::ffi::{c_char, c_void};

/// `m4gn_array`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct ArrayData {
    pub name: *const c_char,
    pub place: i32,
    pub role: i32,
    pub components: i32,
    pub solved: i32,
    pub n: i64,
    pub floor: f64,
    pub weights: *const f64,
}

/// The member `ahead` of `m4gn_host`.
pub type AheadFunction = unsafe extern "C" fn(*mut c_void, f64, *const *mut f64) -> i32;

/// The arrays that a host describes.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn layout(arrays: *const ArrayData, n: i32) -> Result<Layout> {
    let mut all = Vec::new();
    // SAFETY: passed on to the caller.
    for data in unsafe { pointers::slice("arrays", arrays, pointers::count("n_arrays", n)?)? } {
        // SAFETY: passed on to the caller.
        let name = unsafe { pointers::text("arrays.name", data.name)? }.to_string();
        let bad = |what: &str, found: i64, expected: &str| {
            Error::Input(format!("array {name}: {what} {found}: expected {expected}"))
        };
        let place = match data.place {
            0 => Place::Cells,
            1 => Place::Points,
            2 => Place::Faces,
            3 => Place::Boundary,
            n => return Err(bad("place", n.into(), "M4GN_CELLS to M4GN_BOUNDARY")),
        };
        let role = match data.role {
            0 => Role::Solved,
            1 => Role::Follows,
            2 => Role::Carried,
            3 => Role::Prescribed,
            4 => Role::Held,
            n => return Err(bad("role", n.into(), "M4GN_SOLVED to M4GN_HELD")),
        };
        let count = |what: &str, v: i64| usize::try_from(v).map_err(|_| bad(what, v, "0 or more"));
        let items = count("n", data.n)?;
        let components = count("components", data.components.into())?;
        let is_measured = matches!(role, Role::Solved | Role::Follows);
        let solved = if is_measured { count("solved", data.solved.into())? } else { 0 };
        let weights = match role == Role::Solved && !data.weights.is_null() {
            // SAFETY: passed on to the caller.
            true => unsafe { pointers::slice("arrays.weights", data.weights, items)? }.to_vec(),
            false => Vec::new(),
        };
        let floor = (data.floor != f64::NEG_INFINITY).then_some(data.floor);
        all.push(Array { name, place, role, components, solved, items, floor, weights });
    }
    Layout::new(all)
}

/// The values of a state; null is none.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn read<'a>(layout: &Layout, state: *const *const f64) -> Result<Option<Vec<&'a [f64]>>> {
    if state.is_null() {
        return Ok(None);
    }
    let arrays = layout.arrays();
    // SAFETY: passed on to the caller.
    let values = unsafe { pointers::slice("state", state, arrays.len())? };
    let pairs = values.iter().zip(arrays);
    // SAFETY: passed on to the caller.
    let all = pairs.map(|(&values, array)| unsafe { pointers::slice(&array.name, values, array.numbers()) });
    all.collect::<Result<_>>().map(Some)
}

/// Where the arrays of a predicted state go; null of one that is prescribed, and where not all are needed, of one that is not wanted.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn places<'a>(
    layout: &Layout,
    next: *const *mut f64,
    all: bool,
) -> Result<Vec<&'a mut [f64]>> {
    let arrays = layout.arrays();
    // SAFETY: passed on to the caller.
    let values = unsafe { pointers::slice("next", next, arrays.len())? };
    let pairs = values.iter().zip(arrays);
    let place = |(&values, array): (&*mut f64, &Array)| match array.role {
        Role::Prescribed | Role::Held => Ok(&mut [][..]),
        _ if values.is_null() && !all => Ok(&mut [][..]),
        // SAFETY: passed on to the caller; no two are the same.
        _ => unsafe { pointers::slice_mut(&array.name, values, array.numbers()) },
    };
    pairs.map(place).collect()
}

/// Asks the host what its prescribed arrays will be.
pub(super) fn ahead(function: AheadFunction, data: *mut c_void) -> m4gn_ride::Ahead<'static> {
    Box::new(move |later: f64, values: &mut Values| {
        let pointer = |v: &mut Vec<f64>| if v.is_empty() { std::ptr::null_mut() } else { v.as_mut_ptr() };
        let arrays: Vec<*mut f64> = values.iter_mut().map(pointer).collect();
        // SAFETY: arrays of the described lengths, which live through the call; the host's function and data, as the header says.
        match unsafe { function(data, later, arrays.as_ptr()) } {
            0 => Ok(()),
            status => Err(Error::Input(format!(
                "the host does not say what is prescribed {later} s from now: status {status}"
            ))),
        }
    })
}
