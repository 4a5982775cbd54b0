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
        *tensor = copied(tensor, &shape, &mut rng);
        // The product of queries and keys has `factor` times as many terms, and is divided by the root of their number.
        if name.ends_with(".q.weight") {
            let scale = 1.0 / (factor as f32).sqrt();
            tensor.data.iter_mut().for_each(|w| *w *= scale);
        }
    }
    Model::new(model.spec, model.tensors)
}

/// A tensor whose rows are repeated until there are `shape[0]`, and whose columns, where there are to be more of them, are
/// shared out.
fn copied(tensor: &Tensor, shape: &[usize], rng: &mut ChaCha8Rng) -> Tensor {
    let columns = tensor.shape.get(1).copied().unwrap_or(1);
    let (rows, shares) = (shape[0] / tensor.shape[0], shape.get(1).map_or(1, |n| n / columns));
    let mut data = Vec::with_capacity(shape.iter().product());
    for row in tensor.data.chunks_exact(columns) {
        for _ in 0..rows {
            for &weight in row {
                let parts: Vec<f32> = (0..shares).map(|_| 0.5 + rng.random::<f32>()).collect();
                let sum: f32 = parts.iter().sum();
                data.extend(parts.iter().map(|part| weight * part / sum));
            }
        }
    }
    Tensor { shape: shape.to_vec(), data }
}
