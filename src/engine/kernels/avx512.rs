//! AVX-512: a vector is one register. With the BF16 extension a product step is one instruction on pairs.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::simd::{Bf16, Simd, lines};
use std::arch::x86_64::*;

/// AVX-512 F, BW, DQ and VL; `PAIRS`: with BF16.
#[derive(Clone, Copy, Debug)]
pub struct Avx512<const PAIRS: bool>;

// SAFETY of the whole implementation: the trait's functions are called only where the processor has these
// features, with pointers that are good for sixteen numbers.
impl<const PAIRS: bool> Simd for Avx512<PAIRS> {
    type V = __m512;

    lines! {
        splat(x: f32) -> __m512 { _mm512_set1_ps(x) }
        load(p: *const f32) -> __m512 { _mm512_loadu_ps(p) }
        store(p: *mut f32, v: __m512) -> () { _mm512_storeu_ps(p, v) }
        load_bf16(p: *const Bf16) -> __m512 {
            _mm512_castsi512_ps(_mm512_slli_epi32::<16>(_mm512_cvtepu16_epi32(_mm256_loadu_si256(p.cast()))))
        }
        add(a: __m512, b: __m512) -> __m512 { _mm512_add_ps(a, b) }
        sub(a: __m512, b: __m512) -> __m512 { _mm512_sub_ps(a, b) }
        mul(a: __m512, b: __m512) -> __m512 { _mm512_mul_ps(a, b) }
        fma(a: __m512, b: __m512, c: __m512) -> __m512 { _mm512_fmadd_ps(a, b, c) }
        // The instructions for minimum and maximum give their second operand where either is NaN.
        at_most(v: __m512, limit: __m512) -> __m512 { _mm512_min_ps(limit, v) }
        at_least(v: __m512, limit: __m512) -> __m512 { _mm512_max_ps(limit, v) }
        where_positive(v: __m512, then: __m512) -> __m512 {
            _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(v, _mm512_setzero_ps()), then)
        }
        power_of_two(v: __m512) -> __m512 {
            _mm512_castsi512_ps(_mm512_add_epi32(_mm512_slli_epi32::<23>(_mm512_castps_si512(v)), _mm512_set1_epi32(0x3f80_0000)))
        }
    }

    #[inline(always)]
    unsafe fn store_bf16(p: *mut Bf16, v: __m512) {
        if PAIRS {
            let narrow = std::mem::transmute::<__m256bh, __m256i>(_mm512_cvtneps_pbh(v));
            return _mm256_storeu_si256(p.cast(), narrow);
        }
        let bits = _mm512_castps_si512(v);
        let odd = _mm512_and_si512(_mm512_srli_epi32::<16>(bits), _mm512_set1_epi32(1));
        let rounded = _mm512_add_epi32(bits, _mm512_add_epi32(odd, _mm512_set1_epi32(0x7fff)));
        let nan = _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(v, v);
        let quiet = _mm512_or_si512(bits, _mm512_set1_epi32(0x40_0000));
        let bits = _mm512_mask_mov_epi32(rounded, nan, quiet);
        let narrow = _mm512_cvtepi32_epi16(_mm512_srli_epi32::<16>(bits));
        _mm256_storeu_si256(p.cast(), narrow);
    }

    #[inline(always)]
    unsafe fn reciprocal(v: __m512) -> __m512 {
        // 14 bits, doubled by a step of Newton's method.
        let r = _mm512_rcp14_ps(v);
        let error = _mm512_fnmadd_ps(v, r, _mm512_set1_ps(1.0));
        _mm512_fmadd_ps(r, error, r)
    }

    #[inline(always)]
    unsafe fn sum(v: __m512) -> f32 {
        let half = _mm256_add_ps(_mm512_castps512_ps256(v), _mm512_extractf32x8_ps::<1>(v));
        let quarter = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half));
        let two = _mm_add_ps(quarter, _mm_movehl_ps(quarter, quarter));
        _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
    }

    #[inline(always)]
    unsafe fn sums<const N: usize>(v: &[__m512; N]) -> [f32; N] {
        let mut sums = [0.0; N];
        let whole = N / 4 * 4;
        for i in (0..whole).step_by(4) {
            // Four together: halves of each two, quarters of all, and the numbers of each quarter.
            let low = _mm512_add_ps(
                _mm512_shuffle_f32x4::<0b01_00_01_00>(v[i], v[i + 1]),
                _mm512_shuffle_f32x4::<0b11_10_11_10>(v[i], v[i + 1]),
            );
            let high = _mm512_add_ps(
                _mm512_shuffle_f32x4::<0b01_00_01_00>(v[i + 2], v[i + 3]),
                _mm512_shuffle_f32x4::<0b11_10_11_10>(v[i + 2], v[i + 3]),
            );
            let four = _mm512_add_ps(
                _mm512_shuffle_f32x4::<0b10_00_10_00>(low, high),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(low, high),
            );
            let two = _mm512_add_ps(four, _mm512_permute_ps::<0b01_00_11_10>(four));
            let one = _mm512_add_ps(two, _mm512_permute_ps::<0b10_11_00_01>(two));
            let first = _mm512_maskz_compress_ps(0b0001_0001_0001_0001, one);
            _mm_storeu_ps(sums.as_mut_ptr().add(i), _mm512_castps512_ps128(first));
        }
        for i in whole..N {
            sums[i] = Self::sum(v[i]);
        }
        sums
    }

    #[inline(always)]
    unsafe fn step_bf16<const MR: usize, const NR: usize>(
        acc: &mut [[__m512; NR]; MR],
        x: &[*const Bf16; MR],
        k: usize,
        w: *const Bf16,
    ) {
        // A pair of x is read as one integer, aligned or not.
        let mut column = [_mm512_setzero_si512(); NR];
        for (j, column) in column.iter_mut().enumerate() {
            *column = _mm512_loadu_si512(w.add(32 * j).cast());
        }
        if PAIRS {
            let pairs = |v| std::mem::transmute::<__m512i, __m512bh>(v);
            for (acc, x) in acc.iter_mut().zip(x) {
                let x = _mm512_set1_epi32(x.add(k).cast::<i32>().read_unaligned());
                for (acc, w) in acc.iter_mut().zip(&column) {
                    *acc = _mm512_dpbf16_ps(*acc, pairs(x), pairs(*w));
                }
            }
            return;
        }
        for odd in [false, true] {
            let widen = |v: __m512i| {
                _mm512_castsi512_ps(if odd {
                    _mm512_and_si512(v, _mm512_set1_epi32(0xffff_0000u32 as i32))
                } else {
                    _mm512_slli_epi32::<16>(v)
                })
            };
            let mut wide = [_mm512_setzero_ps(); NR];
            for (wide, column) in wide.iter_mut().zip(&column) {
                *wide = widen(*column);
            }
            for (acc, x) in acc.iter_mut().zip(x) {
                let x = widen(_mm512_set1_epi32(x.add(k).cast::<i32>().read_unaligned()));
                for (acc, w) in acc.iter_mut().zip(&wide) {
                    *acc = _mm512_fmadd_ps(x, *w, *acc);
                }
            }
        }
    }
}
