//! Where a run's start no longer shows.

/// Number of leading values to leave out, by the marginal standard error rule (MSER: White 1997; White, Cobb and Spratt 2000).
///
/// Of all starts up to the middle, the one from which the standard error of the mean is least: sum (v - mean)^2 / m^2 over the m
/// values from there on. It is the reverse standard error walked from the end. A later start must lower it by more than `slack` of it.
pub fn mser(values: &[f64], slack: f64) -> usize {
    let n = values.len();
    let (mut count, mut mean, mut squares) = (0.0, 0.0, 0.0);
    let mut errors = vec![0.0; n];
    for (i, v) in values.iter().enumerate().rev() {
        count += 1.0;
        let off = v - mean;
        mean += off / count;
        squares += off * (v - mean);
        errors[i] = squares / (count * count);
    }
    let last = n / 2;
    let least = errors[..=last.min(n.saturating_sub(1))].iter().copied().fold(f64::INFINITY, f64::min);
    let limit = least * (1.0 + slack);
    errors.iter().position(|e| *e <= limit).unwrap_or(0)
}
