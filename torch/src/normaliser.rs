//! Normalisers as tensors.

use m4gn_train::normaliser::{Moments, Normaliser};
use tch::{Device, Kind, Tensor};

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
            (
                Tensor::from_slice(&mean).to_device(device),
                Tensor::from_slice(&std).to_device(device),
            )
        };
        Scales {
            node: pair(&normaliser.node),
            edge: pair(&normaliser.edge),
            output: pair(&normaliser.output),
        }
    }
}

/// Moments of the rows of a tensor `[rows x channels]`.
pub fn moments(rows: &Tensor) -> Moments {
    let rows = rows.to_kind(Kind::Double);
    let host = |t: Tensor| Vec::<f64>::try_from(t.to_device(Device::Cpu)).unwrap_or_default();
    let dims = Some(&[0i64][..]);
    Moments {
        count: rows.size()[0] as f64,
        sum: host(rows.sum_dim_intlist(dims, false, Kind::Double)),
        square: host(rows.square().sum_dim_intlist(dims, false, Kind::Double)),
    }
}
