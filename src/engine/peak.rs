//! What one core can do at most: what the engine's rates are measured against.

use super::kernels::{Addend, Bf16, Buffer, Function, Isa, Number, Output, Packed, product, registers};
use m4gn_model::Precision;
use std::time::{Duration, Instant};

/// Rows, inputs and outputs of the product that is measured.
const SHAPE: (usize, usize) = (8192, 128);

/// Highest rates of this thread, GFLOP/s (a multiplication and an addition are two operations).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Multiply-adds on registers alone: what the units give.
    pub units: f64,
    /// A product of `[8192 x 128]` with `[128 x 128]`.
    pub product: f64,
}

impl Peak {
    /// The higher of the two.
    pub fn gflops(&self) -> f64 {
        self.units.max(self.product)
    }
}

/// Measures for about half a second with the kernels of an instruction set.
pub fn peak(precision: Precision, isa: Isa) -> Peak {
    match precision {
        Precision::Fp32 => measure::<f32>(isa),
        Precision::Bf16 => measure::<Bf16>(isa),
    }
}

fn measure<T: Number>(isa: Isa) -> Peak {
    const ROUNDS: usize = 20_000;
    let (rows, d) = SHAPE;
    let weight: Packed<T> = Packed::new(isa, d, d, |i, o| ((i * 7 + o) % 13) as f32 * 0.01);
    let mut x: Buffer<T> = Buffer::new(rows * d);
    x.iter_mut().enumerate().for_each(|(i, x)| *x = T::from_f32((i % 17) as f32 * 0.1));
    let mut out: Buffer<T> = Buffer::new(rows * d);
    let units = best(|| registers::<T>(isa, ROUNDS));
    let product = best(|| {
        let out = Output::Narrow(&mut out[..]);
        product(isa, &weight, (&x, d), rows, Addend::Nothing, Function::Identity, out);
        2.0 * (rows * d * d) as f64
    });
    Peak { units, product }
}

/// Highest rate of several runs of `work`, which returns its operations.
fn best(mut work: impl FnMut() -> f64) -> f64 {
    let (start, mut best) = (Instant::now(), 0f64);
    while start.elapsed() < Duration::from_millis(250) {
        let start = Instant::now();
        let flops = work();
        best = best.max(flops / start.elapsed().as_secs_f64() * 1e-9);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rate is operations over time. The operations are checked here; the time is the machine's business.
    #[test]
    fn the_operations_of_what_is_measured_are_counted() {
        for isa in Isa::available() {
            // Twice the rounds are twice the operations, whatever the instructions.
            let of = |rounds| (registers::<f32>(isa, rounds), registers::<Bf16>(isa, rounds));
            let (one, two) = (of(10), of(20));
            assert!(one.0 > 0.0 && one.1 > 0.0);
            assert_eq!((two.0, two.1), (2.0 * one.0, 2.0 * one.1));
        }
    }
}
