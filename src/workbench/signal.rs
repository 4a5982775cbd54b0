//! Statistics of a signal.

/// Mean over time of the line through the values; of one time its value, 0 for none.
pub fn mean(times: &[f64], values: &[f64]) -> f64 {
    let weights = weights(times);
    let all: f64 = weights.iter().sum();
    weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>() / all.max(f64::MIN_POSITIVE)
}

/// Root mean square over time of the deviations from the mean.
pub fn fluctuation(times: &[f64], values: &[f64]) -> f64 {
    let m = mean(times, values);
    mean(times, &values.iter().map(|v| (v - m).powi(2)).collect::<Vec<_>>()).sqrt()
}

/// The time that each of these stands for: half of the intervals beside it.
fn weights(times: &[f64]) -> Vec<f64> {
    let n = times.len();
    if n < 2 {
        return vec![1.0; n];
    }
    (0..n).map(|i| 0.5 * (times[(i + 1).min(n - 1)] - times[i.saturating_sub(1)])).collect()
}

/// The middle value, or the mean of the two in the middle; none of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    (n > 0).then(|| 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_a_known_list() {
        let times = [0.0, 1.0, 3.0, 4.0];
        assert_eq!(mean(&times, &[1.0, 2.0, 6.0, 2.0]), (1.5 + 8.0 + 4.0) / 4.0);
        assert!((fluctuation(&times, &[1.0, -1.0, 1.0, -1.0]) - 1.0).abs() < 1e-15);
        assert_eq!((mean(&[], &[]), mean(&[1.0], &[5.0])), (0.0, 5.0));
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 9.0]), Some(3.0));
        assert_eq!(median([]), None);
    }
}
