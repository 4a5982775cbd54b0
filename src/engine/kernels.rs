//! Loops over latent rows `[n x d]`, compiled for the instruction sets that matter and chosen when the engine is made.

use super::options::{Isa, Level};

/// Rows of 16 floats: one AVX-512 register, two of AVX2, four of the baseline.
const LANES: usize = 16;

/// Stabilises the division of a layer norm, as in PyTorch.
const NORM_EPSILON: f32 = 1e-5;

/// Compiles a function for each instruction set; the first argument of what it makes is the [`Isa`].
macro_rules! simd {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $kind:ty),* $(,)?) $body:block)*) => {$(
        $(#[$doc])*
        #[allow(clippy::too_many_arguments)]
        pub fn $name(isa: Isa, $($arg: $kind),*) {
            #[inline(always)]
            fn plain($($arg: $kind),*) $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
            fn avx512($($arg: $kind),*) { plain($($arg),*) }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $kind),*) { plain($($arg),*) }

            match isa.0 {
                // SAFETY: an Isa of this level exists only where the processor has these features.
                #[cfg(target_arch = "x86_64")]
                Level::Avx512 | Level::Avx512Bf16 => unsafe { avx512($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Level::Avx2 => unsafe { avx2($($arg),*) },
                Level::Portable => plain($($arg),*),
            }
        }
    )*};
}

/// What stands between two linear layers, or after the first one when there is only one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// x
    Identity,
    /// max(0, x)
    Relu,
    /// x / (1 + exp(-x))
    Silu,
}

simd! {
    /// `x[i] = f(x[i] + bias)` for each row.
    fn bias_activate(x: &mut [f32], bias: &[f32], f: Function) {
        match f {
            Function::Identity => x.chunks_exact_mut(bias.len()).for_each(|row| add(row, bias)),
            Function::Relu => x.chunks_exact_mut(bias.len()).for_each(|row| add_then(row, bias, relu)),
            Function::Silu => x.chunks_exact_mut(bias.len()).for_each(|row| add_then(row, bias, silu)),
        }
    }

    /// `x[i] = f(x[i] + senders[index[i]] + receivers[owner[i] - first])`: the first layer of an edge network, its
    /// three parts put together. Rows of `d`.
    fn gather_activate(x: &mut [f32], d: usize, senders: &[f32], index: &[i32], receivers: &[f32], owner: &[i32],
                       first: usize, f: Function) {
        for ((row, &s), &r) in x.chunks_exact_mut(d).zip(index).zip(owner) {
            let (s, r) = (s as usize * d, (r as usize - first) * d);
            let (s, r) = (&senders[s..s + d], &receivers[r..r + d]);
            match f {
                Function::Identity => add_two(row, s, r, |v| v),
                Function::Relu => add_two(row, s, r, relu),
                Function::Silu => add_two(row, s, r, silu),
            }
        }
    }

    /// `x[i] = f(x[i] + table[index[i]])`. Rows of `d`.
    fn table_activate(x: &mut [f32], d: usize, table: &[f32], index: &[i32], f: Function) {
        for (row, &i) in x.chunks_exact_mut(d).zip(index) {
            let entry = &table[i as usize * d..(i as usize + 1) * d];
            match f {
                Function::Identity => add(row, entry),
                Function::Relu => add_then(row, entry, relu),
                Function::Silu => add_then(row, entry, silu),
            }
        }
    }

    /// `x[i] += mean of table[k] over k in member[row[i]..row[i + 1]]`. Rows of `d`.
    fn add_means(x: &mut [f32], d: usize, table: &[f32], row: &[u32], member: &[i32]) {
        for (x, bounds) in x.chunks_exact_mut(d).zip(row.windows(2)) {
            let list = &member[bounds[0] as usize..bounds[1] as usize];
            let weight = 1.0 / list.len() as f32;
            for &k in list {
                let entry = &table[k as usize * d..(k as usize + 1) * d];
                for (x, t) in x.iter_mut().zip(entry) {
                    *x += weight * t;
                }
            }
        }
    }

    /// `out[i] = LN(x[i] + bias) * gain + shift` (Ba et al. 2016, variance without Bessel's correction).
    fn layer_norm(x: &[f32], bias: &[f32], gain: &[f32], shift: &[f32], out: &mut [f32]) {
        let d = bias.len();
        for (x, out) in x.chunks_exact(d).zip(out.chunks_exact_mut(d)) {
            let (mean, scale) = moments(x, bias);
            for (o, (((x, b), g), s)) in out.iter_mut().zip(x.iter().zip(bias).zip(gain).zip(shift)) {
                *o = (x + b - mean) * scale * g + s;
            }
        }
    }

    /// `out[i] += LN(x[i] + bias) * gain + shift`: a residual layer's end.
    fn layer_norm_residual(x: &[f32], bias: &[f32], gain: &[f32], shift: &[f32], out: &mut [f32]) {
        let d = bias.len();
        for (x, out) in x.chunks_exact(d).zip(out.chunks_exact_mut(d)) {
            let (mean, scale) = moments(x, bias);
            for (o, (((x, b), g), s)) in out.iter_mut().zip(x.iter().zip(bias).zip(gain).zip(shift)) {
                *o += (x + b - mean) * scale * g + s;
            }
        }
    }

    /// `sums[i] = sum of edges[e] over row[i] <= e < row[i + 1]`, edges counted from `row[0]`. Rows of `d`.
    fn sum_edges(edges: &[f32], d: usize, row: &[u32], sums: &mut [f32]) {
        let first = row[0] as usize;
        for (sum, bounds) in sums.chunks_exact_mut(d).zip(row.windows(2)) {
            sum.fill(0.0);
            let (a, b) = (bounds[0] as usize - first, bounds[1] as usize - first);
            for e in edges[a * d..b * d].chunks_exact(d) {
                add(sum, e);
            }
        }
    }

    /// Row-wise softmax of `scale * x`, in place (eq. 11). Rows of `n`.
    fn softmax(x: &mut [f32], n: usize, scale: f32) {
        for row in x.chunks_exact_mut(n) {
            let largest = row.iter().fold(f32::NEG_INFINITY, |m, &v| m.max(v));
            for v in row.iter_mut() {
                *v = exp(scale * (*v - largest));
            }
            let mut lanes = [0f32; LANES];
            let (whole, rest) = row.as_chunks::<LANES>();
            for chunk in whole {
                add(&mut lanes, chunk);
            }
            let inverse = 1.0 / (lanes.iter().sum::<f32>() + rest.iter().sum::<f32>());
            for v in row.iter_mut() {
                *v *= inverse;
            }
        }
    }
}

#[inline(always)]
fn add(x: &mut [f32], y: &[f32]) {
    for (x, y) in x.iter_mut().zip(y) {
        *x += y;
    }
}

#[inline(always)]
fn add_then(x: &mut [f32], y: &[f32], f: impl Fn(f32) -> f32) {
    for (x, y) in x.iter_mut().zip(y) {
        *x = f(*x + y);
    }
}

#[inline(always)]
fn add_two(x: &mut [f32], y: &[f32], z: &[f32], f: impl Fn(f32) -> f32) {
    for (x, (y, z)) in x.iter_mut().zip(y.iter().zip(z)) {
        *x = f(*x + y + z);
    }
}

#[inline(always)]
fn relu(x: f32) -> f32 {
    // Not f32::max, which would turn NaN into 0 and hide it from the check of the result.
    if x < 0.0 { 0.0 } else { x }
}

#[inline(always)]
fn silu(x: f32) -> f32 {
    x / (1.0 + exp(-x))
}

/// exp(x) to about 2e-7 relative for -87 < x < 88, clamped outside; NaN stays NaN. Without a branch or a call, so
/// that it can be vectorised.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, so that r below is exact enough.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = if x > 88.0 { 88.0 } else { x };
    let x = if x < -87.0 { -87.0 } else { x };
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let n = rounded - ROUND;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    let series = 1.0
        + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    let power = f32::from_bits((rounded.to_bits() << 23).wrapping_add(0x3f80_0000));
    series * power
}

/// Mean and 1/sqrt(variance + epsilon) of a row x + bias.
#[inline(always)]
fn moments(x: &[f32], bias: &[f32]) -> (f32, f32) {
    let n = x.len() as f32;
    let mean = lanes_sum(x, bias, |v| v) / n;
    let variance = lanes_sum(x, bias, |v| (v - mean) * (v - mean)) / n;
    (mean, 1.0 / (variance + NORM_EPSILON).sqrt())
}

/// Sum of f(x + bias) in independent lanes, which vectorises without reordering flags.
#[inline(always)]
fn lanes_sum(x: &[f32], bias: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let (x, x_rest) = x.as_chunks::<LANES>();
    let (b, b_rest) = bias.as_chunks::<LANES>();
    let mut lanes = [0f32; LANES];
    for (x, b) in x.iter().zip(b) {
        for i in 0..LANES {
            lanes[i] += f(x[i] + b[i]);
        }
    }
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            lanes[i] += lanes[i + width];
        }
        width /= 2;
    }
    x_rest
        .iter()
        .zip(b_rest)
        .fold(lanes[0], |sum, (x, b)| sum + f(x + b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn isas() -> Vec<Isa> {
        Isa::available()
    }

    #[test]
    fn exp_is_accurate_and_keeps_nan() {
        let mut worst = 0f64;
        for i in -86_000..88_000 {
            let x = i as f32 * 1e-3;
            worst = worst.max((exp(x) as f64 / (x as f64).exp() - 1.0).abs());
        }
        assert!(worst < 3e-7, "{worst:e}");
        assert!(exp(f32::NAN).is_nan());
        assert!(exp(-1e30) < 2e-38 && exp(1e30).is_finite());
        assert!(relu(f32::NAN).is_nan() && silu(f32::NAN).is_nan());
    }

    #[test]
    fn layer_norm_of_known_rows() {
        for isa in isas() {
            // 1..=18 + bias has mean 9.5 and variance (18^2 - 1) / 12; the row length leaves a rest of 2.
            let x: Vec<f32> = (0..18).map(|i| i as f32).collect();
            let mut out = vec![0.0; 18];
            layer_norm(isa, &x, &[1.0; 18], &[2.0; 18], &[0.5; 18], &mut out);
            let scale = 1.0 / (323.0f64 / 12.0 + 1e-5).sqrt();
            for (i, o) in out.iter().enumerate() {
                let expected = (i as f64 - 8.5) * scale * 2.0 + 0.5;
                assert!((*o as f64 - expected).abs() < 1e-6);
            }
            let before = out.clone();
            layer_norm_residual(isa, &x, &[1.0; 18], &[2.0; 18], &[0.5; 18], &mut out);
            assert!(out.iter().zip(&before).all(|(a, b)| (a - 2.0 * b).abs() < 1e-6));
        }
    }

    #[test]
    fn sums_means_and_softmax() {
        for isa in isas() {
            let mut sums = [9.0; 3];
            sum_edges(isa, &[1.0, 2.0, 4.0], 1, &[5, 7, 7, 8], &mut sums);
            assert_eq!(sums, [3.0, 0.0, 4.0]);
            let mut x = [1.0, 1.0];
            add_means(isa, &mut x, 1, &[10.0, 20.0, 60.0], &[0, 1, 3], &[2, 0, 1]);
            assert_eq!(x, [61.0, 16.0]);
            let mut p = [0.0, 2f32.ln(), 1e4, 1e4];
            softmax(isa, &mut p, 2, 1.0);
            for (a, b) in p.iter().zip([1.0 / 3.0, 2.0 / 3.0, 0.5, 0.5]) {
                assert!((a - b).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn gathers_add_the_right_rows() {
        for isa in isas() {
            let mut x = [0.0, 0.0, 0.0];
            gather_activate(
                isa,
                &mut x,
                1,
                &[1.0, -5.0],
                &[0, 1, 0],
                &[10.0, 2.0],
                &[7, 8, 8],
                7,
                Function::Relu,
            );
            assert_eq!(x, [11.0, 0.0, 3.0]);
            table_activate(isa, &mut x, 1, &[-12.0, 1.0], &[0, 1, 1], Function::Identity);
            assert_eq!(x, [-1.0, 1.0, 4.0]);
        }
    }
}
