//! Mean, fluctuations and frequency of a series, and how well they are known.

use crate::autoregression::{Scatter, batches, scatter};
use crate::series::{Row, Series};
use crate::{settling, spectrum, student, transient};

/// What a series says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Mean after the transient.
    pub mean: f64,
    /// Half of the width of the mean's confidence interval; infinite where it is not known.
    pub half_width: f64,
    /// Root mean square of the deviations from the mean.
    pub rms: f64,
    /// Half of the width of the rms's confidence interval.
    pub rms_half_width: f64,
    /// Change of the mean over the record by the straight line that fits best.
    pub mean_change: f64,
    /// The same of the rms.
    pub rms_change: f64,
    /// Dominant frequency, 1/s, where something oscillates.
    pub frequency: Option<f64>,
    /// Frequencies closer than this are not told apart, 1/s.
    pub frequency_resolution: Option<f64>,
    /// Time at which the transient ends, s.
    pub transient_end: f64,
    /// Number of independent values whose mean would be known as well.
    pub independent_samples: f64,
    /// Degrees of freedom of the mean's interval; infinite where it follows from no scatter.
    pub freedom: f64,
    /// Whole periods that the mean is taken over, where the signal repeats itself or oscillates.
    pub periods: Option<usize>,
    /// Whether each period is like the one before.
    pub periodic: bool,
    /// Whether the mean neither drifts nor rests on a transient or on too few samples.
    pub mean_steady: bool,
    /// Whether the mean drifts.
    pub mean_drifts: bool,
    /// As `mean_steady`, of the fluctuations.
    pub rms_steady: bool,
    /// Share of the time after the transient whose rows came from a surrogate, 0 to 1.
    pub surrogate_share: f64,
    /// Whether the first value is that of all rows, but for rounding: it may be of what the flow has not reached.
    pub unvaried: bool,
    /// Rows of the series.
    pub rows: usize,
}

/// Fewest rows that are looked at.
pub const MIN_ROWS: usize = 16;
/// Most values that a series is reduced to for its transient.
const TRANSIENT_VALUES: usize = 256;
/// Share by which a later start must lower the standard error.
const TRANSIENT_SLACK: f64 = 0.1;
/// Most values that a series is reduced to for the scatter of its mean.
const SCATTER_VALUES: usize = 512;
/// Share of the variance from which the mean is taken over whole periods.
const OSCILLATES: f64 = 0.5;
/// Share of the variance from which a frequency is told.
const HAS_FREQUENCY: f64 = 0.3;
/// Root mean square of the change from period to period, over that of the fluctuations, below which a signal repeats itself.
const REPEATS: f64 = 0.05;
/// Fewest independent samples of a mean that is known, unless the signal repeats itself or settles.
const MIN_SAMPLES: f64 = 60.0;
/// Fewest degrees of freedom of the same.
const MIN_FREEDOM: f64 = 15.0;
/// A run stops when an interval is narrow, and intervals are narrow too often where their variance was found too small. They are
/// wider by so many standard deviations of their own width.
const CAUTION_MEAN: f64 = 1.0;
/// The same for squares, whose distribution is skewed.
const CAUTION_SQUARE: f64 = 3.0;
/// Periods from which on the means of a signal that repeats itself are all that its mean can be: few of them look like the slowest memory.
const MIN_PERIODS: usize = 8;
/// Half-width of the mean of a signal that repeats itself, over its rms, below which it is not told: what its periods still change by.
const FINEST: f64 = 2e-4;
/// Largest deviation of a sine from its mean, over its rms: what a share of a record that is missing, or too much, moves the mean by.
const PEAK: f64 = std::f64::consts::SQRT_2;
/// Half-width of a record at rest, which counts no samples, over that by its samples, up to which it is taken: these are one or two then.
const FEW_SAMPLES: f64 = 4.0;
/// Change over the record, over the rms of the fluctuations, below which a drift widens the interval and no more.
const DRIFTS: f64 = 0.02;

/// What is known of one mean: of the values, or of the squares of their fluctuations.
struct Known {
    half_width: f64,
    of_mean: f64,
    freedom: f64,
    change: f64,
    drifts: bool,
}

/// The part of a record that figures are taken from.
struct Record {
    /// Where it begins and ends, in time that the rows stand for.
    range: (f64, f64),
    /// Number of equal pieces for the scatter: whole periods where there are some.
    pieces: usize,
    periods: Option<usize>,
    /// Share of itself that it is shorter than so many periods.
    lacks: f64,
    line: Option<Oscillation>,
    /// Whether the transient may not have ended.
    over: bool,
}

/// Estimates of a series at this confidence (0.95: 19 of 20 intervals have the true value within them).
///
/// The transient of values and of their squares is cut by MSER ([`crate::transient::mser`]), from the end over whole periods where more than half of the
/// variance is at one frequency. The interval of the mean is the wider one of two of Student's: with variance and degrees of freedom of
/// [`scatter`] of up to 512 means of equal pieces, and of eight batches of them ([`batches`]), which see what is slow. The rms is the root of the mean square, whose interval is found in the same way. A mean drifts if the slope
/// of those pieces is beyond what their scatter about it allows at this confidence.
///
/// A record whose transient takes more than half of it, or whose figures drift, may have settled all the same: to a signal that repeats itself
/// ([`settling::to_repetition`]), or to a value (a steady solver's, [`settling::to_value`]). One that rests but for a solver's noise has no independent
/// samples to speak of, and is known by what it ranges over ([`settling::at_rest`]).
///
/// None for fewer than 16 rows, and for values whose squares are no numbers.
pub fn estimate(series: &Series, confidence: f64) -> Option<Estimate> {
    if series.len() < MIN_ROWS {
        return None;
    }
    let square = |centre: f64| move |r: &Row| (r.value - centre).powi(2);
    let record = record(series);
    let (range, n) = (record.range, record.pieces);
    let mean = series.mean(range, |r| r.value);
    let power = series.mean(range, square(mean));
    if !power.is_finite() || !(mean * mean).is_finite() {
        return None;
    }
    // What is less is rounding
    if power <= 1e-24 * mean * mean {
        let unvaried = settling::spread(series, (0.0, series.duration())) <= 0.0;
        return Some(Estimate { unvaried, ..constant(series, range, mean) });
    }
    let (values, squares) = (series.pieces(range, n, |r| r.value), series.pieces(range, n, square(mean)));
    let mut of_mean = known(&values, confidence, CAUTION_MEAN, DRIFTS * power.sqrt())?;
    let mut of_square = known(&squares, confidence, CAUTION_SQUARE, 2.0 * DRIFTS * power)?;
    let periodic = record.periods.is_some_and(|p| repeats(series, range, p, power));
    if periodic && n >= MIN_PERIODS {
        of_mean.half_width = of_mean.half_width.min(extent(&values));
        of_square.half_width = of_square.half_width.min(extent(&squares));
    }
    if periodic {
        let least = finest(series, range, record.lacks);
        of_mean.half_width = of_mean.half_width.max(least * power.sqrt());
        of_square.half_width = of_square.half_width.max(least * power);
    }
    let variance = power + of_mean.of_mean;
    if !variance.is_finite() || !of_square.half_width.is_finite() {
        return None;
    }
    let rms = variance.sqrt();
    let rows = series.within(range).len() as f64;
    let independent = if of_mean.of_mean > 0.0 { (variance / of_mean.of_mean).min(rows) } else { rows };
    let enough = |known: &Known| {
        periodic || known.of_mean <= 0.0 || (independent >= MIN_SAMPLES && known.freedom >= MIN_FREEDOM)
    };
    let frequency = record.line.filter(|l| l.share >= HAS_FREQUENCY && (periodic || l.periods >= 4.0));
    // Of a signal that repeats itself to the last digit any start that is later looks better
    let over = record.over && !periodic;
    let found = Estimate {
        mean,
        half_width: of_mean.half_width,
        rms,
        rms_half_width: rms - (variance - of_square.half_width).max(0.0).sqrt(),
        mean_change: of_mean.change,
        rms_change: of_square.change / (2.0 * rms),
        frequency: frequency.map(|l| l.periods / l.record),
        frequency_resolution: frequency.map(|l| 1.0 / l.record),
        transient_end: series.time_at(range.0),
        independent_samples: independent,
        freedom: of_mean.freedom,
        periods: record.periods,
        periodic,
        mean_drifts: of_mean.drifts,
        mean_steady: !over && !of_mean.drifts && enough(&of_mean),
        rms_steady: !over && !of_square.drifts && !of_mean.drifts && enough(&of_square),
        surrogate_share: series.mean(range, |r| f64::from(r.surrogate)),
        unvaried: false,
        rows: series.len(),
    };
    let steady = found.mean_steady && found.rms_steady;
    if steady && !record.over {
        return Some(found);
    }
    let better = |e: &Estimate| {
        !steady || (e.half_width <= found.half_width && e.rms_half_width <= found.rms_half_width)
    };
    let value = || settling::to_value(series).filter(|_| over || found.mean_drifts);
    let found = settling::to_repetition(series).filter(better).or_else(value).unwrap_or(found);
    let few = |(_, half_width): &((f64, f64), f64)| *half_width <= FEW_SAMPLES * found.half_width;
    let rest = if found.mean_steady { None } else { settling::at_rest(series).filter(few) };
    Some(match rest {
        Some((range, half_width)) => Estimate {
            mean: series.mean(range, |r| r.value),
            half_width,
            mean_change: 0.0,
            mean_steady: true,
            mean_drifts: false,
            transient_end: series.time_at(range.0),
            surrogate_share: series.mean(range, |r| f64::from(r.surrogate)),
            periods: None,
            ..found
        },
        None => found,
    })
}

/// Cuts the transient, and to whole periods.
fn record(series: &Series) -> Record {
    let end = series.duration();
    let last_half = series.mean((0.5 * end, end), |r| r.value);
    let all = TRANSIENT_VALUES.min(series.len());
    let (mut from, mut over) = transient_end(series, (0.0, end), all, last_half);
    let line = oscillation(series, (from, end));
    let Some(found) = line.filter(|l| l.share >= OSCILLATES && l.periods >= 2.0) else {
        let pieces = SCATTER_VALUES.min(series.len() / 2).max(2);
        return Record { range: (from, end), pieces, periods: None, lacks: 0.0, line, over };
    };
    let period = (end - from) / found.periods;
    // A period that lacks a fiftieth counts: its length is not known better
    let whole = |time: f64| (time / period + 0.02).floor();
    if whole(end) >= 5.0 {
        let first = (end - whole(end) * period).max(0.0);
        (from, over) = transient_end(series, (first, end), whole(end) as usize, last_half);
    }
    let periods = whole(end - from).max(1.0) as usize;
    let each = periods.div_ceil(SCATTER_VALUES);
    let pieces = periods / each;
    let whole = (pieces * each) as f64 * period;
    from = (end - whole).max(0.0);
    let lacks = (whole / (end - from) - 1.0).max(0.0);
    Record { range: (from, end), pieces, periods: Some(pieces * each), lacks, line, over }
}

/// Where the transient of the values and of their fluctuations ends, and whether that is so late that it may not have ended.
///
/// Twice the length that MSER cuts: there, what decays exponentially has left as much as the scatter hides, and a mean of hundreds of values shows it.
fn transient_end(series: &Series, (from, to): (f64, f64), n: usize, centre: f64) -> (f64, bool) {
    let values = series.pieces((from, to), n, |r| r.value);
    let squares = series.pieces((from, to), n, |r| (r.value - centre).powi(2));
    let cut = [values, squares].iter().map(|v| transient::mser(v, TRANSIENT_SLACK)).max().unwrap_or(0);
    (from + (2 * cut).min(n / 2) as f64 / n as f64 * (to - from), cut >= n / 2)
}

#[derive(Clone, Copy)]
pub(crate) struct Oscillation {
    pub(crate) periods: f64,
    pub(crate) share: f64,
    pub(crate) record: f64,
}

pub(crate) fn oscillation(series: &Series, (from, to): (f64, f64)) -> Option<Oscillation> {
    let rows = (series.len() as f64 * (to - from) / to) as usize;
    let values = series.pieces((from, to), rows.clamp(8, spectrum::MOST_VALUES), |r| r.value);
    let line = spectrum::dominant(&values)?;
    Some(Oscillation { periods: line.periods, share: line.share, record: to - from })
}

/// The interval of the mean of these values, and whether they drift.
fn known(values: &[f64], confidence: f64, caution: f64, small: f64) -> Option<Known> {
    let found = scatter(values).filter(|s| s.of_mean.is_finite())?;
    let student = |s: &Scatter| student::two_sided(confidence, s.freedom) * s.of_mean.sqrt();
    let wider = 1.0 + caution / (2.0 * found.freedom).sqrt();
    let few = batches(values);
    let half_width = few.as_ref().map_or(0.0, student).max(student(&found) * wider);
    let of_mean = few.map_or(0.0, |s| s.of_mean).max(found.of_mean);
    let freedom = found.freedom;
    let n = values.len() as f64;
    let change = n * spectrum::line(values).1.abs();
    let significant = values.len() >= 3 && of_mean > 0.0 && {
        let rest = scatter(&spectrum::about_line(values))?;
        let error = (12.0 * rest.of_mean * (n - 1.0) / (n - 2.0)).sqrt();
        // The line has taken a degree of freedom from the residuals
        change > error * student::two_sided(confidence, (rest.freedom - 1.0).max(1.0))
    };
    let half_width = if significant { half_width + change } else { half_width };
    Some(Known { half_width, of_mean, freedom, change, drifts: significant && change > small })
}

/// Half-width of the mean of a signal that repeats itself, over its rms, and of the mean of its squares, over their mean: no end of a period is known
/// better than to a row, and a record may lack a share of itself.
pub(crate) fn finest(series: &Series, range: (f64, f64), lacks: f64) -> f64 {
    FINEST.max(PEAK * (lacks + 1.0 / series.within(range).len().max(1) as f64))
}

/// Largest less least.
pub(crate) fn extent(values: &[f64]) -> f64 {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    high - low
}

/// Whether each of the periods in the range is like the one before.
pub(crate) fn repeats(series: &Series, range: (f64, f64), periods: usize, variance: f64) -> bool {
    const POINTS: usize = 16;
    if periods < 2 || variance <= 0.0 {
        return false;
    }
    let values = series.pieces(range, POINTS * periods, |r| r.value);
    let changes = values[POINTS..].iter().zip(&values).map(|(now, before)| (now - before).powi(2));
    let count = (values.len() - POINTS) as f64;
    changes.sum::<f64>() / count <= 2.0 * REPEATS * REPEATS * variance
}

/// The estimate of values that do not change within the range.
pub(crate) fn constant(series: &Series, range: (f64, f64), mean: f64) -> Estimate {
    Estimate {
        mean,
        transient_end: series.time_at(range.0),
        independent_samples: series.within(range).len() as f64,
        freedom: f64::INFINITY,
        mean_steady: true,
        rms_steady: true,
        surrogate_share: series.mean(range, |r| f64::from(r.surrogate)),
        rows: series.len(),
        ..Estimate::default()
    }
}

#[cfg(test)]
#[path = "estimate_tests.rs"]
mod tests;
