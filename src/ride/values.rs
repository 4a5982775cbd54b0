//! Sums over the arrays that surrogates are measured by.

use m4gn_parallel::Comm;
use m4gn_state::{Array, Values};

/// From old (0) to now (1).
pub(crate) fn between(old: f64, now: f64, fraction: f64) -> f64 {
    old + fraction * (now - old)
}

/// Root mean squares over the rows of all ranks and the solved components, of arrays' values one after the other. Collective.
pub(crate) fn rms<I: Iterator<Item = f64>>(
    comm: &Comm,
    arrays: &[&Array],
    values: impl Iterator<Item = I>,
) -> Vec<f64> {
    let (mut sums, mut rows) = (Vec::new(), Vec::new());
    for (field, list) in arrays.iter().zip(values) {
        let (mut sum, mut n) = (0.0, 0i64);
        for value in list {
            sum += value * value;
            n += 1;
        }
        sums.push(sum);
        rows.push(n / field.components as i64);
    }
    comm.sum_f64(&mut sums);
    comm.sum_i64(&mut rows);
    let pairs = arrays.iter().zip(sums).zip(rows);
    let mean =
        |((field, sum), n): ((&&Array, f64), i64)| (sum / (field.solved as i64 * n.max(1)) as f64).sqrt();
    pairs.map(mean).collect()
}

/// The level about which a field varies: its mean over the rows of all ranks, where it is a scalar; 0 of a vector. Collective.
pub(crate) fn levels(comm: &Comm, arrays: &[&Array], values: &Values) -> Vec<f64> {
    let mut sums: Vec<f64> = values.iter().map(|v| v.iter().sum()).collect();
    let mut rows: Vec<i64> = values.iter().map(|v| v.len() as i64).collect();
    comm.sum_f64(&mut sums);
    comm.sum_i64(&mut rows);
    let pairs = arrays.iter().zip(sums).zip(rows);
    let level = |((field, sum), n): ((&&Array, f64), i64)| match field.components {
        1 => sum / n.max(1) as f64,
        _ => 0.0,
    };
    pairs.map(level).collect()
}
