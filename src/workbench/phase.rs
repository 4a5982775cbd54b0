//! The error that is left where a shift in time is taken out: how far a field is from the cycle that the true fields end in.

use crate::cycle::Cycle;
use m4gn_averages::spectrum;
use serde::Serialize;
use std::f64::consts::TAU;

/// Periods of the true fields, the last ones, that their cycle is made of.
pub const PERIODS: f64 = 4.0;
/// Phases that are looked at, equally far apart.
const PHASES: usize = 720;

/// The place of the true cycle that is nearest to another field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PhaseFree {
    /// Root mean square over cells and components of the difference, in the field's unit.
    pub error: f64,
    /// How far the other field is ahead of the last true one, in periods: at most half a period either way.
    pub shift: f64,
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// True fields that are a cycle.
#[derive(Clone, Debug)]
pub struct Orbit {
    fields: Vec<Vec<f64>>,
    /// Inner products of each with each.
    products: Vec<Vec<f64>>,
    cycle: Cycle,
}

impl Orbit {
    /// Of fields at `times`, s. None: they are too few, or are no cycle of this period, s.
    pub fn new(times: &[f64], fields: Vec<Vec<f64>>, period: f64) -> Option<Self> {
        let row = |a: &Vec<f64>| fields.iter().map(|b| product(a, b)).collect();
        let products: Vec<Vec<f64>> = fields.iter().map(row).collect();
        let cycle = Cycle::new(times, period, &|i, j| products[i][j])?;
        Some(Orbit { fields, products, cycle })
    }

    /// Of a run whose period nobody says: it is looked for in the second half, behind what the run starts up with. `frame`: the field at
    /// the i-th of `times`, s.
    pub fn of_run(times: &[f64], frame: &dyn Fn(usize) -> Vec<f64>) -> Option<Self> {
        let late = times.len() / 2..times.len();
        // How the last field differs from the mean is a direction that an oscillation passes to and fro.
        let mut along = frame(times.len().checked_sub(1)?);
        let share = 1.0 / late.len() as f64;
        late.clone().for_each(|i| along.iter_mut().zip(frame(i)).for_each(|(a, v)| *a -= share * v));
        let signal: Vec<f64> = late.clone().map(|i| product(&frame(i), &along)).collect();
        let period = 1.0 / spectrum::frequency(&times[late], &signal)?;
        let from = times.partition_point(|t| *t < times[times.len() - 1] - PERIODS * period);
        Orbit::new(&times[from..], (from..times.len()).map(frame).collect(), period)
    }

    /// Its place that is nearest to a field, which is of the time of the last true one.
    pub fn nearest(&self, found: &[f64]) -> PhaseFree {
        let with_found: Vec<f64> = self.fields.iter().map(|a| product(a, found)).collect();
        let square = product(found, found);
        let distance = |shift: f64| {
            let weights = self.cycle.weights(-TAU * shift);
            let own: f64 =
                weights.iter().zip(&self.products).map(|(w, row)| w * product(row, &weights)).sum();
            square - 2.0 * product(&weights, &with_found) + own
        };
        let shifts = (0..PHASES).map(|i| i as f64 / PHASES as f64 - 0.5);
        // The cycle is smoothed: without a shift the field itself may be nearer.
        let last = self.fields.len() - 1;
        let unshifted = (self.products[last][last] - 2.0 * with_found[last] + square, 0.0);
        let nearer = |a: (f64, f64), b: (f64, f64)| if b.0 < a.0 { b } else { a };
        let (least, shift) = shifts.map(|s| (distance(s), s)).fold(unshifted, nearer);
        PhaseFree { error: (least.max(0.0) / found.len().max(1) as f64).sqrt(), shift }
    }
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
        let orbit = Orbit::new(&times, fields.clone(), 1.0).unwrap();
        for shift in [-0.4, -0.1, 0.0, 0.025, 0.3] {
            let found = orbit.nearest(&wave(end + shift));
            assert!(found.error < 5e-3 && (found.shift - shift).abs() < 2e-3, "{shift}: {found:?}");
        }
        let larger: Vec<f64> = wave(end - 0.2).iter().map(|v| 1.01 * v).collect();
        let found = orbit.nearest(&larger);
        assert!((found.error - 0.01 / 2f64.sqrt()).abs() < 1e-4, "{found:?}");
        assert!(Orbit::new(&times[..5], fields[..5].to_vec(), 1.0).is_none());
    }

    /// The same wave behind a start-up that decays, and one that goes on to decay.
    #[test]
    fn the_period_of_a_run_is_found() {
        let times: Vec<f64> = (0..60).map(|i| 0.17 * i as f64).collect();
        let end = *times.last().unwrap();
        let of_run = |size: &dyn Fn(f64) -> f64| {
            let of = |t: f64| -> Vec<f64> { wave(t).iter().map(|v| 5.0 + size(t) * v).collect() };
            Orbit::of_run(&times, &|i| of(times[i]))
        };
        let orbit = of_run(&|t: f64| 1.0 - (-3.0 * t).exp()).unwrap();
        let shifted: Vec<f64> = wave(end + 0.2).iter().map(|v| 5.0 + v).collect();
        let found = orbit.nearest(&shifted);
        assert!(found.error < 0.01 && (found.shift - 0.2).abs() < 5e-3, "{found:?}");
        assert!(of_run(&|t: f64| (-t).exp()).is_none());
        assert!(of_run(&|_| 0.0).is_none());
        assert!(Orbit::of_run(&[], &|_| Vec::new()).is_none());
        assert!(Orbit::of_run(&[0.0, 1.0], &|i| vec![i as f64]).is_none());
    }
}
