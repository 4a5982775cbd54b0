//! What frames span, which a case and the data of a training are compared by.

use crate::{Extent, FieldSpec, InputRange, ModelSpec, Solid};
use m4gn_parallel::Comm;
use std::ops;

/// Largest speed and ranges of the inputs, in the frames that were seen so far.
pub struct Ranges<'a> {
    width: usize,
    /// Each input, its components, and its lowest and highest value.
    inputs: Vec<(&'a FieldSpec, ops::Range<usize>, [f64; 2])>,
    /// Square of the largest speed.
    fastest: f64,
}

impl<'a> Ranges<'a> {
    /// Of no frame.
    pub fn new(spec: &'a ModelSpec) -> Self {
        let (mut inputs, mut width) = (Vec::new(), 0);
        for field in &spec.fields {
            let columns = width..width + field.components(spec.dim);
            width = columns.end;
            if spec.reads(field) {
                inputs.push((field, columns, [f64::INFINITY, f64::NEG_INFINITY]));
            }
        }
        Ranges { width, inputs, fastest: 0.0 }
    }

    /// Which input is the velocity.
    fn velocity(&self) -> Option<usize> {
        self.inputs.iter().position(|(field, ..)| field.is_velocity())
    }

    /// Looks at a frame: all fields, as networks see them, of all nodes, or of a body's points.
    pub fn see(&mut self, frame: &[f32]) {
        let velocity = self.velocity();
        for row in frame.chunks_exact(self.width) {
            for (i, (field, columns, [low, high])) in self.inputs.iter_mut().enumerate() {
                let mut square = 0.0;
                for x in row[columns.clone()].iter().map(|&x| field.physical(x.into())) {
                    (*low, *high) = (low.min(x), high.max(x));
                    square += x * x;
                }
                if velocity == Some(i) {
                    self.fastest = self.fastest.max(square);
                }
            }
        }
    }

    /// What all ranks saw, on a mesh of this cell size (m), of a solid where it is one. Collective.
    pub fn extent(mut self, cell_size: f64, solid: Option<Solid>, comm: &Comm) -> Extent {
        let mut largest = vec![self.fastest];
        largest.extend(self.inputs.iter().flat_map(|(_, _, [low, high])| [-low, *high]));
        comm.max_f64(&mut largest);
        let speed = self.velocity().map(|_| largest[0].sqrt());
        let ranges = self.inputs.drain(..).zip(largest[1..].as_chunks().0);
        let inputs = ranges
            .map(|((field, ..), [low, high])| InputRange { field: field.name.clone(), range: [-low, *high] });
        Extent { cell_size, speed, inputs: inputs.collect(), solid }
    }
}
