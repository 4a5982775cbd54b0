//! Rows times packed weights, with what follows a linear layer done while the result is in registers.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

#[cfg(target_arch = "x86_64")]
use super::amx;
use super::buffer::Buffer;
use super::packed::{PANEL, Packed};
use super::simd::{LANES, Number, Simd, silu};
use super::{Function, Isa, compiled, dispatch};

/// Most rows of a tile in registers.
const ROWS: usize = 6;

/// What is added to a product, in rows of the padded number of outputs.
#[derive(Clone, Copy, Debug)]
pub enum Addend<'a, T> {
    /// Nothing.
    Nothing,
    /// One row.
    Bias(&'a [f32]),
    /// Row i to row i.
    Rows(&'a [f32]),
    /// Row i gets `senders[index[i]] + receivers[owner[i] - first]`: the parts of an edge's first layer that are
    /// computed once a node.
    Ends { senders: &'a [T], index: &'a [i32], receivers: &'a [f32], owner: &'a [i32], first: usize },
    /// What stands in the output, and one row.
    Output(&'a [f32]),
}

/// Where a product goes: rows of the padded number of outputs.
pub enum Output<'a, T> {
    /// As it is.
    Wide(&'a mut [f32]),
    /// Rounded to what activations are made of.
    Narrow(&'a mut [T]),
}

/// `out[i] = f(x[i] W + addend[i])` for n rows of x, which stand `stride` numbers apart.
pub fn product<T: Number>(
    isa: Isa,
    weight: &Packed<T>,
    (x, stride): (&[T], usize),
    n: usize,
    addend: Addend<T>,
    function: Function,
    mut out: Output<T>,
) {
    if n == 0 {
        return;
    }
    let columns = weight.columns();
    let read = weight.inputs().next_multiple_of(T::STEP);
    assert!(x.len() >= (n - 1) * stride + read, "rows of a product");
    let space = match &out {
        Output::Wide(out) => out.len(),
        Output::Narrow(out) => out.len(),
    };
    assert!(space >= n * columns, "output of a product");
    let fits = match addend {
        Addend::Nothing => true,
        Addend::Bias(row) | Addend::Output(row) => row.len() >= columns,
        Addend::Rows(rows) => rows.len() >= n * columns,
        Addend::Ends { senders, index, receivers, owner, first } => {
            rows_within(index, n, 0..senders.len() / columns)
                && rows_within(owner, n, first..first + receivers.len() / columns)
        }
    };
    assert!(fits, "addend of a product");
    #[cfg(target_arch = "x86_64")]
    {
        let readable = (x.len() - read) / stride.max(1) + 1;
        if amx::takes::<T>(isa, read, readable) {
            // SAFETY: takes() says so; lengths and indices were checked above.
            return unsafe {
                amx::product(weight, (x.as_ptr(), stride), (n, readable), addend, function, &mut out)
            };
        }
    }
    let (x, out) = (x.as_ptr(), &mut out);
    // SAFETY: lengths and indices were checked above.
    compiled!(isa, T, |weight: &Packed<T>,
                       x: *const T,
                       stride: usize,
                       n: usize,
                       addend: Addend<T>,
                       function: Function,
                       out: &mut Output<T>| {
        // All panels of columns.
        let mut w = weight.start();
        let mut column = 0;
        let steps = weight.inputs().div_ceil(T::STEP);
        for &vectors in weight.panels() {
            let place = (column, weight.columns());
            match vectors {
                1 => panel::<S, T, MR, 1>(w, steps, place, x, stride, n, addend, function, out),
                2 if WIDE => panel::<S, T, MR, 2>(w, steps, place, x, stride, n, addend, function, out),
                3 if WIDE => panel::<S, T, MR, 3>(w, steps, place, x, stride, n, addend, function, out),
                4 if WIDE => panel::<S, T, MR, 4>(w, steps, place, x, stride, n, addend, function, out),
                _ => unreachable!("panels were packed for another instruction set"),
            }
            w = w.add(steps * vectors * LANES * T::STEP);
            column += vectors * LANES;
        }
    })
}

/// Whether the first n of a list are all in a range.
pub(super) fn rows_within(list: &[i32], n: usize, rows: std::ops::Range<usize>) -> bool {
    let Some(list) = list.get(..n) else { return false };
    if list.is_empty() {
        return true;
    }
    // Least and largest, not cut short: this way it is a few vector instructions.
    let least = list.iter().fold(i32::MAX, |m, &i| m.min(i));
    let largest = list.iter().fold(i32::MIN, |m, &i| m.max(i));
    least >= 0 && least as usize >= rows.start && (largest as usize) < rows.end
}

/// One panel of columns, MR rows at a time.
///
/// # Safety
/// As [`product`] checks.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
unsafe fn panel<S: Simd, T: Number, const MR: usize, const NR: usize>(
    w: *const T,
    steps: usize,
    (column, columns): (usize, usize),
    x: *const T,
    stride: usize,
    n: usize,
    addend: Addend<T>,
    function: Function,
    out: &mut Output<T>,
) {
    let mut start = 0;
    while start < n {
        // Past the end the last row is done again, to the same effect.
        let row: [usize; MR] = std::array::from_fn(|i| (start + i).min(n - 1));
        let x: [*const T; MR] = std::array::from_fn(|i| x.add(row[i] * stride));
        let mut acc = [[S::splat(0.0); NR]; MR];
        let mut w = w;
        for step in 0..steps {
            T::step::<S, MR, NR>(&mut acc, &x, step * T::STEP, w);
            w = w.add(NR * LANES * T::STEP);
        }
        finish::<S, T, MR, NR>(acc, &row, (column, columns), addend, function, out);
        start += MR;
    }
}

/// Sums of MR rows of a panel to what stands in the output: addend, function, rounding.
///
/// # Safety
/// As [`product`] checks, of the rows `row` and the panel that begins at `column`.
#[inline(always)]
pub(super) unsafe fn finish<S: Simd, T: Number, const MR: usize, const NR: usize>(
    mut acc: [[S::V; NR]; MR],
    row: &[usize; MR],
    (column, columns): (usize, usize),
    addend: Addend<T>,
    function: Function,
    out: &mut Output<T>,
) {
    match addend {
        Addend::Nothing => {}
        Addend::Bias(bias) => {
            for j in 0..NR {
                let b = S::load(bias.as_ptr().add(column + j * LANES));
                (0..MR).for_each(|i| acc[i][j] = S::add(acc[i][j], b));
            }
        }
        Addend::Rows(rows) => {
            for i in 0..MR {
                let from = rows.as_ptr().add(row[i] * columns + column);
                for j in 0..NR {
                    acc[i][j] = S::add(acc[i][j], S::load(from.add(j * LANES)));
                }
            }
        }
        Addend::Ends { senders, index, receivers, owner, first } => {
            for i in 0..MR {
                let s = *index.get_unchecked(row[i]) as usize;
                let r = *owner.get_unchecked(row[i]) as usize - first;
                let s = senders.as_ptr().add(s * columns + column);
                let r = receivers.as_ptr().add(r * columns + column);
                for j in 0..NR {
                    let ends = S::add(T::load::<S>(s.add(j * LANES)), S::load(r.add(j * LANES)));
                    acc[i][j] = S::add(acc[i][j], ends);
                }
            }
        }
        Addend::Output(bias) => {
            let Output::Wide(out) = out else { unreachable!("only wide outputs are added to") };
            for i in 0..MR {
                let from = out.as_ptr().add(row[i] * columns + column);
                for j in 0..NR {
                    let b = S::load(bias.as_ptr().add(column + j * LANES));
                    acc[i][j] = S::add(acc[i][j], S::add(b, S::load(from.add(j * LANES))));
                }
            }
        }
    }
    match function {
        Function::Identity => {}
        Function::Relu => {
            let zero = S::splat(0.0);
            for i in 0..MR {
                for j in 0..NR {
                    acc[i][j] = S::at_least(acc[i][j], zero);
                }
            }
        }
        // Through memory: unrolled it would be too long, and as a loop over registers there is none.
        Function::Silu => {
            let mut tile = acc;
            silu_each::<S>(tile.as_mut_ptr().cast(), MR * NR);
            acc = tile;
        }
    }
    match out {
        Output::Wide(out) => {
            for i in 0..MR {
                let to = out.as_mut_ptr().add(row[i] * columns + column);
                (0..NR).for_each(|j| S::store(to.add(j * LANES), acc[i][j]));
            }
        }
        Output::Narrow(out) => {
            for i in 0..MR {
                let to = out.as_mut_ptr().add(row[i] * columns + column);
                (0..NR).for_each(|j| T::store::<S>(to.add(j * LANES), acc[i][j]));
            }
        }
    }
}

/// # Safety
/// `v` points to n vectors.
#[inline(always)]
unsafe fn silu_each<S: Simd>(v: *mut S::V, n: usize) {
    let mut i = 0;
    while i < n {
        *v.add(i) = silu::<S>(*v.add(i));
        i += 1;
    }
}

/// Steps of a product on a tile in registers with operands in the first-level cache; returns the operations.
pub fn registers<T: Number>(isa: Isa, rounds: usize) -> f64 {
    #[cfg(target_arch = "x86_64")]
    if amx::takes::<T>(isa, amx::INPUTS, amx::ROWS) {
        return amx::registers(isa, rounds);
    }
    let x: Buffer<T> = Buffer::new(ROWS * T::STEP * 8);
    let w: Buffer<T> = Buffer::new(PANEL * LANES * T::STEP * 8);
    let mut out: Buffer<f32> = Buffer::new(ROWS * PANEL * LANES);
    let (x, w, out) = (x.as_ptr(), w.as_ptr(), out.as_mut_ptr());
    // SAFETY: the buffers hold eight steps of the largest tile.
    let steps = dispatch!(isa, T, steps(x: *const T, w: *const T, out: *mut f32, rounds: usize) -> f64);
    steps * 2.0 * (LANES * T::STEP) as f64
}

/// # Safety
/// As [`registers`] says. Returns products of vectors.
#[inline(always)]
unsafe fn steps<S: Simd, T: Number, const MR: usize, const WIDE: bool>(
    x: *const T,
    w: *const T,
    out: *mut f32,
    rounds: usize,
) -> f64 {
    if WIDE {
        steps_of::<S, T, MR, PANEL>(x, w, out, rounds)
    } else {
        steps_of::<S, T, MR, 1>(x, w, out, rounds)
    }
}

/// # Safety
/// As [`registers`] says.
#[inline(always)]
unsafe fn steps_of<S: Simd, T: Number, const MR: usize, const NR: usize>(
    x: *const T,
    w: *const T,
    out: *mut f32,
    rounds: usize,
) -> f64 {
    let x: [*const T; MR] = std::array::from_fn(|i| x.add(i * 8 * T::STEP));
    let mut acc = [[S::splat(0.0); NR]; MR];
    for _ in 0..rounds {
        for step in 0..8 {
            let w = w.add(step * NR * LANES * T::STEP);
            T::step::<S, MR, NR>(&mut acc, &x, step * T::STEP, w);
        }
    }
    for i in 0..MR {
        for j in 0..NR {
            S::store(out.add((i * NR + j) * LANES), acc[i][j]);
        }
    }
    (rounds * 8 * MR * NR) as f64
}
