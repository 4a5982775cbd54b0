//! Predicted fields by name.

use super::{FieldMut, OutputShape, Session};
use m4gn_base::{Error, Result};
use m4gn_domain::expect_shape;
use m4gn_model::Output;

impl Session {
    /// Whether the arrays are those of all predicted fields.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is missing, unknown, or of another shape.
    pub fn check_outputs<'a>(&self, out: impl Iterator<Item = OutputShape<'a>> + Clone) -> Result<()> {
        for o in out.clone() {
            let field = self.spec.fields.iter().find(|f| f.name == o.name && f.output != Output::None);
            let Some(field) = field else {
                let predicted = self.spec.fields.iter().filter(|f| f.output != Output::None);
                let predicted = predicted.map(|f| f.name.as_str());
                return Err(Error::Input(format!(
                    "the model does not predict '{}'; it predicts {}",
                    o.name,
                    predicted.collect::<Vec<_>>().join(", ")
                )));
            };
            expect_shape(o.name, "output", field.vector, o.components, o.len, self.n_cells)?;
        }
        for field in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            if !out.clone().any(|o| o.name == field.name) {
                return Err(Error::Input(format!("no array for the predicted field '{}'", field.name)));
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
        for (row, result) in out.cells.chunks_exact_mut(out.components).zip(self.result.chunks_exact(m)) {
            match out.components {
                1 => row[0] = result[first],
                _ => self.directions.iter().enumerate().for_each(|(i, &d)| row[d] = result[first + i]),
            }
        }
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
}
