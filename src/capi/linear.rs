//! The arrays of a solver's state, which a dmd surrogate is fitted to.

use super::raw;
use m4gn_linear::{Field, Weight};
use m4gn_mesh::{Error, Result};
use m4gn_ride::Advanced;
use std::ffi::c_char;

/// `m4gn_ride_array`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct ArrayData {
    pub name: *const c_char,
    pub n: i64,
    pub components: i32,
    pub solved: i32,
    pub positive: i32,
    pub fitted: i32,
    pub input: i32,
    pub weights: *const f64,
}

/// The arrays, and those of them that are fields at the rows of the mesh.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn layout(arrays: *const ArrayData, n: i32) -> Result<(Vec<Field>, Vec<Advanced>)> {
    let (mut fields, mut advanced) = (Vec::new(), Vec::new());
    // SAFETY: passed on to the caller.
    unsafe {
        for given in raw::slice("arrays", arrays, raw::count("n_arrays", n)?)? {
            let name = raw::text("arrays.name", given.name)?.to_string();
            let count = |what: &str, v: i64| {
                usize::try_from(v)
                    .map_err(|_| Error::Input(format!("array {name}: {what} {v}: expected 0 or more")))
            };
            let (len, components) = (count("n", given.n)?, count("components", given.components.into())?);
            let solved = count("solved", given.solved.into())?;
            let mut weight = Weight::Carried;
            if solved > 0 {
                if given.fitted != 0 {
                    let items = len / components.max(1);
                    weight = Weight::Items(raw::slice("arrays.weights", given.weights, items)?.to_vec());
                }
                advanced.push(Advanced { name: name.clone(), components, solved });
            }
            let input = given.input != 0;
            if input && solved == 0 {
                weight = Weight::One;
            }
            fields.push(Field { name, len, components, weight, positive: given.positive != 0, input });
        }
    }
    Ok((fields, advanced))
}

/// Measured arrays are fields at the rows of the mesh.
pub(super) fn check_rows(fields: &[Field], advanced: &[Advanced], rows: usize) -> Result<()> {
    let at_rows = |f: &&Field| advanced.iter().any(|a| a.name == f.name);
    match fields.iter().filter(at_rows).find(|f| f.len != f.components * rows) {
        None => Ok(()),
        Some(f) => Err(Error::Input(format!(
            "array {}: {} numbers of {} components: expected those of the mesh's {rows} cells",
            f.name, f.len, f.components
        ))),
    }
}

/// Arrays of these lengths.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn read<'a>(
    arrays: *const *const f64,
    n: i32,
    lengths: &[usize],
) -> Result<Vec<&'a [f64]>> {
    // SAFETY: passed on to the caller.
    let given = unsafe { raw::slice("arrays", arrays, expected(n, lengths)?)? };
    let pairs = given.iter().zip(lengths);
    // SAFETY: passed on to the caller.
    pairs.map(|(&a, &len)| unsafe { raw::slice("arrays", a, len) }).collect()
}

/// The same, to be written.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn places<'a>(
    arrays: *const *mut f64,
    n: i32,
    lengths: &[usize],
) -> Result<Vec<&'a mut [f64]>> {
    // SAFETY: passed on to the caller.
    let given = unsafe { raw::slice("arrays", arrays, expected(n, lengths)?)? };
    let pairs = given.iter().zip(lengths);
    // SAFETY: passed on to the caller; no two are the same.
    pairs.map(|(&a, &len)| unsafe { raw::slice_mut("arrays", a, len) }).collect()
}

fn expected(n: i32, lengths: &[usize]) -> Result<usize> {
    match raw::count("n_arrays", n)? {
        n if n == lengths.len() => Ok(n),
        n => Err(Error::Input(format!("{n} arrays: expected {}, those of the ride's start", lengths.len()))),
    }
}
