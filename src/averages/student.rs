//! Quantiles of Student's t distribution.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// The factor t for which a variable of Student's t distribution lies within -t and t with this probability; `freedom` need not be whole, and is taken
/// to be within 1 and 10000.
pub fn two_sided(probability: f64, freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.clamp(1.0, 1e4))
        .map_or(f64::INFINITY, |t| t.inverse_cdf(0.5 + 0.5 * probability))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (probability, freedom, t) in [
            (0.95, 1.0, 12.7062),
            (0.95, 2.0, 4.30265),
            (0.95, 7.0, 2.36462),
            (0.95, 30.0, 2.04227),
            (0.99, 10.0, 3.16927),
            (0.9, 5.0, 2.01505),
            (0.95, 1e6, 1.960_20),
        ] {
            let found = two_sided(probability, freedom);
            assert!((found / t - 1.0).abs() < 1e-5, "{probability} {freedom}: {found}, not {t}");
        }
        assert!((10.0..1e300).contains(&two_sided(1.0 - 1e-15, 3.0)));
        assert!(two_sided(0.95, 3.5) < two_sided(0.95, 3.0));
    }
}
