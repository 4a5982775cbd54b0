//! Predicted fields by name.

use super::{FieldMut, Session};
use m4gn_base::{Error, Result, refuse_any};
use m4gn_domain::expect_shape;
use m4gn_model::{FieldSpec, Output};

impl Session {
    fn predicted(&self) -> impl Iterator<Item = &FieldSpec> {
        self.spec.fields.iter().filter(|f| f.output != Output::None)
    }

    /// Whether the arrays are those of all predicted fields: [`Error::Input`] naming the field that is missing, unknown, or of another
    /// shape.
    pub(super) fn check_outputs(&self, out: &[FieldMut]) -> Result<()> {
        for o in out {
            let field = self.predicted().find(|f| f.name == o.name).ok_or_else(|| {
                let names: Vec<&str> = self.predicted().map(|f| f.name.as_str()).collect();
                let names = names.join(", ");
                Error::Input(format!("the model does not predict '{}'; it predicts {names}", o.name))
            })?;
            expect_shape(o.name, "output", field.vector, o.components, o.cells.len(), self.n_cells)?;
        }
        let missing = self.predicted().find(|f| out.iter().all(|o| o.name != f.name));
        refuse_any(missing, Error::Input, |f| format!("no array for the predicted field '{}'", f.name))
    }

    /// Writes the kept result of one field, whose shape was checked.
    pub fn write(&self, out: &mut FieldMut) {
        let Some(place) = self.predicted().position(|f| f.name == out.name) else { return };
        let first: usize = self.predicted().take(place).map(|f| f.components(self.spec.dim)).sum();
        let m = self.spec.n_outputs();
        for (row, result) in out.cells.chunks_exact_mut(out.components).zip(self.result.chunks_exact(m)) {
            match out.components {
                1 => row[0] = result[first],
                _ => self.directions.iter().enumerate().for_each(|(i, &d)| row[d] = result[first + i]),
            }
        }
    }
}
