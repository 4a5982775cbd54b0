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

fn check_one(material: &Material, cell: usize) -> Result<()> {
    let positive = |name: &str, unit: &str, value: f64| {
        if value.is_finite() && value > 0.0 {
            return Ok(());
        }
        Err(Error::Input(format!(
            "{name} of cell {cell} is {value} {unit}: expected a positive finite number"
        )))
    };
    positive("Young's modulus", "Pa", material.young)?;
    positive("density", "kg/m^3", material.density)?;
    if !(material.poisson > -1.0 && material.poisson < 0.5) {
        return Err(Error::Input(format!(
            "Poisson's ratio of cell {cell} is {}: expected a value above -1 and below 0.5; for a material that \
             keeps its volume set 0.4999",
            material.poisson
        )));
    }
    // The bulk modulus divides by 1 - 2 nu.
    if material.poisson > 0.5 - 1e-7 {
        return Err(Error::Input(format!(
            "Poisson's ratio of cell {cell} is within 1e-7 of 0.5: the stiffness matrix would be singular to \
             rounding; set 0.4999"
        )));
    }
    Ok(())
}

/// One material a cell, each with values that make sense.
pub(super) fn check(materials: &[Material], n_cells: usize) -> Result<()> {
    refuse(materials.len() != n_cells, Error::Input, || {
        format!("{} materials for {n_cells} cells: expected one a cell", materials.len())
    })?;
    materials.iter().enumerate().try_for_each(|(c, m)| check_one(m, c))
}
