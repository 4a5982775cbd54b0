//! The order in which runs are made: spread over the parameters, then where the finished ones foretell worst.

use super::cycle::{length, looked_at, offset, spanned, weights};
use std::collections::BTreeSet;

/// A finished run.
#[derive(Clone, Debug)]
pub struct Known {
    /// Its row.
    pub row: usize,
    /// Each figure and its tolerance.
    pub figures: Vec<(f64, f64)>,
}

/// The order of runs by their places alone ([`Table::places`](super::table::Table::places)): the one in the middle, then always the one that is
/// farthest from all before, so that whenever a campaign is stopped its runs are spread, and each has a sister near.
pub fn spread(places: &[Vec<f64>]) -> Vec<usize> {
    let mut nearest = vec![f64::INFINITY; places.len()];
    let mut left: Vec<usize> = (0..places.len()).collect();
    let (mut order, mut next) = (Vec::new(), middle(places));
    while let Some(row) = next {
        left.retain(|&i| i != row);
        left.iter().for_each(|&i| nearest[i] = nearest[i].min(length(&offset(&places[i], &places[row]))));
        order.push(row);
        // Of equals the first
        next = left.iter().rev().max_by(|a, b| nearest[**a].total_cmp(&nearest[**b])).copied();
    }
    order
}

/// The run that is made first, in the middle of all; none of none.
pub fn middle(places: &[Vec<f64>]) -> Option<usize> {
    let far = |i: usize| places[i].iter().map(|x| (x - 0.5).powi(2)).sum::<f64>();
    (0..places.len()).min_by(|&a, &b| far(a).total_cmp(&far(b)))
}

/// The row among those `left` that is made next: the one with the largest product of its distance from all that are made or `begun`, and of how far
/// its finished sisters are off what the others foretell of them, in tolerances, and 1. None: too few are finished to foretell anything, or none is left;
/// [`spread`] is the order then.
///
/// What is foretold is what a start takes: sisters by [`weights`], the nearest one where they lie on one side only.
pub fn worst(places: &[Vec<f64>], left: &[usize], begun: &BTreeSet<usize>, known: &[Known]) -> Option<usize> {
    let first = places.first()?;
    let all: Vec<Vec<f64>> = places.iter().map(|p| offset(first, p)).collect();
    let directions = spanned(&all).first().map_or(0, Vec::len);
    let most = looked_at(directions);
    if known.len() <= most || known.iter().all(|k| k.figures.is_empty()) {
        return None;
    }
    let errors: Vec<f64> = (0..known.len()).map(|i| off(places, known, i, most)).collect();
    let around = 1 << directions.min(16);
    let score = |&row: &usize| {
        let far = |other: usize| length(&offset(&places[row], &places[other]));
        let alone =
            begun.iter().chain(known.iter().map(|k| &k.row)).map(|&r| far(r)).fold(f64::INFINITY, f64::min);
        let mut near: Vec<(f64, f64)> =
            known.iter().zip(&errors).map(|(k, e)| (far(k.row).max(1e-12), *e)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(around);
        let (sum, weight) = near.iter().fold((0.0, 0.0), |(s, w), (far, e)| (s + e / far, w + 1.0 / far));
        alone * (1.0 + sum / weight)
    };
    left.iter().rev().max_by(|a, b| score(a).total_cmp(&score(b))).copied()
}

/// How far the i-th finished run is off what the others foretell of it, in tolerances: of its figures the worst.
fn off(places: &[Vec<f64>], known: &[Known], i: usize, most: usize) -> f64 {
    let mut others: Vec<(Vec<f64>, &Known)> = known
        .iter()
        .enumerate()
        .filter(|(k, _)| *k != i)
        .map(|(_, k)| (offset(&places[known[i].row], &places[k.row]), k))
        .collect();
    others.sort_by(|a, b| length(&a.0).total_cmp(&length(&b.0)));
    others.truncate(most);
    let offsets: Vec<Vec<f64>> = others.iter().map(|(o, _)| o.clone()).collect();
    let weights =
        weights(&offsets).unwrap_or_else(|| (0..others.len()).map(|k| f64::from(u8::from(k == 0))).collect());
    let error = |(q, (value, tolerance)): (usize, &(f64, f64))| {
        let foretold: f64 =
            others.iter().zip(&weights).map(|((_, k), w)| w * k.figures.get(q).map_or(0.0, |f| f.0)).sum();
        (foretold - value).abs() / tolerance
    };
    known[i].figures.iter().enumerate().map(error).filter(|e| e.is_finite()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_spread_from_the_middle_outwards() {
        let line: Vec<Vec<f64>> = (0..5).map(|i| vec![f64::from(i) / 4.0]).collect();
        assert_eq!(spread(&line), [2, 0, 4, 1, 3]);
        assert_eq!(spread(&[vec![], vec![]]), [0, 1]);
        assert!(spread(&[]).is_empty());
        assert_eq!((middle(&line), middle(&[])), (Some(2), None));
    }

    /// Runs until each of those that are left is within its tolerance of what the others foretell of it.
    fn needed(places: &[Vec<f64>], response: &dyn Fn(f64) -> f64, tolerance: f64, foretold: bool) -> usize {
        let known = |row: usize| Known { row, figures: vec![(response(places[row][0]), tolerance)] };
        let (all, mut done) = (spread(places), Vec::<usize>::new());
        loop {
            let left: Vec<usize> = all.iter().copied().filter(|r| !done.contains(r)).collect();
            let finished: Vec<Known> = done.iter().map(|&r| known(r)).collect();
            let far = |&row: &usize| {
                let with: Vec<Known> = finished.iter().cloned().chain([known(row)]).collect();
                done.len() < 2 || off(places, &with, done.len(), looked_at(1)) > 1.0
            };
            if !left.iter().any(far) {
                return done.len();
            }
            let next = worst(places, &left, &BTreeSet::new(), &finished).filter(|_| foretold);
            done.push(next.unwrap_or(left[0]));
        }
    }

    #[test]
    fn fewer_runs_say_as_much_where_the_response_is_not_the_same_everywhere() {
        let places: Vec<Vec<f64>> = (0..24).map(|i| vec![f64::from(i) / 23.0]).collect();
        let of = |response: &dyn Fn(f64) -> f64, tolerance: f64| {
            [false, true].map(|foretold| needed(&places, response, tolerance, foretold))
        };
        // An instability that begins, a front, a resonance, and what is smooth
        let onset = of(&|x| (x - 0.3f64).max(0.0).sqrt(), 0.01);
        let front = of(&|x| ((x - 0.7) / 0.05).tanh(), 0.02);
        let peak = of(&|x| (-((x - 0.4) / 0.1).powi(2)).exp(), 0.01);
        let smooth = of(&|x| 1.0 + x * x + 0.5 * (2.0 * x).sin(), 0.02);
        assert!(
            [onset, front, peak].iter().all(|[spread, foretold]| foretold < spread),
            "{onset:?} {front:?} {peak:?}"
        );
        assert!(smooth[1] <= smooth[0] && smooth[0] < 8, "{smooth:?}");
    }

    #[test]
    fn what_is_being_made_is_not_made_beside() {
        let places: Vec<Vec<f64>> = (0..9).map(|i| vec![f64::from(i) / 8.0]).collect();
        let known: Vec<Known> = [0, 2, 4, 6, 8]
            .map(|row| Known { row, figures: vec![(if row > 4 { 1.0 } else { 0.0 }, 0.01)] })
            .to_vec();
        let first = worst(&places, &[1, 3, 5, 7], &BTreeSet::new(), &known).unwrap();
        assert!(first == 5 || first == 3, "beside the step: {first}");
        let next = worst(&places, &[1, 3, 5, 7], &BTreeSet::from([first]), &known).unwrap();
        assert_ne!(next, first);
        assert_eq!(worst(&places, &[1], &BTreeSet::new(), &known[..4]), None, "too few");
        assert_eq!(worst(&places, &[], &BTreeSet::new(), &known), None);
    }
}
