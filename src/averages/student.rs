//! Quantiles of Student's t distribution.

/// The factor t for which a variable of Student's t distribution lies within -t and t with this probability.
///
/// `freedom` need not be whole. By bisection of the distribution function, to 1e-7 of t; the incomplete beta function by its
/// continued fraction (Lentz's method, NIST DLMF 8.17.22).
pub fn two_sided(probability: f64, freedom: f64) -> f64 {
    let freedom = freedom.clamp(1e-3, 1e9);
    let outside = 1.0 - probability;
    let beyond = |t: f64| incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t));
    let (mut low, mut high) = (0.0, 1.0);
    while beyond(high) > outside && high < 1e12 {
        high *= 2.0;
    }
    while high - low > 1e-7 * high {
        let middle = 0.5 * (low + high);
        if beyond(middle) > outside { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that a variable of Student's t distribution lies farther from 0 than `t`.
pub fn beyond(t: f64, freedom: f64) -> f64 {
    if !t.is_finite() {
        return 0.0;
    }
    incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t))
}

/// Logarithm of the gamma function (Lanczos, 9 terms, g = 7) for x > 0.
fn ln_gamma(x: f64) -> f64 {
    const C: [f64; 8] = [
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    if x < 0.5 {
        return (std::f64::consts::PI / (std::f64::consts::PI * x).sin()).ln() - ln_gamma(1.0 - x);
    }
    let x = x - 1.0;
    let sum =
        C.iter().enumerate().fold(0.999_999_999_999_809_9, |sum, (i, c)| sum + c / (x + i as f64 + 1.0));
    let t = x + 7.5;
    0.5 * std::f64::consts::TAU.ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// The regularised incomplete beta function I_x(a, b).
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return f64::from(x >= 1.0);
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p();
    front.exp() / a * continued_fraction(a, b, x)
}

fn continued_fraction(a: f64, b: f64, x: f64) -> f64 {
    let kept = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let mut c = 1.0;
    let mut d = 1.0 / kept(1.0 - (a + b) * x / (a + 1.0));
    let mut sum = d;
    for m in 1..10_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a - 1.0 + 2.0 * m) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 1.0 + 2.0 * m));
        let mut factor = 1.0;
        for term in [even, odd] {
            d = 1.0 / kept(1.0 + term * d);
            c = kept(1.0 + term / c);
            factor = c * d;
            sum *= factor;
        }
        if (factor - 1.0).abs() < 1e-14 {
            break;
        }
    }
    sum
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
            (0.95, 1e6, 1.959_966),
        ] {
            let found = two_sided(probability, freedom);
            assert!((found / t - 1.0).abs() < 1e-5, "{probability} {freedom}: {found}, not {t}");
            assert!((beyond(found, freedom) - (1.0 - probability)).abs() < 1e-6);
        }
        assert!(two_sided(0.95, 3.5) < two_sided(0.95, 3.0));
    }
}
