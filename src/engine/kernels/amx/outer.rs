//! Gradients of weights.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::block::{Sums, block};
use super::{INPUTS, ROWS, Tiles};
use crate::kernels::Isa;
use crate::kernels::Level;
use crate::kernels::packed::padded;
use crate::kernels::simd::{Bf16, LANES, Number};
use std::arch::x86_64::*;
use std::mem::MaybeUninit;

/// As [`crate::kernels::outer()`], of `n` rows: `left` and `right` have room for the rows of both, a whole number of steps.
///
/// # Safety
/// The processor has tiles, and what outer() checks holds.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512bf16,avx2,fma")]
pub unsafe fn outer<T: Number>(
    (y, y_stride): (*const T, usize),
    (x, x_stride): (*const T, usize),
    n: usize,
    (outputs, columns): (usize, usize),
    sums: *mut f32,
    (left, right): (&mut [T], &mut [T]),
) {
    let _tiles = Tiles::new(Isa(Level::Amx));
    let rows = n.next_multiple_of(INPUTS);
    let width = padded(outputs);
    assert!(
        size_of::<T>() == 2 && left.len() >= rows * width && right.len() >= rows * columns,
        "room for the operands of an outer product"
    );
    let steps = rows / INPUTS;
    let (left, right) = (left.as_mut_ptr().cast::<u8>(), right.as_mut_ptr().cast::<u8>());
    // Bytes between the outputs of `left`, and between the pairs of `right`.
    let (output, pair) = (2 * rows, 4 * columns);
    for i in (0..rows).step_by(2) {
        for c in (0..columns).step_by(LANES) {
            let both = row_pair(x.cast(), x_stride, (i, n), c);
            _mm512_storeu_si512(right.add(i / 2 * pair + 4 * c).cast(), both);
        }
    }
    for step in 0..steps {
        for o in (0..width).step_by(LANES) {
            let mut pairs = [_mm512_setzero_si512(); 16];
            for p in 0..16 {
                pairs[p] = row_pair(y.cast(), y_stride, (step * INPUTS + 2 * p, n), o);
            }
            let pairs = transposed(pairs);
            for i in 0..16 {
                _mm512_storeu_si512(left.add((o + i) * output + 64 * step).cast(), pairs[i]);
            }
        }
    }
    for first in (0..outputs).step_by(ROWS) {
        let mut column = 0;
        while column < columns {
            let vectors = ((columns - column) / LANES).min(4);
            let from = (left.add(first * output).cast_const(), output);
            let by = (right.add(4 * column).cast_const(), pair, steps);
            let to = (sums.add(first * columns + column), columns, outputs - first);
            match vectors {
                1 => add_block::<1>(from, by, to),
                2 => add_block::<2>(from, by, to),
                3 => add_block::<3>(from, by, to),
                _ => add_block::<4>(from, by, to),
            }
            column += vectors * LANES;
        }
    }
}

/// `sums += x W` as [`block`], for as many of the 16 rows as there are.
///
/// # Safety
/// As [`block`], but for the number of rows of the sums.
#[inline(always)]
unsafe fn add_block<const NR: usize>(
    x: (*const u8, usize),
    w: (*const u8, usize, usize),
    (sums, columns, rows): (*mut f32, usize, usize),
) {
    let mut own = MaybeUninit::<Sums>::uninit();
    let own = own.as_mut_ptr().cast::<f32>();
    if rows >= ROWS {
        return block::<NR>(x, w, Some((sums, 4 * columns)), (sums, 4 * columns));
    }
    block::<NR>(x, w, None, (own, NR * 64));
    for i in 0..rows {
        for j in 0..NR {
            let to = sums.add(i * columns + j * LANES);
            let from = own.add((i * NR + j) * LANES);
            _mm512_storeu_ps(to, _mm512_add_ps(_mm512_loadu_ps(to), _mm512_loadu_ps(from)));
        }
    }
}

/// Sixteen numbers of row i, each with that of row i + 1 behind it; rows from n on are zero.
///
/// # Safety
/// Rows up to n have sixteen numbers at `column`.
#[inline(always)]
unsafe fn row_pair(x: *const Bf16, stride: usize, (i, n): (usize, usize), column: usize) -> __m512i {
    if i >= n {
        return _mm512_setzero_si512();
    }
    let from = x.add(i * stride + column);
    let first = _mm512_cvtepu16_epi32(_mm256_loadu_si256(from.cast()));
    if i + 1 >= n {
        return first;
    }
    let second = _mm512_cvtepu16_epi32(_mm256_loadu_si256(from.add(stride).cast()));
    _mm512_or_si512(first, _mm512_slli_epi32::<16>(second))
}

/// Number i of vector j of what comes in is number j of vector i of what goes out.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn transposed(v: [__m512i; 16]) -> [__m512i; 16] {
    let zero = _mm512_setzero_si512();
    // Numbers of two vectors, then of four, within quarters.
    let (mut two, mut four) = ([zero; 16], [zero; 16]);
    for i in 0..8 {
        two[2 * i] = _mm512_unpacklo_epi32(v[2 * i], v[2 * i + 1]);
        two[2 * i + 1] = _mm512_unpackhi_epi32(v[2 * i], v[2 * i + 1]);
    }
    for i in 0..4 {
        for half in 0..2 {
            let (a, b) = (two[4 * i + half], two[4 * i + 2 + half]);
            four[4 * i + 2 * half] = _mm512_unpacklo_epi64(a, b);
            four[4 * i + 2 * half + 1] = _mm512_unpackhi_epi64(a, b);
        }
    }
    // Now quarter q of four[4 i + k] has number 4 q + k of the vectors 4 i to 4 i + 3: quarters change places.
    let mut out = [zero; 16];
    for k in 0..4 {
        let low = _mm512_shuffle_i32x4::<0b10_00_10_00>(four[k], four[4 + k]);
        let high = _mm512_shuffle_i32x4::<0b11_01_11_01>(four[k], four[4 + k]);
        let low2 = _mm512_shuffle_i32x4::<0b10_00_10_00>(four[8 + k], four[12 + k]);
        let high2 = _mm512_shuffle_i32x4::<0b11_01_11_01>(four[8 + k], four[12 + k]);
        out[k] = _mm512_shuffle_i32x4::<0b10_00_10_00>(low, low2);
        out[8 + k] = _mm512_shuffle_i32x4::<0b11_01_11_01>(low, low2);
        out[4 + k] = _mm512_shuffle_i32x4::<0b10_00_10_00>(high, high2);
        out[12 + k] = _mm512_shuffle_i32x4::<0b11_01_11_01>(high, high2);
    }
    out
}
