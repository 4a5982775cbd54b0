//! The elastic body of a solid's case.

use super::FoamCase;
use super::triples;
use crate::fem::{self, Fixed, Material, Options, Plane, PointMesh};
use crate::mesh::ElasticModes;
use crate::modes::ModalOptions;
use crate::parallel::Comm;
use crate::{Error, Result};

impl FoamCase {
    /// Modes of the elastic body in the cells, as the function objects make them; none where the case has no
    /// displacement or its material is not known. After [`FoamCase::mesh`].
    ///
    /// # Errors
    /// As [`fem::modes`].
    pub fn elastic_modes(&mut self, modal: &ModalOptions) -> Result<Option<ElasticModes>> {
        let flags = self.part("body_flags")?;
        let [plane_stress, free_body] = flags[..] else {
            return Ok(None);
        };
        let points = triples(&self.part("body_points")?);
        let (young, poisson, density) = (
            self.part("body_young")?,
            self.part("body_poisson")?,
            self.part("body_density")?,
        );
        let mesh = PointMesh {
            directions: self.part("directions")?.into_iter().map(|d| d as usize).collect(),
            point_global: (0..points.len() as i64).collect(),
            points,
            n_cells: young.len(),
            face_start: self.labels("body_face_start")?,
            face_points: self.labels("body_face_points")?,
            face_owner: self.labels("body_face_owner")?,
            face_neighbour: self.labels("body_face_neighbour")?,
        };
        if [poisson.len(), density.len()] != [young.len(); 2] {
            return Err(Error::Internal("material arrays of different lengths".into()));
        }
        let materials: Vec<Material> = (0..young.len())
            .map(|c| Material {
                young: young[c],
                poisson: poisson[c],
                density: density[c],
            })
            .collect();
        let held = self.labels("body_fixed_point")?;
        let fixed: Vec<Fixed> = held
            .into_iter()
            .zip(self.labels("body_fixed_components")?)
            .map(|(point, mask)| Fixed {
                point,
                components: [1, 2, 4].map(|bit| mask & bit != 0),
            })
            .collect();
        let options = Options {
            plane: if plane_stress != 0.0 {
                Plane::Stress
            } else {
                Plane::Strain
            },
            free_body: free_body != 0.0,
            modal: modal.clone(),
            ..Options::default()
        };
        let found = fem::modes(&mesh, &materials, &fixed, &options, &Comm::serial())?;
        let points = mesh.cell_points();
        let mean = |vector: &Vec<[f64; 3]>| {
            points
                .iter()
                .map(|points| {
                    let sum = |d: usize| points.iter().map(|&p| vector[p][d]).sum::<f64>();
                    [0, 1, 2].map(|d| sum(d) / points.len() as f64)
                })
                .collect()
        };
        Ok(Some(ElasticModes {
            vectors: found.vectors.iter().map(mean).collect(),
            eigenvalues: found.eigenvalues,
        }))
    }
}
