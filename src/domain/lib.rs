//! What a surrogate lives on: the fields at the cells of a mesh that stays ([`cells`]), or a body at points that deforms and is touched
//! ([`body`]). This room alone knows which of the two it is; who learns, predicts or measures takes a [`Domain`], and a host's run a
//! [`Host`].
//!
//! A state is a row of all components of the fields for each node, first of the nodes whose fields are predicted, then of the boundary.

pub mod body;
mod boundary;
pub mod cells;
mod components;
mod field;
mod host;
mod kind;

pub use body::MeshEdge;
pub use boundary::{Boundary, as_seen, faces_seen_as_their_cells, impose};
pub use components::Components;
pub use field::{FieldMut, expect_shape};
pub use host::{Host, HostOptions, Hosted, Predict, fits, open};
pub use kind::{Kind, Statistics, check_kind, moves, operator, shared};

use m4gn_base::Result;
pub use m4gn_mesh::Field;
use m4gn_mesh::Mesh;
use m4gn_model::modal::ModalSource;
use m4gn_model::{Level, ModelSpec, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;
use std::fmt::Debug;

/// One model step on physical fields: what goes into the network, on which edges, what is to come out, and the next state, each with
/// its derivative.
pub trait Domain: Debug + Send + Sync {
    /// Components of its fields.
    fn components(&self) -> &Components;

    /// How its boundary values follow.
    fn boundary(&self) -> &Boundary;

    /// The same, to show it frames.
    fn boundary_mut(&mut self) -> &mut Boundary;

    /// Whether a component of a node's fields is prescribed: it gets no noise, what the network says of it does not count, and it is as
    /// recorded, or as the host has it, after each step.
    fn is_held(&self, node: usize, component: usize) -> bool {
        self.boundary().is_held(node, component)
    }

    /// Of each node whether it counts for the outputs of one field, whose components these are.
    fn free(&self, components: &[usize]) -> Vec<bool> {
        let n = self.boundary().n_inner;
        (0..n).map(|node| !components.iter().any(|&c| self.is_held(node, c))).collect()
    }

    /// Whether the edges are others in each state.
    fn moves(&self) -> bool {
        self.mesh_edges().is_some()
    }

    /// Takes off a state what its flow does not know, the level of a pressure, as a host's is taken off before each step.
    fn take_level_off(&self, _state: &mut [f32]) {}

    /// From the derivative by a state without its levels, `state`, to that by the one that had them.
    fn take_level_off_backward(&self, _state: &[f32], _d_state: &mut [f32]) {}

    /// Components of which [`Domain::take_level_off`] takes a level off, and where it is read; none where there is nothing to take.
    fn levels(&self) -> Option<(&[usize], &Level)> {
        None
    }

    /// Gives the graph the edges of a state of its local nodes, whose ghosts are filled first, and those of coarser graphs, which stay,
    /// their features there. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Numerical`](m4gn_base::Error::Numerical) for a state that is not finite.
    fn set_edges(&self, _comm: &Comm, _state: &mut [f32], _structure: &mut Structure) -> Result<()> {
        Ok(())
    }

    /// Adds to the derivative by the state what the derivatives by the features of the edges of [`Domain::set_edges`] make of it: by those
    /// of the graph, then by those of each coarser one. On one rank.
    fn edges_backward(&self, _structure: &Structure, _d_features: &[Vec<f32>], _d_state: &mut [f32]) {}

    /// Physical inputs of the network at a state. `next` holds what is prescribed at the end of the step.
    fn inputs(&self, state: &[f32], next: &[f32], inputs: &mut Vec<f32>);

    /// What the derivative by the inputs is by the state.
    fn inputs_backward(&self, d_inputs: &[f32], d_state: &mut [f32]);

    /// The same domain reflected in the second direction.
    fn reflected(&self) -> Box<dyn Domain>;

    /// A copy.
    fn boxed(&self) -> Box<dyn Domain>;

    /// The rows of a frame whose ranges say what a model was trained on.
    fn ranging<'a>(&self, frame: &'a [f32]) -> &'a [f32] {
        frame
    }

    /// Where edges come and go with the state: those that stay, at rest.
    fn mesh_edges(&self) -> Option<&[MeshEdge]> {
        None
    }

    /// The edges that a state of the local nodes has beside those that stay.
    fn world_edges(&self, _state: &[f32]) -> Vec<MeshEdge> {
        Vec::new()
    }

    /// Physical outputs that lead exactly to `next`: changes from the present state, with its noise, or values.
    fn target(&self, state: &[f32], next: &[f32], target: &mut Vec<f32>) {
        target.clear();
        let c = self.components();
        let rows = state.chunks_exact(c.count).zip(next.chunks_exact(c.count));
        for (now, next) in rows.take(self.boundary().n_inner) {
            let outputs = c.outputs.iter().zip(&c.delta);
            target.extend(outputs.map(|(&i, delta)| if *delta { next[i] - now[i] } else { next[i] }));
        }
    }

    /// What the derivative by the target is by the state.
    fn target_backward(&self, d_target: &[f32], d_state: &mut [f32]) {
        let c = self.components();
        let rows = d_target.chunks_exact(c.outputs.len());
        for (d, row) in d_state.chunks_exact_mut(c.count).zip(rows) {
            let outputs = c.outputs.iter().zip(&c.delta).zip(row);
            outputs.filter(|((_, delta), _)| **delta).for_each(|((&i, _), x)| d[i] -= x);
        }
    }

    /// The state one step later from physical outputs. `next` holds what is prescribed at the new time.
    fn advance(&self, state: &[f32], outputs: &[f32], next: &[f32]) -> Vec<f32> {
        let c = self.components();
        let mut new = next.to_vec();
        for (node, row) in outputs.chunks_exact(c.outputs.len()).enumerate() {
            let outputs = c.outputs.iter().zip(&c.delta).zip(row);
            for ((&i, delta), y) in outputs.filter(|((i, _), _)| !self.is_held(node, **i)) {
                let at = node * c.count + i;
                new[at] = if *delta { state[at] + y } else { *y };
            }
        }
        self.boundary().follow(&mut new, |i| !c.given.contains(&i));
        new
    }

    /// From the derivative by the next state, which is spoilt, to that by the outputs, which is added to, and by the
    /// present state.
    fn advance_backward(&self, d_next: &mut [f32], d_outputs: &mut [f32]) -> Vec<f32> {
        let c = self.components();
        self.boundary().follow_backward(d_next, |i| !c.given.contains(&i));
        let mut d_state = vec![0.0; d_next.len()];
        for (node, row) in d_outputs.chunks_exact_mut(c.outputs.len()).enumerate() {
            let outputs = c.outputs.iter().zip(&c.delta).zip(row);
            for ((&i, delta), y) in outputs.filter(|((i, _), _)| !self.is_held(node, **i)) {
                let at = node * c.count + i;
                *y += d_next[at];
                if *delta {
                    d_state[at] = d_next[at];
                }
            }
        }
        d_state
    }
}

impl Clone for Box<dyn Domain> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// A domain and what its network lives on.
#[derive(Debug)]
pub struct Place {
    /// The domain, whose nodes are the network's.
    pub domain: Box<dyn Domain>,
    /// What the network lives on; of a body at rest.
    pub structure: Structure,
    /// Mean distance of neighbouring nodes, m; of a body at rest.
    pub cell_size: f64,
    /// The way from the cells, where the nodes are groups of them.
    pub coarse: Option<Coarse>,
}

impl Place {
    /// The domain of the model that `spec` describes on an undecomposed mesh, at a resolution (m) or a node a cell. `settings` say how
    /// segments are cut.
    ///
    /// # Errors
    /// [`Error::Mesh`](m4gn_base::Error::Mesh) for a mesh or a body that no graph can be made of; for segments that cannot be found.
    pub fn whole(
        mesh: &Mesh,
        spec: &ModelSpec,
        settings: &SegmentSpec,
        resolution: Option<f64>,
        modes: &dyn ModalSource,
    ) -> Result<Self> {
        match Kind::of_model(spec) {
            Kind::Body => body::place(mesh, spec, settings, modes),
            Kind::Cells => cells::place(mesh, spec, settings, resolution, modes),
        }
    }
}
