//! Components of the fields of a model.

use m4gn_model::{ModelSpec, Output};

/// Components of the fields: which are inputs, which outputs, and how.
#[derive(Clone, Debug)]
pub struct Components {
    /// Components of all fields together.
    pub count: usize,
    /// Field of each component.
    pub field: Vec<usize>,
    /// Components that are inputs.
    pub inputs: Vec<usize>,
    /// Components that are predicted.
    pub outputs: Vec<usize>,
    /// Whether each of the outputs is a change.
    pub delta: Vec<bool>,
    /// Components that are not predicted.
    pub given: Vec<usize>,
    /// Components that change sign under reflection in the second direction.
    pub odd: Vec<bool>,
}

impl Components {
    /// Counts the components of a model's fields.
    pub fn new(spec: &ModelSpec) -> Self {
        let mut c = Components {
            count: 0,
            field: vec![],
            inputs: vec![],
            outputs: vec![],
            delta: vec![],
            given: vec![],
            odd: vec![],
        };
        for (f, field) in spec.fields.iter().enumerate() {
            for i in 0..field.components(spec.dim) {
                if field.input {
                    c.inputs.push(c.count);
                }
                match field.output {
                    Output::None => c.given.push(c.count),
                    output => {
                        c.outputs.push(c.count);
                        c.delta.push(output == Output::Delta);
                    }
                }
                c.field.push(f);
                c.odd.push(field.vector && i == 1);
                c.count += 1;
            }
        }
        c
    }

    /// Components of the first predicted field.
    pub fn headline(&self) -> impl Iterator<Item = usize> {
        let field = self.field[self.outputs[0]];
        (0..self.count).filter(move |&i| self.field[i] == field)
    }

    /// Mean square, over the cells (of which there are `cells`) and its components, of the difference of the first predicted field
    /// in two frames.
    pub fn mean_square(&self, a: &[f32], b: &[f32], cells: usize) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        let rows = a.chunks_exact(self.count).zip(b.chunks_exact(self.count));
        for (a, b) in rows.take(cells) {
            for i in self.headline() {
                sum += (f64::from(a[i]) - f64::from(b[i])).powi(2);
                n += 1.0;
            }
        }
        sum / n
    }
}
