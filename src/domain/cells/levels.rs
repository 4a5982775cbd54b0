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
    /// Of each field that has one.
    fields: Vec<Levelled>,
    level: Option<Level>,
}

#[derive(Clone, Debug)]
struct Levelled {
    name: String,
    /// Its component of a state.
    column: usize,
    /// As it was last taken off; 0 where the field was not handed in.
    level: f64,
}

impl Levels {
    /// Of the fields of a model on this rank's part of a host's mesh. Collective.
    pub fn new(mesh: &Mesh, spec: &ModelSpec, comm: &Comm) -> Self {
        let (mut fields, mut width) = (Vec::new(), 0);
        for field in &spec.fields {
            if field.has_level() {
                fields.push(Levelled { name: field.name.clone(), column: width, level: 0.0 });
            }
            width += field.components(spec.dim);
        }
        let level = (!fields.is_empty()).then(|| Level::new(mesh, comm));
        Levels { width, fields, level }
    }

    /// Writes the values of these fields into a state (rows of all components, cells and then boundary) without their levels. The shapes
    /// were checked on all ranks. Collective.
    pub fn take_off(&mut self, fields: &[Field], state: &mut [f32], comm: &Comm) {
        for of in &mut self.fields {
            of.level = 0.0;
            let found = fields.iter().find(|f| f.name == of.name);
            if let (Some(field), Some(level)) = (found, &self.level) {
                of.level = level.of(field.cells, field.boundary, comm);
                let values = field.cells.iter().chain(field.boundary);
                for (row, value) in state.chunks_exact_mut(self.width).zip(values) {
                    row[of.column] = (value - of.level) as f32;
                }
            }
        }
    }

    /// The level that was taken off a field; 0 where none was.
    pub fn of(&self, field: &str) -> f64 {
        self.fields.iter().find(|of| of.name == field).map_or(0.0, |of| of.level)
    }
}
