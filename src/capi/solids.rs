//! Exports: modes of elastic bodies.

use super::modes::{ModesHandle, ModesOptionsData};
use super::raw;
use crate::Result;
use crate::fem::{self, Fixed, MassKind, Material, Options, Plane, PointMesh};
use crate::modes::Modes;
use crate::parallel::Comm;

/// `m4gn_solid`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct SolidData {
    pub n_directions: i32,
    pub directions: [i32; 3],
    pub n_points: i32,
    pub point_global: *const i64,
    pub points: *const f64,
    pub n_faces: i32,
    pub n_internal_faces: i32,
    pub face_start: *const i32,
    pub face_points: *const i32,
    pub face_owner: *const i32,
    pub face_neighbour: *const i32,
    pub n_cells: i32,
    pub young: *const f64,
    pub poisson: *const f64,
    pub density: *const f64,
    pub n_fixed: i32,
    pub fixed_point: *const i32,
    pub fixed_components: *const i32,
    pub plane_stress: i32,
    pub lumped_mass: i32,
    pub free_body: i32,
}

/// A body as it came in.
struct Body {
    mesh: PointMesh,
    materials: Vec<Material>,
    fixed: Vec<Fixed>,
    options: Options,
}

impl SolidData {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn mesh(&self) -> Result<PointMesh> {
        let directions = raw::directions(self.n_directions, self.directions)?;
        let points = raw::count("n_points", self.n_points)?;
        let faces = raw::count("n_faces", self.n_faces)?;
        let internal = raw::count("n_internal_faces", self.n_internal_faces)?;
        // SAFETY: the lengths are those that the header gives for each array.
        unsafe {
            let face_start = raw::slice("face_start", self.face_start, faces + 1)?;
            let listed = raw::count("last face_start", face_start[faces])?;
            Ok(PointMesh {
                directions,
                points: raw::vectors("points", self.points, points)?.to_vec(),
                point_global: raw::slice("point_global", self.point_global, points)?.to_vec(),
                n_cells: raw::count("n_cells", self.n_cells)?,
                face_start: face_start.to_vec(),
                face_points: raw::slice("face_points", self.face_points, listed)?.to_vec(),
                face_owner: raw::slice("face_owner", self.face_owner, faces)?.to_vec(),
                face_neighbour: raw::slice("face_neighbour", self.face_neighbour, internal)?.to_vec(),
            })
        }
    }

    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn read(&self) -> Result<Body> {
        // SAFETY: passed on to the caller, as are the lengths.
        unsafe {
            let mesh = self.mesh()?;
            let n = mesh.n_cells;
            let (young, poisson, density) = (
                raw::slice("young", self.young, n)?,
                raw::slice("poisson", self.poisson, n)?,
                raw::slice("density", self.density, n)?,
            );
            let materials = (0..n).map(|c| Material {
                young: young[c],
                poisson: poisson[c],
                density: density[c],
            });
            let count = raw::count("n_fixed", self.n_fixed)?;
            let points = raw::slice("fixed_point", self.fixed_point, count)?;
            let components = match self.fixed_components.is_null() {
                true => vec![7; count],
                false => raw::slice("fixed_components", self.fixed_components, count)?.to_vec(),
            };
            let fixed = points.iter().zip(components).map(|(&point, mask)| Fixed {
                point,
                components: [1, 2, 4].map(|bit| mask & bit != 0),
            });
            Ok(Body {
                materials: materials.collect(),
                fixed: fixed.collect(),
                options: Options {
                    mass: if self.lumped_mass != 0 {
                        MassKind::Lumped
                    } else {
                        MassKind::Consistent
                    },
                    plane: if self.plane_stress != 0 {
                        Plane::Stress
                    } else {
                        Plane::Strain
                    },
                    free_body: self.free_body != 0,
                    ..Default::default()
                },
                mesh,
            })
        }
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(comm: i32, body: *const SolidData, options: *const ModesOptionsData) -> Result<ModesHandle> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<Body> {
        // SAFETY: passed on to the caller.
        unsafe {
            let mut found = raw::reference("body", body)?.read()?;
            found.options.modal = raw::reference("options", options)?.read()?;
            Ok(found)
        }
    };
    let body = comm.agree(read())?;
    let found = fem::modes(&body.mesh, &body.materials, &body.fixed, &body.options, &comm)?;
    Ok(ModesHandle {
        n_rows: 3 * body.mesh.points.len(),
        modes: Modes {
            eigenvalues: found.eigenvalues,
            vectors: found
                .vectors
                .into_iter()
                .map(|v| v.into_iter().flatten().collect())
                .collect(),
        },
    })
}

exports! {
    /// Solves for the modes of an elastic body.
    fn m4gn_solid_modes_new(
        comm: i32,
        body: *const SolidData,
        options: *const ModesOptionsData,
        modes: *mut *mut ModesHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let modes = raw::reference_mut("modes", modes)?;
            *modes = std::ptr::null_mut();
            *modes = Box::into_raw(Box::new(new(comm, body, options)?));
        }
        Ok(0)
    }
}
