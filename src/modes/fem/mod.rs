//! Modes of elastic bodies (Algorithm 1, solid): finite-element stiffness and mass on the solver's own mesh (eq. 5),
//! K phi = omega^2 M phi.
//!
//! A mesh by points ([`PointMesh`]) of any polyhedra, or a 2-D one of any polygons, isotropic linear elasticity cell by
//! cell, held displacement components. Points are shared by ranks: each has one owner, which assembles its rows. Which
//! elements, and why they do not lock, is said in `smoothing.rs`; measured figures stand in `docs/lab/2026-11-solids.md`.

mod assembly;
mod body;
mod check;
mod constraint;
mod host;
mod material;
mod mesh;
mod numbering;
mod plane;
mod smoothing;
mod strain;
mod volume;

#[cfg(test)]
#[path = "../../../tests/samples/points.rs"]
pub mod sample;

pub use body::body_modes;
pub use constraint::Fixed;
pub use host::HostBody;
pub use material::{Material, Plane};
pub use mesh::PointMesh;

use crate::{Mass, Problem};
use m4gn_base::{Error, Result};
use m4gn_mesh::Extent;
use m4gn_model::modal::{ModalOptions, Modes};
use m4gn_parallel::Comm;
use mesh::Cell;
use numbering::Numbering;
use strain::CellMass;

/// Eigenvalues below this, relative to the shift, are those of rigid motions.
const RIGID: f64 = 1e-4;

/// What is solved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// 2-D only: plane strain or plane stress. In 2-D a body is 1 m thick whatever the mesh is.
    pub plane: Plane,
    /// Whether a body that is held nowhere is meant: its rigid motions then come first, with eigenvalues 0.
    pub free_body: bool,
    /// Number of modes, eigensolver.
    pub modal: ModalOptions,
}

/// Displacement modes, by ascending eigenvalue.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidModes {
    /// Squared angular frequencies, 1/s^2.
    pub eigenvalues: Vec<f64>,
    /// For each mode the displacement (x, y, z) of each of this rank's points, those that other ranks have too
    /// included; 0 where it is held and in the third direction of 2-D. Scaled to phi^T M phi = the body's mass: the
    /// root mean square of the displacement over the body is 1.
    pub vectors: Vec<Vec<[f64; 3]>>,
}

/// Stiffness and mass of a body, distributed, with held displacements removed.
pub struct System {
    /// K and M of the points that move, `dim` unknowns a point, points in the order of `owned_points`.
    pub problem: Problem,
    /// Local points of this rank's rows.
    pub owned_points: Vec<usize>,
    /// Mass of the whole body, held points included, kg (2-D: kg for 1 m of thickness).
    pub mass: f64,
    numbering: Numbering,
    /// Place of each row's point among this rank's own points.
    movable: Vec<usize>,
    /// For each local point the one that carries its unknowns.
    representative: Vec<Option<usize>>,
    directions: Vec<usize>,
}

/// Assembles stiffness and mass of a body from one material a cell. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::Mesh`] for meshes that are not whole, inverted cells, and global point numbers that do not fit together;
/// [`Error::Input`] for materials out of range and where nothing is held (unless `free_body`) or nothing can move.
pub fn assemble(
    mesh: &PointMesh,
    materials: &[Material],
    fixed: &[Fixed],
    options: &Options,
    comm: &Comm,
) -> Result<System> {
    mesh.check(comm)?;
    comm.agree(material::check(materials, mesh.n_cells))?;
    let dim = mesh.dim();
    let planar = dim == 2;
    let (cells, representative) = comm.agree(cells(mesh))?;
    let mut carries = vec![false; mesh.points.len()];
    for &p in cells.iter().flat_map(|c| &c.points) {
        carries[p] = true;
    }
    let numbering = Numbering::new(mesh, &carries, planar, comm)?;
    let held = constraint::held(mesh, fixed, &representative, options.free_body, &numbering, comm)?;

    let along = |x: &[f64; 3]| [0, 1, 2].map(|d| mesh.directions.get(d).map_or(0.0, |&k| x[k]));
    let x: Vec<[f64; 3]> = mesh.points.iter().map(along).collect();
    let moduli: Vec<(f64, f64)> = materials.iter().map(|m| material::moduli(m, dim, options.plane)).collect();
    let averages = volume::averages(&cells, &mesh.point_global, &numbering, comm);
    let (strains, units) = smoothing::strains(&cells, &x, &moduli, &numbering, &averages, comm)?;
    let masses: Vec<CellMass> = cells
        .iter()
        .zip(units)
        .zip(materials)
        .map(|((cell, unit), material)| CellMass {
            points: cell.points.iter().map(|&p| numbering.number[p].unwrap_or(-1)).collect(),
            mass: unit.iter().map(|m| m * material.density).collect(),
        })
        .collect();
    let mut mass = [masses.iter().flat_map(|m| &m.mass).sum::<f64>()];
    comm.sum_f64(&mut mass);

    let strains = strain::to_owners(strains, &numbering, comm);
    let masses = strain::to_owners(masses, &numbering, comm);
    let movable = assembly::Movable::new(&held, dim, comm);
    let (stiffness, masses) = assembly::rows(&strains, &masses, dim, &numbering, &movable, comm);
    let owned_points: Vec<usize> = movable.own.iter().map(|&i| numbering.owned[i]).collect();
    Ok(System {
        problem: Problem {
            stiffness,
            mass: Mass::Matrix(masses),
            block: dim,
            positions: owned_points.iter().map(|&p| x[p]).collect(),
            shift: Some(shift(mesh, &x, materials, comm)),
        },
        owned_points,
        mass: mass[0],
        numbering,
        movable: movable.own,
        representative,
        directions: mesh.directions.clone(),
    })
}

/// A little below 0, measured by shear waves across the body: near enough for slender bodies, far enough for the
/// rigid motions of free ones not to drown the others in rounding. 1/s^2. Collective.
fn shift(mesh: &PointMesh, x: &[[f64; 3]], materials: &[Material], comm: &Comm) -> f64 {
    let Extent { low, high } = Extent::around(x.iter(), comm);
    let speed = |m: &Material| material::moduli(m, mesh.dim(), Plane::Strain).1 / m.density;
    let mut fastest = [materials.iter().map(speed).fold(f64::NEG_INFINITY, f64::max)];
    comm.max_f64(&mut fastest);
    let square: f64 = (0..mesh.dim()).map(|d| (high[d] - low[d]).powi(2)).sum();
    -1e-3 * fastest[0] / square
}

/// Cells, and for each local point the one that carries its unknowns.
fn cells(mesh: &PointMesh) -> Result<(Vec<Cell>, Vec<Option<usize>>)> {
    if mesh.dim() == 2 {
        let section = plane::section(mesh)?;
        return Ok((section.cells, section.twin));
    }
    Ok((mesh.polyhedra(), (0..mesh.points.len()).map(Some).collect()))
}

/// The first displacement modes of a body. Collective; all ranks fail together.
///
/// If the last eigenvalue is repeated, its whole cluster is returned. Signs, and bases of repeated eigenvalues, are
/// chosen by positions alone.
///
/// # Errors
/// As [`assemble`] and [`crate::solve`].
pub fn modes(
    mesh: &PointMesh,
    materials: &[Material],
    fixed: &[Fixed],
    options: &Options,
    comm: &Comm,
) -> Result<SolidModes> {
    let system = assemble(mesh, materials, fixed, options, comm)?;
    let found = crate::solve(&system.problem, comm, &options.modal)?;
    let zero = system.problem.shift.map_or(0.0, |s| RIGID * s.abs());
    comm.agree(match found.eigenvalues.first() {
        Some(&value) if value <= zero && !options.free_body => Err(Error::Input(format!(
            "the body, or a part of it that shares no point with the rest, is not held: it moves without deforming \
             (eigenvalue {value:e} 1/s^2). Hold points that do not all lie on a line of each part, or ask for a free body's \
             modes"
        ))),
        _ => Ok(()),
    })?;
    Ok(system.displacements(found, comm))
}

impl System {
    /// From the scale of [`crate::solve`], which knows the movable points' mass only, to the body's. Collective.
    fn scale(&self, comm: &Comm) -> f64 {
        let mut sum = [self.problem.mass.values().iter().sum::<f64>()];
        comm.sum_f64(&mut sum);
        (self.mass * self.directions.len() as f64 / sum[0]).sqrt()
    }

    /// Turns rows' values into displacements of all of this rank's points. Collective.
    fn displacements(&self, found: Modes, comm: &Comm) -> SolidModes {
        let dim = self.directions.len();
        // The points whose unknowns this rank's points carry, each once.
        let number = |r: &Option<usize>| r.and_then(|p| self.numbering.number[p]).unwrap_or(-1);
        let ask: Vec<i64> = self.representative.iter().map(number).collect();
        let known: Vec<i64> = ask.iter().copied().filter(|&n| n >= 0).collect();
        let weight = self.scale(comm);
        let mut vectors = Vec::with_capacity(found.vectors.len());
        for mode in &found.vectors {
            let mut own = vec![0.0; self.numbering.owned.len() * dim];
            for (row, &place) in self.movable.iter().enumerate() {
                for d in 0..dim {
                    own[place * dim + d] = mode[row * dim + d] * weight;
                }
            }
            let values = self.numbering.fetch(comm, &known, &own, dim);
            let mut values = values.chunks_exact(dim);
            let displacement = |&number: &i64| {
                let mut u = [0.0; 3];
                if number >= 0 {
                    for (&d, &v) in self.directions.iter().zip(values.next().unwrap_or(&[])) {
                        u[d] = v;
                    }
                }
                u
            };
            vectors.push(ask.iter().map(displacement).collect());
        }
        SolidModes { eigenvalues: found.eigenvalues, vectors }
    }
}

#[cfg(test)]
mod beam;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod refusals;
#[cfg(test)]
mod tests;
