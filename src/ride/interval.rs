//! The time between snapshots where a case sets none: so many time steps at first, then a share of the period that fits show.

use m4gn_dmd::Mode;
use serde::{Deserialize, Serialize};

/// Time steps of the solver between snapshots before a period is known: the longest of those that were made of late.
const STEPS: f64 = 10.0;

/// Snapshots in a period, once it is known.
const IN_A_PERIOD: f64 = 14.0;

/// Steps whose longest is remembered: between once and twice as many.
const LATE: usize = 500;

/// An interval within this factor of the one that is wanted stays: a shorter one costs a window.
const NEAR: f64 = 2.0;

/// States that have missed faster waves are set nearer by this factor.
const FARTHEST: f64 = 4.0;

/// Changes for a period at most: a flow that never repeats shows another one at each try.
const CHANGES: usize = 3;

/// Least share of the energy of the mode whose period counts.
pub(crate) const LEAST_ENERGY: f64 = 0.01;

/// Two tries show the same period where theirs differ by less, of the longer one.
const ALIKE: f64 = 0.2;

/// What the time between snapshots follows from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Interval {
    /// The longest step of the solver among the `LATE` before the last `count` ones, and among these, s.
    longest: [f64; 2],
    count: usize,
    /// The period that the last try of a fit showed, s.
    period: Option<f64>,
    /// The interval that follows from periods, s, and how often it was changed.
    found: Option<f64>,
    changes: usize,
}

impl Interval {
    /// For a run whose first step has this length, s.
    pub fn new(delta_t: f64) -> Self {
        Interval { longest: [0.0, delta_t], ..Interval::default() }
    }

    /// The first one, s; `fixed`: what the case sets.
    pub fn first(fixed: Option<f64>, delta_t: f64) -> f64 {
        fixed.unwrap_or(STEPS * delta_t)
    }

    /// The solver has made a step of this length, s.
    pub fn step(&mut self, delta_t: f64) {
        if self.count == LATE {
            (self.longest, self.count) = ([self.longest[1], 0.0], 0);
        }
        self.longest[1] = self.longest[1].max(delta_t);
        self.count += 1;
    }

    /// The interval where it is to be another than `present` (s): that of the case or of the period, doubled as often as it takes to be as
    /// long as a step; else so many steps, where `present` is off from that by more than a factor of two.
    pub fn other(&self, fixed: Option<f64>, present: f64, delta_t: f64) -> Option<f64> {
        let longest = self.longest.iter().copied().fold(delta_t, f64::max);
        let steps = STEPS * longest;
        let other = match fixed.or(self.found) {
            Some(known) => no_shorter(known, longest),
            None if steps > 2.0 * present || steps < 0.5 * present => steps,
            None => present,
        };
        (other != present).then_some(other)
    }

    /// The period that the interval follows from, s; none: it does not.
    pub fn period(&self) -> Option<f64> {
        self.found.and(self.period)
    }

    /// A fit of states so far apart (s) was wrong between them: they have missed faster waves.
    pub fn missed(&mut self, present: f64) {
        if self.changes < CHANGES {
            (self.found, self.period) = (Some(present / FARTHEST), None);
            self.changes += 1;
        }
    }

    /// Takes the modes of a fit, largest share of the energy first. `present`: the interval, s. One that `holds` has no period by
    /// chance, and asks for no longer interval. Whether the period wants another one.
    pub fn take(&mut self, modes: &[Mode], present: f64, holds: bool) -> bool {
        let waves =
            |m: &&Mode| m.frequency > 0.0 && m.energy >= LEAST_ENERGY && m.growth_rate.abs() < m.frequency;
        let period = modes.iter().find(waves).map(|m| 1.0 / m.frequency);
        let before = if holds { period } else { std::mem::replace(&mut self.period, period) };
        let (Some(period), Some(before)) = (period, before) else { return false };
        if self.changes == CHANGES || (period - before).abs() > ALIKE * period.max(before) {
            return false;
        }
        let wanted = period / IN_A_PERIOD;
        let longest = self.longest[0].max(self.longest[1]);
        // Every second state stays where the interval is doubled: that costs nothing
        let longer = !holds && wanted > NEAR * present;
        let shorter = no_shorter(wanted, longest) < present / NEAR;
        if longer || shorter {
            (self.found, self.period) = (Some(if longer { 2.0 * present } else { wanted }), Some(period));
            self.changes += usize::from(shorter);
        }
        longer || shorter
    }
}

/// An interval, doubled as often as it takes to be as long as a step, s.
fn no_shorter(interval: f64, step: f64) -> f64 {
    interval * (step / interval * (1.0 - 1e-6)).log2().ceil().max(0.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(period: f64) -> Mode {
        Mode { frequency: 1.0 / period, growth_rate: 0.0, amplitude: 1.0, energy: 0.5, number: 0 }
    }

    #[test]
    fn the_interval_is_doubled_for_a_period_that_was_seen_twice() {
        let mut interval = Interval::new(0.002);
        let first = Interval::first(None, 0.002);
        assert_eq!((first, interval.other(None, first, 0.002)), (0.02, None));
        interval.take(&[wave(1.4)], first, false);
        assert_eq!(interval.other(None, first, 0.002), None, "once may be chance");
        interval.take(&[wave(0.9)], first, false);
        assert_eq!(interval.other(None, first, 0.002), None, "another one");
        interval.take(&[wave(0.91)], first, false);
        assert_eq!(interval.other(None, first, 0.002), Some(0.04));
        assert!(interval.period().is_some_and(|p| (p - 0.91).abs() < 1e-12));
        assert_eq!(interval.other(None, 0.04, 0.004), None, "it no longer follows the steps");
        assert_eq!(interval.other(None, 0.04, 0.05), Some(0.08), "but is as long as one");
        interval.take(&[wave(0.92)], 0.04, false);
        assert_eq!(interval.other(None, 0.04, 0.002), None, "near enough");
        (0..9).for_each(|_| _ = interval.take(&[wave(9.0)], 0.04, false));
        assert_eq!(
            (interval.other(None, 0.04, 0.002), interval.changes),
            (Some(0.08), 0),
            "doubled at most, at no cost"
        );
    }

    /// Harmonics would be waves of other frequencies between the states.
    #[test]
    fn a_fit_that_holds_on_few_states_a_period_shortens_the_interval() {
        let mut interval = Interval::new(0.001);
        assert!(!interval.take(&[wave(0.2)], 0.025, true), "eight states are enough");
        assert!(interval.take(&[wave(0.07)], 0.025, true));
        let found = interval.other(None, 0.025, 0.001).unwrap();
        assert!((found - 0.005).abs() < 1e-12, "{found}");
        assert!(!interval.take(&[wave(0.07)], found, true), "it has been shortened");
        assert!(!interval.take(&[wave(1.4)], found, true), "what holds needs no longer one");
        let mut interval = Interval::new(0.01);
        assert!(interval.take(&[wave(0.6)], 0.25, true));
        let found = interval.other(None, 0.25, 0.01).unwrap();
        assert!(interval.take(&[wave(0.05)], found, true));
        let found = interval.other(None, found, 0.01).unwrap();
        assert!(!interval.take(&[wave(0.0501)], found, true), "there are no shorter steps: {found}");
    }

    #[test]
    fn noise_and_drifts_change_nothing() {
        let mut interval = Interval::new(0.001);
        let drift = Mode { frequency: 0.0, ..wave(1.0) };
        let fast = Mode { growth_rate: -30.0, ..wave(0.1) };
        let small = Mode { energy: 0.005, ..wave(2.0) };
        for _ in 0..3 {
            interval.take(&[drift, fast, small], 0.01, false);
        }
        assert_eq!((interval.other(None, 0.01, 0.001), interval.period()), (None, None));
        for k in 0..20 {
            let present = interval.other(None, 0.01, 0.001).unwrap_or(0.01);
            interval.take(&[wave(present * if k % 4 < 2 { 100.0 } else { 3.0 })], present, false);
        }
        assert_eq!(interval.changes, CHANGES, "a flow that never repeats is not followed for ever");
    }

    /// Steps that are no longer made are forgotten.
    #[test]
    fn without_a_period_the_interval_follows_the_steps() {
        let mut interval = Interval::new(0.01);
        (0..2 * LATE + 1).for_each(|_| interval.step(0.001));
        assert_eq!(interval.other(None, 0.1, 0.001), Some(0.01));
        assert_eq!(interval.other(Some(0.25), 0.25, 0.001), None, "but for what the case sets");
    }
}
