//! AMX: tiles of 16 rows of 64 bytes, and products of bf16 between them.
//!
//! A tile of x holds 16 rows of 32 inputs; a tile of a packed weight 16 pairs of inputs for 16 outputs, which is how
//! [`Packed`] orders them; a tile of sums 16 rows of 16 outputs in fp32. The instructions stand in assembly because the
//! compiler's own functions for them are not stable yet.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::avx512::Avx512;
use super::packed::{Packed, padded};
use super::product::{Addend, Output, finish};
use super::simd::{Bf16, LANES, Number, Simd};
use super::{Function, Isa};
use crate::options::Level;
use std::arch::asm;
use std::arch::x86_64::*;
use std::cell::Cell;
use std::mem::MaybeUninit;
use std::ops::Range;
use std::sync::OnceLock;

/// Rows of a tile.
pub const ROWS: usize = 16;

/// Inputs that one step of tiles takes.
pub const INPUTS: usize = 32;

/// Rows of a tile that are finished at a time: with four vectors each they fill half of the registers.
const FINISHED: usize = 4;

/// Whether the processor has AMX with bf16 and the system lets this process use it, which is asked for once.
pub fn available() -> bool {
    static AVAILABLE: OnceLock<bool> = OnceLock::new();
    *AVAILABLE.get_or_init(|| !cfg!(miri) && processor_has_tiles() && system_grants_tiles())
}

fn processor_has_tiles() -> bool {
    let features = std::arch::x86_64::__cpuid(1).ecx;
    if features & (1 << 27) == 0 || std::arch::x86_64::__cpuid(0).eax < 7 {
        return false;
    }
    // AMX-BF16 and AMX-TILE.
    let edx = std::arch::x86_64::__cpuid_count(7, 0).edx;
    if edx & (1 << 22) == 0 || edx & (1 << 24) == 0 {
        return false;
    }
    let saved: u32;
    // SAFETY: bit 27 of the features above says that the instruction is there; it reads what the system saves.
    unsafe { asm!("xgetbv", in("ecx") 0, out("eax") saved, out("edx") _, options(nomem, nostack)) };
    const TILES: u32 = 0b11 << 17;
    saved & TILES == TILES
}

#[cfg(target_os = "linux")]
fn system_grants_tiles() -> bool {
    // Linux keeps room for a thread's tiles only where the process has asked for it (arch_prctl(2)).
    const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
    const TILE_DATA: libc::c_long = 18;
    // SAFETY: a system call with two numbers.
    unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, TILE_DATA) == 0 }
}

#[cfg(not(target_os = "linux"))]
fn system_grants_tiles() -> bool {
    false
}

/// What `ldtilecfg` reads: the shape of each of the eight tiles.
#[repr(C, align(64))]
struct Shapes {
    palette: u8,
    start: u8,
    reserved: [u8; 14],
    bytes: [u16; 16],
    rows: [u8; 16],
}

static SHAPES: Shapes = Shapes {
    palette: 1,
    start: 0,
    reserved: [0; 14],
    bytes: [64, 64, 64, 64, 64, 64, 64, 64, 0, 0, 0, 0, 0, 0, 0, 0],
    rows: [16, 16, 16, 16, 16, 16, 16, 16, 0, 0, 0, 0, 0, 0, 0, 0],
};

thread_local! {
    /// Whether a [`Tiles`] of this thread lives.
    static READY: Cell<bool> = const { Cell::new(false) };
}

/// While one lives, its thread's tiles have their shapes. Setting them takes as long as a small product, so that whoever
/// does many holds one around them; those within it cost nothing.
#[derive(Debug)]
pub struct Tiles {
    /// Whether this one set the shapes. A pointer, so that it stays with its thread.
    owner: bool,
    thread: std::marker::PhantomData<*const ()>,
}

impl Tiles {
    /// For products with this instruction set; nothing where it has no tiles.
    pub fn new(isa: Isa) -> Self {
        let owner = isa.0 == Level::Amx && !READY.replace(true);
        if owner {
            // SAFETY: an Isa of this level exists only where the processor has tiles and the system grants them.
            unsafe {
                asm!("ldtilecfg [{}]", in(reg) &raw const SHAPES, options(nostack, readonly, preserves_flags));
            }
        }
        Tiles {
            owner,
            thread: std::marker::PhantomData,
        }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        if self.owner {
            READY.set(false);
            // SAFETY: as above. Other code of this thread finds the tiles unset, as it would without us.
            unsafe { asm!("tilerelease", options(nomem, nostack, preserves_flags)) };
        }
    }
}

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
struct Sums([f32; SUMS]);

/// Numbers of [`Sums`].
const SUMS: usize = ROWS * 4 * LANES;

/// `sums += x W` for 16 rows of x, `stride` bytes apart, and NR vectors of outputs, whose pairs of inputs stand `row` bytes
/// apart: from the sums at `begin`, or from zero where that is none, to those at `end`, both with the bytes between rows.
///
/// # Safety
/// A [`Tiles`] of this thread lives; 16 rows of x have `steps` times 64 bytes, W `steps` times 16 pairs, and the sums 16
/// rows of NR vectors.
#[inline(always)]
unsafe fn block<const NR: usize>(
    (x, stride): (*const u8, usize),
    (w, row, steps): (*const u8, usize, usize),
    begin: Option<(*const f32, usize)>,
    (end, end_row): (*mut f32, usize),
) {
    // SAFETY: passed on.
    unsafe {
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
}

/// Whether a product has the shape of tiles; `rows` is how many rows of x can be read.
pub fn takes<T: Number>(isa: Isa, inputs: usize, rows: usize) -> bool {
    isa.0 == Level::Amx && T::STEP == 2 && inputs.is_multiple_of(INPUTS) && inputs > 0 && rows >= ROWS
}

/// As [`super::product()`], whose callers are [`takes`]' own.
///
/// # Safety
/// [`takes`] says so, and what product() checks holds.
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
        // SAFETY: the panel's weights are `steps * 32 * vectors` vectors from w; the rest is passed on.
        unsafe {
            match vectors {
                1 => panel::<T, 1>(w, steps, place, from, rows, addend, function, out),
                2 => panel::<T, 2>(w, steps, place, from, rows, addend, function, out),
                3 => panel::<T, 3>(w, steps, place, from, rows, addend, function, out),
                4 => panel::<T, 4>(w, steps, place, from, rows, addend, function, out),
                _ => unreachable!("panels were packed for another instruction set"),
            }
            w = w.add(steps * INPUTS * vectors * LANES);
        }
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
        // SAFETY: rows `first..first + 16` of x can be read; `rows` are within what product() checked.
        unsafe {
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
            // SAFETY: passed on.
            unsafe {
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
        // SAFETY: passed on.
        unsafe {
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
}

/// As [`super::outer()`], of `n` rows: `left` and `right` have room for the rows of both, a whole number of steps.
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
    // SAFETY: pairs of rows up to n, whole vectors; both buffers are as long as checked above.
    unsafe {
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
    // SAFETY: passed on.
    unsafe {
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
}

/// Sixteen numbers of row i, each with that of row i + 1 behind it; rows from n on are zero.
///
/// # Safety
/// Rows up to n have sixteen numbers at `column`.
#[inline(always)]
unsafe fn row_pair(x: *const Bf16, stride: usize, (i, n): (usize, usize), column: usize) -> __m512i {
    // SAFETY: passed on.
    unsafe {
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
}

/// Number i of vector j of what comes in is number j of vector i of what goes out.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn transposed(v: [__m512i; 16]) -> [__m512i; 16] {
    // SAFETY: passed on.
    unsafe {
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
