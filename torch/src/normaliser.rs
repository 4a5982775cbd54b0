//! Normalisers as tensors.

use m4gn_base::Result;
use m4gn_learn::normaliser::{Moments, Normaliser};
use m4gn_model::Model;
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

    /// Those of a model.
    ///
    /// Errors: [`m4gn_base::Error::Model`] for one that is missing.
    pub fn of_model(model: &Model, device: Device) -> Result<Self> {
        let part = |name: &str| -> Result<Tensor> {
            Ok(Tensor::from_slice(&model.tensor(&format!("norm.{name}"))?.data).to_device(device))
        };
        Ok(Scales {
            node: (part("node.mean")?, part("node.std")?),
            edge: (part("edge.mean")?, part("edge.std")?),
            output: (part("output.mean")?, part("output.std")?),
        })
    }
}
