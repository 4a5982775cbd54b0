//! Loops over latent rows `[n x d]`, written once and compiled for each instruction set.
//!
//! What an unsafe function relies on stands above it; blocks within it would say it again.
#![allow(unsafe_op_in_unsafe_fn)]

#[cfg(target_arch = "x86_64")]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod buffer;
mod dense;
mod gradient;
mod isa;
mod outer;
mod packed;
mod portable;
mod product;
mod rows;
mod simd;

#[cfg(target_arch = "x86_64")]
pub use amx::Tiles;
pub use buffer::Buffer;
pub use dense::{Adam, adam, multiply_add, softmax_backward};
pub use gradient::{Saved, activation_backward, norm_backward, silu_keep};
pub use isa::Isa;
use isa::Level;
pub use outer::{Pairs, gather_add, outer, scatter_add};
pub use packed::{Packed, padded};
pub use product::{Addend, Output, product, registers};
pub use rows::*;
pub use simd::{Bf16, Number};

use m4gn_model::Activation;

/// What stands between two linear layers, or after the first one when there is only one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// x
    Identity,
    /// max(0, x)
    Relu,
    /// x / (1 + exp(-x))
    Silu,
}

impl From<Activation> for Function {
    fn from(activation: Activation) -> Self {
        match activation {
            Activation::Relu => Function::Relu,
            Activation::Silu => Function::Silu,
        }
    }
}

impl Isa {
    /// Vectors of a panel of columns: what the registers hold.
    fn panel(self) -> usize {
        match self.0 {
            Level::Avx512 | Level::Avx512Bf16 | Level::Amx => 4,
            _ => 1,
        }
    }
}

/// Calls `name::<S, T, MR, WIDE>(arguments)` compiled for the instruction set of an [`Isa`]: `S` its vectors, `MR`
/// the rows of a product's tile, `WIDE` whether a panel has several vectors. The arguments are variables of the caller.
///
/// The callee is unsafe; the caller keeps its promises.
macro_rules! dispatch {
    ($isa:expr, $t:ident, $name:ident($($arg:ident: $kind:ty),*) $(-> $result:ty)?) => {{
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512bf16,avx2,fma")]
        unsafe fn avx512_bf16<$t: Number>($($arg: $kind),*) $(-> $result)? {
            $name::<$crate::kernels::avx512::Avx512<true>, $t, 6, true>($($arg),*)
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
        unsafe fn avx512<$t: Number>($($arg: $kind),*) $(-> $result)? {
            $name::<$crate::kernels::avx512::Avx512<false>, $t, 6, true>($($arg),*)
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        unsafe fn avx2<$t: Number>($($arg: $kind),*) $(-> $result)? {
            $name::<$crate::kernels::avx2::Avx2, $t, 6, false>($($arg),*)
        }
        use $crate::kernels::Level;
        // SAFETY: an Isa of a level exists only where the processor has its features; the rest is the caller's.
        unsafe {
            match $isa.0 {
                #[cfg(target_arch = "x86_64")]
                Level::Avx512Bf16 | Level::Amx => avx512_bf16::<$t>($($arg),*),
                #[cfg(target_arch = "x86_64")]
                Level::Avx512 => avx512::<$t>($($arg),*),
                #[cfg(target_arch = "x86_64")]
                Level::Avx2 => avx2::<$t>($($arg),*),
                _ => $name::<$crate::kernels::portable::Portable, $t, 2, false>($($arg),*),
            }
        }
    }};
}
use dispatch;

/// As [`dispatch`], with the callee's body in place, which sees `S`, `MR` and `WIDE` beside its arguments.
macro_rules! compiled {
    ($isa:expr, $t:ident, |$($arg:ident: $kind:ty),*| $body:block) => {{
        #[inline(always)]
        #[allow(clippy::too_many_arguments)]
        unsafe fn all<S: Simd, $t: Number, const MR: usize, const WIDE: bool>($($arg: $kind),*) $body
        $crate::kernels::dispatch!($isa, $t, all($($arg: $kind),*))
    }};
}
use compiled;

/// Instruction sets of other processors have no tiles.
#[cfg(not(target_arch = "x86_64"))]
pub struct Tiles;

#[cfg(not(target_arch = "x86_64"))]
impl Tiles {
    /// Nothing.
    pub fn new(_: Isa) -> Self {
        Tiles
    }
}

#[cfg(test)]
mod tests;
