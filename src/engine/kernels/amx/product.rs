//! Rows times packed weights.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::block::{Sums, block};
use super::{INPUTS, ROWS, Tiles};
use crate::kernels::Level;
use crate::kernels::avx512::Avx512;
use crate::kernels::packed::Packed;
use crate::kernels::product::{Addend, Output, finish};
use crate::kernels::simd::{Bf16, LANES, Number, Simd};
use crate::kernels::{Function, Isa};
use std::arch::x86_64::*;
use std::mem::MaybeUninit;
use std::ops::Range;

/// Rows of a tile that are finished at a time: with four vectors each they fill half of the registers.
const FINISHED: usize = 4;

/// As [`crate::kernels::product()`], for n rows of x, of which the first `readable` can be read.
///
/// # Safety
/// [`super::takes`] allows it, and what kernels::product() checks holds.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512bf16,avx2,fma")]
pub unsafe fn product<T: Number>(
    weight: &Packed<T>,
    (x, stride): (*const T, usize),
    (n, readable): (usize, usize),
    addend: Addend<T>,
    function: Function,
    out: &mut Output<T>,
) {
    let _tiles = Tiles::new(Isa(Level::Amx));
    let mut w = weight.start();
    let mut column = 0;
    let steps = weight.inputs().div_ceil(INPUTS);
    for &vectors in weight.panels() {
        let place = (column, weight.columns());
        let from = (x, stride);
        let rows = (n, readable);
        match vectors {
            1 => panel::<T, 1>(w, steps, place, from, rows, addend, function, out),
            2 => panel::<T, 2>(w, steps, place, from, rows, addend, function, out),
            3 => panel::<T, 3>(w, steps, place, from, rows, addend, function, out),
            4 => panel::<T, 4>(w, steps, place, from, rows, addend, function, out),
            _ => unreachable!("panels were packed for another instruction set"),
        }
        w = w.add(steps * INPUTS * vectors * LANES);
        column += vectors * LANES;
    }
}

/// # Safety
/// As [`product`].
#[inline(always)]
#[allow(clippy::too_many_arguments)]
unsafe fn panel<T: Number, const NR: usize>(
    w: *const T,
    steps: usize,
    (column, columns): (usize, usize),
    (x, stride): (*const T, usize),
    (n, readable): (usize, usize),
    addend: Addend<T>,
    function: Function,
    out: &mut Output<T>,
) {
    let mut own = MaybeUninit::<Sums>::uninit();
    let own = own.as_mut_ptr().cast::<f32>();
    let bytes = stride * size_of::<T>();
    for start in (0..n).step_by(ROWS) {
        // At the end rows of before, or rows that nobody asks for, are multiplied as well.
        let first = start.min(readable - ROWS);
        let rows = start..n.min(start + ROWS);
        let whole = first == start && rows.len() == ROWS;
        // The sums begin with what is added, where that stands in rows of fp32.
        let (begin, addend) = match addend {
            Addend::Bias(bias) => (Some((bias.as_ptr().add(column), 0)), Addend::Nothing),
            Addend::Rows(from) if whole => {
                let from = from.as_ptr().add(start * columns + column);
                (Some((from, 4 * columns)), Addend::Nothing)
            }
            other => (None, other),
        };
        let from = (x.add(first * stride).cast(), bytes);
        if let (true, Output::Wide(out), Addend::Nothing, Function::Identity) =
            (whole, &mut *out, addend, function)
        {
            let end = (out.as_mut_ptr().add(start * columns + column), 4 * columns);
            block::<NR>(from, (w.cast(), NR * 64, steps), begin, end);
            continue;
        }
        block::<NR>(from, (w.cast(), NR * 64, steps), begin, (own, NR * 64));
        let sums = own.wrapping_sub(first * NR * LANES);
        match (&mut *out, addend, function) {
            (Output::Narrow(out), Addend::Nothing, Function::Identity | Function::Relu)
                if NR.is_multiple_of(2) =>
            {
                let relu = function == Function::Relu;
                let to = out.as_mut_ptr().add(column).cast();
                narrow_rows::<NR>(sums, rows, (to, columns), relu);
            }
            _ => finish_rows::<T, NR>(sums, rows, (column, columns), addend, function, out),
        }
    }
}

/// Sums to bf16, or the larger of them and zero: two vectors at a time.
///
/// # Safety
/// `sums` points to NR vectors for each of the rows, `to` to rows of `columns`.
#[inline(always)]
unsafe fn narrow_rows<const NR: usize>(
    sums: *const f32,
    rows: Range<usize>,
    (to, columns): (*mut Bf16, usize),
    relu: bool,
) {
    for i in rows {
        for j in (0..NR).step_by(2) {
            let from = sums.wrapping_add((i * NR + j) * LANES);
            let (mut low, mut high) = (_mm512_loadu_ps(from), _mm512_loadu_ps(from.add(LANES)));
            if relu {
                // The second operand where either is NaN.
                low = _mm512_max_ps(_mm512_setzero_ps(), low);
                high = _mm512_max_ps(_mm512_setzero_ps(), high);
            }
            let both = _mm512_cvtne2ps_pbh(high, low);
            let to: *mut __m512bh = to.add(i * columns + j * LANES).cast();
            to.write_unaligned(both);
        }
    }
}

/// # Safety
/// As [`product`]; `sums` points to NR vectors for each of the rows.
#[inline(always)]
unsafe fn finish_rows<T: Number, const NR: usize>(
    sums: *const f32,
    rows: Range<usize>,
    place: (usize, usize),
    addend: Addend<T>,
    function: Function,
    out: &mut Output<T>,
) {
    for start in rows.clone().step_by(FINISHED) {
        let mut row = [start; FINISHED];
        let mut acc = [[Avx512::<true>::splat(0.0); NR]; FINISHED];
        for i in 0..FINISHED {
            row[i] = (start + i).min(rows.end - 1);
            let from = sums.wrapping_add(row[i] * NR * LANES);
            for j in 0..NR {
                acc[i][j] = Avx512::<true>::load(from.add(j * LANES));
            }
        }
        finish::<Avx512<true>, T, FINISHED, NR>(acc, &row, place, addend, function, out);
    }
}
