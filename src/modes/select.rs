//! Which of the computed eigenpairs are taken: as many as asked for, repeated eigenvalues whole.

use super::pair::Pair;
use m4gn_mesh::{Error, Result};
use m4gn_model::modal::ModeCount;
use std::ops::Range;

/// Eigenvalues closer than this, relatively, are one repeated eigenvalue.
const CLUSTER: f64 = 1e-6;

/// Complex pairs with a larger imaginary part, relatively, are no vibration.
const COMPLEX: f64 = 0.1;

/// Whether so many modes can be had of `total` unknowns.
pub(super) fn check(count: ModeCount, total: usize) -> Result<()> {
    match count {
        ModeCount::Fixed(n) if n > 0 && n >= total => Err(Error::Input(format!(
            "{n} modes of {total} unknowns: expected at most {}; set modes in the dictionary",
            total.saturating_sub(1)
        ))),
        ModeCount::Energy { share, .. } if !(share > 0.0 && share <= 1.0) => {
            Err(Error::Input(format!("energy share {share}: expected more than 0 and at most 1")))
        }
        ModeCount::Energy { most: 0, .. } => {
            Err(Error::Input("energy share of at most 0 modes: expected at least 1".into()))
        }
        ModeCount::Energy { .. } if total < 2 => {
            Err(Error::Input(format!("modes of {total} unknowns: expected at least 2 unknowns")))
        }
        _ => Ok(()),
    }
}

/// Pairs that have to be computed, not counting the rest of the last cluster.
pub(super) fn candidates(count: ModeCount, total: usize) -> usize {
    match count {
        ModeCount::Fixed(n) => n,
        ModeCount::Energy { most, .. } => most.min(total - 1),
    }
}

/// How many of the sorted pairs are taken.
///
/// `zero` is the size of the rounding of eigenvalues that are 0.
pub(super) fn count(pairs: &[Pair], count: ModeCount, zero: f64, total: usize) -> Result<usize> {
    let wanted = candidates(count, total);
    if pairs.len() < wanted {
        return Err(Error::Numerical(format!(
            "{wanted} modes: only {} eigenvalues are finite; ask for fewer modes (the rank of M is their number)",
            pairs.len()
        )));
    }
    let values: Vec<f64> = pairs.iter().map(|p| p.value).collect();
    let n = match count {
        ModeCount::Fixed(n) => n,
        ModeCount::Energy { share, .. } => enough(&values[..wanted], share, zero),
    };
    let n = whole_clusters(&values, n, zero).unwrap_or(pairs.len());
    match pairs[..n].iter().find(|p| p.imaginary.abs() > COMPLEX * p.value.abs().max(zero)) {
        None => Ok(n),
        Some(p) => Err(Error::Numerical(format!(
            "the eigenvalue {:e} +- {:e} i is complex: expected eigenvalues of a vibration, real up to the asymmetry of \
             a discretisation; look at boundary conditions and signs of K and M",
            p.value,
            p.imaginary.abs()
        ))),
    }
}

/// How many of modes that are there, by ascending eigenvalue and repeated ones whole, are taken.
pub(super) fn first(values: &[f64], count: ModeCount) -> usize {
    let size = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let (wanted, zero) = (candidates(count, values.len() + 1).min(values.len()), 1e-9 * size);
    let n = match count {
        ModeCount::Fixed(_) => wanted,
        ModeCount::Energy { share, .. } => enough(&values[..wanted], share, zero),
    };
    match n {
        0 => 0,
        n => whole_clusters(values, n, zero).unwrap_or(values.len()),
    }
}

/// Modes that hold the share of the energy, see [`ModeCount::Energy`].
fn enough(values: &[f64], share: f64, zero: f64) -> usize {
    let energy = |&value: &f64| match value > zero {
        true => 1.0 / value,
        false => 0.0,
    };
    let sum: f64 = values.iter().map(energy).sum();
    let mut held = 0.0;
    for (i, value) in values.iter().enumerate() {
        held += energy(value);
        // A whole cluster's rounding must not ask for one mode more.
        if held >= share * sum * (1.0 - 1e-9) && *value > zero {
            return i + 1;
        }
    }
    values.len()
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
