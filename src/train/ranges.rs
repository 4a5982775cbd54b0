//! What the data span: ranges that a model says it was trained on.

use super::samples::Sample;
use m4gn_model::{Extent, InputRange, ModelSpec};

/// Largest speed and ranges of the inputs of a trajectory.
pub(super) fn extent(sample: &Sample, spec: &ModelSpec) -> Extent {
    let (mut inputs, mut speed, mut column) = (Vec::new(), None, 0);
    for field in &spec.fields {
        let n = field.components(spec.dim);
        let columns = column..column + n;
        column += n;
        if !field.input {
            continue;
        }
        let (mut range, mut fastest) = ([f64::INFINITY, f64::NEG_INFINITY], 0f64);
        for row in sample.frames.chunks_exact(sample.width) {
            let mut square = 0.0;
            for x in row[columns.clone()].iter().map(|&x| f64::from(x)) {
                range = [range[0].min(x), range[1].max(x)];
                square += x * x;
            }
            fastest = fastest.max(square);
        }
        inputs.push(InputRange {
            field: field.name.clone(),
            range,
        });
        if field.is_velocity() && speed.is_none() {
            speed = Some(fastest.sqrt());
        }
    }
    Extent {
        cell_size: sample.cell_size,
        speed,
        inputs,
    }
}
