//! The cycle of a run as a combination of its sisters' cycles: weights by the parameters, and the states that a run stores for it.

use faer::Mat;

/// States a period that a run stores, and how many it keeps: more than a period's.
const A_PERIOD: f64 = 8.0;
const KEPT: usize = 10;

/// Least spread of the parameters in a direction, over the largest, that is one.
const SPANS: f64 = 1e-3;
/// Largest sum of the magnitudes of sisters' weights: beyond it they extrapolate.
const WITHIN: f64 = 2.0;

/// Time between two states that a run of this period stores, and how many it keeps.
pub fn stored(period: f64) -> (f64, usize) {
    (period / A_PERIOD, KEPT)
}

/// The longest time between states, `every` at most, of which a run's duration is a multiple: so the state at its end is one of them.
pub fn dividing(every: f64, duration: f64) -> f64 {
    duration / (duration / every).ceil()
}

/// Length of an offset in the parameters, each of which goes from 0 to 1.
pub fn length(offset: &[f64]) -> f64 {
    offset.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// From one place in the parameters to another.
pub fn offset(from: &[f64], to: &[f64]) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| b - a).collect()
}

/// Offsets in parameters in coordinates of their own span, of as few directions as they have: parameters may depend on each other.
pub fn spanned(offsets: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let matrix = Mat::from_fn(offsets.len(), offsets.first().map_or(0, Vec::len), |i, c| offsets[i][c]);
    let Ok(svd) = matrix.thin_svd() else { return offsets.to_vec() };
    let (u, values) = (svd.U(), svd.S().column_vector());
    let count = (0..values.nrows()).filter(|&c| values[c] > SPANS * values[0]).count();
    (0..offsets.len()).map(|i| (0..count).map(|c| u[(i, c)] * values[c]).collect()).collect()
}

/// How many sisters are looked at, the nearest ones: one more than a polynomial of degree 2 has terms.
pub fn looked_at(directions: usize) -> usize {
    (directions + 1) * (directions + 2) / 2 + 1
}

/// Weights of sisters whose parameters are `offsets` from a run's own: moving least squares (Lancaster and Salkauskas, Math. Comp. 37, 1981), exact
/// for polynomials of degree 2, else 1. None: they do not lie around the run.
pub fn weights(offsets: &[Vec<f64>]) -> Option<Vec<f64>> {
    let offsets = spanned(offsets);
    let far = offsets.iter().map(|o| length(o)).fold(0.0, f64::max);
    if far == 0.0 {
        return None;
    }
    [2, 1].into_iter().find_map(|degree| {
        let terms: Vec<Vec<f64>> = offsets.iter().map(|o| terms(o, far, degree)).collect();
        let near = |i: usize| (length(&offsets[i]) / far).max(1e-3).powi(-2);
        let matrix = Mat::from_fn(offsets.len(), terms[0].len(), |i, c| near(i) * terms[i][c]);
        let inverse = matrix.thin_svd().ok()?.pseudoinverse();
        let found: Vec<f64> = (0..offsets.len()).map(|i| near(i) * inverse[(0, i)]).collect();
        let exact = (0..terms[0].len()).all(|c| {
            let sum: f64 = found.iter().zip(&terms).map(|(w, t)| w * t[c]).sum();
            (sum - f64::from(u8::from(c == 0))).abs() < 1e-6
        });
        (exact && found.iter().map(|w| w.abs()).sum::<f64>() <= WITHIN).then_some(found)
    })
}

/// 1, the parameters over `far`, and for degree 2 their products.
fn terms(offset: &[f64], far: f64, degree: usize) -> Vec<f64> {
    let x: Vec<f64> = offset.iter().map(|v| v / far).collect();
    let mut all = [&[1.0], &x[..]].concat();
    if degree == 2 {
        all.extend((0..x.len()).flat_map(|i| x[i..].iter().map(|y| x[i] * y).collect::<Vec<_>>()));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::Cycle;
    use std::f64::consts::TAU;

    #[test]
    fn the_state_at_the_end_is_one_that_is_stored() {
        assert_eq!([dividing(0.25, 2.0), dividing(0.3, 1.0), dividing(3.0, 2.0)], [0.25, 0.25, 2.0]);
    }

    const CELLS: usize = 64;

    /// A wave that travels, steepened by harmonics, on a mean: amplitude and wave number depend on the parameter, the clock's start is anybody's.
    fn wave(parameter: f64, phase: f64) -> Vec<f64> {
        let value = |i: usize| {
            let x = TAU * i as f64 / CELLS as f64;
            let harmonic =
                |n: i32| (1.0 + parameter) * 0.5f64.powi(n) * (f64::from(n) * (2.0 * x - phase)).cos();
            3.0 + parameter * x + (1..=3).map(harmonic).sum::<f64>()
        };
        (0..CELLS).map(value).collect()
    }

    fn products<'a>(a: &'a [Vec<f64>], b: &'a [Vec<f64>]) -> impl Fn(usize, usize) -> f64 + 'a {
        |i, j| a[i].iter().zip(&b[j]).map(|(x, y)| x * y).sum()
    }

    fn combined(weights: &[f64], states: &[Vec<f64>]) -> Vec<f64> {
        (0..states[0].len()).map(|i| weights.iter().zip(states).map(|(w, s)| w * s[i]).sum()).collect()
    }

    /// States of a wave every eighth of its period, as a run leaves them: the last one at any time.
    fn states(parameter: f64, period: f64, end: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut times: Vec<f64> = (0..9).map(|i| f64::from(i) * period / 8.0).collect();
        times.push(end);
        let states = times.iter().map(|t| wave(parameter, TAU * t / period)).collect();
        (times, states)
    }

    fn off(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_travelling_wave_is_its_mean_and_harmonics() {
        let (period, end) = (0.4, 0.43);
        let (times, states) = states(0.2, period, end);
        let cycle = Cycle::new(&times, period, &products(&states, &states)).unwrap();
        assert!(
            Cycle::covers(&times, period)
                && !Cycle::covers(&times[8..], period)
                && !Cycle::covers(&[], period)
        );
        assert!(off(&combined(&cycle.weights(0.0), &states), &wave(0.2, TAU * end / period)) < 1e-9);
        assert!(off(&combined(&cycle.weights(1.1), &states), &wave(0.2, TAU * end / period - 1.1)) < 1e-9);
        // Less than a period; another period; a wave that is none
        let of = |n: usize, period: f64, states: &[Vec<f64>]| {
            Cycle::new(&times[..n], period, &products(&states[..n], &states[..n])).is_some()
        };
        assert!(of(9, period, &states) && !of(8, period, &states) && !of(10, 0.3, &states));
        let scattered: Vec<Vec<f64>> = (0..10).map(|i| wave(0.2, f64::from(i * i * i % 11))).collect();
        assert!(!of(10, period, &scattered));
    }

    #[test]
    fn sisters_are_interpolated_in_phase() {
        let runs = [(0.0, 0.4, 0.43), (0.1, 0.37, 0.371), (0.3, 0.3, 0.31)];
        let all = runs.map(|(parameter, period, end)| states(parameter, period, end));
        let cycles: Vec<Cycle> = (0..3)
            .map(|i| Cycle::new(&all[i].0, runs[i].1, &products(&all[i].1, &all[i].1)).unwrap())
            .collect();
        let among = weights(&runs.map(|(parameter, ..)| vec![parameter - 0.2])).unwrap();
        let mut found = vec![0.0; CELLS];
        for i in 0..3 {
            let ahead = cycles[i].ahead_of(&cycles[0], &products(&all[0].1, &all[i].1));
            let part = combined(&cycles[i].weights(ahead), &all[i].1);
            found.iter_mut().zip(part).for_each(|(f, p)| *f += among[i] * p);
        }
        assert!(off(&found, &wave(0.2, TAU * 0.43 / 0.4)) < 1e-9);
    }

    #[test]
    fn weights_are_exact_for_polynomials_and_do_not_extrapolate() {
        let of = |places: &[&[f64]]| weights(&places.iter().map(|p| p.to_vec()).collect::<Vec<_>>());
        let near = |a: Option<Vec<f64>>, b: &[f64]| off(&a.unwrap(), b) < 1e-6;
        assert!(near(of(&[&[-0.1], &[0.3]]), &[0.75, 0.25]));
        assert!(near(of(&[&[-1.0], &[1.0], &[2.0]]), &[1.0 / 3.0, 1.0, -1.0 / 3.0]));
        assert_eq!(of(&[&[1.0], &[2.0]]), None, "both on one side");
        assert_eq!(of(&[&[1.0]]), None);
        assert!(near(of(&[&[-1.0, -1.0], &[1.0, -1.0], &[0.0, 2.0]]), &[1.0 / 3.0; 3]));
        assert_eq!(of(&[&[-1.0, 0.0], &[1.0, 0.0]]).map(|w| w.len()), Some(2), "on the line between them");
        assert_eq!(of(&[&[-1.0, 1.0], &[1.0, 1.0]]), None, "beside it");
        // Parameters that say the same to eight digits
        assert!(near(of(&[&[-0.1, -0.1 + 1e-8], &[0.3, 0.3 - 2e-8]]), &[0.75, 0.25]));
    }
}
