//! Which of the computed eigenpairs are taken: as many as asked for, repeated eigenvalues whole.

use super::pair::Pair;
use m4gn_base::{Error, Result};
use std::ops::Range;

/// Eigenvalues closer than this, relatively, are one repeated eigenvalue.
const CLUSTER: f64 = 1e-6;

/// Whether so many modes can be had of `total` unknowns.
pub(super) fn check(n: usize, total: usize) -> Result<()> {
    match n > 0 && n >= total {
        true => Err(Error::Input(format!(
            "{n} modes of {total} unknowns: expected at most {}; set modes in the dictionary",
            total.saturating_sub(1)
        ))),
        false => Ok(()),
    }
}

/// How many of the sorted pairs are taken where `wanted` are asked for.
///
/// `zero` is the size of the rounding of eigenvalues that are 0.
pub(super) fn count(pairs: &[Pair], wanted: usize, zero: f64) -> Result<usize> {
    if pairs.len() < wanted {
        return Err(Error::Numerical(format!(
            "{wanted} modes: only {} eigenvalues are finite; ask for fewer modes (the rank of M is their number)",
            pairs.len()
        )));
    }
    let values: Vec<f64> = pairs.iter().map(|p| p.value).collect();
    Ok(whole_clusters(&values, wanted, zero).unwrap_or(pairs.len()))
}

/// How many of modes that are there, by ascending eigenvalue and repeated ones whole, are taken.
pub(super) fn first(values: &[f64], wanted: usize) -> usize {
    let size = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    match wanted {
        0 => 0,
        n => whole_clusters(values, n, 1e-9 * size).unwrap_or(values.len()),
    }
}

/// How many pairs make the first `n` with the cluster of the n-th whole; none if that cannot be seen yet.
pub(super) fn whole_clusters(values: &[f64], n: usize, zero: f64) -> Option<usize> {
    let mut count = n;
    while count < values.len() && same(values[count - 1], values[count], zero) {
        count += 1;
    }
    (count < values.len()).then_some(count)
}

/// Runs of repeated eigenvalues.
pub(super) fn clusters(pairs: &[Pair], zero: f64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut first = 0;
    for end in 1..=pairs.len() {
        if end == pairs.len() || !same(pairs[end - 1].value, pairs[end].value, zero) {
            runs.push(first..end);
            first = end;
        }
    }
    runs
}

fn same(a: f64, b: f64, zero: f64) -> bool {
    (b - a).abs() <= (CLUSTER * a.abs().max(b.abs())).max(zero)
}
