//! Numbers of snapshots, and sums of their products that do not depend on the order of the terms.

use m4gn_parallel::{Comm, everywhere};
use m4gn_state::Array;
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// Numbers that are worked on at a time, so that they stay in the first cache.
pub(crate) const BLOCK: usize = 2048;

/// How the numbers of snapshots are kept. Sums are in double precision with both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// 8 bytes a number.
    #[default]
    Double,
    /// 4 bytes a number.
    Single,
}

/// The differences of a field from its reference.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    Double(Vec<f64>),
    Single(Vec<f32>),
    /// There is no difference: what does not change takes no memory.
    Same,
}

impl Values {
    pub fn set(&mut self, storage: Storage, values: &[f64], reference: &[f64]) {
        if values == reference {
            *self = Values::Same;
            return;
        }
        if *self == Values::Same {
            *self = match storage {
                Storage::Double => Values::Double(vec![0.0; values.len()]),
                Storage::Single => Values::Single(vec![0.0; values.len()]),
            };
        }
        let pairs = values.iter().zip(reference);
        match self {
            Values::Double(to) => to.iter_mut().zip(pairs).for_each(|(d, (x, r))| *d = x - r),
            Values::Single(to) => to.iter_mut().zip(pairs).for_each(|(d, (x, r))| *d = (x - r) as f32),
            Values::Same => {}
        }
    }

    /// `out[i] += c * self[from + i]`.
    pub fn add(&self, c: f64, from: usize, out: &mut [f64]) {
        let to = from + out.len();
        match self {
            Values::Double(v) => out.iter_mut().zip(&v[from..to]).for_each(|(o, d)| *o += c * d),
            Values::Single(v) => out.iter_mut().zip(&v[from..to]).for_each(|(o, d)| *o += c * f64::from(*d)),
            Values::Same => {}
        }
    }

    /// Adds the products `other[i] * self[from + i]`.
    pub fn dot(&self, sum: &mut Sum, other: &[f64], from: usize) {
        let to = from + other.len();
        match self {
            Values::Double(v) => Arch::new().dispatch(Dot { sum, a: other, b: &v[from..to] }),
            Values::Single(v) => {
                let mut double = [0.0; BLOCK];
                double.iter_mut().zip(&v[from..to]).for_each(|(d, s)| *d = f64::from(*s));
                Arch::new().dispatch(Dot { sum, a: other, b: &double[..other.len()] });
            }
            Values::Same => {}
        }
    }
}

/// A sum and what its rounding has left out: twice the digits, so that the order of the terms, and with it the number of ranks, does not
/// show in the rounded sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sum(pub f64, pub f64);

impl Sum {
    fn add(&mut self, x: f64) {
        let sum = self.0 + x;
        let part = sum - self.0;
        self.1 += (self.0 - (sum - part)) + (x - part);
        self.0 = sum;
    }

    fn join(&mut self, other: Sum) {
        self.add(other.0);
        self.1 += other.1;
    }
}

/// Vectors of sums side by side: as many as hide the time of an addition.
const SUMS: usize = 4;

/// Adds the products of two arrays of the same length, in vectors as wide as the processor has them.
pub(crate) struct Dot<'a> {
    pub sum: &'a mut Sum,
    pub a: &'a [f64],
    pub b: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ((a, a_rest), (b, b_rest)) = (S::as_simd_f64s(self.a), S::as_simd_f64s(self.b));
        let ((a, a_few), (b, b_few)) = (a.as_chunks::<SUMS>(), b.as_chunks::<SUMS>());
        let (mut high, mut low) = ([simd.splat_f64s(0.0); SUMS], [simd.splat_f64s(0.0); SUMS]);
        for (x, y) in a.iter().zip(b) {
            for i in 0..SUMS {
                add_products(simd, &mut high[i], &mut low[i], x[i], y[i]);
            }
        }
        for (x, y) in a_few.iter().zip(b_few) {
            add_products(simd, &mut high[0], &mut low[0], *x, *y);
        }
        // Eight numbers in a vector at most
        let mut lanes = [[0.0; 8 * SUMS]; 2];
        for (i, (h, l)) in high.iter().zip(&low).enumerate() {
            S::as_mut_simd_f64s(&mut lanes[0]).0[i] = *h;
            S::as_mut_simd_f64s(&mut lanes[1]).0[i] = *l;
        }
        for (h, l) in lanes[0].iter().zip(&lanes[1]).take(SUMS * S::F64_LANES) {
            self.sum.join(Sum(*h, *l));
        }
        a_rest.iter().zip(b_rest).for_each(|(x, y)| self.sum.add(x * y));
    }
}

/// [`Sum::add`] of products, lane by lane.
#[inline(always)]
fn add_products<S: Simd>(simd: S, high: &mut S::f64s, low: &mut S::f64s, x: S::f64s, y: S::f64s) {
    let term = simd.mul_f64s(x, y);
    let sum = simd.add_f64s(*high, term);
    let part = simd.sub_f64s(sum, *high);
    let of_high = simd.sub_f64s(*high, simd.sub_f64s(sum, part));
    *low = simd.add_f64s(*low, simd.add_f64s(of_high, simd.sub_f64s(term, part)));
    *high = sum;
}

/// Sums of the parts of all ranks. Collective.
pub(crate) fn sum_all(comm: &Comm, parts: &[Sum]) -> Vec<f64> {
    let local: Vec<f64> = parts.iter().flat_map(|s| [s.0, s.1]).collect();
    let mut sums = vec![Sum::default(); parts.len()];
    for of_rank in everywhere(comm, &local).chunks_exact(local.len().max(1)) {
        for (sum, part) in sums.iter_mut().zip(of_rank.chunks_exact(2)) {
            sum.join(Sum(part[0], part[1]));
        }
    }
    sums.iter().map(|s| s.0 + s.1).collect()
}

/// Values of a field from number `from` on times their weights.
pub(crate) fn weigh(field: &Array, from: usize, values: &mut [f64]) {
    let w = &field.weights;
    match field.components {
        _ if w.is_empty() => {}
        1 => values.iter_mut().zip(&w[from..]).for_each(|(v, w)| *v *= w),
        n => values.iter_mut().enumerate().for_each(|(i, v)| *v *= w[(from + i) / n]),
    }
}
