//! Root-mean-square errors as Table 1 of the paper takes them: over nodes, components and time steps, unweighted. One
//! definition for `m4gn validate`, `m4gn compare`, `m4gn hybrid` and `mode observe`.

use serde::Serialize;

/// Sum of squared differences and their number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SquaredError {
    sum: f64,
    count: usize,
}

impl SquaredError {
    /// Of two lists of the same length, component by component.
    pub fn between<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> Self {
        let sum = a.iter().zip(b).map(|(&a, &b)| (a.into() - b.into()).powi(2)).sum();
        SquaredError { sum, count: a.len().min(b.len()) }
    }

    /// Of two lists of x, y, z, of which `dim` components are solved and the others are 0, by components.
    pub fn of_solved(a: &[f64], b: &[f64], dim: usize) -> Self {
        let all = SquaredError::between(a, b);
        SquaredError { count: all.count / 3 * dim, ..all }
    }

    /// Adds the other's differences.
    pub fn add(&mut self, other: SquaredError) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// Root of the mean square; 0 for no differences.
    pub fn rmse(&self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt()
    }
}

/// RMSE over steps 1 to i for each i: RMSE-1 is the first, RMSE-50 the fiftieth, RMSE-all the last.
pub fn cumulative(steps: &[SquaredError]) -> Vec<f64> {
    let mut total = SquaredError::default();
    let one = |step: &SquaredError| {
        total.add(*step);
        total.rmse()
    };
    steps.iter().map(one).collect()
}

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
    fn cumulative_values_on_paper() {
        // Two nodes, two components. Step 1: differences 1, 1, 1, 1; step 2: 3, 3, 3, 3; step 3: none.
        let zero = [0.0_f64; 4];
        let steps = [[1.0; 4], [3.0; 4], [0.0; 4]].map(|s| SquaredError::between(&s, &zero));
        let c = cumulative(&steps);
        assert_eq!(c[0], 1.0);
        assert!(
            (c[1] - 5.0_f64.sqrt()).abs() < 1e-15 && (c[2] - (10.0_f64 / 3.0).sqrt()).abs() < 1e-15,
            "{c:?}"
        );
        assert_eq!(SquaredError::between(&[1.0_f32, 2.0], &[1.0, 0.0]).rmse(), 2.0_f64.sqrt());
        assert_eq!(SquaredError::default().rmse(), 0.0);
    }

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
