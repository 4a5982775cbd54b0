//! An elastic body as a host describes it.

use super::{Fixed, Material, Options, Plane, PointMesh};
use m4gn_mesh::ffi::host::SolidArrays;

/// What [`super::modes`] takes, of a host's arrays.
#[derive(Clone, Debug)]
pub struct HostBody {
    /// Cells by faces and points.
    pub mesh: PointMesh,
    /// Of each cell.
    pub materials: Vec<Material>,
    /// Held displacements.
    pub fixed: Vec<Fixed>,
    /// What the body is; how many modes of it, the caller says.
    pub options: Options,
}

impl HostBody {
    /// A copy of the arrays.
    pub fn new(host: &SolidArrays) -> Self {
        let materials = host.young.iter().zip(host.poisson).zip(host.density);
        let masks = host.fixed_components.map_or(vec![7; host.fixed_point.len()], <[i32]>::to_vec);
        let fixed = host.fixed_point.iter().zip(masks);
        HostBody {
            mesh: PointMesh {
                directions: host.directions.clone(),
                points: host.points.to_vec(),
                point_global: host.point_global.to_vec(),
                n_cells: host.young.len(),
                face_start: host.face_start.to_vec(),
                face_points: host.face_points.to_vec(),
                face_owner: host.face_owner.to_vec(),
                face_neighbour: host.face_neighbour.to_vec(),
            },
            materials: materials
                .map(|((&young, &poisson), &density)| Material { young, poisson, density })
                .collect(),
            fixed: fixed
                .map(|(&point, mask)| Fixed { point, components: [1, 2, 4].map(|bit| mask & bit != 0) })
                .collect(),
            options: Options {
                plane: match host.plane_stress {
                    true => Plane::Stress,
                    false => Plane::Strain,
                },
                free_body: host.free_body,
                ..Options::default()
            },
        }
    }
}
