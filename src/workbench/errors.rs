//! Errors of a field of a run beside those of holding the last true field.

use m4gn_train::errors::{SquaredError, cumulative};
use serde::Serialize;

/// Errors of a field of a run over time, in the field's unit, beside those of holding the last true field.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FieldErrors {
    /// RMSE over times 1 to i.
    pub rmse: Vec<f64>,
    /// The same for the held field.
    pub hold_last_rmse: Vec<f64>,
    /// RMSE at each time alone.
    pub error: Vec<f64>,
    /// The same for the held field.
    pub hold_last_error: Vec<f64>,
    /// Root mean square of the true field over all times.
    pub rms: f64,
}

/// A field while the times go by.
#[derive(Debug)]
pub struct Track {
    held: Vec<f64>,
    run: Vec<SquaredError>,
    hold: Vec<SquaredError>,
    square: SquaredError,
}

impl Track {
    /// Begins with the true field that is held.
    pub fn new(held: Vec<f64>) -> Self {
        Track { held, run: Vec::new(), hold: Vec::new(), square: SquaredError::default() }
    }

    /// The true field and the run's at the next time.
    pub fn add(&mut self, truth: &[f64], found: &[f64]) {
        self.run.push(SquaredError::between(truth, found));
        self.hold.push(SquaredError::between(truth, &self.held));
        self.square.add(SquaredError::between(truth, &vec![0.0; truth.len()]));
    }

    /// All times.
    pub fn finish(&self) -> FieldErrors {
        let each = |all: &[SquaredError]| all.iter().map(SquaredError::rmse).collect();
        FieldErrors {
            rmse: cumulative(&self.run),
            hold_last_rmse: cumulative(&self.hold),
            error: each(&self.run),
            hold_last_error: each(&self.hold),
            rms: self.square.rmse(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_beside_the_one_that_is_held() {
        let mut track = Track::new(vec![0.0, 0.0]);
        track.add(&[1.0, 1.0], &[1.0, 1.0]);
        track.add(&[3.0, 3.0], &[5.0, 5.0]);
        let found = track.finish();
        assert_eq!((found.error, found.hold_last_error), (vec![0.0, 2.0], vec![1.0, 3.0]));
        assert_eq!((found.rmse[1], found.hold_last_rmse[1]), (2.0_f64.sqrt(), 5.0_f64.sqrt()));
        assert_eq!(found.rms, 5.0_f64.sqrt());
    }
}
