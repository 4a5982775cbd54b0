//! Plain Rust: loops over sixteen numbers that the compiler vectorises for its baseline.

use super::simd::{Bf16, LANES, Number, Simd, lines};

/// Runs anywhere.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

type Lanes = [f32; LANES];

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Lanes {
    std::array::from_fn(f)
}

/// a b + c, fused only where that is an instruction: elsewhere it is a slow function of the C library.
#[inline(always)]
fn multiply_add(a: f32, b: f32, c: f32) -> f32 {
    if cfg!(any(target_feature = "fma", target_arch = "aarch64")) { a.mul_add(b, c) } else { a * b + c }
}

// SAFETY of the whole implementation: pointers are good for sixteen numbers, as the trait's callers promise.
impl Simd for Portable {
    type V = Lanes;

    lines! {
        splat(x: f32) -> Lanes { [x; LANES] }
        load(p: *const f32) -> Lanes { p.cast::<Lanes>().read() }
        add(a: Lanes, b: Lanes) -> Lanes { each(|i| a[i] + b[i]) }
        sub(a: Lanes, b: Lanes) -> Lanes { each(|i| a[i] - b[i]) }
        mul(a: Lanes, b: Lanes) -> Lanes { each(|i| a[i] * b[i]) }
        fma(a: Lanes, b: Lanes, c: Lanes) -> Lanes { each(|i| multiply_add(a[i], b[i], c[i])) }
        // Not f32::min and max, which would turn NaN into the limit and hide it from the check of the result.
        at_most(v: Lanes, limit: Lanes) -> Lanes { each(|i| if limit[i] < v[i] { limit[i] } else { v[i] }) }
        at_least(v: Lanes, limit: Lanes) -> Lanes { each(|i| if limit[i] > v[i] { limit[i] } else { v[i] }) }
        where_positive(v: Lanes, then: Lanes) -> Lanes { each(|i| if v[i] > 0.0 { then[i] } else { 0.0 }) }
        reciprocal(v: Lanes) -> Lanes { v.map(|v| 1.0 / v) }
        power_of_two(v: Lanes) -> Lanes { v.map(|v| f32::from_bits((v.to_bits() << 23).wrapping_add(0x3f80_0000))) }
        store(p: *mut f32, v: Lanes) -> () { p.cast::<Lanes>().write(v) }
        load_bf16(p: *const Bf16) -> Lanes { p.cast::<[Bf16; LANES]>().read().map(Bf16::to_f32) }
        store_bf16(p: *mut Bf16, v: Lanes) -> () { p.cast::<[Bf16; LANES]>().write(v.map(Bf16::from_f32)) }
    }

    #[inline(always)]
    unsafe fn sum(v: Lanes) -> f32 {
        let mut v = v;
        let mut width = LANES / 2;
        while width > 0 {
            for i in 0..width {
                v[i] += v[i + width];
            }
            width /= 2;
        }
        v[0]
    }

    #[inline(always)]
    unsafe fn step_f32<const MR: usize, const NR: usize>(
        acc: &mut [[Lanes; NR]; MR],
        x: &[*const f32; MR],
        k: usize,
        w: *const f32,
    ) {
        for j in 0..NR {
            let w = Self::load(w.add(LANES * j));
            for (acc, x) in acc.iter_mut().zip(x) {
                let x = *x.add(k);
                acc[j] = each(|i| multiply_add(x, w[i], acc[j][i]));
            }
        }
    }

    #[inline(always)]
    unsafe fn step_bf16<const MR: usize, const NR: usize>(
        acc: &mut [[Lanes; NR]; MR],
        x: &[*const Bf16; MR],
        k: usize,
        w: *const Bf16,
    ) {
        for j in 0..NR {
            let pairs = w.add(2 * LANES * j).cast::<[[Bf16; 2]; LANES]>().read();
            for odd in [0, 1] {
                let w = each(|i| pairs[i][odd].to_f32());
                for (acc, x) in acc.iter_mut().zip(x) {
                    let x = (*x.add(k + odd)).to_f32();
                    acc[j] = each(|i| multiply_add(x, w[i], acc[j][i]));
                }
            }
        }
    }
}
