//! Inputs that the model to start from does not have yet.

use super::normaliser::Moments;
use super::workload::Workload;
use m4gn_base::Result;
use m4gn_domain::Components;
use m4gn_model::{FieldSpec, Model, ModelSpec};

/// Whether `new` has the fields of `old`, and after them none but inputs that are not predicted.
pub fn follow(old: &[FieldSpec], new: &[FieldSpec]) -> bool {
    new.starts_with(old) && new[old.len()..].iter().all(FieldSpec::is_given)
}

/// The model with the inputs that `spec` has after those of the model. Their weights are zero, so that the network says
/// what it said; their normalisers are those of the training trajectories.
///
/// # Errors
/// As reading a frame.
pub fn extend(mut model: Model, spec: &ModelSpec, work: &Workload) -> Result<Model> {
    let (old, new) = (model.spec.n_field_inputs(), spec.n_field_inputs());
    if old == new {
        return Ok(model);
    }
    let components = Components::new(spec);
    let added = &components.inputs[old..];
    let mut moments = Moments::new(new - old);
    for sample in &work.train {
        for frame in [0, sample.n_frames / 2, sample.n_frames - 1] {
            let frame = sample.frame(frame)?;
            let rows = frame.chunks_exact(components.count);
            let values: Vec<f32> = rows.flat_map(|row| added.iter().map(|&c| row[c])).collect();
            moments.add(&Moments::of(&values, added.len()));
        }
    }
    let (mean, std) = moments.mean_std();
    for (name, values) in [("norm.node.mean", mean), ("norm.node.std", std)] {
        let tensor = model.tensors.get_mut(name).expect("a model has its normalisers");
        tensor.data.extend(values);
        tensor.shape = vec![new];
    }
    // A row of the first layer: the inputs that are fields, then the features that do not change with time.
    let first = "encoder.node.0.weight";
    let tensor = model.tensors.get_mut(first).expect("a model encodes its nodes");
    let columns = tensor.shape[1];
    let widened = tensor.data.chunks_exact(columns).flat_map(|row| {
        let (fields, others) = row.split_at(old);
        let zeros = std::iter::repeat_n(0.0, new - old);
        fields.iter().copied().chain(zeros).chain(others.iter().copied())
    });
    tensor.data = widened.collect();
    tensor.shape[1] += new - old;
    // Nor does the encoding of the nodes' positions, where there is one, add anything to these inputs.
    let last = model.spec.architecture.hidden_layers;
    for part in ["weight", "bias"] {
        let Some(tensor) = model.tensors.get_mut(&format!("encoder.position.{last}.{part}")) else {
            continue;
        };
        let row = tensor.data.len() / tensor.shape[0];
        tensor.data.splice(old * row..old * row, std::iter::repeat_n(0.0, (new - old) * row));
        tensor.shape[0] += new - old;
    }
    model.spec.fields = spec.fields.clone();
    Model::new(model.spec, model.tensors)
}
