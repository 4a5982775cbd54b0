//! Fields by name into node features, and the network's outputs into fields.

use super::field::expect_shape;
use super::{Field, FieldMut, OutputShape, Session};
use m4gn_mesh::{Error, Result};
use m4gn_model::Output;

impl Session {
    /// Whether the arrays are those of all predicted fields.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is missing, unknown, or of another shape.
    pub fn check_outputs<'a>(&self, out: impl Iterator<Item = OutputShape<'a>> + Clone) -> Result<()> {
        for o in out.clone() {
            let field = self
                .spec
                .fields
                .iter()
                .find(|f| f.name == o.name && f.output != Output::None);
            let Some(field) = field else {
                return Err(Error::Input(format!(
                    "the model does not predict '{}'; it predicts {}",
                    o.name,
                    self.names(true)
                )));
            };
            expect_shape(o.name, "output", field.vector, o.components, o.len, self.n_cells)?;
        }
        for field in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            if !out.clone().any(|o| o.name == field.name) {
                return Err(Error::Input(format!(
                    "no array for the predicted field '{}'",
                    field.name
                )));
            }
        }
        Ok(())
    }

    /// Writes the kept result of one field, whose shape was checked.
    pub fn write(&self, out: &mut FieldMut) {
        let Some(first) = self.output_column(out.name) else {
            return;
        };
        let m = self.spec.n_outputs();
        for (row, result) in out
            .cells
            .chunks_exact_mut(out.components)
            .zip(self.result.chunks_exact(m))
        {
            match out.components {
                1 => row[0] = result[first],
                _ => self
                    .directions
                    .iter()
                    .enumerate()
                    .for_each(|(i, &d)| row[d] = result[first + i]),
            }
        }
    }

    /// Node features from fields.
    pub(crate) fn gather(&mut self, fields: &[Field]) -> Result<()> {
        let width = self.spec.n_field_inputs();
        let mut column = 0;
        for spec in self.spec.fields.iter().filter(|f| f.input) {
            let field = fields.iter().find(|f| f.name == spec.name).ok_or_else(|| {
                Error::Input(format!(
                    "input field '{}' is missing; the model reads {}",
                    spec.name,
                    self.names(false)
                ))
            })?;
            let (name, c) = (field.name, field.components);
            expect_shape(name, "cell", spec.vector, c, field.cells.len(), self.n_cells)?;
            expect_shape(
                name,
                "boundary",
                spec.vector,
                c,
                field.boundary.len(),
                self.n_boundary,
            )?;
            let scalar = [0];
            let directions = if spec.vector {
                &self.directions[..]
            } else {
                &scalar
            };
            let rows = field.cells.chunks_exact(c).chain(field.boundary.chunks_exact(c));
            for (node, (to, from)) in self.inputs.chunks_exact_mut(width).zip(rows).enumerate() {
                for (i, &d) in directions.iter().enumerate() {
                    if !from[d].is_finite() {
                        let place = place(node, self.n_cells);
                        return Err(Error::Numerical(format!(
                            "input field '{name}' is {} at {place}",
                            from[d]
                        )));
                    }
                    to[column + i] = from[d] as f32;
                }
            }
            if spec.vector {
                let columns = column..column + directions.len();
                for &(face, cell) in &self.read_from_cells {
                    let (from, to) = (cell * width, (self.n_cells + face) * width);
                    self.inputs
                        .copy_within(from + columns.start..from + columns.end, to + columns.start);
                }
            }
            column += directions.len();
        }
        Ok(())
    }

    /// Fields at the new time from the network's outputs and the fields of now.
    pub(crate) fn scatter(&mut self, fields: &[Field]) -> Result<()> {
        let m = self.spec.n_outputs();
        let mut column = 0;
        for spec in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            let scalar = [0];
            let directions = if spec.vector {
                &self.directions[..]
            } else {
                &scalar
            };
            let old = match spec.output {
                Output::Delta => fields.iter().find(|f| f.name == spec.name),
                _ => None,
            };
            for (i, &d) in directions.iter().enumerate() {
                let rows = self.result.chunks_exact_mut(m).zip(self.outputs.chunks_exact(m));
                for (cell, (result, output)) in rows.enumerate() {
                    let before = old.map_or(0.0, |f| f.cells[cell * f.components + d]);
                    let after = before + f64::from(output[column + i]);
                    if !after.is_finite() {
                        return Err(Error::Numerical(format!(
                            "the model's '{}' is {after} at {}: the state has left what it was trained on; hand \
                             back to the solver sooner",
                            spec.name,
                            place(cell, self.n_cells)
                        )));
                    }
                    result[column + i] = after;
                }
            }
            column += directions.len();
        }
        Ok(())
    }

    fn output_column(&self, name: &str) -> Option<usize> {
        let mut column = 0;
        for f in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            if f.name == name {
                return Some(column);
            }
            column += f.components(self.spec.dim);
        }
        None
    }

    fn names(&self, outputs: bool) -> String {
        let wanted = self.spec.fields.iter().filter(|f| {
            if outputs {
                f.output != Output::None
            } else {
                f.input
            }
        });
        wanted.map(|f| f.name.as_str()).collect::<Vec<_>>().join(", ")
    }
}

fn place(node: usize, n_cells: usize) -> String {
    match node.checked_sub(n_cells) {
        None => format!("cell {node}"),
        Some(face) => format!("boundary face {face}"),
    }
}
