//! Layer norms and what goes with them, sums and softmax over rows.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::product::rows_within;
use super::simd::{LANES, Number, Simd, exp};
use super::{Isa, compiled, padded};

/// Stabilises the division of a layer norm, as in PyTorch.
const NORM_EPSILON: f32 = 1e-5;

/// Gain and shift of a layer norm over `width` numbers, padded with zeros.
pub struct Norm {
    width: usize,
    gain: Vec<f32>,
    shift: Vec<f32>,
    /// One for numbers, zero for the padding.
    mask: Vec<f32>,
}

impl Norm {
    /// Of a gain and a shift of one width.
    pub fn new(gain: &[f32], shift: &[f32]) -> Self {
        let pad = |x: &[f32]| {
            let mut x = x.to_vec();
            x.resize(padded(x.len()), 0.0);
            x
        };
        Norm { width: gain.len(), mask: pad(&vec![1.0; gain.len()]), gain: pad(gain), shift: pad(shift) }
    }

    /// Numbers that are normalised together.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// The same, padded.
    pub fn columns(&self) -> usize {
        self.gain.len()
    }

    /// Gain, padded with zeros.
    pub(super) fn gain(&self) -> &[f32] {
        &self.gain
    }

    /// One for numbers, zero for the padding.
    pub(super) fn mask(&self) -> &[f32] {
        &self.mask
    }
}

/// Where a layer norm goes, rows of the padded width.
pub enum Normed<'a, T> {
    /// `out[i] = y`
    Wide(&'a mut [f32]),
    /// `out[i] = y`, rounded.
    Narrow(&'a mut [T]),
    /// `out[i] += y`: a residual layer's end.
    Residual(&'a mut [f32]),
    /// `edges[i] = before[i] + y` (or `edges[i] + y` where before is none), rounded.
    Latents { before: Option<&'a [T]>, edges: &'a mut [T] },
    /// The end of an edge block (eq. 3): `e = before[i] + y` (or `edges[i] + y` where before is none) goes to
    /// `edges[i]` if `keep`, and is added to `sums[owner[i] - first]`.
    Edges {
        before: Option<&'a [T]>,
        edges: &'a mut [T],
        keep: bool,
        sums: &'a mut [f32],
        owner: &'a [i32],
        first: usize,
    },
}

/// y = LN(x[i]) * gain + shift (Ba et al. 2016, variance without Bessel's correction) for n rows of the padded width.
pub fn layer_norm<T: Number>(isa: Isa, norm: &Norm, x: &[f32], n: usize, out: Normed<T>) {
    norms_of(isa, norm, x, n, out, None);
}

/// As [`layer_norm`], keeping what its derivative needs: the rows before gain and shift, rounded, and each row's factor.
pub fn layer_norm_keep<T: Number>(
    isa: Isa,
    norm: &Norm,
    x: &[f32],
    n: usize,
    out: Normed<T>,
    (normed, scale): (&mut [T], &mut [f32]),
) {
    assert!(normed.len() >= n * norm.columns() && scale.len() >= n, "rows that a layer norm keeps");
    norms_of(isa, norm, x, n, out, Some((normed.as_mut_ptr(), scale.as_mut_ptr())));
}

/// Pointers to keep rows at are good for n of them.
fn norms_of<T: Number>(
    isa: Isa,
    norm: &Norm,
    x: &[f32],
    n: usize,
    mut out: Normed<T>,
    keep: Option<(*mut T, *mut f32)>,
) {
    let columns = norm.gain.len();
    assert!(x.len() >= n * columns, "rows of a layer norm");
    let fits = match &out {
        Normed::Wide(out) | Normed::Residual(out) => out.len() >= n * columns,
        Normed::Narrow(out) => out.len() >= n * columns,
        Normed::Latents { before, edges } => {
            before.is_none_or(|b| b.len() >= n * columns) && edges.len() >= n * columns
        }
        Normed::Edges { before, edges, sums, owner, first, .. } => {
            before.is_none_or(|b| b.len() >= n * columns)
                && edges.len() >= n * columns
                && rows_within(owner, n, *first..*first + sums.len() / columns)
        }
    };
    assert!(fits, "output of a layer norm");
    let (x, out) = (x.as_ptr(), &mut out);
    // SAFETY: lengths and indices were checked above.
    compiled!(isa, T, |norm: &Norm,
                       x: *const f32,
                       n: usize,
                       out: &mut Normed<T>,
                       keep: Option<(*mut T, *mut f32)>| {
        // Rows together, whose chains of additions the processor then overlaps.
        let mut i = 0;
        while WIDE && i + 8 <= n {
            norm_rows::<S, T, 8>(norm, x, i, out, keep);
            i += 8;
        }
        while i < n {
            norm_rows::<S, T, 1>(norm, x, i, out, keep);
            i += 1;
        }
    })
}

/// Rows `at..at + R`.
///
/// # Safety
/// As [`layer_norm`] checks.
#[inline(always)]
unsafe fn norm_rows<S: Simd, T: Number, const R: usize>(
    norm: &Norm,
    x: *const f32,
    at: usize,
    out: &mut Normed<T>,
    keep: Option<(*mut T, *mut f32)>,
) {
    let columns = norm.gain.len();
    let last = columns - LANES;
    let inverse = 1.0 / norm.width as f32;
    let (gain, shift) = (norm.gain.as_ptr(), norm.shift.as_ptr());
    let x: [*const f32; R] = std::array::from_fn(|i| x.add((at + i) * columns));
    let mut sum = [S::splat(0.0); R];
    for j in (0..columns).step_by(LANES) {
        for i in 0..R {
            sum[i] = S::add(sum[i], S::load(x[i].add(j)));
        }
    }
    let sums = S::sums(&sum);
    let mut mean = sum;
    for i in 0..R {
        mean[i] = S::splat(sums[i] * inverse);
    }
    // The padding is not part of the variance.
    let mask = S::load(norm.mask.as_ptr().add(last));
    let mut squares = [S::splat(0.0); R];
    for i in 0..R {
        let v = S::mul(S::sub(S::load(x[i].add(last)), mean[i]), mask);
        squares[i] = S::mul(v, v);
    }
    for j in (0..last).step_by(LANES) {
        for i in 0..R {
            let v = S::sub(S::load(x[i].add(j)), mean[i]);
            squares[i] = S::fma(v, v, squares[i]);
        }
    }
    let mut factor = S::sums(&squares);
    for factor in &mut factor {
        *factor = 1.0 / (*factor * inverse + NORM_EPSILON).sqrt();
    }
    // y = (x - mean) factor = x factor + offset
    let (mut scale, mut offset) = (squares, squares);
    for i in 0..R {
        scale[i] = S::splat(factor[i]);
        offset[i] = S::mul(S::sub(S::splat(0.0), mean[i]), scale[i]);
        if let Some((_, kept)) = keep {
            *kept.add(at + i) = factor[i];
        }
    }
    if let Some((kept, _)) = keep {
        let kept = kept.add(at * columns);
        for j in (0..columns).step_by(LANES) {
            for i in 0..R {
                let v = S::mul(S::sub(S::load(x[i].add(j)), mean[i]), scale[i]);
                T::store::<S>(kept.add(i * columns + j), v);
            }
        }
    }
    let y = |i: usize, j: usize, gain: S::V, shift: S::V| {
        S::fma(S::fma(S::load(x[i].add(j)), scale[i], offset[i]), gain, shift)
    };
    // Does this with each vector of y: `to` is its place in `rows`, `place` how far that is behind the first of these rows.
    macro_rules! each {
        ($rows:expr, |$to:ident, $place:pat, $y:ident| $done:expr) => {{
            let rows = $rows.add(at * columns);
            for j in (0..columns).step_by(LANES) {
                let (gain, shift) = (S::load(gain.add(j)), S::load(shift.add(j)));
                for i in 0..R {
                    let place = i * columns + j;
                    let ($to, $place, $y) = (rows.add(place), place, y(i, j, gain, shift));
                    $done;
                }
            }
        }};
    }
    match out {
        Normed::Wide(out) => each!(out.as_mut_ptr(), |to, _, y| S::store(to, y)),
        Normed::Narrow(out) => each!(out.as_mut_ptr(), |to, _, y| T::store::<S>(to, y)),
        Normed::Residual(out) => each!(out.as_mut_ptr(), |to, _, y| S::store(to, S::add(S::load(to), y))),
        Normed::Latents { before, edges } => {
            let edge = edges.as_mut_ptr();
            let before = before.map_or(edge.cast_const(), |b| b.as_ptr()).add(at * columns);
            each!(edge, |to, p, y| T::store::<S>(to, S::add(T::load::<S>(before.add(p)), y)))
        }
        Normed::Edges { before, edges, keep, sums, owner, first } => {
            let edge = edges.as_mut_ptr().add(at * columns);
            let before = before.map_or(edge.cast_const(), |b| b.as_ptr().add(at * columns));
            let sums = sums.as_mut_ptr();
            let mut sum = [sums; R];
            for (i, sum) in sum.iter_mut().enumerate() {
                *sum = sums.add((*owner.get_unchecked(at + i) as usize - *first) * columns);
            }
            // Edges of one node follow each other, so that its sum mostly stays in a register.
            let mut same = true;
            for i in 1..R {
                same &= sum[i] == sum[0];
            }
            for j in (0..columns).step_by(LANES) {
                let (gain, shift) = (S::load(gain.add(j)), S::load(shift.add(j)));
                let mut total = S::load(sum[0].add(j));
                for i in 0..R {
                    let e = S::add(T::load::<S>(before.add(i * columns + j)), y(i, j, gain, shift));
                    if *keep {
                        T::store::<S>(edge.add(i * columns + j), e);
                    }
                    if !same && i > 0 {
                        S::store(sum[i - 1].add(j), total);
                        total = S::load(sum[i].add(j));
                    }
                    total = S::add(total, e);
                }
                S::store(sum[R - 1].add(j), total);
            }
        }
    }
}

/// `out[i] = x[i]`, rounded to what activations are made of; a whole number of vectors.
pub fn narrow<T: Number>(isa: Isa, x: &[f32], out: &mut [T]) {
    assert!(out.len() == x.len() && x.len().is_multiple_of(LANES), "rows to be rounded");
    let (x, out, n) = (x.as_ptr(), out.as_mut_ptr(), x.len());
    // SAFETY: both have n numbers, whole vectors.
    compiled!(isa, T, |x: *const f32, out: *mut T, n: usize| {
        for i in (0..n).step_by(LANES) {
            T::store::<S>(out.add(i), S::load(x.add(i)));
        }
    })
}

/// `x[i] += mean of table[k] over k in member[row[i]..row[i + 1]]`, rows of `width` numbers, a whole number of
/// vectors.
pub fn add_means(isa: Isa, x: &mut [f32], width: usize, table: &[f32], row: &[u32], member: &[i32]) {
    type T = f32;
    let n = row.len() - 1;
    let members = &member[row[0] as usize..row[n] as usize];
    assert!(x.len() >= n * width && width.is_multiple_of(LANES), "rows of means");
    assert!(rows_within(members, members.len(), 0..table.len() / width), "members of means");
    let (x, table) = (x.as_mut_ptr(), table.as_ptr());
    // SAFETY: lengths and indices were checked above.
    compiled!(isa, T, |x: *mut f32, width: usize, table: *const f32, row: &[u32], member: &[i32]| {
        for (i, bounds) in row.windows(2).enumerate() {
            let list = &member[bounds[0] as usize..bounds[1] as usize];
            let weight = S::splat(1.0 / list.len() as f32);
            for j in (0..width).step_by(LANES) {
                let to = x.add(i * width + j);
                let mut sum = S::load(to);
                for &k in list {
                    sum = S::fma(weight, S::load(table.add(k as usize * width + j)), sum);
                }
                S::store(to, sum);
            }
        }
    })
}

/// Softmax of `scale * x[i]` over the first n numbers of each row of `width`, a whole number of vectors, in place
/// (eq. 11).
pub fn softmax(isa: Isa, x: &mut [f32], width: usize, n: usize, scale: f32) {
    type T = f32;
    assert!(
        width.is_multiple_of(LANES) && x.len().is_multiple_of(width) && 0 < n && n <= width,
        "rows of a softmax"
    );
    // SAFETY: whole rows of whole vectors.
    compiled!(isa, T, |x: &mut [f32], width: usize, n: usize, scale: f32| {
        for row in x.chunks_exact_mut(width) {
            // Whatever stands in the padding, it leaves as zero.
            row[n..].fill(f32::NEG_INFINITY);
            let largest = row.iter().fold(f32::NEG_INFINITY, |m, &v| m.max(v));
            let p = row.as_mut_ptr();
            for j in (0..width).step_by(LANES) {
                let v = S::sub(S::load(p.add(j)), S::splat(largest));
                S::store(p.add(j), exp::<S>(S::mul(S::splat(scale), v)));
            }
            std::slice::from_raw_parts_mut(p.add(n), width - n).fill(0.0);
            let mut sum = S::splat(0.0);
            for j in (0..width).step_by(LANES) {
                sum = S::add(sum, S::load(p.add(j)));
            }
            let inverse = S::splat(1.0 / S::sum(sum));
            for j in (0..width).step_by(LANES) {
                S::store(p.add(j), S::mul(S::load(p.add(j)), inverse));
            }
        }
    })
}
