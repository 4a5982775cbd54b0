//! The error that is left where a shift in time is taken out: how far a run's last field is from the full run's cycle.

use crate::cycle::Cycle;
use serde::Serialize;
use std::f64::consts::TAU;

/// Periods of the full run, the last ones, that its cycle is made of.
pub(super) const PERIODS: f64 = 4.0;
/// Phases that are looked at, equally far apart.
const PHASES: usize = 720;

/// The place of the full run's cycle that is nearest to the other run's last field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PhaseFree {
    /// Root mean square over cells and components of the difference, in the field's unit.
    pub error: f64,
    /// How far the other run is ahead of the full one, in periods: at most half a period either way.
    pub shift: f64,
}

/// `fields` are the full run's at `times` (s), the last at that of `last`. None: they are too few, or are no cycle of this period (s).
pub(super) fn nearest(times: &[f64], fields: &[Vec<f64>], last: &[f64], period: f64) -> Option<PhaseFree> {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let products: Vec<Vec<f64>> =
        fields.iter().map(|a| fields.iter().map(|b| product(a, b)).collect()).collect();
    let cycle = Cycle::new(times, period, &|i, j| products[i][j])?;
    let with_last: Vec<f64> = fields.iter().map(|a| product(a, last)).collect();
    let square = product(last, last);
    let distance = |shift: f64| {
        let weights = cycle.weights(-TAU * shift);
        let own: f64 = weights.iter().zip(&products).map(|(w, row)| w * product(row, &weights)).sum();
        square - 2.0 * product(&weights, &with_last) + own
    };
    let shifts = (0..PHASES).map(|i| i as f64 / PHASES as f64 - 0.5);
    // The cycle is smoothed: without a shift the field itself may be nearer.
    let own = products[fields.len() - 1][fields.len() - 1] - 2.0 * with_last[fields.len() - 1] + square;
    let all = shifts.map(|s| (distance(s), s)).chain([(own, 0.0)]);
    let (least, shift) = all.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(PhaseFree { error: (least.max(0.0) / last.len() as f64).sqrt(), shift })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(t: f64) -> Vec<f64> {
        (0..40).map(|cell| (TAU * (t - cell as f64 / 40.0)).sin()).collect()
    }

    /// A wave of period 1 s, stored each 0.23 s: of one that is a tenth of a period late nothing is left, and of one whose amplitude is a
    /// hundredth larger a hundredth of its root mean square.
    #[test]
    fn a_shift_in_time_is_taken_out_and_an_amplitude_is_not() {
        let times: Vec<f64> = (0..18).map(|i| 3.0 + 0.23 * i as f64).collect();
        let fields: Vec<Vec<f64>> = times.iter().map(|t| wave(*t)).collect();
        let end = *times.last().unwrap();
        for shift in [-0.4, -0.1, 0.0, 0.025, 0.3] {
            let found = nearest(&times, &fields, &wave(end + shift), 1.0).unwrap();
            assert!(found.error < 5e-3 && (found.shift - shift).abs() < 2e-3, "{shift}: {found:?}");
        }
        let larger: Vec<f64> = wave(end - 0.2).iter().map(|v| 1.01 * v).collect();
        let found = nearest(&times, &fields, &larger, 1.0).unwrap();
        assert!((found.error - 0.01 / 2f64.sqrt()).abs() < 1e-4, "{found:?}");
        assert_eq!(nearest(&times[..5], &fields[..5], &larger, 1.0), None);
    }
}
