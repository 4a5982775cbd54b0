//! Root-mean-square errors as Table 1 of the paper takes them: over nodes, components and time steps, unweighted. One
//! definition for the validations of `m4gn train`, for `m4gn validate`, `m4gn compare` and `m4gn hybrid`.

/// Recorded frames that RMSE-50 is over, in training as in `m4gn validate`.
pub const HORIZON: usize = 50;

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

    /// Of a mean square of one difference.
    pub fn of_mean(square: f64) -> Self {
        SquaredError { sum: square, count: 1 }
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

/// RMSE at the three horizons, in the unit of the field; infinite where a rollout became non-finite before, NaN where there is none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Figures {
    /// RMSE-1: single steps, from every recorded frame at the stride.
    pub rmse_1: f64,
    /// RMSE-50: the rollout from the first frame, over the steps within its first [`crate::HORIZON`] frames.
    pub rmse_50: f64,
    /// RMSE-all: over all its steps.
    pub rmse_all: f64,
}

impl Figures {
    /// Of one trajectory: errors of single steps and of the steps of the rollout, `steps` within the horizon and in all. `diverged`: whether the rollout
    /// ended early; one that is not there has no figures.
    pub fn of(single: &[SquaredError], rollout: &[SquaredError], steps: [usize; 2], diverged: bool) -> Self {
        let over = |errors: &[SquaredError]| {
            let mut total = SquaredError::default();
            errors.iter().for_each(|e| total.add(*e));
            if total.count > 0 { total.rmse() } else { f64::NAN }
        };
        let [rmse_50, rmse_all] = steps.map(|n| match rollout.get(..n.min(steps[1])) {
            Some(part) => over(part),
            None if rollout.is_empty() && !diverged => f64::NAN,
            None => f64::INFINITY,
        });
        Figures { rmse_1: over(single), rmse_50, rmse_all }
    }

    /// The mean over trajectories.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Figures> + Clone) -> Self {
        let count = all.clone().count() as f64;
        let mean = |of: fn(&Figures) -> f64| all.clone().map(of).sum::<f64>() / count;
        Figures { rmse_1: mean(|f| f.rmse_1), rmse_50: mean(|f| f.rmse_50), rmse_all: mean(|f| f.rmse_all) }
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
    fn figures_on_paper() {
        let errors = |of: &[f64]| of.iter().map(|e| SquaredError::of_mean(e * e)).collect::<Vec<_>>();
        let f = Figures::of(&errors(&[3.0, 4.0]), &errors(&[1.0, 7.0, 0.0]), [2, 3], false);
        assert_eq!((f.rmse_1, f.rmse_50, f.rmse_all), (12.5_f64.sqrt(), 5.0, (50.0_f64 / 3.0).sqrt()));
        // The horizon is longer than the rollout
        let f = Figures::of(&errors(&[3.0]), &errors(&[1.0, 7.0]), [9, 2], false);
        assert_eq!((f.rmse_50, f.rmse_all), (5.0, 5.0));
        let f = Figures::of(&errors(&[3.0]), &errors(&[1.0, 7.0]), [2, 3], true);
        assert_eq!((f.rmse_50, f.rmse_all), (5.0, f64::INFINITY));
        // A step that counts nothing, and no rollout
        let f = Figures::of(&[SquaredError::default()], &[], [2, 3], false);
        assert!(f.rmse_1.is_nan() && f.rmse_50.is_nan() && f.rmse_all.is_nan());
        let both = [
            Figures { rmse_1: 1.0, rmse_50: 2.0, rmse_all: 3.0 },
            Figures { rmse_1: 3.0, rmse_50: 4.0, rmse_all: 5.0 },
        ];
        assert_eq!(Figures::mean(both.iter()), Figures { rmse_1: 2.0, rmse_50: 3.0, rmse_all: 4.0 });
    }
}
