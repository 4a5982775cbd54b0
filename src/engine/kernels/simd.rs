//! What the kernels need of an instruction set: sixteen fp32 numbers at a time.

use super::buffer::Plain;

/// A number of the upper half of an fp32: 8 bits of exponent, 8 of mantissa with the hidden one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

/// Numbers in a vector.
pub const LANES: usize = 16;

/// An instruction set. Every function is unsafe: the processor must have it, and pointers must be good for sixteen
/// numbers.
#[allow(clippy::missing_safety_doc)]
pub trait Simd: Copy {
    /// Sixteen fp32 numbers.
    type V: Copy;

    /// All lanes x.
    unsafe fn splat(x: f32) -> Self::V;
    /// From memory.
    unsafe fn load(p: *const f32) -> Self::V;
    /// To memory.
    unsafe fn store(p: *mut f32, v: Self::V);
    /// From memory, exact.
    unsafe fn load_bf16(p: *const Bf16) -> Self::V;
    /// To memory, rounded to nearest even.
    unsafe fn store_bf16(p: *mut Bf16, v: Self::V);
    /// a + b
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V;
    /// a - b
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V;
    /// a b
    unsafe fn mul(a: Self::V, b: Self::V) -> Self::V;
    /// a b + c
    unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// The smaller of limit and v; NaN where v is.
    unsafe fn at_most(v: Self::V, limit: Self::V) -> Self::V;
    /// The larger of limit and v; NaN where v is.
    unsafe fn at_least(v: Self::V, limit: Self::V) -> Self::V;
    /// `then` where v is positive, else 0.
    unsafe fn where_positive(v: Self::V, then: Self::V) -> Self::V;
    /// 1 / v to fp32 rounding.
    unsafe fn reciprocal(v: Self::V) -> Self::V;
    /// 2^n where n stands in the low bits of the numbers' mantissas.
    unsafe fn power_of_two(v: Self::V) -> Self::V;
    /// Sum of the lanes.
    unsafe fn sum(v: Self::V) -> f32;
    /// Sums of the lanes of each.
    #[inline(always)]
    unsafe fn sums<const N: usize>(v: &[Self::V; N]) -> [f32; N] {
        let mut sums = [0.0; N];
        for (sum, v) in sums.iter_mut().zip(v) {
            *sum = Self::sum(*v);
        }
        sums
    }

    /// `acc[i][j] += x[i][k] * w[j]`, w of NR vectors.
    #[inline(always)]
    unsafe fn step_f32<const MR: usize, const NR: usize>(
        acc: &mut [[Self::V; NR]; MR],
        x: &[*const f32; MR],
        k: usize,
        w: *const f32,
    ) {
        let mut column = [Self::splat(0.0); NR];
        for (j, column) in column.iter_mut().enumerate() {
            *column = Self::load(w.add(LANES * j));
        }
        for (acc, x) in acc.iter_mut().zip(x) {
            let x = Self::splat(*x.add(k));
            for (acc, w) in acc.iter_mut().zip(&column) {
                *acc = Self::fma(x, *w, *acc);
            }
        }
    }
    /// `acc[i][j] += x[i][k] * w[j] even + x[i][k + 1] * w[j] odd`: w of NR vectors of sixteen pairs.
    unsafe fn step_bf16<const MR: usize, const NR: usize>(
        acc: &mut [[Self::V; NR]; MR],
        x: &[*const Bf16; MR],
        k: usize,
        w: *const Bf16,
    );
}

/// Functions of a [`Simd`] that are one expression, a line each.
macro_rules! lines {
    ($($name:ident($($arg:ident: $kind:ty),*) -> $result:ty { $body:expr })*) => {
        $(
            #[inline(always)]
            unsafe fn $name($($arg: $kind),*) -> $result {
                $body
            }
        )*
    };
}
pub(super) use lines;

/// What latents, activations and weights are made of.
#[allow(clippy::missing_safety_doc)]
pub trait Number: Plain + Default + Send + Sync + std::fmt::Debug + 'static {
    /// Inputs that one step of a product takes.
    const STEP: usize;
    /// Rows that go through a perceptron at a time, so that activations and sums stay in the first two caches: more of them
    /// where numbers are small, since the sums of an outer product are read and written once each time.
    const ROWS: usize;

    /// Rounded to nearest even.
    fn from_f32(x: f32) -> Self;
    /// Exact.
    fn to_f32(self) -> f32;
    /// Sixteen from memory.
    unsafe fn load<S: Simd>(p: *const Self) -> S::V;
    /// Sixteen to memory.
    unsafe fn store<S: Simd>(p: *mut Self, v: S::V);
    /// One step of a product, as [`Simd::step_f32`] and [`Simd::step_bf16`].
    unsafe fn step<S: Simd, const MR: usize, const NR: usize>(
        acc: &mut [[S::V; NR]; MR],
        x: &[*const Self; MR],
        k: usize,
        w: *const Self,
    );
}

/// Functions of a [`Number`], by those of a [`Simd`] that load, store and multiply it.
macro_rules! by {
    ($load:ident, $store:ident, $step:ident) => {
        #[inline(always)]
        unsafe fn load<S: Simd>(p: *const Self) -> S::V {
            S::$load(p)
        }

        #[inline(always)]
        unsafe fn store<S: Simd>(p: *mut Self, v: S::V) {
            S::$store(p, v)
        }

        #[inline(always)]
        unsafe fn step<S: Simd, const MR: usize, const NR: usize>(
            acc: &mut [[S::V; NR]; MR],
            x: &[*const Self; MR],
            k: usize,
            w: *const Self,
        ) {
            S::$step(acc, x, k, w)
        }
    };
}

impl Number for f32 {
    const STEP: usize = 1;
    const ROWS: usize = 48;

    fn from_f32(x: f32) -> Self {
        x
    }

    fn to_f32(self) -> f32 {
        self
    }

    by!(load, store, step_f32);
}

impl Number for Bf16 {
    const STEP: usize = 2;
    const ROWS: usize = 96;

    #[inline(always)]
    fn from_f32(x: f32) -> Self {
        let bits = x.to_bits();
        if x.is_nan() {
            // Quiet, so that no NaN rounds to infinity.
            return Bf16((bits >> 16) as u16 | 0x40);
        }
        Bf16(((bits + 0x7fff + ((bits >> 16) & 1)) >> 16) as u16)
    }

    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
    }

    by!(load_bf16, store_bf16, step_bf16);
}

/// exp(v) to about 2e-7 relative for -87 < v < 88, clamped outside; NaN stays NaN.
#[inline(always)]
pub unsafe fn exp<S: Simd>(v: S::V) -> S::V {
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, so that r below is exact enough.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let v = S::at_least(S::at_most(v, S::splat(88.0)), S::splat(-87.0));
    let rounded = S::fma(v, S::splat(std::f32::consts::LOG2_E), S::splat(ROUND));
    let n = S::sub(rounded, S::splat(ROUND));
    let r = S::fma(n, S::splat(-LN2_HIGH), v);
    let r = S::fma(n, S::splat(-LN2_LOW), r);
    let mut series = S::splat(1.0 / 720.0);
    for c in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        series = S::fma(series, r, S::splat(c));
    }
    S::mul(series, S::power_of_two(rounded))
}

/// v / (1 + exp(-v))
#[inline(always)]
pub unsafe fn silu<S: Simd>(v: S::V) -> S::V {
    let e = exp::<S>(S::sub(S::splat(0.0), v));
    S::mul(v, S::reciprocal(S::add(S::splat(1.0), e)))
}
