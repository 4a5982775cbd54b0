//! Elastic bodies as C has them: `m4gn_solid` of `m4gn.h`.

use super::host::{count, directions, slice, vectors};
use m4gn_base::Result;

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
    pub free_body: i32,
}

/// The same as slices.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct SolidArrays<'a> {
    pub directions: Vec<usize>,
    pub points: &'a [[f64; 3]],
    pub point_global: &'a [i64],
    pub face_start: &'a [i32],
    pub face_points: &'a [i32],
    pub face_owner: &'a [i32],
    pub face_neighbour: &'a [i32],
    pub young: &'a [f64],
    pub poisson: &'a [f64],
    pub density: &'a [f64],
    pub fixed_point: &'a [i32],
    /// None: all components.
    pub fixed_components: Option<&'a [i32]>,
    pub plane_stress: bool,
    pub free_body: bool,
}

impl SolidData {
    /// The arrays, of the lengths that the counts say; labels are checked where they are used.
    ///
    /// # Errors
    /// [`m4gn_base::Error::Input`] naming a null pointer or a negative count.
    ///
    /// # Safety
    /// Pointers must be what `m4gn.h` says, and stay as they are while the slices live.
    pub unsafe fn arrays<'a>(&self) -> Result<SolidArrays<'a>> {
        let directions = directions(self.n_directions, self.directions)?;
        let points = count("n_points", self.n_points)?;
        let faces = count("n_faces", self.n_faces)?;
        let internal = count("n_internal_faces", self.n_internal_faces)?;
        let cells = count("n_cells", self.n_cells)?;
        let fixed = count("n_fixed", self.n_fixed)?;
        // SAFETY: the lengths are those that the header gives for each array.
        unsafe {
            let face_start = slice("face_start", self.face_start, faces + 1)?;
            let listed = count("last face_start", face_start[faces])?;
            Ok(SolidArrays {
                directions,
                points: vectors("points", self.points, points)?,
                point_global: slice("point_global", self.point_global, points)?,
                face_start,
                face_points: slice("face_points", self.face_points, listed)?,
                face_owner: slice("face_owner", self.face_owner, faces)?,
                face_neighbour: slice("face_neighbour", self.face_neighbour, internal)?,
                young: slice("young", self.young, cells)?,
                poisson: slice("poisson", self.poisson, cells)?,
                density: slice("density", self.density, cells)?,
                fixed_point: slice("fixed_point", self.fixed_point, fixed)?,
                fixed_components: match self.fixed_components.is_null() {
                    true => None,
                    false => Some(slice("fixed_components", self.fixed_components, fixed)?),
                },
                plane_stress: self.plane_stress != 0,
                free_body: self.free_body != 0,
            })
        }
    }
}
