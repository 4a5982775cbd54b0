//! Estimates as text.

use crate::estimate::Estimate;

impl Estimate {
    /// The mean in one line: `Cd 2.803 +- 0.012 (95 %), transient to 2.4 s, 41 independent samples`.
    pub fn line(&self, name: &str, confidence: f64) -> String {
        self.line_of(name, (self.mean, self.half_width), confidence)
    }

    /// The rms of the fluctuations in one line.
    pub fn rms_line(&self, name: &str, confidence: f64) -> String {
        self.line_of(&format!("{name} rms"), (self.rms, self.rms_half_width), confidence)
    }

    fn line_of(&self, name: &str, (value, half_width): (f64, f64), confidence: f64) -> String {
        let rests_on = match self.periods.filter(|_| self.periodic) {
            Some(periods) => format!("{periods} periods"),
            None => format!("{:.0} independent samples", self.independent_samples),
        };
        let drifts = match (self.mean_drifts, self.unvaried) {
            (true, _) => ", drifts",
            (false, true) => ", has kept its first value",
            (false, false) => "",
        };
        let from = match self.surrogate_share {
            0.0 => String::new(),
            share => format!(", {:.0} % of the time from a surrogate", 100.0 * share),
        };
        format!(
            "{name} {} ({} %), transient to {} s, {rests_on}{drifts}{from}",
            with_half_width(value, half_width),
            (1e6 * confidence).round() / 1e4,
            rounded(self.transient_end)
        )
    }
}

/// To four digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// Both numbers with as many decimals as the half-width has two digits.
pub fn with_half_width(value: f64, half_width: f64) -> String {
    let small = value != 0.0 && value.abs() < 1e-3;
    if !half_width.is_finite() || half_width <= 0.0 {
        return if small {
            format!("{value:.5e} +- {half_width}")
        } else {
            format!("{value:.6} +- {half_width}")
        };
    }
    match 1 - half_width.log10().floor() as i32 {
        decimals @ 0..=8 => {
            let decimals = decimals as usize;
            format!("{value:.decimals$} +- {half_width:.decimals$}")
        }
        9.. if !small => format!("{value:.8} +- {half_width:.1e}"),
        _ => format!("{value:.5e} +- {half_width:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::with_half_width;

    #[test]
    fn figures_have_the_digits_that_are_known() {
        assert_eq!(with_half_width(2.80312, 0.0123), "2.803 +- 0.012");
        assert_eq!(with_half_width(2.80312, 3.0), "2.8 +- 3.0");
        assert_eq!(with_half_width(28031.2, 456.0), "2.80312e4 +- 4.6e2");
        assert_eq!(with_half_width(0.5, 1e-14), "0.50000000 +- 1.0e-14");
        assert_eq!(with_half_width(0.5, f64::INFINITY), "0.500000 +- inf");
        assert_eq!(with_half_width(1.5e-12, 1e-14), "1.50000e-12 +- 1.0e-14");
        assert_eq!(with_half_width(-1.5e-7, f64::INFINITY), "-1.50000e-7 +- inf");
        assert_eq!(with_half_width(0.0, 0.0), "0.000000 +- 0");
    }
}
