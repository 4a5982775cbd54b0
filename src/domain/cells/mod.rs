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
use m4gn_model::{Level, ModelSpec, SegmentSpec, cell_size};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;

/// The fields at cells, or groups of them, and at their boundary faces.
#[derive(Clone, Debug)]
pub struct Cells {
    components: Components,
    boundary: Boundary,
    /// Components that are predicted and have a level, and where that is read; on one rank.
    levels: Option<(Vec<usize>, Level)>,
}

impl Cells {
    /// On the mesh of the network's nodes.
    pub fn new(nodes: &Mesh, spec: &ModelSpec) -> Self {
        let boundary = Boundary::new(nodes, &spec.fields, spec.dim);
        Cells { components: Components::new(spec), boundary, levels: None }
    }

    /// The same of an undecomposed mesh, whose states can have their levels taken off.
    fn with_levels(mut self, nodes: &Mesh, spec: &ModelSpec) -> Self {
        let c = &self.components;
        let has_level = |i: &usize| spec.fields[c.field[*i]].has_level();
        let columns: Vec<usize> = c.outputs.iter().copied().filter(has_level).collect();
        self.levels = (!columns.is_empty()).then(|| (columns, Level::new(nodes, &Comm::serial())));
        self
    }

    /// Values of a component at cells and boundary faces.
    fn column(&self, state: &[f32], column: usize) -> [Vec<f32>; 2] {
        let mut rows = state.chunks_exact(self.components.count).map(|row| row[column]);
        [rows.by_ref().take(self.boundary.n_inner).collect(), rows.collect()]
    }

    /// Of a graph without a mesh: so many cells and boundary nodes, whose values are prescribed.
    pub fn prescribed(n_cells: usize, n_boundary: usize, spec: &ModelSpec) -> Self {
        Cells {
            components: Components::new(spec),
            boundary: Boundary::prescribed(n_cells, n_boundary, &spec.fields, spec.dim),
            levels: None,
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

    fn take_level_off(&self, state: &mut [f32]) {
        for (column, level) in
            self.levels.iter().flat_map(|(columns, level)| columns.iter().map(move |c| (*c, level)))
        {
            let [mut cells, mut boundary] = self.column(state, column);
            level.take_off(&mut cells, &mut boundary);
            let rows = state.chunks_exact_mut(self.components.count);
            rows.zip(cells.iter().chain(&boundary)).for_each(|(row, value)| row[column] = *value);
        }
    }

    fn take_level_off_backward(&self, state: &[f32], d_state: &mut [f32]) {
        let width = self.components.count;
        for (column, level) in
            self.levels.iter().flat_map(|(columns, level)| columns.iter().map(move |c| (*c, level)))
        {
            let [cells, boundary] = self.column(state, column);
            let sum: f64 = d_state.chunks_exact(width).map(|row| f64::from(row[column])).sum();
            for (node, share) in level.shares(&cells, &boundary) {
                d_state[node * width + column] -= (share * sum) as f32;
            }
        }
    }

    fn levels(&self) -> Option<(&[usize], &Level)> {
        self.levels.as_ref().map(|(columns, level)| (&columns[..], level))
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
        domain: Box::new(Cells::new(nodes, spec).with_levels(nodes, spec)),
        structure: Structure::new(nodes, spec, settings, modes, None, &comm)?,
        cell_size: cell_size(nodes, &comm),
        coarse,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::NodeType;
    use m4gn_samples::mesh as sample;

    /// With outlets and without; the derivative is that of differences.
    #[test]
    fn levels_come_off_states_and_through_their_derivatives() {
        let spec = m4gn_samples::model::spec();
        for closed in [false, true] {
            let mut mesh = sample::triangles(5, 4, 1.5, 1.0);
            if closed {
                mesh.boundary.iter_mut().for_each(|b| b.kind = NodeType::Wall);
            }
            let cells = Cells::new(&mesh, &spec).with_levels(&mesh, &spec);
            let size = 3 * (mesh.cell_volumes.len() + mesh.boundary.len());
            let state: Vec<f32> = (0..size).map(|i| (2.3 * i as f32).sin() + 3.0).collect();
            let weight = |i: usize| (0.3 * i as f64).cos() + 0.5;
            let without = |state: &[f32]| {
                let mut state = state.to_vec();
                cells.take_level_off(&mut state);
                state
            };
            let sum = |state: &[f32]| -> f64 {
                without(state).iter().enumerate().map(|(i, v)| weight(i) * f64::from(*v)).sum()
            };
            let bare = without(&state);
            let pairs = bare.iter().zip(&state).enumerate();
            assert!(pairs.clone().all(|(i, (a, b))| i % 3 == 2 || a == b), "U has no level");
            let shifted: Vec<f32> =
                state.iter().enumerate().map(|(i, v)| if i % 3 == 2 { v + 1.5 } else { *v }).collect();
            assert!(without(&shifted).iter().zip(&bare).all(|(a, b)| (a - b).abs() < 1e-5), "{closed}");
            let mut d: Vec<f32> = (0..size).map(|i| weight(i) as f32).collect();
            cells.take_level_off_backward(&bare, &mut d);
            for i in (0..size).step_by(7).chain((2..size).step_by(3)) {
                let moved = |by: f32| {
                    let mut state = state.clone();
                    state[i] += by;
                    sum(&state)
                };
                let found = (moved(1.0 / 64.0) - moved(-1.0 / 64.0)) * 32.0;
                assert!((found - f64::from(d[i])).abs() < 2e-3, "{closed} {i}: {found} {}", d[i]);
            }
        }
        // Nothing is taken off where nothing that has a level is predicted.
        let mut given = spec.clone();
        given.fields[1].output = m4gn_model::Output::None;
        let mesh = sample::triangles(5, 4, 1.5, 1.0);
        assert!(Cells::new(&mesh, &given).with_levels(&mesh, &given).levels().is_none());
    }
}
