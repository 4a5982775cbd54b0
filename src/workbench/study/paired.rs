//! The errors of two networks on the same trajectories: their mean difference and its interval.

use m4gn_averages::student::two_sided;
use serde::Serialize;
use std::collections::BTreeMap;

/// A mean of paired differences, and the ends of its interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Paired {
    pub part: f64,
    pub low: f64,
    pub high: f64,
}

impl Paired {
    /// Of the errors' logarithms, of the network and of the other: a list a seed, of the same trajectories. Other trajectories and other seeds would both
    /// give another mean, so that their variances add (degrees of freedom: Welch-Satterthwaite).
    pub fn of(own: &[BTreeMap<&str, f64>], other: &[BTreeMap<&str, f64>]) -> Option<Self> {
        let mut by_seed = Vec::new();
        let mut by_trajectory: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (own, other) in own.iter().zip(other) {
            let pairs: Vec<_> =
                own.iter().filter_map(|(&path, e)| Some((path, e - other.get(path)?))).collect();
            // A seed without a pair has no mean
            if !pairs.is_empty() {
                by_seed.push(mean(pairs.iter().map(|p| p.1)));
            }
            pairs.iter().for_each(|&(path, d)| by_trajectory.entry(path).or_default().push(d));
        }
        let by_trajectory: Vec<f64> = by_trajectory.into_values().map(|d| mean(d.into_iter())).collect();
        if by_trajectory.len() < 2 {
            return None;
        }
        let middle = mean(by_trajectory.iter().copied());
        let [(a, freedom_a), (b, freedom_b)] = [&by_trajectory, &by_seed].map(|means| {
            let (n, center) = (means.len() as f64, mean(means.iter().copied()));
            let square: f64 = means.iter().map(|d| (d - center).powi(2)).sum();
            (square / (n * (n - 1.0)).max(1.0), (n - 1.0).max(1.0))
        });
        let half_width = match a + b > 0.0 {
            true => {
                two_sided(0.95, (a + b).powi(2) / (a * a / freedom_a + b * b / freedom_b)) * (a + b).sqrt()
            }
            false => 0.0,
        };
        let [part, low, high] = [middle, middle + half_width, middle - half_width].map(|x| 1.0 - x.exp());
        (part.is_finite() && low.is_finite()).then_some(Paired { part, low, high })
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    values.sum::<f64>() / n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paired_differences_have_the_interval_of_students_t() {
        let list = |values: &[f64]| -> BTreeMap<&str, f64> {
            ["a", "b", "c"].into_iter().zip(values.iter().copied()).collect()
        };
        let [zero, twice] = [vec![list(&[0.0; 3])], vec![list(&[0.0; 3]); 2]];
        // One seed: -.1 +- 4.303 (.1/sqrt(3))
        let paired = Paired::of(&[list(&[-0.2, -0.1, 0.0])], &zero).unwrap();
        let half = 4.302_65 * 0.1 / 3f64.sqrt();
        for (found, logarithm) in [(paired.part, -0.1), (paired.low, -0.1 + half), (paired.high, -0.1 - half)]
        {
            assert!((found - (1.0 - f64::exp(logarithm))).abs() < 1e-5, "{paired:?}");
        }
        // A second seed of other trajectories tells nothing
        let apart = [list(&[-0.2, -0.1, 0.0]), BTreeMap::from([("z", 1.0)])];
        assert_eq!(Paired::of(&apart, &twice), Some(paired));
        // Two seeds that differ, on trajectories that do not: -.1 +- 12.706 (.1)
        let paired = Paired::of(&[list(&[0.0; 3]), list(&[-0.2; 3])], &twice).unwrap();
        assert!((paired.low - (1.0 - f64::exp(-0.1 + 1.270_62))).abs() < 1e-4, "{paired:?}");
        let alike = Paired::of(&zero, &zero).unwrap();
        assert_eq!(alike, Paired { part: 0.0, low: 0.0, high: 0.0 });
        assert_eq!(Paired::of(&[BTreeMap::from([("a", 1.0)])], &zero), None);
    }
}
