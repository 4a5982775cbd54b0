//! Instruction sets, of which a processor has some.

#[cfg(target_arch = "x86_64")]
use super::amx;
use m4gn_base::{Error, Result};

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
                    true if amx::available() => Level::Amx,
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
