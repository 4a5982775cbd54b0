//! The elastic body of a solid's case.

use super::FoamCase;
use m4gn_base::Result;
use m4gn_mesh::ElasticModes;
use m4gn_model::modal::ModalOptions;
use m4gn_modes::fem;
use m4gn_parallel::Comm;

impl FoamCase {
    /// Modes of the elastic body in the cells, as the function objects make them; none where the case has no
    /// displacement or its material is not known. After [`FoamCase::mesh`].
    ///
    /// # Errors
    /// As [`fem::modes`].
    pub fn elastic_modes(&mut self, modal: &ModalOptions) -> Result<Option<ElasticModes>> {
        let Some(body) = &self.body else {
            return Ok(None);
        };
        let options = fem::Options { modal: modal.clone(), ..body.options.clone() };
        let found = fem::modes(&body.mesh, &body.materials, &body.fixed, &options, &Comm::serial())?;
        let points = body.mesh.cell_points();
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
