//! Derivatives of norms and activations, with the sums for biases, gains and shifts that fall off on the way.
// Loops over constant ranges are unrolled, which keeps what they index in registers.
#![allow(clippy::needless_range_loop)]

use super::rows::Norm;
use super::simd::{LANES, Number, Simd, exp};
use super::{Isa, compiled};

/// Through a layer norm: `d`, n rows of dL/dy, becomes dL/dx in place and, rounded, in `narrow`. `normed` and `scale`
/// are what [`super::layer_norm_keep`] kept; the sums for gain, shift, and the bias that was added to x are added to.
#[allow(clippy::too_many_arguments)]
pub fn norm_backward<T: Number>(
    isa: Isa,
    norm: &Norm,
    (normed, scale): (&[T], &[f32]),
    n: usize,
    d: &mut [f32],
    narrow: &mut [T],
    sums: [&mut [f32]; 3],
) {
    let columns = norm.columns();
    let size = n * columns;
    assert!(
        normed.len() >= size && scale.len() >= n && d.len() >= size && narrow.len() >= size,
        "rows of the derivative of a layer norm"
    );
    assert!(sums.iter().all(|s| s.len() >= columns), "sums of the derivative of a layer norm");
    let sums = sums.map(|s| s.as_mut_ptr());
    let (normed, scale, d, narrow) = (normed.as_ptr(), scale.as_ptr(), d.as_mut_ptr(), narrow.as_mut_ptr());
    // SAFETY: lengths were checked above.
    compiled!(isa, T, |norm: &Norm,
                       normed: *const T,
                       scale: *const f32,
                       n: usize,
                       d: *mut f32,
                       narrow: *mut T,
                       sums: [*mut f32; 3]| {
        let mut i = 0;
        while WIDE && i + 4 <= n {
            norm_some_backward::<S, T, 4>(norm, normed, scale, i, d, narrow, sums);
            i += 4;
        }
        while i < n {
            norm_some_backward::<S, T, 1>(norm, normed, scale, i, d, narrow, sums);
            i += 1;
        }
    })
}

/// Rows `at..at + R`: with g = dy * gain, dx = scale (g - mean(g) - normed mean(g normed)).
///
/// # Safety
/// As [`norm_backward`] checks.
#[inline(always)]
unsafe fn norm_some_backward<S: Simd, T: Number, const R: usize>(
    norm: &Norm,
    normed: *const T,
    scale: *const f32,
    at: usize,
    d: *mut f32,
    narrow: *mut T,
    [gain_sum, shift_sum, bias_sum]: [*mut f32; 3],
) {
    let columns = norm.columns();
    let (gain, mask) = (norm.gain().as_ptr(), norm.mask().as_ptr());
    let inverse = 1.0 / norm.width() as f32;
    let normed: [*const T; R] = std::array::from_fn(|i| normed.add((at + i) * columns));
    let d: [*mut f32; R] = std::array::from_fn(|i| d.add((at + i) * columns));
    let narrow: [*mut T; R] = std::array::from_fn(|i| narrow.add((at + i) * columns));
    let mut mean = [S::splat(0.0); R];
    let mut along = [S::splat(0.0); R];
    for j in (0..columns).step_by(LANES) {
        let gain = S::load(gain.add(j));
        for i in 0..R {
            let g = S::mul(S::load(d[i].add(j)), gain);
            mean[i] = S::add(mean[i], g);
            along[i] = S::fma(g, T::load::<S>(normed[i].add(j)), along[i]);
        }
    }
    let mut factor = mean;
    for i in 0..R {
        mean[i] = S::splat(S::sum(mean[i]) * inverse);
        along[i] = S::splat(S::sum(along[i]) * inverse);
        factor[i] = S::splat(*scale.add(at + i));
    }
    for j in (0..columns).step_by(LANES) {
        let (gain, mask) = (S::load(gain.add(j)), S::load(mask.add(j)));
        let (mut of_gain, mut of_shift) = (S::load(gain_sum.add(j)), S::load(shift_sum.add(j)));
        let mut of_bias = S::load(bias_sum.add(j));
        for i in 0..R {
            let (y, x) = (S::load(d[i].add(j)), T::load::<S>(normed[i].add(j)));
            of_gain = S::fma(y, x, of_gain);
            of_shift = S::add(of_shift, y);
            let v = S::sub(S::mul(y, gain), S::fma(x, along[i], mean[i]));
            // What stands in the padding is none of the loss's business.
            let v = S::mul(S::mul(v, factor[i]), mask);
            of_bias = S::add(of_bias, v);
            S::store(d[i].add(j), v);
            T::store::<S>(narrow[i].add(j), v);
        }
        S::store(gain_sum.add(j), of_gain);
        S::store(shift_sum.add(j), of_shift);
        S::store(bias_sum.add(j), of_bias);
    }
}

/// What is kept of an activation for its derivative.
#[derive(Clone, Copy, Debug)]
pub enum Saved<'a, T> {
    /// Its value: the derivative of max(0, x) is 1 where it is positive.
    Value(&'a [T]),
    /// The derivative itself.
    Slope(&'a [T]),
}

/// Through an activation: `d`, n rows of its derivative, is multiplied by the activation's in place and, rounded, in
/// `narrow`; the sums over the rows are added to `bias`.
pub fn activation_backward<T: Number>(
    isa: Isa,
    kept: Saved<T>,
    (n, columns): (usize, usize),
    d: &mut [f32],
    narrow: &mut [T],
    bias: &mut [f32],
) {
    let (kept, slope) = match kept {
        Saved::Value(x) => (x, false),
        Saved::Slope(x) => (x, true),
    };
    let size = n * columns;
    assert!(
        columns.is_multiple_of(LANES)
            && kept.len() >= size
            && d.len() >= size
            && narrow.len() >= size
            && bias.len() >= columns,
        "rows of the derivative of an activation"
    );
    let (kept, d, narrow, bias) = (kept.as_ptr(), d.as_mut_ptr(), narrow.as_mut_ptr(), bias.as_mut_ptr());
    // SAFETY: lengths were checked above.
    compiled!(isa, T, |kept: *const T,
                       slope: bool,
                       n: usize,
                       columns: usize,
                       d: *mut f32,
                       narrow: *mut T,
                       bias: *mut f32| {
        let mut j = 0;
        while WIDE && j + 4 * LANES <= columns {
            activation_columns::<S, T, 4>(kept, slope, (n, columns), j, d, narrow, bias);
            j += 4 * LANES;
        }
        while j < columns {
            activation_columns::<S, T, 1>(kept, slope, (n, columns), j, d, narrow, bias);
            j += LANES;
        }
    })
}

/// C vectors of each row from column `at` on, whose chains of additions the processor then overlaps.
///
/// # Safety
/// As [`activation_backward`] checks.
#[inline(always)]
unsafe fn activation_columns<S: Simd, T: Number, const C: usize>(
    kept: *const T,
    slope: bool,
    (n, columns): (usize, usize),
    at: usize,
    d: *mut f32,
    narrow: *mut T,
    bias: *mut f32,
) {
    let mut sum = [S::splat(0.0); C];
    for c in 0..C {
        sum[c] = S::load(bias.add(at + c * LANES));
    }
    for i in 0..n {
        for c in 0..C {
            let at = i * columns + at + c * LANES;
            let (v, kept) = (S::load(d.add(at)), T::load::<S>(kept.add(at)));
            let v = match slope {
                true => S::mul(v, kept),
                false => S::where_positive(kept, v),
            };
            sum[c] = S::add(sum[c], v);
            S::store(d.add(at), v);
            T::store::<S>(narrow.add(at), v);
        }
    }
    for c in 0..C {
        S::store(bias.add(at + c * LANES), sum[c]);
    }
}

/// x / (1 + exp(-x)) and its derivative, both rounded; whole vectors.
pub fn silu_keep<T: Number>(isa: Isa, x: &[f32], value: &mut [T], slope: &mut [T]) {
    let n = x.len();
    assert!(n.is_multiple_of(LANES) && value.len() >= n && slope.len() >= n, "rows of an activation");
    let (x, value, slope) = (x.as_ptr(), value.as_mut_ptr(), slope.as_mut_ptr());
    // SAFETY: all have n numbers, whole vectors.
    compiled!(isa, T, |x: *const f32, value: *mut T, slope: *mut T, n: usize| {
        for i in (0..n).step_by(LANES) {
            let (x, one) = (S::load(x.add(i)), S::splat(1.0));
            let s = S::reciprocal(S::add(one, exp::<S>(S::sub(S::splat(0.0), x))));
            let y = S::mul(x, s);
            T::store::<S>(value.add(i), y);
            T::store::<S>(slope.add(i), S::fma(y, S::sub(one, s), s));
        }
    })
}
