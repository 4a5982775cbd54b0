//! How the engine computes: precision, threads, instruction set.

#[cfg(target_arch = "x86_64")]
use super::kernels::has_tiles;
use m4gn_base::{Error, Result};
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

/// An instruction set that this processor has. Only [`Isa::detect`] and its kin make one, so having it is proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(pub(super) Level);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
pub(super) enum Level {
    Portable,
    Avx2,
    Avx512,
    Avx512Bf16,
    Amx,
}

m4gn_base::names! {
    Level: Portable "portable", Avx2 "avx2", Avx512 "avx512", Avx512Bf16 "avx512-bf16", Amx "amx"
}

impl Isa {
    /// The widest that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                return Isa(match is_x86_feature_detected!("avx512bf16") {
                    true if has_tiles() => Level::Amx,
                    true => Level::Avx512Bf16,
                    false => Level::Avx512,
                });
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Isa(Level::Avx2);
            }
        }
        Isa(Level::Portable)
    }

    /// All that this processor has, the portable one first.
    pub fn available() -> Vec<Self> {
        let widest = Self::detect().0;
        Level::ALL.into_iter().filter(|l| *l <= widest).map(Isa).collect()
    }

    /// Whether a network in bf16 takes less time than one in fp32: with AMX, and with AVX-512 BF16 elsewhere than on
    /// processors of Intel, whose product of pairs has half the rate of fp32's. Otherwise bf16 saves memory alone.
    pub fn bf16_pays(self) -> bool {
        match self.0 {
            Level::Amx => true,
            Level::Avx512Bf16 => !made_by_intel(),
            _ => false,
        }
    }

    /// Plain Rust that runs anywhere.
    pub fn portable() -> Self {
        Isa(Level::Portable)
    }

    /// By name: `portable`, `avx2`, `avx512`, `avx512-bf16`, `amx`.
    ///
    /// # Errors
    /// [`Error::Input`] for a name that is none of these, or an instruction set that this processor lacks.
    pub fn parse(name: &str) -> Result<Self> {
        let available = Self::available();
        available.iter().find(|isa| isa.name() == name).copied().ok_or_else(|| {
            let names: Vec<_> = available.iter().map(|isa| isa.name()).collect();
            Error::Input(format!("instruction set '{name}': this processor has {}", names.join(", ")))
        })
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.0.name()
    }
}

fn made_by_intel() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        // "GenuineIntel", in registers b, d, c.
        let name = std::arch::x86_64::__cpuid(0);
        [name.ebx, name.edx, name.ecx].map(u32::to_le_bytes).concat() == b"GenuineIntel"
    }
    #[cfg(not(target_arch = "x86_64"))]
    false
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
