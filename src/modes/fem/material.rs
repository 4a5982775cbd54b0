//! Isotropic linear elasticity, cell by cell.

use m4gn_base::{Error, Result, refuse};
pub use m4gn_mesh::body::Material;

/// What a 2-D mesh is a section of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Plane {
    /// A body that is long, or held, in the third direction: no strain there.
    #[default]
    Strain,
    /// A thin plate: no stress in the third direction.
    Stress,
}

/// Lamé's first parameter and the shear modulus, Pa, of `dim` directions.
pub(super) fn moduli(material: &Material, dim: usize, plane: Plane) -> (f64, f64) {
    let (e, nu) = (material.young, material.poisson);
    let mu = e / (2.0 * (1.0 + nu));
    let lambda = match (dim, plane) {
        (2, Plane::Stress) => e * nu / (1.0 - nu * nu),
        _ => e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
    };
    (lambda, mu)
}

/// One material a cell, each with values that make sense.
pub(super) fn check(materials: &[Material], n_cells: usize) -> Result<()> {
    refuse(materials.len() != n_cells, Error::Input, || {
        format!("{} materials for {n_cells} cells: expected one a cell", materials.len())
    })?;
    materials.iter().enumerate().try_for_each(|(c, m)| m.check(("cell", c), Error::Input))
}
