//! A wider network that says what a narrower one said, to be trained on from there: Net2Net (Chen, Goodfellow & Shlens 2016,
//! arXiv 1511.05641).

use m4gn_base::Result;
use m4gn_model::{Architecture, Model, Tensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How many times as wide `new` is as `old`, where all else is alike: latents, and with them the hidden width of the segment
/// transformer. None for another network.
pub(super) fn factor(old: &Architecture, new: &Architecture) -> Option<usize> {
    let factor = new.width.checked_div(old.width)?;
    let mut wider = old.clone();
    wider.width = old.width.checked_mul(factor)?;
    if let Some(m) = wider.m4gn_mut() {
        let ffn = &mut m.segment_transformer.ffn_width;
        *ffn = ffn.checked_mul(factor)?;
    }
    (wider == *new).then_some(factor)
}

/// The model with each latent value `factor` times, side by side. What reads them shares its weight out among the copies,
/// unequally, so that they learn different things; sums, norms and hence the outputs stay.
pub(super) fn widen(mut model: Model, factor: usize, seed: u64) -> Result<Model> {
    if factor == 1 {
        return Ok(model);
    }
    model.spec.architecture.width *= factor;
    if let Some(m) = model.spec.architecture.m4gn_mut() {
        m.segment_transformer.ffn_width *= factor;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for (name, shape) in Model::tensor_shapes(&model.spec) {
        let Some(tensor) = model.tensors.get_mut(&name) else {
            continue;
        };
        if tensor.shape == shape {
            continue;
        }
        if name.ends_with(".score.weight") {
            // Scores are by a vector over its length, which stays where one of the copies has all.
            let alone = |w: &f32| std::iter::once(*w).chain(std::iter::repeat_n(0.0, factor - 1));
            tensor.data = tensor.data.iter().flat_map(alone).collect();
            tensor.shape = shape;
            continue;
        }
        *tensor = copied(tensor, &shape, factor, &mut rng);
        // The product of queries and keys has `factor` times as many terms, and is divided by the root of their number.
        if name.ends_with(".q.weight") {
            let scale = 1.0 / (factor as f32).sqrt();
            tensor.data.iter_mut().for_each(|w| *w *= scale);
        }
    }
    Model::new(model.spec, model.tensors)
}

/// A tensor whose rows are repeated until there are `shape[0]`, and whose columns, where there are to be more of them, are
/// shared out: those of latents, which stand behind those of features.
fn copied(tensor: &Tensor, shape: &[usize], factor: usize, rng: &mut ChaCha8Rng) -> Tensor {
    let columns = tensor.shape.get(1).copied().unwrap_or(1);
    let features = (factor * columns - shape.get(1).copied().unwrap_or(1)) / (factor - 1);
    let rows = shape[0] / tensor.shape[0];
    let mut data = Vec::with_capacity(shape.iter().product());
    for row in tensor.data.chunks_exact(columns) {
        for _ in 0..rows {
            for (at, &weight) in row.iter().enumerate() {
                let shares = if at < features { 1 } else { factor };
                let parts: Vec<f32> = (0..shares).map(|_| 0.5 + rng.random::<f32>()).collect();
                let sum: f32 = parts.iter().sum();
                data.extend(parts.iter().map(|part| weight * part / sum));
            }
        }
    }
    Tensor { shape: shape.to_vec(), data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_engine::{Engine, EngineOptions, Forward};
    use m4gn_model::modal::NoModes;
    use m4gn_model::{Kind, SegmentMethod};
    use m4gn_parallel::Comm;
    use m4gn_structure::Structure;

    #[test]
    fn a_wider_network_of_any_kind_says_what_the_narrower_one_says() {
        let (mesh, comm) = (m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0), Comm::serial());
        let mut spec = m4gn_samples::model::spec();
        spec.segments.method = SegmentMethod::Metis;
        let stage = spec.architecture.m4gn().unwrap().clone();
        for kind in [
            Kind::M4gn(stage.clone()),
            Kind::Eagle(stage),
            Kind::MeshGraphNet { layers: 2 },
            Kind::Gcn { layers: 2 },
            Kind::BsmsGnn { levels: 2 },
            Kind::GUNet { levels: 2 },
        ] {
            spec.architecture.kind = kind;
            let structure = Structure::new(&mesh, &spec, &spec.segments, &NoModes, None, &comm).unwrap();
            let n = structure.graph.n_owned * spec.n_field_inputs();
            let inputs: Vec<f32> = (0..n).map(|i| (0.7 * i as f32).sin()).collect();
            let outputs = |model: &Model| {
                let mut engine = Engine::new(model, &structure, &EngineOptions::default()).unwrap();
                let mut outputs = vec![0f32; structure.graph.n_cells * spec.n_outputs()];
                engine.forward(&comm, &inputs, &mut outputs).unwrap();
                outputs
            };
            let narrow = Model::random(spec.clone(), 5).unwrap();
            let expected = outputs(&narrow);
            let largest = expected.iter().fold(0f32, |m, y| m.max(y.abs()));
            for factor in [2, 3] {
                let found = outputs(&widen(narrow.clone(), factor, 1).unwrap());
                let pairs = found.iter().zip(&expected);
                let apart = pairs.fold(0f32, |m, (a, b)| m.max((a - b).abs())) / largest;
                assert!(apart < 1e-4, "{factor} times {:?}: {apart}", spec.architecture);
            }
        }
    }
}
