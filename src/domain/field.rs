//! Predicted fields, as a host has them.

use m4gn_base::{Error, Result, refuse};

/// Where a predicted field goes.
#[derive(Debug)]
pub struct FieldMut<'a> {
    /// Name, as in the model.
    pub name: &'a str,
    /// 1 or 3.
    pub components: usize,
    /// `[n_cells x components]`; components that are not solved stay as they are.
    pub cells: &'a mut [f64],
}

/// Whether an array of field `name` is as the model and the mesh want it, `n` rows.
///
/// # Errors
/// [`Error::Input`] naming the field, what was expected and what was found.
pub fn expect_shape(
    name: &str,
    what: &str,
    vector: bool,
    components: usize,
    len: usize,
    n: usize,
) -> Result<()> {
    let expected = if vector { 3 } else { 1 };
    if components != expected {
        let kind = if vector { "a vector" } else { "a scalar" };
        return Err(Error::Input(format!(
            "field '{name}': the model has {kind} ({expected} components), found {components} components"
        )));
    }
    refuse(len != n * components, Error::Input, || {
        format!("field '{name}': expected {} {what} values ({n} x {components}), found {len}", n * components)
    })
}
