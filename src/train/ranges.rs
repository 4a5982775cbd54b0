//! What the data span: ranges that a model says it was trained on.

use m4gn_base::{Error, Result};
use m4gn_data::Trajectory;
use m4gn_domain::Components;
use m4gn_model::{Extent, InputRange, ModelSpec, Solid};
use serde::Deserialize;

/// Largest speed and ranges of the inputs, in the frames that were seen so far.
pub(super) struct Ranges {
    width: usize,
    /// First and last component of each input, its range, and whether it is the velocity.
    inputs: Vec<(std::ops::Range<usize>, InputRange, bool)>,
    components: Components,
    /// Square of the largest speed.
    fastest: f64,
}

impl Ranges {
    /// Of no frame.
    pub fn new(spec: &ModelSpec) -> Self {
        let (mut inputs, mut width, mut has_velocity) = (Vec::new(), 0, false);
        for field in &spec.fields {
            let columns = width..width + field.components(spec.dim);
            width = columns.end;
            if spec.reads(field) {
                let range =
                    InputRange { field: field.name.clone(), range: [f64::INFINITY, f64::NEG_INFINITY] };
                let velocity = field.is_velocity() && !has_velocity;
                has_velocity |= velocity;
                inputs.push((columns, range, velocity));
            }
        }
        Ranges { width, inputs, components: Components::new(spec), fastest: 0.0 }
    }

    /// Looks at a frame: all fields of all nodes, or of a body's points.
    pub fn see(&mut self, frame: &[f32]) {
        for row in frame.chunks_exact(self.width) {
            for (columns, input, velocity) in &mut self.inputs {
                let mut square = 0.0;
                for x in columns.clone().map(|i| self.components.physical(i, row[i])) {
                    input.range = [input.range[0].min(x), input.range[1].max(x)];
                    square += x * x;
                }
                if *velocity {
                    self.fastest = self.fastest.max(square);
                }
            }
        }
    }

    /// What was seen, on a mesh of this cell size (m), of a solid where it is one.
    pub fn extent(self, cell_size: f64, solid: Option<Solid>) -> Extent {
        let speed = self.inputs.iter().any(|i| i.2).then(|| self.fastest.sqrt());
        Extent { cell_size, speed, inputs: self.inputs.into_iter().map(|i| i.1).collect(), solid }
    }
}

/// What a trajectory says of its solid: a body by its elements, a solver's case by the provenance that `m4gnRecorder` writes.
///
/// # Errors
/// [`Error::File`] for a provenance that has something else under this name.
pub(super) fn solid(trajectory: &Trajectory) -> Result<Option<Solid>> {
    if let Some(body) = trajectory.body() {
        return Ok(Some(Solid::of_body(body)));
    }
    let recorded = &trajectory.provenance()["solid"];
    if recorded.is_null() {
        return Ok(None);
    }
    let found = Solid::deserialize(recorded).map_err(|e| e.to_string());
    let checked = found.and_then(|solid| match solid.fault() {
        Some(fault) => Err(fault),
        None => Ok(solid),
    });
    checked.map(Some).map_err(|e| Error::file(trajectory.path(), format!("provenance, entry solid: {e}")))
}
