//! How the engine computes: precision, threads.

use super::kernels::Isa;
use m4gn_model::Precision;
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};

/// What a case asks for: a precision, the faster one, or what suits the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrecisionChoice {
    /// As `Auto` for a model of fields at cells that was trained in bf16, as `Fp32` for any other.
    Model,
    /// bf16 where the processors of all ranks are faster in it, else fp32.
    Auto,
    /// [`Precision::Fp32`].
    #[default]
    Fp32,
    /// [`Precision::Bf16`].
    Bf16,
}

impl PrecisionChoice {
    /// The precision of all ranks, for a model that was trained in `trained`. Collective.
    pub fn agreed(self, trained: Precision, comm: &Comm) -> Precision {
        let lacking = comm.any(!Isa::detect().bf16_pays());
        match (self, trained) {
            (PrecisionChoice::Fp32, _) | (PrecisionChoice::Model, Precision::Fp32) => Precision::Fp32,
            (PrecisionChoice::Bf16, _) => Precision::Bf16,
            _ if !lacking => Precision::Bf16,
            _ => Precision::Fp32,
        }
    }
}

/// What an engine is made with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EngineOptions {
    /// Threads of this rank; 0: 1.
    pub n_threads: usize,
    /// Of the products.
    pub precision: Precision,
    /// None: the widest that the processor has.
    pub isa: Option<Isa>,
    /// Whether the engine takes the time of its phases.
    pub profile: bool,
    /// Whether the graph gets other edges ([`crate::Forward::set_edges`]).
    pub edges_move: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_names() {
        for p in [Precision::Fp32, Precision::Bf16] {
            assert_eq!(serde_json::to_string(&p).unwrap(), format!("\"{}\"", p.name()));
        }
        let auto = match Isa::detect().bf16_pays() {
            true => Precision::Bf16,
            false => Precision::Fp32,
        };
        let alone = Comm::serial();
        assert_eq!(PrecisionChoice::default(), PrecisionChoice::Fp32);
        for trained in [Precision::Fp32, Precision::Bf16] {
            assert_eq!(PrecisionChoice::Auto.agreed(trained, &alone), auto);
            assert_eq!(PrecisionChoice::Fp32.agreed(trained, &alone), Precision::Fp32);
            assert_eq!(PrecisionChoice::Bf16.agreed(trained, &alone), Precision::Bf16);
        }
        let model = PrecisionChoice::Model;
        assert_eq!(model.agreed(Precision::Fp32, &alone), Precision::Fp32);
        assert_eq!(model.agreed(Precision::Bf16, &alone), auto);
        let all = Isa::available();
        assert_eq!((all[0], all[all.len() - 1]), (Isa::portable(), Isa::detect()));
        for isa in all {
            assert_eq!(Isa::parse(isa.name()).unwrap(), isa);
            let known = match isa.name() {
                "amx" => Some(true),
                "avx512-bf16" => None,
                _ => Some(false),
            };
            assert!(known.is_none_or(|pays| pays == isa.bf16_pays()), "{}", isa.name());
        }
        m4gn_samples::fails(Isa::parse("mmx"), &["portable"]);
    }
}
