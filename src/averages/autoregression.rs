//! The variance of a mean of values that follow each other.

/// What the values of a stationary series say of their mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Variance of the mean.
    pub of_mean: f64,
    /// Degrees of freedom of that variance, for Student's t.
    pub freedom: f64,
}

/// Highest order that is tried.
const MAX_ORDER: usize = 10;
/// Values for each coefficient at least.
const VALUES_PER_ORDER: usize = 10;

/// Values that are averaged for the next coarser look at a series.
const COARSER: usize = 4;
/// Fewest values of a coarser look.
const FEWEST: usize = 24;

/// The variance of the mean of `values`, at the time scale that shows most of it.
///
/// A slow part of small variance hides behind a fast one at the lags that [`of_values`] looks at, and shows in means of 4 and of 16 values
/// (batch means; Flyvbjerg and Petersen 1989 look for the plateau in the same way). A coarser look counts if its variance is larger by more
/// than a standard deviation.
///
/// None for fewer than 2 values.
pub fn scatter(values: &[f64]) -> Option<Scatter> {
    let mut found = of_values(values)?;
    let fine = found.of_mean;
    let mut coarse = values.to_vec();
    while coarse.len() / COARSER >= FEWEST {
        coarse = coarse.chunks_exact(COARSER).map(|c| c.iter().sum::<f64>() / COARSER as f64).collect();
        let look = of_values(&coarse)?;
        if look.of_mean > fine.max(found.of_mean) * (2.0 / look.freedom).sqrt().exp() {
            found = look;
        }
    }
    Some(found)
}

/// Number of [`batches`].
const BATCHES: usize = 8;

/// The variance of the mean of `values` by the scatter of eight batches, which a slow part of small variance cannot hide from.
///
/// None for fewer than 16 values; the first ones are left out where eight does not divide their number.
pub fn batches(values: &[f64]) -> Option<Scatter> {
    let size = values.len() / BATCHES;
    let whole = &values[values.len() - BATCHES * size..];
    let means: Vec<f64> =
        whole.chunks_exact(size.max(1)).map(|c| c.iter().sum::<f64>() / size as f64).collect();
    (size >= 2).then(|| of_values(&means)).flatten()
}

/// The variance of the mean of `values` by an autoregressive spectral estimate at frequency 0.
///
/// Coefficients by Burg's recursion; the order is that of the least corrected Akaike criterion. With the coefficients a_j and the
/// innovations' variance s2, the variance of the mean of n values is s2 / (1 - sum a_j)^2 / n. The variance of the logarithm of this
/// estimate follows from that of the coefficients (delta method; 1' G^-1 1 by the formula of Gohberg and Semencul), gives the degrees
/// of freedom, and corrects the bias that comes from taking the mean from the values themselves, which for one coefficient near 1 is
/// as large (Kendall 1954). No more than Student's t of the values where none is correlated.
///
/// None for fewer than 2 values.
fn of_values(values: &[f64]) -> Option<Scatter> {
    let n = values.len();
    if n < 2 {
        return None;
    }
    let count = n as f64;
    let mean = values.iter().sum::<f64>() / count;
    let centred: Vec<f64> = values.iter().map(|v| v - mean).collect();
    let power = centred.iter().map(|v| v * v).sum::<f64>() / count;
    let white = Scatter { of_mean: power / (count - 1.0), freedom: count - 1.0 };
    if power <= 0.0 {
        return Some(white);
    }
    let highest = MAX_ORDER.min(n / VALUES_PER_ORDER);
    let mut best = (criterion(power, n, 0), white);
    burg(&centred, power, highest, |coefficients, innovation| {
        let order = coefficients.len();
        let value = criterion(innovation, n, order);
        if value < best.0 {
            best = (value, of_coefficients(coefficients, innovation, count));
        }
    });
    Some(best.1)
}

fn criterion(innovation: f64, n: usize, order: usize) -> f64 {
    let (n, parameters) = (n as f64, order as f64 + 2.0);
    n * innovation.max(f64::MIN_POSITIVE).ln() + 2.0 * parameters * n / (n - parameters - 1.0).max(1.0)
}

fn of_coefficients(a: &[f64], innovation: f64, n: f64) -> Scatter {
    let order = a.len();
    let gain = (1.0 - a.iter().sum::<f64>()).max(1e-6);
    // 1' G^-1 1 times the innovations' variance
    let (mut c, mut d, mut quadratic) = (0.0, 0.0, 0.0);
    for i in 0..order {
        c += if i == 0 { 1.0 } else { -a[i - 1] };
        d -= a[order - 1 - i];
        quadratic += c * c - d * d;
    }
    let of_coefficients = 4.0 * quadratic.max(0.0) / (n * gain * gain);
    let innovation = innovation * n / (n - order as f64 - 1.0).max(1.0);
    Scatter {
        of_mean: innovation / (gain * gain) / n * of_coefficients.min(4.0).exp(),
        freedom: (2.0 / (2.0 / (n - 1.0) + of_coefficients)).max(1.0),
    }
}

/// Burg's recursion: tells the coefficients and the variance of the innovations of each order from 1 on.
fn burg(values: &[f64], power: f64, highest: usize, mut tell: impl FnMut(&[f64], f64)) {
    let n = values.len();
    let (mut forward, mut backward) = (values.to_vec(), values.to_vec());
    let mut a: Vec<f64> = Vec::new();
    let mut innovation = power;
    for order in 1..=highest {
        let pairs = || (order..n).map(|i| (forward[i], backward[i - 1]));
        let above: f64 = pairs().map(|(f, b)| f * b).sum();
        let below: f64 = pairs().map(|(f, b)| f * f + b * b).sum();
        if below <= 0.0 {
            return;
        }
        let k = (2.0 * above / below).clamp(-1.0, 1.0);
        let previous = a.clone();
        a.iter_mut().zip(previous.iter().rev()).for_each(|(a, other)| *a -= k * other);
        a.push(k);
        innovation *= 1.0 - k * k;
        for i in (order..n).rev() {
            let (f, b) = (forward[i], backward[i - 1]);
            forward[i] = f - k * b;
            backward[i] = b - k * f;
        }
        if innovation <= 1e-14 * power {
            return;
        }
        tell(&a, innovation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn independent_values_have_the_error_of_the_textbook() {
        let found = scatter(&[1.0, 2.0, 4.0, 5.0]).unwrap();
        // 10 / 3 / 4
        assert!((found.of_mean - 10.0 / 12.0).abs() < 1e-12 && found.freedom == 3.0, "{found:?}");
        assert_eq!(scatter(&[2.0; 50]).unwrap().of_mean, 0.0);
        assert_eq!(scatter(&[2.0]), None);
        // Batches of two each: the textbook's error of their means
        let values: Vec<f64> = (0..17).map(f64::from).collect();
        let found = batches(&values).unwrap();
        assert!((found.of_mean - 24.0 / 8.0).abs() < 1e-12 && found.freedom == 7.0, "{found:?}");
        assert_eq!(batches(&values[..15]), None);
    }

    #[test]
    fn the_variance_of_a_known_autoregression() {
        // 1' G^-1 1 s2 of one coefficient is 1 - a^2; the variance of the mean of n values s2 / (1 - a)^2 / n
        let found = of_coefficients(&[0.6], 1.0, 1000.0);
        let of_a: f64 = 4.0 * (1.0 - 0.36) / (1000.0 * 0.16);
        let expected = 1000.0 / 998.0 / 0.16 / 1000.0 * of_a.exp();
        assert!((found.of_mean / expected - 1.0).abs() < 1e-12, "{found:?}");
        assert!((found.freedom - 2.0 / (2.0 / 999.0 + of_a)).abs() < 1e-9, "{found:?}");
        let mut process = crate::processes::Process::new(crate::processes::Kind::Ar(0.6), 1, false);
        let values: Vec<f64> = (0..20_000).map(|_| process.next_row().1 - 2.0).collect();
        let mut orders = Vec::new();
        burg(&values, 1.0, 2, |a, innovation| orders.push((a.to_vec(), innovation)));
        assert!((orders[0].0[0] - 0.6).abs() < 0.02 && orders[1].0[1].abs() < 0.02, "{orders:?}");
        assert!((orders[0].1 - 0.64).abs() < 0.02, "{orders:?}");
    }
}
