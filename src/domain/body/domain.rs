//! A body as a domain: edges and inputs of its states, and their derivatives.

use super::coarser;
use super::graph::{Body, MeshEdge, by_ends};
use crate::{Boundary, Components, Domain};
use m4gn_base::{Error, Result};
use m4gn_mesh::vector::Vector;
use m4gn_model::N_CONTACT_INPUTS;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;

impl Body {
    /// The same body and obstacle reflected in y.
    pub fn mirrored(&self) -> Self {
        let flip = |x: &mut Vector| x[1] = -x[1];
        let mut other = self.clone();
        other.rest.iter_mut().for_each(flip);
        other.obstacle.iter_mut().for_each(flip);
        other.edges.iter_mut().for_each(|e| flip(&mut e.rest));
        // So that normals still leave the obstacle.
        other.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        other
    }
}

impl Domain for Body {
    fn components(&self) -> &Components {
        &self.components
    }

    fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    fn boundary_mut(&mut self) -> &mut Boundary {
        &mut self.boundary
    }

    fn is_held(&self, point: usize, _component: usize) -> bool {
        self.held[point]
    }

    fn set_edges(&self, comm: &Comm, state: &mut [f32], structure: &mut Structure) -> Result<()> {
        let (local, owned) = (3 * self.n_local, 3 * self.n_owned);
        let checked = match state[..owned.min(state.len())].iter().position(|v| !v.is_finite()) {
            _ if state.len() < local => {
                Err(Error::Input(format!("{} displacement components, expected {local}", state.len())))
            }
            Some(i) => Err(Error::Numerical(format!("the displacement of node {} is {}", i / 3, state[i]))),
            None => Ok(()),
        };
        comm.agree(checked)?;
        let Structure { graph, levels, .. } = structure;
        graph.halo.exchange_f32(comm, &mut state[..local], 3);
        self.edges_at(&state[..local], graph);
        coarser::strain(comm, &state[..local], levels);
        Ok(())
    }

    fn edges_backward(&self, structure: &Structure, d: &[Vec<f32>], d_state: &mut [f32]) {
        let Some((d, of_levels)) = d.split_first() else { return };
        by_ends(&structure.graph, d, 1.0, d_state);
        coarser::strain_backward(&structure.levels, of_levels, d_state);
    }

    fn inputs(&self, state: &[f32], next: &[f32], inputs: &mut Vec<f32>) {
        self.inputs_at(state, next, inputs);
    }

    /// The motion of an obstacle is prescribed, and how near it is counts as given.
    fn inputs_backward(&self, d_inputs: &[f32], d_state: &mut [f32]) {
        let fields = self.components.inputs.len();
        let rows = d_inputs.chunks_exact(fields + N_CONTACT_INPUTS);
        for (to, d) in d_state.chunks_exact_mut(self.components.count).zip(rows) {
            to.iter_mut().zip(&d[..fields]).for_each(|(to, d)| *to += d);
        }
    }

    fn reflected(&self) -> Box<dyn Domain> {
        Box::new(self.mirrored())
    }

    fn boxed(&self) -> Box<dyn Domain> {
        Box::new(self.clone())
    }

    fn ranging<'a>(&self, frame: &'a [f32]) -> &'a [f32] {
        &frame[..self.n_points() * self.components.count]
    }

    fn mesh_edges(&self) -> Option<&[MeshEdge]> {
        Some(&self.edges)
    }

    fn world_edges(&self, state: &[f32]) -> Vec<MeshEdge> {
        self.world_edges_at(state)
    }
}
