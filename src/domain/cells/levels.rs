//! States without the level of a pressure that the flow does not know.

use crate::Field;
use m4gn_mesh::Mesh;
use m4gn_model::{Level, ModelSpec};
use m4gn_parallel::Comm;

/// Takes the levels off the states of a host's fields.
#[derive(Clone, Debug)]
pub struct Levels {
    /// Components of a state.
    width: usize,
    /// Name and component of each field that has one.
    fields: Vec<(String, usize)>,
    level: Option<Level>,
}

impl Levels {
    /// Of the fields of a model on this rank's part of a host's mesh. Collective.
    pub fn new(mesh: &Mesh, spec: &ModelSpec, comm: &Comm) -> Self {
        let (mut fields, mut width) = (Vec::new(), 0);
        for field in &spec.fields {
            if field.has_level() {
                fields.push((field.name.clone(), width));
            }
            width += field.components(spec.dim);
        }
        let level = (!fields.is_empty()).then(|| Level::new(mesh, comm));
        Levels { width, fields, level }
    }

    /// Writes the values of these fields into a state (rows of all components, cells and then boundary) without their levels, which are
    /// returned by name. The shapes were checked on all ranks; a field that is not handed in has none. Collective.
    pub fn take_off(&self, fields: &[Field], state: &mut [f32], comm: &Comm) -> Vec<(&str, f64)> {
        let mut levels = Vec::new();
        for (name, column) in &self.fields {
            let found = fields.iter().find(|f| f.name == name);
            if let (Some(field), Some(level)) = (found, &self.level) {
                let level = level.of(field.cells, field.boundary, comm);
                let values = field.cells.iter().chain(field.boundary);
                for (row, value) in state.chunks_exact_mut(self.width).zip(values) {
                    row[*column] = (value - level) as f32;
                }
                levels.push((name.as_str(), level));
            }
        }
        levels
    }
}
