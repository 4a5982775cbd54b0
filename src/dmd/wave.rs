//! The leading wave of the last snapshots: its frequency from a fit, its amplitude and growth by least squares beside a drift. The growth of a
//! fit's mode is none of an amplitude that saturates: more modes make up for that.

use crate::choose::{hold, score};
use crate::dmd::{Delayed, Dmd, Window};
use std::f64::consts::{PI, SQRT_2, TAU};

/// Snapshots of the fits that a wave is found and raised with: two to three periods of a wave of seven to ten snapshots.
pub(crate) const WINDOW: usize = 20;

/// Delays and directions of these fits.
const DELAYS: usize = 8;
const RANK: usize = 12;

/// Snapshots by which two fits are apart that must agree, and by how much their frequencies may differ.
pub(crate) const APART: usize = 2;
const ANGLE: f64 = 0.05;

/// Error of the snapshots that are held back from the earlier of two fits, over that of holding, up to which they count.
const HELD_BACK: f64 = 0.25;

/// Periods that an amplitude is taken over, and least and usual number of periods between two amplitudes that give a growth. A growth a period
/// below the last number is taken over all snapshots.
const OVER: f64 = 1.4;
const BETWEEN: f64 = 0.5;
const APART_BY: f64 = 0.8;
const LITTLE: f64 = 0.06;

/// What a wave and a drift leave of the states at most, over the wave.
const LEFT: f64 = 0.15;

/// The leading wave of the last snapshots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leading {
    /// A stride.
    pub growth: f64,
    /// Radians a stride; above 0.
    pub angle: f64,
    /// Square of its amplitude where the growth is taken.
    pub square: f64,
    /// Strides from there to the end.
    pub lag: f64,
    /// At the end.
    pub amplitude: f64,
}

impl Leading {
    /// Growth in a period.
    pub fn rate(&self) -> f64 {
        self.growth * TAU / self.angle
    }

    /// Root mean square of the wave, over that of what the fields vary by.
    pub fn size(&self) -> f64 {
        self.amplitude / SQRT_2
    }
}

/// A fit, its amplitudes at the end of the window, and the radians a stride of its leading wave; none where nothing oscillates.
pub(crate) fn leading(window: &Window) -> Option<(Dmd, Vec<[f64; 2]>, f64)> {
    let dmd = Delayed::new(window, DELAYS, RANK)?.modes(RANK, true)?;
    let places = 0..=window.len() - DELAYS;
    let history = |i: usize| (i..i + DELAYS).map(|row| window.row(row)).collect::<Vec<_>>();
    let course: Vec<Vec<[f64; 2]>> = places.map(|i| dmd.amplitudes(&history(i))).collect();
    let square = |k: usize| course.iter().map(|a| a[k][0] * a[k][0] + a[k][1] * a[k][1]).sum::<f64>();
    let angle = |k: usize| dmd.eigenvalues()[k][1].atan2(dmd.eigenvalues()[k][0]);
    // A wave that is slower than the window is long is a drift.
    let least = TAU / window.len() as f64;
    let waves = (0..dmd.eigenvalues().len()).filter(|&k| angle(k) > least && square(k).is_finite());
    let k = waves.max_by(|&a, &b| square(a).total_cmp(&square(b)))?;
    let (now, angle) = (course.last()?.clone(), angle(k));
    Some((dmd, now, angle))
}

/// A wave of this angle and a drift of this degree in some of the snapshots, by least squares: its amplitude in the middle, and what both leave,
/// over the wave.
fn wave(window: &Window, range: std::ops::Range<usize>, angle: f64, degree: i32) -> (f64, f64) {
    let n = range.len();
    let time = |i: usize| i as f64 - (n as f64 - 1.0) / 2.0;
    let column = |of: &dyn Fn(f64) -> f64| (0..n).map(|i| of(time(i))).collect::<Vec<f64>>();
    let mut columns: Vec<Vec<f64>> = (0..=degree).map(|d| column(&|t| (t / n as f64).powi(d))).collect();
    columns.push(column(&|t| (angle * t).cos()));
    columns.push(column(&|t| (angle * t).sin()));
    // Orthonormal columns; r: of the last two by themselves.
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let (m, mut r) = (columns.len(), [[0.0; 2]; 2]);
    for k in 0..m {
        for _ in 0..2 {
            for l in 0..k {
                let share = dot(&columns[l], &columns[k]);
                if l + 2 >= m {
                    r[0][1] += share;
                }
                let other = columns[l].clone();
                columns[k].iter_mut().zip(&other).for_each(|(x, y)| *x -= share * y);
            }
        }
        let length = dot(&columns[k], &columns[k]).sqrt();
        if k + 2 >= m {
            r[k + 2 - m][k + 2 - m] = length;
        }
        columns[k].iter_mut().for_each(|x| *x /= length);
    }
    let product = |a: &[f64], b: &[f64]| -> f64 {
        (0..n).map(|i| a[i] * dot(&window.row(range.start + i)[range.clone()], b)).sum()
    };
    let whole: f64 = range.clone().map(|i| window.row(i)[i]).sum();
    let left = whole - columns.iter().map(|q| product(q, q)).sum::<f64>();
    // Coefficients of the last two: R^-1 Q^T x
    let inverse = [[1.0 / r[0][0], -r[0][1] / (r[0][0] * r[1][1])], [0.0, 1.0 / r[1][1]]];
    let last = &columns[m - 2..];
    let square: f64 = inverse
        .iter()
        .map(|row| {
            let q: Vec<f64> = (0..n).map(|i| row[0] * last[0][i] + row[1] * last[1][i]).collect();
            product(&q, &q)
        })
        .sum();
    (square.max(0.0).sqrt(), left.max(0.0) / n as f64 / (0.5 * square).max(f64::MIN_POSITIVE))
}

/// The wave of the last snapshots, where two fits say the same of its frequency, the earlier one foretells what comes, and growth is the same
/// beside a drift that bends and one that does not.
pub(crate) fn clear(window: &Window) -> Option<Leading> {
    let n = window.len();
    let part = |from: usize| leading(&window.part(from..from + WINDOW));
    let last = window.part(n - WINDOW - APART..n);
    let ((dmd, _, earlier), (_, _, found)) = part(n - WINDOW - APART).zip(part(n - WINDOW))?;
    // What the earlier fit does not foretell is no wave, or not one alone.
    let foretold = score(&last, &dmd, APART).0 < HELD_BACK * HELD_BACK * hold(&last, APART);
    if !foretold || (found - earlier).abs() > ANGLE * found {
        return None;
    }
    // The frequency with which least is left
    let tries = (-5..=5).map(|i| found * (1.0 + 0.01 * f64::from(i)));
    let left = |angle: f64| wave(window, n - WINDOW..n, angle, 1).1;
    let angle = tries.min_by(|&a, &b| left(a).total_cmp(&left(b)))?;
    let period = TAU / angle;
    let length = (OVER * period).round().max(DELAYS as f64) as usize;
    if (length as f64 + BETWEEN * period) as usize > n {
        return None;
    }
    let taken = |between: usize| {
        let course = |degree: i32| {
            [n - length - between, n - length].map(|from| wave(window, from..from + length, angle, degree))
        };
        let growth = |[first, last]: [(f64, f64); 2]| (last.0 / first.0).ln() / between as f64;
        let (straight, bent) = (course(1), course(2));
        let rates = [straight, bent].map(|amplitudes| growth(amplitudes) * period);
        (between as f64, rates, straight)
    };
    let short = taken(((APART_BY * period).round() as usize).clamp(1, n - length));
    let long = taken(n - length);
    let is_slow = short.1[0].abs() < LITTLE && long.1[0].abs() < LITTLE;
    let (between, [rate, other], [(first, _), (last, left)]) = if is_slow { long } else { short };
    let agree = (rate - other).abs() < 0.15 * rate.abs() + 0.02;
    let half = (length as f64 - 1.0) / 2.0;
    (agree && left < LEFT && first > 0.0 && rate.is_finite()).then(|| Leading {
        growth: rate / period,
        angle,
        square: first * last,
        lag: 0.5 * between + half,
        amplitude: last * (rate / period * half).exp(),
    })
}

/// What the last snapshots vary by: the sum of squares about their mean.
pub(crate) fn activity(window: &Window) -> f64 {
    let last = window.part(window.len() - WINDOW..window.len());
    let squares: f64 = (0..WINDOW).map(|i| last.row(i)[i]).sum();
    let mean: f64 = (0..WINDOW).map(|i| last.row(i).iter().sum::<f64>()).sum::<f64>() / WINDOW as f64;
    squares - mean
}

impl Dmd {
    /// Amplitudes with a wave and what is faster than half of it, its harmonics, times a factor.
    pub(crate) fn raised(&self, amplitudes: &[[f64; 2]], angle: f64, factor: f64) -> Vec<[f64; 2]> {
        let pairs = self.eigenvalues().iter().zip(amplitudes);
        let fast = |[re, im]: &[f64; 2]| im.atan2(*re).abs() > 0.5 * angle.min(PI);
        pairs.map(|(e, &[x, y])| if fast(e) { [factor * x, factor * y] } else { [x, y] }).collect()
    }
}
