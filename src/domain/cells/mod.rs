//! Fields at the cells of a mesh that stays.

mod groups;
mod host;
mod levels;

pub use host::CellsHost;
pub use levels::Levels;

use crate::{Boundary, Components, Domain, Place};
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_model::modal::ModalSource;
use m4gn_model::{ModelSpec, SegmentSpec, cell_size};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;

/// The fields at cells, or groups of them, and at their boundary faces.
#[derive(Clone, Debug)]
pub struct Cells {
    components: Components,
    boundary: Boundary,
}

impl Cells {
    /// On the mesh of the network's nodes.
    pub fn new(nodes: &Mesh, spec: &ModelSpec) -> Self {
        Cells { components: Components::new(spec), boundary: Boundary::new(nodes, &spec.fields, spec.dim) }
    }

    /// Of a graph without a mesh: so many cells and boundary nodes, whose values are prescribed.
    pub fn prescribed(n_cells: usize, n_boundary: usize, spec: &ModelSpec) -> Self {
        Cells {
            components: Components::new(spec),
            boundary: Boundary::prescribed(n_cells, n_boundary, &spec.fields, spec.dim),
        }
    }
}

impl Domain for Cells {
    fn components(&self) -> &Components {
        &self.components
    }

    fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    fn boundary_mut(&mut self) -> &mut Boundary {
        &mut self.boundary
    }

    fn inputs(&self, state: &[f32], _next: &[f32], inputs: &mut Vec<f32>) {
        let c = &self.components;
        inputs.clear();
        for row in state.chunks_exact(c.count) {
            inputs.extend(c.inputs.iter().map(|&i| row[i]));
        }
    }

    fn inputs_backward(&self, d_inputs: &[f32], d_state: &mut [f32]) {
        let c = &self.components;
        let rows = d_inputs.chunks_exact(c.inputs.len());
        for (d, row) in d_state.chunks_exact_mut(c.count).zip(rows) {
            c.inputs.iter().zip(row).for_each(|(&i, x)| d[i] += x);
        }
    }

    fn reflected(&self) -> Box<dyn Domain> {
        self.boxed()
    }

    fn boxed(&self) -> Box<dyn Domain> {
        Box::new(self.clone())
    }
}

/// As [`Place::whole`].
pub(crate) fn place(
    mesh: &Mesh,
    spec: &ModelSpec,
    settings: &SegmentSpec,
    resolution: Option<f64>,
    modes: &dyn ModalSource,
) -> Result<Place> {
    let comm = Comm::serial();
    let coarse = match resolution {
        Some(length) => Coarse::new(mesh, length, &comm)?,
        None => None,
    };
    let nodes = coarse.as_ref().map_or(mesh, |coarse| &coarse.mesh);
    Ok(Place {
        domain: Box::new(Cells::new(nodes, spec)),
        structure: Structure::new(nodes, spec, settings, modes, None, &comm)?,
        cell_size: cell_size(nodes, &comm),
        coarse,
    })
}
