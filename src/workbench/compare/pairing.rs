//! What of two cases belongs together: cells and stored times.

use super::mapping::Mapping;
use super::motion::place;
use crate::foam_case::FoamCase;
use crate::user_case::is_collated;
use m4gn_base::{Error, Result};
use std::path::Path;

/// How values of B become values at the cells of A: with `interpolate` also where the meshes differ.
///
/// # Errors
/// [`Error::Mesh`] with the first difference of the meshes, where they differ and nothing is to be interpolated.
pub fn mapping(a: &mut FoamCase, b: &mut FoamCase, interpolate: bool) -> Result<Mapping> {
    match same_mesh(a, b) {
        Ok(()) => Ok(Mapping::Same),
        Err(Error::Mesh(_)) if interpolate && a.description().directions == b.description().directions => {
            let directions = a.description().directions.clone();
            Ok(Mapping::linear(&a.cell_centres()?, &b.cell_centres()?, &directions))
        }
        Err(e) => Err(e),
    }
}

/// Whether the cells of both cases are the same ones in the same order.
///
/// # Errors
/// [`Error::Mesh`] with the first difference.
pub fn same_mesh(a: &mut FoamCase, b: &mut FoamCase) -> Result<()> {
    let differ = |what: String| {
        Error::Mesh(format!(
            "the two cases have different meshes: {what}. Both must be run on the same mesh ({} and {})",
            a.description().path,
            b.description().path
        ))
    };
    if a.description().cells != b.description().cells {
        return Err(differ(format!("{} and {} cells", a.description().cells, b.description().cells)));
    }
    let (ca, cb) = (a.cell_centres()?, b.cell_centres()?);
    let size = ca.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
    let far = |(p, q): &(&[f64; 3], &[f64; 3])| (0..3).any(|d| (p[d] - q[d]).abs() > 1e-6 * size);
    match ca.iter().zip(&cb).position(|pair| far(&pair)) {
        None => Ok(()),
        Some(i) => Err(Error::Mesh(format!(
            "the two cases have different meshes: cell {i} is at {} m in {} and at {} m in {}. Both must be run on the \
             same mesh with the same numbering",
            place(ca[i]),
            a.description().path,
            place(cb[i]),
            b.description().path
        ))),
    }
}

/// Index pair of the field that is held, and the pairs after it.
pub type CommonTimes = ((usize, usize), Vec<(usize, usize)>);

/// Times stored in both cases, from the last one at or before the takeover, where there was one.
///
/// # Errors
/// [`Error::Input`] when nothing is left to compare.
pub fn common_times(a: &FoamCase, b: &FoamCase, takeover: Option<f64>) -> Result<CommonTimes> {
    let pairs = match_times(&a.description().times, &b.description().times);
    let time = |p: &(usize, usize)| a.description().times[p.0];
    let name = |case: &FoamCase| {
        let d = case.description();
        let hint = match is_collated(Path::new(&d.path)) {
            true => " (those of its ranks are in one folder, collated: run reconstructPar before)",
            false => "",
        };
        match (d.times.first(), d.times.last()) {
            (Some(first), Some(last)) => {
                format!("{} has {} times, {first} to {last} s{hint}", d.path, d.times.len())
            }
            _ => format!("{} has no stored times{hint}", d.path),
        }
    };
    let none = || Error::Input(format!("fewer than two common times to compare: {}, {}", name(a), name(b)));
    let Some(takeover) = takeover else {
        // Time 0 holds what the user prescribed, not what a solver computed; U may be missing there.
        let mut pairs = pairs.into_iter();
        let hold = pairs.next().ok_or_else(none)?;
        let rest: Vec<_> = pairs.collect();
        return if rest.is_empty() { Err(none()) } else { Ok((hold, rest)) };
    };
    let slack = 1e-6 * takeover.abs().max(1e-6);
    let hold = pairs.iter().copied().rfind(|p| time(p) <= takeover + slack);
    let after: Vec<_> = pairs.iter().copied().filter(|p| time(p) > takeover + slack).collect();
    match hold {
        Some(hold) if !after.is_empty() => Ok((hold, after)),
        _ => Err(Error::Input(format!(
            "errors are to count from {takeover} s on (--from, or the surrogate's takeover), and there must be common stored times both up to then and after: {}, {}",
            name(a),
            name(b)
        ))),
    }
}

/// Pairs of indices of equal times; both lists ascend.
fn match_times(a: &[f64], b: &[f64]) -> Vec<(usize, usize)> {
    let (mut i, mut j, mut pairs) = (0, 0, Vec::new());
    while i < a.len() && j < b.len() {
        // Time names are written with six digits unless the case says more.
        if (a[i] - b[j]).abs() <= 2e-6 * a[i].abs().max(b[j].abs()) {
            pairs.push((i, j));
            i += 1;
            j += 1;
        } else if a[i] < b[j] {
            i += 1;
        } else {
            j += 1;
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_matched_up_to_the_digits_of_their_names() {
        let a = [0.0, 0.1, 0.2, 0.3, 0.4];
        let b = [0.0, 0.2000001, 0.35, 0.4];
        assert_eq!(match_times(&a, &b), [(0, 0), (2, 1), (4, 3)]);
        assert!(match_times(&a, &[]).is_empty());
    }
}
