//! Numbers of the command line that have a range; one outside of it is bad usage.

type Parsed<T> = std::result::Result<T, String>;

fn number(text: &str, within: impl Fn(f64) -> bool, expected: &str) -> Parsed<f64> {
    text.parse::<f64>().ok().filter(|v| within(*v)).ok_or_else(|| format!("expected {expected}"))
}

pub fn above_zero(text: &str) -> Parsed<f64> {
    number(text, |v| v.is_finite() && v > 0.0, "a number above 0")
}

pub fn share(text: &str) -> Parsed<f64> {
    number(text, |v| v > 0.0 && v < 1.0, "a number between 0 and 1, without them")
}

/// Of a solver, s.
pub fn time(text: &str) -> Parsed<f64> {
    number(text, |v| v.is_finite() && v >= 1e-6, "a time of at least 1e-6 s")
}

pub fn poisson(text: &str) -> Parsed<f64> {
    number(text, |v| (0.0..=0.49).contains(&v), "a number from 0 to 0.49")
}

pub fn count(text: &str) -> Parsed<usize> {
    text.parse::<usize>().ok().filter(|n| *n > 0).ok_or_else(|| "expected a whole number, at least 1".into())
}
