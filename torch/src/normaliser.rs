//! Normalisers as tensors.

use tch::{Device, Tensor};

/// Means and deviations on the device.
pub struct Scales {
    /// Of node field inputs, `[inputs]`.
    pub node: (Tensor, Tensor),
    /// Of edge features, `[dim + 1]`.
    pub edge: (Tensor, Tensor),
    /// Of outputs, `[outputs]`.
    pub output: (Tensor, Tensor),
}

impl Scales {
    /// Of these normalisers.
    pub fn new(of: &m4gn_engine::backward::Scales, device: Device) -> Self {
        let [node, edge, output] = [&of.node, &of.edge, &of.output].map(|scale| {
            let on_device = |values: &[f32]| Tensor::from_slice(values).to_device(device);
            (on_device(&scale.mean), on_device(&scale.std))
        });
        Scales { node, edge, output }
    }
}
