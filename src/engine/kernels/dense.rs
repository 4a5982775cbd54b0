//! Small products of attention's derivative, and Adam: loops that the compiler vectorises for each instruction set.

use super::simd::{Number, Simd};
use super::{Isa, compiled};

/// `c += factor a b` with a `[n x k]`, b `[k x m]`, c `[n x m]` of sizes n, k, m; each a slice and how far apart its rows stand.
pub fn multiply_add(
    isa: Isa,
    sizes: (usize, usize, usize),
    factor: f32,
    a: (&[f32], usize),
    b: (&[f32], usize),
    c: (&mut [f32], usize),
) {
    type T = f32;
    // SAFETY: safe code, compiled for an instruction set that the processor has.
    compiled!(isa, T, |sizes: (usize, usize, usize),
                       factor: f32,
                       a: (&[f32], usize),
                       b: (&[f32], usize),
                       c: (&mut [f32], usize)| {
        let ((n, k, m), (a, a_stride), (b, b_stride), (c, c_stride)) = (sizes, a, b, c);
        for i in 0..n {
            let row = &mut c[i * c_stride..i * c_stride + m];
            for (p, a) in a[i * a_stride..i * a_stride + k].iter().enumerate() {
                let a = factor * a;
                let b = &b[p * b_stride..p * b_stride + m];
                row.iter_mut().zip(b).for_each(|(c, b)| *c += a * b);
            }
        }
    })
}

/// From dL/dp of rows p of a softmax over n scores to dL/d score, in place: p (d - sum(d p)). Rows of `stride`.
pub fn softmax_backward(isa: Isa, p: &[f32], d: &mut [f32], (n, stride): (usize, usize)) {
    type T = f32;
    // SAFETY: safe code, compiled for an instruction set that the processor has.
    compiled!(isa, T, |p: &[f32], d: &mut [f32], n: usize, stride: usize| {
        for (p, d) in p.chunks_exact(stride).zip(d.chunks_exact_mut(stride)) {
            let (p, d) = (&p[..n], &mut d[..n]);
            let along: f32 = p.iter().zip(&*d).map(|(p, d)| p * d).sum();
            d.iter_mut().zip(p).for_each(|(d, p)| *d = p * (*d - along));
        }
    })
}

/// Adam's numbers for one update.
#[derive(Clone, Copy, Debug)]
pub struct Adam {
    /// The gradient is multiplied by this first.
    pub clip: f32,
    /// Decay of the two moments.
    pub betas: [f32; 2],
    /// One minus these.
    pub rest: [f32; 2],
    /// Learning rate over the first moment's correction.
    pub rate: f32,
    /// 1 / root of the second moment's correction.
    pub correction: f32,
}

/// One update of Adam (Kingma and Ba 2015, algorithm 1) in one pass over memory.
pub fn adam(
    isa: Isa,
    numbers: Adam,
    gradient: &[f32],
    weights: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
) {
    type T = f32;
    // SAFETY: safe code, compiled for an instruction set that the processor has.
    compiled!(isa, T, |numbers: Adam,
                       gradient: &[f32],
                       weights: &mut [f32],
                       first: &mut [f32],
                       second: &mut [f32]| {
        let Adam { clip, betas: [b1, b2], rest: [c1, c2], rate, correction } = numbers;
        let moments = first.iter_mut().zip(second);
        for ((g, w), (m, v)) in gradient.iter().zip(weights).zip(moments) {
            let g = g * clip;
            *m = *m * b1 + g * c1;
            *v = *v * b2 + g * g * c2;
            *w -= *m / (v.sqrt() * correction + 1e-8) * rate;
        }
    })
}
