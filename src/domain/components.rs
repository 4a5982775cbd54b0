//! Components of the fields of a model.

use m4gn_model::{FieldSpec, ModelSpec, Output};

/// Components of the fields: which are inputs, which outputs, and how.
#[derive(Clone, Debug, Default)]
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
    /// The fields.
    fields: Vec<FieldSpec>,
}

impl Components {
    /// Counts the components of a model's fields.
    pub fn new(spec: &ModelSpec) -> Self {
        let mut c = Components { fields: spec.fields.clone(), ..Components::default() };
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

    /// Components of each predicted field.
    pub fn predicted(&self) -> impl Iterator<Item = &[usize]> {
        self.outputs.chunk_by(|&a, &b| self.field[a] == self.field[b])
    }

    /// Components of the first predicted field.
    pub fn headline(&self) -> &[usize] {
        self.predicted().next().unwrap_or_default()
    }

    /// The physical value of a component of a state.
    pub fn physical(&self, component: usize, seen: f32) -> f64 {
        self.fields[self.field[component]].physical(seen.into())
    }

    /// As [`FieldSpec::floor`], of the field of a component.
    pub fn floor(&self, component: usize) -> Option<f64> {
        self.fields[self.field[component]].floor
    }

    /// Mean square, over these nodes and components, of the difference of the physical fields of two frames.
    pub fn mean_square(
        &self,
        components: &[usize],
        a: &[f32],
        b: &[f32],
        nodes: impl Iterator<Item = usize>,
    ) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for node in nodes {
            for at in components.iter().map(|i| node * self.count + i) {
                let i = at % self.count;
                sum += (self.physical(i, a[at]) - self.physical(i, b[at])).powi(2);
            }
            count += components.len();
        }
        sum / count.max(1) as f64
    }
}
