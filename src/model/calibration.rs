//! How far the errors of a model's rollouts grow over those of its single strides, measured on recorded data: part of a
//! model's description (`m4gn calibrate` writes it). From it and one stride that solver and surrogate both take, a controller tells
//! how far a jump may go.

use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// Largest growth over one stride that means anything: beyond it no tolerance allows a jump, and the data hold what is out of range.
const MOST: f64 = 1e9;

/// Smallest growth that a file may have: errors do not shrink by that, and below it anything is let jump.
const LEAST: f64 = 1.0 / MOST;

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
        self.after.get(i).map(|error| error / self.before.max(f64::MIN_POSITIVE))
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

/// The growth of all predicted fields' errors. Entries of a file that are not known are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Share of the rollouts on a new trajectory, drawn like these, whose errors are not larger than what the factors say.
    pub coverage: f64,
    /// Trajectories that it was measured on.
    pub trajectories: usize,
    /// Rollouts on them.
    pub rollouts: usize,
    /// Of each predicted field.
    pub growth: Vec<Growth>,
}

impl Calibration {
    /// From the errors of each field in the rollouts on each trajectory, which have as many strides each.
    ///
    /// The factor for a number of strides is the conformal quantile of the ratios for data in groups: rollouts on one trajectory are
    /// alike, trajectories are independent. Of `n` trajectories each rollout weighs 1/(n + 1) over the number of rollouts on its
    /// trajectory, and the factor is the smallest ratio below which the weights come to `coverage` (hierarchical conformal
    /// prediction: Lee, Barber and Willett, arXiv 2306.06342). That cannot be more than n/(n + 1): with fewer trajectories than the
    /// coverage needs, the factors are the largest ratios, and the coverage is what that is worth.
    ///
    /// # Errors
    /// [`Error::Input`] for a coverage outside of 0 to 1, and where there is no rollout.
    pub fn new(coverage: f64, fields: Vec<(String, Vec<Vec<RolloutErrors>>)>) -> Result<Self> {
        if !(coverage > 0.0 && coverage < 1.0) {
            return Err(Error::Input(format!("coverage {coverage}: expected a share above 0 and below 1")));
        }
        let all = fields.first().map_or(&[][..], |f| &f.1[..]);
        let (trajectories, rollouts) = (all.len(), all.iter().map(Vec::len).sum());
        if rollouts == 0 || fields.iter().any(|f| f.1.iter().any(Vec::is_empty)) {
            return Err(Error::Input(
                "no rollouts to calibrate on: expected at least one on each trajectory".into(),
            ));
        }
        let coverage = coverage.min(Self::most(trajectories));
        let growth = fields.into_iter().map(|(field, groups)| {
            let cases = groups.iter().flatten();
            let strides = cases.map(|c| c.after.len()).min().unwrap_or(0);
            let mut factors: Vec<f64> = (0..strides).map(|i| quantile(&groups, i, coverage)).collect();
            for i in 1..factors.len() {
                factors[i] = factors[i].max(factors[i - 1]);
            }
            Growth { field, factors }
        });
        let calibration = Calibration { coverage, trajectories, rollouts, growth: growth.collect() };
        let first = |g: &&Growth| g.factors.first().is_some_and(|f| f.is_nan() || *f > MOST);
        match calibration.growth.iter().find(first) {
            None => Ok(calibration),
            Some(growth) => Err(Error::Numerical(format!(
                "errors of {} grow {:e} times in one stride: look for values that are out of range in the data",
                growth.field, growth.factors[0]
            ))),
        }
    }

    /// What is wrong in it, with the entry that it is about.
    pub(super) fn fault(&self) -> Option<String> {
        if !(0.0..1.0).contains(&self.coverage) {
            return Some(format!(
                "coverage: expected a share of at least 0 and below 1, found {}",
                self.coverage
            ));
        }
        self.growth.iter().find_map(|growth| {
            let factors = &growth.factors;
            let bad = |(i, f): &(usize, &f64)| !(**f >= LEAST && f.is_finite()) || *i > 0 && **f < factors[i - 1];
            let (i, factor) = factors.iter().enumerate().find(bad)?;
            Some(format!(
                "growth of {}, factor {i}: expected finite numbers of at least {LEAST:e} that do not fall, found {factor:e}",
                growth.field
            ))
        })
    }

    /// The largest coverage that so many trajectories can tell of.
    pub fn most(trajectories: usize) -> f64 {
        trajectories as f64 / (trajectories + 1) as f64
    }

    /// The factors of a field; none where it was not measured.
    pub fn factors(&self, field: &str) -> Option<&[f64]> {
        let found = self.growth.iter().find(|g| g.field == field);
        found.map(|g| &g.factors[..]).filter(|f| !f.is_empty())
    }
}

/// The smallest growth of errors over `i + 1` strides below which the weights of the rollouts come to `coverage`.
fn quantile(groups: &[Vec<RolloutErrors>], i: usize, coverage: f64) -> f64 {
    let weigh = |group: &Vec<RolloutErrors>| {
        let weight = 1.0 / (groups.len() + 1) as f64 / group.len() as f64;
        let ratios = group.iter().filter_map(|c| c.growth(i));
        ratios.map(|ratio| (ratio, weight)).collect::<Vec<_>>()
    };
    let mut ratios: Vec<(f64, f64)> = groups.iter().flat_map(weigh).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0.0;
    let reached = ratios.iter().find(|(_, weight)| {
        sum += weight;
        // Sums of weights are not exact
        sum >= coverage - 1e-9
    });
    reached.map_or(f64::MAX, |(ratio, _)| ratio.min(f64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rollout(growth: f64) -> RolloutErrors {
        RolloutErrors { before: 0.5, after: vec![0.5 * growth, growth] }
    }

    #[test]
    fn growth_that_means_nothing_is_refused() {
        let of = |factors: &[f64]| Calibration {
            coverage: 0.9,
            trajectories: 9,
            rollouts: 9,
            growth: vec![Growth { field: "U".into(), factors: factors.to_vec() }],
        };
        assert_eq!(of(&[0.5, 2.0, 2.0]).fault(), None);
        for bad in [&[0.0][..], &[1e-300, 1.0], &[-1.0], &[1.0, f64::INFINITY], &[f64::NAN], &[2.0, 1.0]] {
            let fault = of(bad).fault().unwrap();
            assert!(fault.contains("growth of U, factor"), "{fault}");
        }
        // One value of 1e38 in the data, whose square overflows.
        let mut rollouts: Vec<Vec<RolloutErrors>> = (1..=9).map(|i| vec![rollout(f64::from(i))]).collect();
        rollouts[8][0].after[0] = f64::INFINITY;
        m4gn_samples::fails(Calibration::new(0.9, vec![("U".into(), rollouts)]), &["errors of U grow"]);
    }

    /// Nine trajectories with a rollout each, whose errors after one stride are 1 to 9 times that of the stride before, and after
    /// two twice that.
    fn nine() -> Vec<(String, Vec<Vec<RolloutErrors>>)> {
        let groups = (1..=9).map(|i| vec![rollout(f64::from(i))]).collect();
        vec![("U".into(), groups)]
    }

    #[test]
    fn with_a_rollout_each_the_factor_is_that_of_rank_coverage_times_one_more_than_there_are() {
        let c = Calibration::new(0.8, nine()).unwrap();
        assert_eq!((c.rollouts, c.trajectories, c.coverage), (9, 9, 0.8));
        assert_eq!(c.factors("U"), Some(&[8.0, 16.0][..]));
        assert_eq!(c.factors("p"), None);
        let json = serde_json::to_string(&c).unwrap();
        assert_eq!(serde_json::from_str::<Calibration>(&json).unwrap(), c);
        let with_more = json.replacen('{', r#"{"carried":0.95,"#, 1);
        assert_eq!(serde_json::from_str::<Calibration>(&with_more).unwrap(), c);
    }

    #[test]
    fn rollouts_on_one_trajectory_weigh_as_one() {
        // Three trajectories: 1/4 each. Below 1 lie 1/4, below 2 lie 1/2, and of the third half below 3
        let groups = vec![vec![rollout(1.0); 100], vec![rollout(2.0)], vec![rollout(3.0), rollout(4.0)]];
        for (coverage, factor) in [(0.25, 1.0), (0.5, 2.0), (0.6, 3.0), (0.7, 4.0)] {
            let c = Calibration::new(coverage, vec![("U".into(), groups.clone())]).unwrap();
            assert_eq!(c.factors("U").unwrap()[0], factor, "{coverage}");
        }
    }

    #[test]
    fn the_coverage_is_no_more_than_the_trajectories_can_tell_of() {
        let c = Calibration::new(0.95, nine()).unwrap();
        assert_eq!((c.coverage, c.factors("U")), (0.9, Some(&[9.0, 18.0][..])));
    }

    #[test]
    fn factors_do_not_fall_and_what_is_not_finite_stays_a_number() {
        let mut cases = nine();
        for (second, factor) in [(0.1, 18.0), (f64::INFINITY, f64::MAX)] {
            for case in cases[0].1.iter_mut().flatten() {
                case.after = vec![9.0, second];
            }
            let c = Calibration::new(0.5, cases.clone()).unwrap();
            assert_eq!(c.factors("U"), Some(&[18.0, factor][..]));
        }
    }

    #[test]
    fn what_cannot_be_calibrated_on_is_refused() {
        assert!(Calibration::new(1.0, nine()).is_err());
        let empty = vec![("U".into(), vec![vec![]])];
        m4gn_samples::fails(Calibration::new(0.9, empty), &["at least one on each"]);
    }
}
