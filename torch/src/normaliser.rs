//! Normalisers as tensors.

use crate::contact::host;
use m4gn_base::Result;
use m4gn_learn::normaliser::{Moments, Normaliser};
use m4gn_model::ModelSpec;
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
    pub fn new(normaliser: &Normaliser, device: Device) -> Self {
        let pair = |m: &Moments| {
            let (mean, std) = m.mean_std();
            (Tensor::from_slice(&mean).to_device(device), Tensor::from_slice(&std).to_device(device))
        };
        Scales {
            node: pair(&normaliser.node),
            edge: pair(&normaliser.edge),
            output: pair(&normaliser.output),
        }
    }
}

/// What examples show ([`Normaliser::of_example`]): node inputs, edge features and outputs, physical.
///
/// Errors: [`m4gn_base::Error::Internal`] where a tensor cannot be read.
pub fn of_example(spec: &ModelSpec, [inputs, edges, outputs]: [&Tensor; 3]) -> Result<Normaliser> {
    Ok(Normaliser::of_example(spec, &host(inputs)?, &host(edges)?, &host(outputs)?))
}
