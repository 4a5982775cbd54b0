//! A field on a mesh, as a host has it.

/// A field at one time on this rank. Vectors are three values (x, y, z) a row whatever the solved directions.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// Name, as in the model, or as the recording declares it.
    pub name: &'a str,
    /// 1 or 3.
    pub components: usize,
    /// `[n_cells x components]`
    pub cells: &'a [f64],
    /// `[n_boundary x components]`, face values.
    pub boundary: &'a [f64],
}
