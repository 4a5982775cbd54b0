//! Fields of the host, by name: what a step and a recording read, and where a step writes.

use super::raw::{self, FieldData, FieldOut};
use m4gn_base::{Error, Result};
use m4gn_step::{Field, OutputShape};

/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn read_fields<'a>(
    (fields, n): (*const FieldData, i32),
    n_cells: usize,
    n_boundary: usize,
) -> Result<Vec<Field<'a>>> {
    // SAFETY: passed on to the caller.
    let list = unsafe { raw::slice("fields", fields, raw::count("number of fields", n)?)? };
    let read = |f: &FieldData| {
        // SAFETY: as above; the components were checked before the lengths are made of them.
        unsafe {
            let name = raw::text("field name", f.name)?;
            let components = components(name, f.components)?;
            Ok(Field {
                name,
                components,
                cells: raw::slice(name, f.cells, components * n_cells)?,
                // Who reads them says that they are missing.
                boundary: match f.boundary.is_null() {
                    true => &[],
                    false => raw::slice(name, f.boundary, components * n_boundary)?,
                },
            })
        }
    };
    list.iter().map(read).collect()
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn read_outputs<'a>(
    (out, n): (*const FieldOut, i32),
    n_cells: usize,
) -> Result<Vec<(OutputShape<'a>, *mut f64)>> {
    // SAFETY: passed on to the caller.
    let list = unsafe { raw::slice("outputs", out, raw::count("number of outputs", n)?)? };
    let read = |f: &FieldOut| {
        // SAFETY: as above.
        let name = unsafe { raw::text("output name", f.name)? };
        let components = components(name, f.components)?;
        let len = components * n_cells;
        if len > 0 && (f.cells.is_null() || !f.cells.is_aligned()) {
            return Err(Error::Input(format!(
                "output '{name}': expected an array of {len}, found a null pointer"
            )));
        }
        Ok((OutputShape { name, components, len }, f.cells))
    };
    list.iter().map(read).collect()
}

fn components(name: &str, n: i32) -> Result<usize> {
    match n {
        1 | 3 => Ok(n as usize),
        _ => Err(Error::Input(format!("field '{name}': expected 1 or 3 components, found {n}"))),
    }
}
