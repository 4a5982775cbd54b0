//! A stride that a surrogate takes beside the solver, from the solver's own fields, and that is compared with where the solver arrives.
//!
//! If the solver's time steps do not meet the stride, the prediction is interpolated linearly to the time at which the solver has arrived.

use crate::control::StrideError;
use crate::schedule::Step;
use crate::surrogate::{Start, Surrogate};
use crate::values::{between, levels, rms};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_state::{Array, Values};

/// Two times this near, as a part of a stride, are the same.
const SAME: f64 = 1e-6;

/// A stride beside the solver.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Shadow {
    /// Whether one is under way.
    pub waiting: bool,
    /// Time at which it began, s.
    pub begun: f64,
    /// Whether the prediction is finite.
    pub finite: bool,
    /// Whether the surrogate took no stride: the solver is waited for alone.
    pub idle: bool,
    /// The advanced arrays of the solver at the start.
    pub start: Values,
    /// One stride from them.
    pub predicted: Values,
}

/// A stride. Says why its result must not be used, where that is so.
pub(crate) fn predict(
    surrogate: &mut dyn Surrogate,
    start: Start,
    next: &mut Values,
) -> Result<Option<String>> {
    match surrogate.predict(start, next) {
        Ok(()) => Ok(None),
        Err(Error::Numerical(what)) => Ok(Some(what)),
        Err(e) => Err(e),
    }
}

/// The arrays that a surrogate advances, of all of a state.
pub(crate) fn advanced(surrogate: &dyn Surrogate, state: &Values) -> Values {
    surrogate.describe().advances.iter().map(|&i| state[i].clone()).collect()
}

impl Shadow {
    /// Predicts from the solver's present state. Says why the result must not be used, where that is so. Collective.
    pub fn begin(
        &mut self,
        surrogate: &mut dyn Surrogate,
        step: &Step,
        start: Start,
    ) -> Result<Option<String>> {
        self.start = advanced(surrogate, start.state);
        self.predicted = self.start.clone();
        let bad = predict(surrogate, start, &mut self.predicted)?;
        (self.finite, self.begun, self.waiting) = (bad.is_none(), step.time, true);
        self.idle = false;
        Ok(bad)
    }

    /// Waits for where the solver comes in a stride, without a prediction.
    pub fn begin_idle(&mut self, surrogate: &dyn Surrogate, step: &Step, state: &Values) {
        self.start = advanced(surrogate, state);
        self.predicted = self.start.clone();
        (self.finite, self.begun, self.waiting, self.idle) = (true, step.time, true, true);
    }

    /// Part of the stride that the solver has come, near 1.
    pub fn fraction(&self, step: &Step, stride: f64) -> f64 {
        let fraction = (step.time - self.begun) / stride;
        if (fraction - 1.0).abs() < SAME { 1.0 } else { fraction }
    }

    /// Whether this is the solver's time step nearest to the end of the stride.
    pub fn has_arrived(&self, step: &Step, stride: f64) -> bool {
        self.waiting && self.fraction(step, stride) > 1.0 - 0.5 * step.delta_t / stride
    }

    /// Compares with the solver's values of the advanced arrays where it has arrived, and ends. The error is no number where there was no
    /// prediction. Collective.
    pub fn compare(
        &mut self,
        comm: &Comm,
        fields: &[&Array],
        now: &Values,
        fraction: f64,
    ) -> Vec<StrideError> {
        let predicted = self.start.iter().zip(&self.predicted).zip(now);
        let off = predicted.map(|((old, new), now)| {
            let triples = old.iter().zip(new).zip(now);
            triples.map(|((o, n), s)| between(*o, *n, fraction) - s)
        });
        let error = rms(comm, fields, off);
        let pairs = now.iter().zip(&self.start);
        let change = rms(comm, fields, pairs.map(|(s, old)| s.iter().zip(old).map(|(a, b)| a - b)));
        let size = rms(comm, fields, now.iter().map(|s| s.iter().copied()));
        let levels = levels(comm, fields, now);
        let about = now.iter().zip(&levels);
        let variation = rms(comm, fields, about.map(|(s, level)| s.iter().map(move |v| v - level)));
        self.waiting = false;
        let rows = error.into_iter().zip(change).zip(size.into_iter().zip(variation));
        rows.map(|((error, change), (size, variation))| StrideError {
            error: match (self.idle, self.finite) {
                (true, _) => f64::NAN,
                (_, true) => error,
                _ => f64::INFINITY,
            },
            change,
            size,
            variation: variation.max(change),
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy, at};

    fn start(state: &Values) -> Start<'_> {
        Start { state, ahead: None, duration: 0.5 }
    }

    #[test]
    fn a_stride_is_compared_where_the_solver_arrives_between_two_strides() {
        let (comm, mut toy) = (Comm::serial(), Toy::new(0.5).biased(0.25));
        let layout = toy::layout();
        let mut shadow = Shadow::default();
        assert!(!shadow.has_arrived(&at(1.0, 0.2, 9.0, 0), 0.5), "nothing is under way");
        let bad = shadow.begin(&mut toy, &at(1.0, 0.2, 9.0, 0), start(&toy::state(1.0))).unwrap();
        assert_eq!(bad, None);
        // Steps of 0.2: that of 1.4 is nearest to 1.5, and 4/5 of the way.
        assert!(!shadow.has_arrived(&at(1.2, 0.2, 9.0, 1), 0.5));
        let step = at(1.4, 0.2, 9.0, 2);
        assert!(!shadow.has_arrived(&step, 0.5), "0.8 is not above 1 - 0.2");
        let step = at(1.6, 0.2, 9.0, 3);
        assert!(shadow.has_arrived(&step, 0.5));
        let fraction = shadow.fraction(&step, 0.5);
        assert!((fraction - 1.2).abs() < 1e-12);
        let now = advanced(&toy, &toy::state(1.6));
        let rows = shadow.compare(&comm, &layout.pick(&[0]), &now, fraction);
        // On paper: from the start along the chord to what was predicted, extended, against where the solver is.
        let chord = |i: usize| {
            let (start, end) = (toy::solver(1.0)[i], toy::solver(1.5)[i] + 0.25);
            start + 1.2 * (end - start) - toy::solver(1.6)[i]
        };
        let expected = ((chord(0).powi(2) + chord(1).powi(2)) / 2.0).sqrt();
        assert!((rows[0].error - expected).abs() < 1e-12, "{rows:?} {expected}");
        let size = toy::rms_of(&toy::solver(1.6));
        assert!((rows[0].size - size).abs() < 1e-12, "{rows:?} {size}");
        let half = (now[0][0] - now[0][1]).abs() / 2.0;
        assert!((rows[0].variation - half.max(rows[0].change)).abs() < 1e-12, "{rows:?} {half}");
        assert!(!shadow.waiting);
        assert_eq!(shadow.fraction(&at(1.5 + 1e-8, 0.2, 9.0, 0), 0.5), 1.0, "rounding");
    }

    #[test]
    fn errors_are_relative_to_what_varies_and_not_to_a_level() {
        let (comm, mut toy) = (Comm::serial(), Toy::new(0.5));
        let layout = toy::layout();
        let mut shadow = Shadow::default();
        // 300 K, and a tenth of a kelvin more in one of the cells.
        let warm = toy::of([300.0, 300.1]);
        shadow.begin(&mut toy, &at(1.0, 0.1, 9.0, 0), start(&warm)).unwrap();
        let rows = shadow.compare(&comm, &layout.pick(&[0]), &advanced(&toy, &warm), 1.0);
        assert!((rows[0].variation - 0.05).abs() < 1e-9 && rows[0].size > 300.0, "{rows:?}");
        // A field that is the same everywhere varies by what it changes.
        shadow.begin(&mut toy, &at(1.0, 0.1, 9.0, 0), start(&warm)).unwrap();
        let rows = shadow.compare(&comm, &layout.pick(&[0]), &vec![vec![302.0, 302.0]], 1.0);
        assert!((rows[0].variation - rows[0].change).abs() < 1e-12 && rows[0].change > 1.9, "{rows:?}");
    }

    #[test]
    fn a_prediction_that_is_not_finite_has_an_infinite_error() {
        let (comm, mut toy) = (Comm::serial(), Toy::new(0.5).broken_above(f64::NEG_INFINITY));
        let mut shadow = Shadow::default();
        let bad = shadow.begin(&mut toy, &at(1.0, 0.1, 9.0, 0), start(&toy::state(1.0))).unwrap();
        assert!(bad.is_some_and(|what| what.contains("not finite")));
        let rows = shadow.compare(&comm, &toy::layout().pick(&[0]), &advanced(&toy, &toy::state(1.5)), 1.0);
        assert_eq!(rows[0].error, f64::INFINITY);
        assert!(rows[0].change > 0.0);
    }
}
