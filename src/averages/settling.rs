//! Records whose end is known before their start-up is half of them: what settles to a value, or to a repeating signal.

use crate::Series;
use crate::estimate::{Estimate, Oscillation, constant, extent, finest, oscillation, repeats};

/// Largest ratio of successive changes of what settles.
const SETTLES: f64 = 0.7;
/// Share of its whole range within which a record has settled to a value.
const SETTLED: f64 = 0.01;
/// Range of a later part of a record over that of an earlier one, up to which it rests.
const RESTS: f64 = 1.1;
/// Shares of the record, at its end, in which a repeating signal is looked for.
const ENDS: [f64; 3] = [0.5, 0.35, 0.25];
/// Fewest periods in such an end, which is cut into this many blocks of whole periods.
const BLOCKS: usize = 4;
/// Periods of the strongest line that a signal may take to repeat itself: the drag of a wake that is not symmetric takes two.
const LINES: [usize; 2] = [1, 2];
/// Mean square of the values just before such an end, about its mean and over its own, above which the end is no more than a pause.
const LINGERS: f64 = 20.0;
/// Share of the variance at one frequency and its harmonics, above which blocks of whole periods say something of the mean.
const ONE_LINE: f64 = 0.5;
/// Largest range of the blocks' means, over the rms, and of their mean squares, over the mean square, that is taken for all that they vary by.
const SAME: f64 = 0.02;

/// The estimate of a record that settles to one value; none of another.
///
/// The last four eighths range over less and less: the mean is that of the last eighth, and the interval holds all that a geometric series of
/// ranges leaves, which is at most a hundredth of the whole range.
pub(crate) fn to_value(series: &Series) -> Option<Estimate> {
    let end = series.duration();
    let edge = |k: usize| (1.0 - k as f64 / 8.0) * end;
    let ranges: Vec<f64> = (1..=4).rev().map(|k| spread(series, (edge(k), edge(k - 1)))).collect();
    let ratio = ratio(&ranges);
    let range = (edge(1), end);
    let mean = series.mean(range, |r| r.value);
    let left = ranges[3] / (1.0 - ratio);
    let few = ranges.iter().any(|r| !r.is_finite());
    (!few && ratio <= SETTLES && left <= SETTLED * spread(series, (0.0, end))).then(|| Estimate {
        half_width: left,
        rms: series.mean(range, |r| (r.value - mean).powi(2)).sqrt(),
        rms_half_width: f64::INFINITY,
        rms_steady: false,
        ..constant(series, range, mean)
    })
}

/// The end of a record that rests, but for a solver's noise, and how far its mean may be from the true one; none of another.
///
/// What moves on ranges over twice as much in its last half as in the quarter before, and over four times as much in its last three quarters as in the
/// three sixteenths before; what slows down as a root, over 1.4 and 2 times as much. A record that rests does not. Its interval holds ten times what the
/// three quarters range over.
pub(crate) fn at_rest(series: &Series) -> Option<((f64, f64), f64)> {
    let end = series.duration();
    let over = |from: f64, to: f64| spread(series, (from * end, to * end));
    let (start, last) = (over(0.0625, 0.25), over(0.25, 1.0));
    let rests = start.is_finite() && last <= RESTS * start && over(0.5, 1.0) <= RESTS * over(0.25, 0.5);
    rests.then_some(((0.25 * end, end), 10.0 * last))
}

/// The estimate of a record whose end repeats itself, or comes to; none of another.
///
/// Of the longest end in which each period is like the one before: four blocks of whole periods. Mean and mean square are those of the last block. Their
/// intervals hold twice what the blocks differ by where that is little, or all that a geometric series of their changes leaves. Where no end repeats
/// itself, the mean alone may be known, from blocks that come nearer and nearer to it.
pub(crate) fn to_repetition(series: &Series) -> Option<Estimate> {
    let end = series.duration();
    let lines = ENDS.iter().filter_map(|share| oscillation(series, ((1.0 - share) * end, end)));
    let ends: Vec<End> =
        lines.flat_map(|line| LINES.map(|lines| End::of(series, line, lines))).flatten().collect();
    ends.iter()
        .find_map(|end| end.repeated(series))
        .or_else(|| ends.iter().find_map(|end| end.approached(series)))
}

/// The end of a record, in blocks of whole periods.
struct End {
    line: Oscillation,
    /// Periods of the line that a signal takes to repeat itself, and in a block.
    lines: usize,
    periods: usize,
    range: (f64, f64),
    last: (f64, f64),
    mean: f64,
    power: f64,
    means: Vec<f64>,
}

impl End {
    /// The end that has this line, in blocks of so many of its periods, or whole multiples of it.
    fn of(series: &Series, line: Oscillation, lines: usize) -> Option<Self> {
        let end = series.duration();
        let period = line.record / line.periods;
        let periods = (line.periods + 0.02) as usize / (lines * BLOCKS) * lines;
        let begin = |blocks: usize| (end - (blocks * periods) as f64 * period).max(0.0);
        let (range, last) = ((begin(BLOCKS), end), (begin(1), end));
        let mean = series.mean(last, |r| r.value);
        let power = series.mean(last, |r| (r.value - mean).powi(2));
        let means = series.pieces(range, BLOCKS, |r| r.value);
        // Not where a signal lingers that was elsewhere just before
        let before = ((2.0 * range.0 - end).max(0.0), range.0);
        let lingers = series.mean(before, |r| (r.value - mean).powi(2)) > LINGERS * power;
        (periods > 0 && power > 1e-24 * mean * mean && !lingers).then_some(End {
            line,
            lines,
            periods,
            range,
            last,
            mean,
            power,
            means,
        })
    }

    fn repeated(&self, series: &Series) -> Option<Estimate> {
        if !repeats(series, self.range, self.periods / self.lines * BLOCKS, self.power) {
            return None;
        }
        let squares = series.pieces(self.range, BLOCKS, |r| (r.value - self.mean).powi(2));
        let rms = self.power.sqrt();
        let least = finest(series, self.last, 0.0);
        let of_square = left(&squares, SAME * self.power)?.max(least * self.power);
        Some(Estimate {
            rms_half_width: rms - (self.power - of_square).max(0.0).sqrt(),
            rms_change: (squares[BLOCKS - 1] - squares[BLOCKS - 2]) / (2.0 * rms),
            rms_steady: true,
            frequency: Some(self.line.periods / self.line.record),
            frequency_resolution: Some(1.0 / self.line.record),
            periods: Some(self.periods),
            periodic: true,
            ..self.known(series, left(&self.means, SAME * rms)?.max(least * rms))
        })
    }

    fn approached(&self, series: &Series) -> Option<Estimate> {
        let known = |half_width| self.known(series, half_width);
        approach(&self.means).filter(|_| self.line.share >= ONE_LINE).map(known)
    }

    /// With the mean alone.
    fn known(&self, series: &Series, half_width: f64) -> Estimate {
        Estimate {
            half_width,
            rms: self.power.sqrt(),
            rms_half_width: f64::INFINITY,
            rms_steady: false,
            mean_change: self.means[BLOCKS - 1] - self.means[BLOCKS - 2],
            transient_end: series.time_at(self.range.0),
            ..constant(series, self.last, self.mean)
        }
    }
}

/// Largest ratio of a value to the one before it.
fn ratio(values: &[f64]) -> f64 {
    values.windows(2).map(|v| if v[1] > 0.0 { v[1] / v[0] } else { 0.0 }).fold(0.0, f64::max)
}

/// How far the last of these values may be from the one that they come to, at least a quarter of `little`; none where they do not.
fn left(values: &[f64], little: f64) -> Option<f64> {
    let range = extent(values);
    let changes: Vec<f64> = values.windows(2).map(|v| (v[1] - v[0]).abs()).collect();
    let ratio = ratio(&changes);
    let geometric = changes.last()? * ratio / (1.0 - ratio).max(1e-12);
    match (ratio <= SETTLES, range <= little) {
        (true, true) => Some(geometric.max(0.5 * range).max(0.25 * little)),
        (true, false) => Some(2.0 * geometric),
        (false, true) => Some((2.0 * range).max(0.25 * little)),
        (false, false) => None,
    }
}

/// As [`left`], of values that come nearer and nearer from one side: no less than what they range over.
fn approach(values: &[f64]) -> Option<f64> {
    let changes: Vec<f64> = values.windows(2).map(|v| v[1] - v[0]).collect();
    let nearer = changes.windows(2).all(|c| c[0] * c[1] > 0.0 && c[1] / c[0] <= SETTLES);
    nearer.then(|| left(values, 0.0).map(|l| l.max(extent(values)))).flatten()
}

/// Largest less least value of the rows within the range, 0 where they differ by no more than rounding; infinite for too few rows.
pub(crate) fn spread(series: &Series, range: (f64, f64)) -> f64 {
    let values: Vec<f64> = series.within(range).iter().map(|r| r.value).collect();
    let size = values.iter().fold(0.0, |size: f64, v| size.max(v.abs()));
    match values.len() < 8 {
        true => f64::INFINITY,
        false => Some(extent(&values)).filter(|e| *e > 1e-12 * size).unwrap_or(0.0),
    }
}
