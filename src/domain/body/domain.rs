//! A body as a domain: edges and inputs of its states, and their derivatives.

use super::graph::{Body, MeshEdge, N_FEATURES, features_backward};
use crate::{Boundary, Components, Domain, Edges};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{Error, Result};
use m4gn_structure::graph::Graph;

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
        if let Some((skins, _)) = &mut other.skins {
            skins.reflect();
        }
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

    fn is_held(&self, point: usize) -> bool {
        self.held[point]
    }

    fn set_edges(&self, comm: &Comm, state: &mut [f32], graph: &mut Graph) -> Result<()> {
        let (local, owned) = (3 * self.n_local(), 3 * self.n_owned());
        let checked = match state[..owned.min(state.len())].iter().position(|v| !v.is_finite()) {
            _ if state.len() < local => {
                Err(Error::Input(format!("{} displacement components, expected {local}", state.len())))
            }
            Some(i) => Err(Error::Numerical(format!("the displacement of node {} is {}", i / 3, state[i]))),
            None => Ok(()),
        };
        comm.agree(checked)?;
        graph.halo.exchange_f32(comm, &mut state[..local], 3);
        self.edges_at(&state[..local], graph);
        Ok(())
    }

    fn edges_backward(&self, edges: &Edges, d: &[f32], d_state: &mut [f32]) {
        let rows = edges.features.chunks_exact(N_FEATURES).zip(d.chunks_exact(N_FEATURES));
        for ((x, d), (&s, &r)) in rows.zip(edges.senders.iter().zip(&edges.receivers)) {
            for (i, by) in features_backward(x, d).into_iter().enumerate() {
                d_state[3 * s as usize + i] += by;
                d_state[3 * r as usize + i] -= by;
            }
        }
    }

    fn inputs(&self, state: &[f32], next: &[f32], inputs: &mut Vec<f32>) {
        self.inputs_at(state, next, inputs);
    }

    /// The motion of an obstacle is prescribed, and how near it is counts as given.
    fn inputs_backward(&self, _d_inputs: &[f32], _d_state: &mut [f32]) {}

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
