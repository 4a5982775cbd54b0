//! In what a network's products are computed: part of a model's description.

use m4gn_base::{Error, Result};
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

impl Precision {
    /// From a dictionary's word: `fp32`, `bf16`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other word.
    pub fn parse(word: &str) -> Result<Self> {
        match word {
            "fp32" => Ok(Precision::Fp32),
            "bf16" => Ok(Precision::Bf16),
            _ => Err(Error::Input(format!("precision '{word}': expected fp32 or bf16"))),
        }
    }

    /// Whether it is [`Precision::Fp32`].
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes what it may skip by reference")]
    pub(crate) fn is_fp32(&self) -> bool {
        *self == Precision::Fp32
    }

    /// The word that [`Precision::parse`] takes.
    pub fn name(self) -> &'static str {
        match self {
            Precision::Fp32 => "fp32",
            Precision::Bf16 => "bf16",
        }
    }
}
