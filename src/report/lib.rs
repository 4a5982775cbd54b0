//! What people look at: self-contained HTML pages with tables, charts (SVG) and pictures of fields (PNG), and files
//! for ParaView.

pub mod chart;
pub mod page;
pub mod picture;
pub mod series;
pub mod table;
pub mod vtu;

pub use chart::{Chart, Series};
pub use page::Page;
pub use picture::{CellMap, Snapshot};
pub use table::Table;
pub use vtu::Grid;

pub use m4gn_base::files::write_whole as write_file;

/// A number with `digits` significant digits, without an exponent where that reads better.
pub fn number(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-4..7).contains(&exponent) {
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.*e}", digits.saturating_sub(1))
    }
}

/// As [`number`]; "-" for none.
pub fn figure(value: Option<f64>, digits: usize) -> String {
    number(value.unwrap_or(f64::NAN), digits)
}

/// A fraction as a percentage; "-" for none.
pub fn percent(value: Option<f64>) -> String {
    match value {
        Some(v) if v.is_finite() => format!("{} %", number(100.0 * v, 3)),
        _ => "-".into(),
    }
}

/// A time, s, without the digits of rounding.
pub fn seconds(time: f64) -> String {
    format!("{time:.9e}").parse::<f64>().map_or("-".into(), |time| time.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_digits() {
        assert_eq!(number(0.012345, 3), "0.0123");
        assert_eq!(number(1234.5, 3), "1234");
        assert_eq!(number(1.5e-9, 2), "1.5e-9");
        assert_eq!(number(f64::NAN, 3), "-");
        assert_eq!(percent(Some(0.0123)), "1.23 %");
        assert_eq!(percent(None), "-");
        assert_eq!(seconds(0.1 + 0.2), "0.3");
        assert_eq!(seconds(2.5e-10), "0.00000000025");
    }
}
