//! In what a network's products are computed: part of a model's description.

use serde::{Deserialize, Serialize};

/// In what the network's products are computed. Sums, norms and softmax are in fp32 in either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Weights, activations and latents in fp32.
    #[default]
    Fp32,
    /// Weights, activations and edge latents in bf16 (8 bits of mantissa), accumulation in fp32.
    Bf16,
}

m4gn_base::names! { Precision: Fp32 "fp32", Bf16 "bf16" }
