//! Outer products, which are the gradients of weights, and rows gathered and scattered by index.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

#[cfg(target_arch = "x86_64")]
use super::amx;
use super::buffer::Buffer;
use super::packed::{PANEL, padded};
use super::product::rows_within;
use super::simd::{LANES, Number, Simd};
use super::{Isa, compiled};

/// Rows of both operands of an outer product in the order that its steps read them, where steps take several rows.
pub struct Pairs<T> {
    left: Buffer<T>,
    right: Buffer<T>,
}

impl<T: Number> Pairs<T> {
    /// For up to `rows` rows of up to `left` and `right` numbers.
    pub fn new(rows: usize, left: usize, right: usize) -> Self {
        let size = |width: usize| match T::STEP {
            1 => 0,
            // As many as a step of tiles takes.
            _ => rows.next_multiple_of(32) * padded(width),
        };
        Pairs { left: Buffer::new(size(left)), right: Buffer::new(size(right)) }
    }
}

/// `sums[o * columns + c] += sum over n rows i of y[i][o] * x[i][c]`, for `outputs` numbers of y and `columns`, whole
/// vectors, of x: dW = dY^T X. Rows stand a stride apart and are readable to whole vectors.
#[allow(clippy::too_many_arguments)]
pub fn outer<T: Number>(
    isa: Isa,
    (y, y_stride): (&[T], usize),
    (x, x_stride): (&[T], usize),
    n: usize,
    (outputs, columns): (usize, usize),
    sums: &mut [f32],
    pairs: &mut Pairs<T>,
) {
    if n == 0 || outputs == 0 {
        return;
    }
    let left = padded(outputs);
    assert!(columns.is_multiple_of(LANES) && sums.len() >= outputs * columns, "sums of an outer product");
    assert!(
        y.len() >= (n - 1) * y_stride + left && x.len() >= (n - 1) * x_stride + columns,
        "rows of an outer product"
    );
    #[cfg(target_arch = "x86_64")]
    if amx::takes::<T>(isa, amx::INPUTS, amx::ROWS) {
        let (y, x) = ((y.as_ptr(), y_stride), (x.as_ptr(), x_stride));
        let operands = (&mut pairs.left[..], &mut pairs.right[..]);
        // SAFETY: takes() says that there are tiles; lengths were checked above.
        return unsafe { amx::outer(y, x, n, (outputs, columns), sums.as_mut_ptr(), operands) };
    }
    let (y, y_step, x, x_step, steps) = match T::STEP {
        1 => (y.as_ptr(), y_stride, x.as_ptr(), x_stride, n),
        step => {
            interleave(isa, (y, y_stride), n, left, &mut pairs.left);
            interleave(isa, (x, x_stride), n, columns, &mut pairs.right);
            let (y, x) = (pairs.left.as_ptr(), pairs.right.as_ptr());
            (y, step * left, x, step * columns, n.div_ceil(step))
        }
    };
    let sums = sums.as_mut_ptr();
    // SAFETY: rows and sums are as long as checked above, or as interleave() made them.
    compiled!(isa, T, |y: *const T,
                       y_step: usize,
                       x: *const T,
                       x_step: usize,
                       steps: usize,
                       outputs: usize,
                       columns: usize,
                       sums: *mut f32| {
        let mut column = 0;
        while column < columns {
            let left = (columns - column) / LANES;
            let vectors = if WIDE { left.min(PANEL) } else { 1 };
            let x = x.add(column * T::STEP);
            let sums = sums.add(column);
            let sizes = (outputs, columns);
            match vectors {
                4 if WIDE => outer_panel::<S, T, MR, 4>(y, y_step, x, x_step, steps, sizes, sums),
                3 if WIDE => outer_panel::<S, T, MR, 3>(y, y_step, x, x_step, steps, sizes, sums),
                2 if WIDE => outer_panel::<S, T, MR, 2>(y, y_step, x, x_step, steps, sizes, sums),
                _ => outer_panel::<S, T, MR, 1>(y, y_step, x, x_step, steps, sizes, sums),
            }
            column += vectors * LANES;
        }
    })
}

/// Rows two by two, number by number; a missing last row is zero.
fn interleave<T: Number>(isa: Isa, (x, stride): (&[T], usize), n: usize, width: usize, out: &mut [T]) {
    assert!(
        T::STEP == 2 && out.len() >= n.next_multiple_of(2) * width && x.len() >= (n - 1) * stride + width,
        "rows to be interleaved"
    );
    let (x, out) = (x.as_ptr(), out.as_mut_ptr());
    // SAFETY: n rows of x, n rounded up to pairs of out.
    compiled!(isa, T, |x: *const T, stride: usize, n: usize, width: usize, out: *mut T| {
        for i in (0..n).step_by(2) {
            let out = std::slice::from_raw_parts_mut(out.add(i * width), 2 * width);
            let first = std::slice::from_raw_parts(x.add(i * stride), width);
            if i + 1 < n {
                let second = std::slice::from_raw_parts(x.add((i + 1) * stride), width);
                for ((out, a), b) in out.chunks_exact_mut(2).zip(first).zip(second) {
                    (out[0], out[1]) = (*a, *b);
                }
            } else {
                for (out, a) in out.chunks_exact_mut(2).zip(first) {
                    (out[0], out[1]) = (*a, T::default());
                }
            }
        }
    })
}

/// # Safety
/// As [`outer`] checks.
#[inline(always)]
unsafe fn outer_panel<S: Simd, T: Number, const MR: usize, const NR: usize>(
    y: *const T,
    y_step: usize,
    x: *const T,
    x_step: usize,
    steps: usize,
    (outputs, columns): (usize, usize),
    sums: *mut f32,
) {
    let mut start = 0;
    while start < outputs {
        // Past the end the last output is computed again, and not added.
        let y: [*const T; MR] = std::array::from_fn(|i| y.add((start + i).min(outputs - 1) * T::STEP));
        let mut acc = [[S::splat(0.0); NR]; MR];
        let mut x = x;
        let mut at = 0;
        for _ in 0..steps {
            T::step::<S, MR, NR>(&mut acc, &y, at, x);
            x = x.add(x_step);
            at += y_step;
        }
        for i in 0..MR {
            if start + i < outputs {
                let to = sums.add((start + i) * columns);
                for j in 0..NR {
                    let to = to.add(j * LANES);
                    S::store(to, S::add(S::load(to), acc[i][j]));
                }
            }
        }
        start += MR;
    }
}

/// `x[i] += table[index[i] - first]`, n rows.
pub fn gather_add(isa: Isa, x: &mut [f32], columns: usize, table: &[f32], index: &[i32], first: usize) {
    assert!(fit(x.len(), columns, table.len(), index, first), "rows to be gathered");
    let both = (x.as_mut_ptr(), table.as_ptr().cast_mut());
    // SAFETY: all rows are within; the table is only read.
    unsafe { move_rows(isa, both, columns, index, first, true) }
}

/// `table[index[i] - first] += x[i]`, n rows.
pub fn scatter_add<T: Number>(
    isa: Isa,
    x: &[T],
    columns: usize,
    table: &mut [f32],
    index: &[i32],
    first: usize,
) {
    assert!(fit(x.len(), columns, table.len(), index, first), "rows to be scattered");
    let both = (x.as_ptr().cast_mut(), table.as_mut_ptr());
    // SAFETY: all rows are within; x is only read.
    unsafe { move_rows(isa, both, columns, index, first, false) }
}

/// Whether x has a row for each of an index, and the table those that it names.
fn fit(x: usize, columns: usize, table: usize, index: &[i32], first: usize) -> bool {
    columns.is_multiple_of(LANES)
        && x >= index.len() * columns
        && rows_within(index, index.len(), first..first + table / columns)
}

/// Either way; only the side that is added to is written.
///
/// # Safety
/// All rows are within, whole vectors.
unsafe fn move_rows<T: Number>(
    isa: Isa,
    (x, table): (*mut T, *mut f32),
    columns: usize,
    index: &[i32],
    first: usize,
    gather: bool,
) {
    compiled!(isa, T, |x: *mut T,
                       table: *mut f32,
                       columns: usize,
                       index: &[i32],
                       first: usize,
                       gather: bool| {
        for (i, &row) in index.iter().enumerate() {
            let x = x.add(i * columns);
            let row = table.add((row as usize - first) * columns);
            for j in (0..columns).step_by(LANES) {
                let (x, row) = (x.add(j), row.add(j));
                let sum = S::add(T::load::<S>(x), S::load(row));
                if gather { T::store::<S>(x, sum) } else { S::store(row, sum) }
            }
        }
    })
}
