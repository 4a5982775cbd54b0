//! How far the errors of a model's rollouts grow over those of its single strides, measured on recorded data: part of a
//! model's description (`m4gn calibrate` writes it). From it and one stride that solver and surrogate both take, a controller tells
//! how far a jump may go.

use m4gn_mesh::{Error, Result};
use serde::{Deserialize, Serialize};

/// Errors of one field in a rollout.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutErrors {
    /// Of the stride before it.
    pub before: f64,
    /// After 1, 2, ... strides.
    pub after: Vec<f64>,
}

impl RolloutErrors {
    /// Error after `i + 1` strides over that of the stride before; none for more strides than there are.
    pub fn growth(&self, i: usize) -> Option<f64> {
        self.after
            .get(i)
            .map(|error| error / self.before.max(f64::MIN_POSITIVE))
    }
}

/// Growth of one predicted field's errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Growth {
    /// Name of the field.
    pub field: String,
    /// Factor `i`: what the error of the stride before a rollout is to be multiplied with, so that the error after `i + 1` strides
    /// of the rollout is not more in the calibration's share of all cases. Does not fall with `i`.
    pub factors: Vec<f64>,
}

/// The growth of all predicted fields' errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Share of the rollouts whose errors are not larger than what the factors say.
    pub coverage: f64,
    /// Trajectories that it was measured on.
    pub trajectories: usize,
    /// Rollouts on them.
    pub rollouts: usize,
    /// Of each predicted field.
    pub growth: Vec<Growth>,
}

impl Calibration {
    /// From the errors of each field in all rollouts, which have as many strides each.
    ///
    /// The factor for a number of strides is the conformal quantile of the ratios: of `n` rollouts the ratio of rank
    /// `ceil(coverage (n + 1))` (split conformal prediction, Vovk et al. 2005).
    ///
    /// # Errors
    /// [`Error::Input`] for too few rollouts for this coverage, and for a coverage outside of 0 to 1.
    pub fn new(
        coverage: f64,
        trajectories: usize,
        fields: Vec<(String, Vec<RolloutErrors>)>,
    ) -> Result<Self> {
        if !(coverage > 0.0 && coverage < 1.0) {
            return Err(Error::Input(format!(
                "coverage {coverage}: expected a share above 0 and below 1"
            )));
        }
        let rollouts = fields.first().map_or(0, |f| f.1.len());
        let rank = (coverage * (rollouts + 1) as f64).ceil() as usize;
        if rank > rollouts {
            let least = (coverage / (1.0 - coverage)).ceil();
            return Err(Error::Input(format!(
                "{rollouts} rollouts are too few for a coverage of {coverage}: expected at least {least}"
            )));
        }
        let growth = fields.into_iter().map(|(field, cases)| {
            let strides = cases.iter().map(|c| c.after.len()).min().unwrap_or(0);
            let mut factors: Vec<f64> = (0..strides)
                .map(|i| {
                    let mut ratios: Vec<f64> = cases.iter().filter_map(|c| c.growth(i)).collect();
                    ratios.sort_by(f64::total_cmp);
                    ratios[rank - 1].min(f64::MAX)
                })
                .collect();
            for i in 1..factors.len() {
                factors[i] = factors[i].max(factors[i - 1]);
            }
            Growth { field, factors }
        });
        Ok(Calibration {
            coverage,
            trajectories,
            rollouts,
            growth: growth.collect(),
        })
    }

    /// The factors of a field; none where it was not measured.
    pub fn factors(&self, field: &str) -> Option<&[f64]> {
        let found = self.growth.iter().find(|g| g.field == field);
        found.map(|g| &g.factors[..]).filter(|f| !f.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine rollouts whose errors after one stride are 1 to 9 times that of the stride before, and after two twice that.
    fn nine() -> Vec<(String, Vec<RolloutErrors>)> {
        let one = |i: i32| RolloutErrors {
            before: 0.5,
            after: vec![0.5 * f64::from(i), f64::from(i)],
        };
        let cases = (1..=9).map(one).collect();
        vec![("U".into(), cases)]
    }

    #[test]
    fn the_quantile_is_that_of_rank_coverage_times_one_more_than_there_are() {
        let c = Calibration::new(0.8, 3, nine()).unwrap();
        assert_eq!((c.rollouts, c.trajectories), (9, 3));
        assert_eq!(c.factors("U"), Some(&[8.0, 16.0][..]));
        assert_eq!(c.factors("p"), None);
        let json = serde_json::to_string(&c).unwrap();
        assert_eq!(serde_json::from_str::<Calibration>(&json).unwrap(), c);
    }

    #[test]
    fn factors_do_not_fall_and_what_is_not_finite_stays_a_number() {
        let mut cases = nine();
        for case in &mut cases[0].1 {
            case.after = vec![f64::INFINITY, 0.1];
        }
        let c = Calibration::new(0.5, 3, cases).unwrap();
        assert_eq!(c.factors("U"), Some(&[f64::MAX, f64::MAX][..]));
    }

    #[test]
    fn too_few_rollouts_are_refused() {
        let text = Calibration::new(0.95, 3, nine()).unwrap_err().to_string();
        assert!(text.contains("at least 19"), "{text}");
        assert!(Calibration::new(1.0, 3, nine()).is_err());
    }
}
