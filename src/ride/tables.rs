//! Tables and messages: figures as a stream of C++ has them, columns as OpenFOAM's function objects have them.

/// Wider than the digits of a figure: its sign, point and exponent.
const MORE: usize = 8;

/// Figures with so many significant digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digits(pub usize);

impl Digits {
    /// As `%g` of C has it.
    pub fn of(self, value: f64) -> String {
        if value == 0.0 || !value.is_finite() {
            return match value {
                v if v.is_nan() => "nan".into(),
                v if v.is_infinite() => if v > 0.0 { "inf" } else { "-inf" }.into(),
                _ => "0".into(),
            };
        }
        let digits = self.0.max(1) as i32;
        let text = format!("{value:.*e}", digits as usize - 1);
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        let exponent: i32 = exponent.parse().unwrap_or(0);
        if exponent < -4 || exponent >= digits {
            let sign = if exponent < 0 { '-' } else { '+' };
            return format!("{}e{sign}{:02}", trimmed(mantissa), exponent.abs());
        }
        trimmed(&format!("{value:.*}", (digits - 1 - exponent) as usize)).to_string()
    }

    /// Lines that say what a table is, and one with the names of its columns.
    pub fn header(self, lines: &[String], values: &[(&str, String)], columns: &[String]) -> String {
        let width = self.0 + MORE;
        let mut text = String::new();
        for line in lines {
            text += &format!("# {line:<w$}\n", w = width - 2);
        }
        for (name, value) in values {
            text += &format!("# {name:<w$}: {value}\n", w = width - 2);
        }
        for (i, name) in columns.iter().enumerate() {
            text += &match i {
                0 => format!("# {name:<w$}", w = width - 2),
                _ => format!("\t{name:<width$}"),
            };
        }
        text + "\n"
    }
}

fn trimmed(number: &str) -> &str {
    match number.contains('.') {
        true => number.trim_end_matches('0').trim_end_matches('.'),
        false => number,
    }
}

/// The rows of a table, after each other.
pub(crate) fn row(columns: &[String]) -> String {
    columns.join("\t") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_a_stream() {
        let d = Digits(6);
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (0.05, "0.05"),
            (123_456.0, "123456"),
            (1_234_567.0, "1.23457e+06"),
            (0.000_123_456_78, "0.000123457"),
            (0.000_012_345_678, "1.23457e-05"),
            (-2.5e-300, "-2.5e-300"),
            (9.999_999, "10"),
            (999_999.9, "1e+06"),
            (100.0, "100"),
            (f64::INFINITY, "inf"),
            (f64::NEG_INFINITY, "-inf"),
            (f64::NAN, "nan"),
        ] {
            assert_eq!(d.of(value), text, "{value}");
        }
        assert_eq!(Digits(12).of(0.1 + 0.2), "0.3");
        assert_eq!(Digits(17).of(0.1), "0.10000000000000001");
    }

    #[test]
    fn a_header_is_as_wide_as_its_figures() {
        let text = Digits(6).header(
            &["What it is".into()],
            &[("stride (s)", "0.05".into())],
            &["Time".into(), "steps".into()],
        );
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "# What it is  ");
        assert_eq!(lines[1], "# stride (s)  : 0.05");
        assert_eq!(lines[2], "# Time        \tsteps         ");
    }
}
