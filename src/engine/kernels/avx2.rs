//! AVX2 with FMA: a vector is two registers. bf16 is widened by shifts.

use super::simd::{Bf16, Simd, lines};
use std::arch::x86_64::*;

/// AVX2 and FMA.
#[derive(Clone, Copy, Debug)]
pub struct Avx2;

type Pair = [__m256; 2];

/// Sixteen bf16 as two vectors of eight.
#[inline(always)]
unsafe fn widen(narrow: __m128i) -> __m256 {
    _mm256_castsi256_ps(_mm256_slli_epi32::<16>(_mm256_cvtepu16_epi32(narrow)))
}

/// The upper halves of eight fp32, rounded to nearest even, each in 32 bits.
#[inline(always)]
unsafe fn narrow(v: __m256) -> __m256i {
    let bits = _mm256_castps_si256(v);
    let odd = _mm256_and_si256(_mm256_srli_epi32::<16>(bits), _mm256_set1_epi32(1));
    let rounded = _mm256_add_epi32(bits, _mm256_add_epi32(odd, _mm256_set1_epi32(0x7fff)));
    let nan = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_UNORD_Q>(v, v));
    let quiet = _mm256_or_si256(bits, _mm256_set1_epi32(0x40_0000));
    _mm256_srli_epi32::<16>(_mm256_blendv_epi8(rounded, quiet, nan))
}

// SAFETY of the whole implementation: the trait's functions are called only where the processor has these
// features, with pointers that are good for sixteen numbers.
impl Simd for Avx2 {
    type V = Pair;

    lines! {
        splat(x: f32) -> Pair { [_mm256_set1_ps(x); 2] }
        load(p: *const f32) -> Pair { [_mm256_loadu_ps(p), _mm256_loadu_ps(p.add(8))] }
        add(a: Pair, b: Pair) -> Pair { [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])] }
        sub(a: Pair, b: Pair) -> Pair { [_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])] }
        mul(a: Pair, b: Pair) -> Pair { [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])] }
        fma(a: Pair, b: Pair, c: Pair) -> Pair { [_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])] }
        // The instructions for minimum and maximum give their second operand where either is NaN.
        at_most(v: Pair, limit: Pair) -> Pair { [_mm256_min_ps(limit[0], v[0]), _mm256_min_ps(limit[1], v[1])] }
        at_least(v: Pair, limit: Pair) -> Pair { [_mm256_max_ps(limit[0], v[0]), _mm256_max_ps(limit[1], v[1])] }
        load_bf16(p: *const Bf16) -> Pair { [widen(_mm_loadu_si128(p.cast())), widen(_mm_loadu_si128(p.add(8).cast()))] }
        reciprocal(v: Pair) -> Pair { [_mm256_div_ps(_mm256_set1_ps(1.0), v[0]), _mm256_div_ps(_mm256_set1_ps(1.0), v[1])] }
    }

    #[inline(always)]
    unsafe fn store(p: *mut f32, v: Pair) {
        _mm256_storeu_ps(p, v[0]);
        _mm256_storeu_ps(p.add(8), v[1]);
    }

    #[inline(always)]
    unsafe fn store_bf16(p: *mut Bf16, v: Pair) {
        // The pack works within 128-bit halves; the permutation puts the quarters in order.
        let packed = _mm256_packus_epi32(narrow(v[0]), narrow(v[1]));
        _mm256_storeu_si256(p.cast(), _mm256_permute4x64_epi64::<0b11_01_10_00>(packed));
    }

    #[inline(always)]
    unsafe fn where_positive(v: Pair, then: Pair) -> Pair {
        let zero = _mm256_setzero_ps();
        [
            _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(v[0], zero), then[0]),
            _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(v[1], zero), then[1]),
        ]
    }

    #[inline(always)]
    unsafe fn power_of_two(v: Pair) -> Pair {
        let one = _mm256_set1_epi32(0x3f80_0000);
        v.map(|v| {
            let n = _mm256_slli_epi32::<23>(_mm256_castps_si256(v));
            _mm256_castsi256_ps(_mm256_add_epi32(n, one))
        })
    }

    #[inline(always)]
    unsafe fn sum(v: Pair) -> f32 {
        let half = _mm256_add_ps(v[0], v[1]);
        let quarter = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half));
        let two = _mm_add_ps(quarter, _mm_movehl_ps(quarter, quarter));
        _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
    }

    #[inline(always)]
    unsafe fn step_bf16<const MR: usize, const NR: usize>(
        acc: &mut [[Pair; NR]; MR],
        x: &[*const Bf16; MR],
        k: usize,
        w: *const Bf16,
    ) {
        // A pair of x is read as one integer, aligned or not.
        for odd in [false, true] {
            let widen = |v: __m256i| {
                _mm256_castsi256_ps(if odd {
                    _mm256_and_si256(v, _mm256_set1_epi32(0xffff_0000u32 as i32))
                } else {
                    _mm256_slli_epi32::<16>(v)
                })
            };
            let mut column = [[_mm256_setzero_ps(); 2]; NR];
            for (j, column) in column.iter_mut().enumerate() {
                let w = w.add(32 * j).cast::<__m256i>();
                *column = [widen(_mm256_loadu_si256(w)), widen(_mm256_loadu_si256(w.add(1)))];
            }
            for (acc, x) in acc.iter_mut().zip(x) {
                let x = widen(_mm256_set1_epi32(x.add(k).cast::<i32>().read_unaligned()));
                for (acc, w) in acc.iter_mut().zip(&column) {
                    acc[0] = _mm256_fmadd_ps(x, w[0], acc[0]);
                    acc[1] = _mm256_fmadd_ps(x, w[1], acc[1]);
                }
            }
        }
    }
}
