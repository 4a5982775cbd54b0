//! Line charts as SVG.

use m4gn_base::{Error, Result};
use plotters::prelude::*;

/// A curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Text of the legend.
    pub name: String,
    /// x, y; non-finite points break the line.
    pub points: Vec<(f64, f64)>,
    /// Colour.
    pub colour: (u8, u8, u8),
    /// Whether each point is a dot, without a line through them.
    pub dots: bool,
}

/// The colours of curves: told apart by colour-blind people too (Okabe and Ito).
pub const BLUE: (u8, u8, u8) = (0, 114, 178);
/// See [`BLUE`].
pub const ORANGE: (u8, u8, u8) = (213, 94, 0);
/// See [`BLUE`].
pub const GREY: (u8, u8, u8) = (120, 120, 120);

impl Series {
    /// A curve through `x`, `y`.
    pub fn new(name: &str, x: &[f64], y: &[f64], colour: (u8, u8, u8)) -> Self {
        Series {
            name: name.into(),
            points: x.iter().copied().zip(y.iter().copied()).collect(),
            colour,
            dots: false,
        }
    }
}

/// Curves over a common axis.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Text under the x axis, with the unit.
    pub x_label: String,
    /// Text beside the y axis, with the unit.
    pub y_label: String,
    /// Curves, drawn in this order.
    pub series: Vec<Series>,
    /// What the axes show.
    pub axis: Axis,
}

/// What the y axis of a chart shows, and the x axis where that is not the range of the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The range of the values.
    Range,
    /// The range of the values and zero.
    FromZero,
    /// The logarithm of the values, on both axes; those that are not positive break the line.
    Logarithmic,
}

impl Axis {
    /// The place of a value on an axis: of a logarithmic one its exponent of ten, NaN where there is none.
    fn place(self, value: f64) -> f64 {
        match self {
            Axis::Logarithmic if value > 0.0 => value.log10(),
            Axis::Logarithmic => f64::NAN,
            Axis::Range | Axis::FromZero => value,
        }
    }

    /// The label of a tick on an axis that spans `range`.
    fn label(self, place: f64, range: f64) -> String {
        match self {
            Axis::Logarithmic => power(place),
            Axis::Range | Axis::FromZero => tick(place, range),
        }
    }
}

/// The label of a tick at an exponent of ten: two digits. The places of ticks are sums, and off by rounding.
fn power(exponent: f64) -> String {
    let exponent = (exponent * 1e9).round() / 1e9;
    let unit = 10f64.powf(exponent.floor() - 1.0);
    super::number((10f64.powf(exponent) / unit).round() * unit, 2)
}

const WIDTH: u32 = 900;
const HEIGHT: u32 = 320;
/// Names in a row of the legend.
const PER_ROW: usize = 5;

impl Chart {
    /// The chart as an SVG document.
    pub fn svg(&self) -> Result<String> {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        self.draw(&area).map_err(|e| Error::Internal(format!("chart of {}: {e}", self.y_label)))?;
        drop(area);
        Ok(svg)
    }

    /// The points of a curve as they are drawn: of a logarithmic axis, the exponents of ten.
    fn drawn(&self, series: &Series) -> Vec<(f64, f64)> {
        let place = |&(x, y): &(f64, f64)| (self.axis.place(x), self.axis.place(y));
        series.points.iter().map(place).collect()
    }

    fn range(&self, of: impl Fn(&(f64, f64)) -> f64) -> Option<(f64, f64)> {
        let points: Vec<(f64, f64)> = self.series.iter().flat_map(|s| self.drawn(s)).collect();
        let values = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()).map(of);
        values.fold(None, |range: Option<(f64, f64)>, v| {
            Some(range.map_or((v, v), |(l, h)| (l.min(v), h.max(v))))
        })
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, plotters::coord::Shift>,
    ) -> std::result::Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        area.fill(&WHITE)?;
        let rows = match self.series.len() {
            0 | 1 => 0,
            n => n.div_ceil(PER_ROW),
        };
        let (legend, area) = &area.split_vertically(30 * rows as u32);
        let (x_low, x_high) = self.range(|p| p.0).unwrap_or((0.0, 1.0));
        let (mut low, mut high) = self.range(|p| p.1).unwrap_or((0.0, 1.0));
        if self.axis == Axis::FromZero {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        let margin = if high > low { 0.06 * (high - low) } else { 0.5 * high.abs().max(1e-12) };
        let floor = if self.axis == Axis::FromZero && low == 0.0 { 0.0 } else { low - margin };
        let x_high = if x_high > x_low { x_high } else { x_low + 1.0 };
        // Dots stand clear of the frame.
        let (x_low, x_high) = match self.series.iter().any(|s| s.dots) {
            true if self.axis == Axis::Logarithmic => (x_low - 0.1, x_high + 0.1),
            true => (x_low - 0.05 * (x_high - x_low), x_high + 0.05 * (x_high - x_low)),
            false => (x_low, x_high),
        };
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_right(30)
            .x_label_area_size(42)
            .y_label_area_size(72)
            .build_cartesian_2d(x_low..x_high, floor..high + margin)?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .label_style(("sans-serif", 14))
            .axis_desc_style(("sans-serif", 15))
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(225, 225, 225))
            .x_label_formatter(&|v| self.axis.label(*v, x_high - x_low))
            .y_label_formatter(&|v| self.axis.label(*v, high - low))
            .draw()?;
        let colour = |series: &Series| RGBColor(series.colour.0, series.colour.1, series.colour.2);
        for series in &self.series {
            let colour = colour(series);
            let points = self.drawn(series);
            if series.dots {
                let places = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
                chart.draw_series(places.map(|&p| Circle::new(p, 4, colour.filled())))?;
                continue;
            }
            for run in points.split(|p| !(p.0.is_finite() && p.1.is_finite())) {
                chart.draw_series(LineSeries::new(run.iter().copied(), colour.stroke_width(2)))?;
            }
        }
        // Above the curves, where it hides none of them.
        if self.series.len() > 1 {
            for (i, series) in self.series.iter().enumerate() {
                let left = 90 + 160 * (i % PER_ROW) as i32;
                let top = 30 * (i / PER_ROW) as i32;
                let line = [(left, top + 18), (left + 26, top + 18)];
                legend.draw(&PathElement::new(line, colour(series).stroke_width(2)))?;
                legend.draw(&Text::new(series.name.as_str(), (left + 34, top + 11), ("sans-serif", 15)))?;
            }
        }
        area.present()
    }
}

/// A tick's label: what is zero up to rounding is zero, and no trailing zeros.
fn tick(value: f64, range: f64) -> String {
    let text = super::number(if value.abs() < 1e-9 * range { 0.0 } else { value }, 4);
    match text.contains('.') && !text.contains('e') {
        true => text.trim_end_matches('0').trim_end_matches('.').into(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_holds_its_labels_and_survives_gaps_and_empty_series() {
        let chart = Chart {
            x_label: "t [s]".into(),
            y_label: "RMSE [m/s]".into(),
            series: vec![
                Series::new("hybrid", &[0.0, 1.0, 2.0], &[0.0, f64::NAN, 2.0], BLUE),
                Series::new("hold", &[], &[], GREY),
                Series { dots: true, ..Series::new("cases", &[0.5, f64::NAN], &[1.0, 1.0], ORANGE) },
            ],
            axis: Axis::FromZero,
        };
        let svg = chart.svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("RMSE [m/s]") && svg.contains("hybrid"));
        assert!(!svg.contains("NaN"));
        assert_eq!(svg.matches("<circle").count(), 1);
    }

    /// A power law is a straight line: equal distances in x and in y.
    #[test]
    fn two_logarithmic_axes_make_a_line_of_a_power_law() {
        let chart = Chart {
            x_label: "cells".into(),
            y_label: "ms".into(),
            series: vec![Series {
                dots: true,
                ..Series::new("law", &[1e3, 1e4, 1e5, 0.0], &[1.0, 100.0, 1e4, 1.0], BLUE)
            }],
            axis: Axis::Logarithmic,
        };
        let svg = chart.svg().unwrap();
        for text in ["1000", "10000", "100"] {
            assert!(svg.lines().any(|line| line == text), "{text}: {svg}");
        }
        let places: Vec<[i32; 2]> = svg
            .split("<circle")
            .skip(1)
            .map(|circle| {
                ["cx=\"", "cy=\""].map(|key| {
                    let (_, rest) = circle.split_once(key).unwrap();
                    rest.split('"').next().unwrap().parse().unwrap()
                })
            })
            .collect();
        assert_eq!(places.len(), 3, "{svg}");
        for axis in 0..2 {
            let steps = [1, 2].map(|i| places[i][axis] - places[i - 1][axis]);
            assert!(steps[0].abs() > 50 && (steps[0] - steps[1]).abs() <= 1, "{places:?}");
        }
    }
}
