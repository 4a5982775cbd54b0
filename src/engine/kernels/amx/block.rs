//! Sixteen rows of a product, and the instructions that make them.

use super::{INPUTS, ROWS, Tiles};
use crate::kernels::Isa;
use crate::kernels::simd::LANES;
use std::arch::asm;

/// Tile `$tile` from memory, rows `$step` bytes apart.
macro_rules! load {
    ($tile:literal, $from:expr, $step:expr) => {
        asm!(
            concat!("tileloadd tmm", $tile, ", [{from} + {step}*1]"),
            from = in(reg) $from,
            step = in(reg) $step,
            options(nostack, readonly, preserves_flags)
        )
    };
}

/// Tile `$tile` to memory, rows `$step` bytes apart.
macro_rules! store {
    ($tile:literal, $to:expr, $step:expr) => {
        asm!(
            concat!("tilestored [{to} + {step}*1], tmm", $tile),
            to = in(reg) $to,
            step = in(reg) $step,
            options(nostack, preserves_flags)
        )
    };
}

/// `sums += x w`, all tiles.
macro_rules! multiply {
    ($sums:literal, $x:literal, $w:literal) => {
        asm!(
            concat!("tdpbf16ps tmm", $sums, ", tmm", $x, ", tmm", $w),
            options(nomem, nostack, preserves_flags)
        )
    };
}

macro_rules! zero {
    ($($tile:literal)*) => {
        asm!($(concat!("tilezero tmm", $tile)),*, options(nomem, nostack, preserves_flags))
    };
}

/// Sums of 16 rows for up to four vectors of outputs.
#[repr(C, align(64))]
pub struct Sums([f32; SUMS]);

/// Numbers of [`Sums`].
const SUMS: usize = ROWS * 4 * LANES;

/// `sums += x W` for 16 rows of x, `stride` bytes apart, and NR vectors of outputs, whose pairs of inputs stand `row` bytes
/// apart: from the sums at `begin`, or from zero where that is none, to those at `end`, both with the bytes between rows.
///
/// # Safety
/// A [`Tiles`] of this thread lives; 16 rows of x have `steps` times 64 bytes, W `steps` times 16 pairs, and the sums 16
/// rows of NR vectors.
#[inline(always)]
pub unsafe fn block<const NR: usize>(
    (x, stride): (*const u8, usize),
    (w, row, steps): (*const u8, usize, usize),
    begin: Option<(*const f32, usize)>,
    (end, end_row): (*mut f32, usize),
) {
    match begin {
        None => zero!(0 1 2 3),
        Some((from, step)) => {
            load!(0, from, step);
            if NR > 1 {
                load!(1, from.add(LANES), step);
            }
            if NR > 2 {
                load!(2, from.add(2 * LANES), step);
            }
            if NR > 3 {
                load!(3, from.add(3 * LANES), step);
            }
        }
    }
    let (mut x, mut w) = (x, w);
    for _ in 0..steps {
        load!(4, x, stride);
        load!(5, w, row);
        multiply!(0, 4, 5);
        if NR > 1 {
            load!(6, w.add(64), row);
            multiply!(1, 4, 6);
        }
        if NR > 2 {
            load!(7, w.add(128), row);
            multiply!(2, 4, 7);
        }
        if NR > 3 {
            load!(5, w.add(192), row);
            multiply!(3, 4, 5);
        }
        x = x.add(64);
        w = w.add(16 * row);
    }
    store!(0, end, end_row);
    if NR > 1 {
        store!(1, end.add(LANES), end_row);
    }
    if NR > 2 {
        store!(2, end.add(2 * LANES), end_row);
    }
    if NR > 3 {
        store!(3, end.add(3 * LANES), end_row);
    }
}

/// Products of tiles without a load between them, `rounds` times four; returns the operations.
pub fn registers(isa: Isa, rounds: usize) -> f64 {
    let _tiles = Tiles::new(isa);
    // SAFETY: the tiles have their shapes; nothing is written to memory.
    unsafe {
        zero!(0 1 2 3 4 5 6 7);
        for _ in 0..rounds {
            multiply!(0, 4, 5);
            multiply!(1, 4, 6);
            multiply!(2, 4, 7);
            multiply!(3, 4, 5);
        }
    }
    (rounds * 4 * ROWS * LANES * INPUTS * 2) as f64
}
