//! Start-ups cut short: the wave that grows or falls is brought to the size that it will have, in place of waiting for it.
//!
//! What is extrapolated is the amplitude of a fit's leading mode, and not time: projective integration (Gear and Kevrekidis, SIAM J. Sci.
//! Comput. 24, 2003). Near the onset of a wave `d ln A/dt = s - l A^2` (Stuart and Landau), so that the growth rates at two amplitudes say
//! where it ends. The new state is a combination of states of the run, as conservative as they are. It is kept where the wave then is what
//! it was brought to and nearer to where it stays, else the state before is taken up again.

use crate::dmd::Window;
use crate::wave::{APART, Leading, WINDOW, activity, clear};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Snapshots between two looks.
const EVERY: usize = 2;

/// Looks after a change within which it must be clear what has come of it.
const LOOKS: usize = 12;

/// Changes that are undone before it is left alone.
const PATIENCE: usize = 2;

/// Snapshots after a change in which what no wave made dies out.
const PASSES: usize = 8;

/// Growth a period below which a wave has settled, the change of amplitude that is left then, and what of the first variation a wave has that
/// is none any more.
const SETTLED: f64 = 0.006;
const NEAR: f64 = 0.02;
const GONE: f64 = 0.02;

/// Looks one after the other that say so.
const SURE: usize = 4;

/// Growth a period below which a wave is given up after so many looks, though it has not settled.
const CALM: f64 = 0.02;
const LONG: usize = 20;

/// Most that an amplitude is raised by at once, and what is left of a wave that dies.
const MOST: f64 = 3.0;
const LEAST: f64 = 0.1;

/// Ratio of squared amplitudes from which on growth rates say where the growth ends, of fast and of slow ones, and that a wave has fallen by
/// which is taken for one that dies.
const APART_ENOUGH: f64 = 1.35;
const FAR_APART: f64 = 1.4;
const FALLEN: f64 = 1.6;

/// Looks that this is taken from at most, and the least difference of the logarithms of their squared amplitudes.
const KNOWN: usize = 12;
const SPACING: f64 = 0.08;

/// Growth a period below which it is slow.
const SLOW: f64 = 0.15;

/// Periods that a wave needs to settle by itself up to which it is left alone, as a change upsets it for as long, and what a start-up does
/// besides is taken for its growth: of one that comes to less than twice its amplitude, of one that comes to more, and once it was changed,
/// when its growth is known at amplitudes far apart.
const SOON: f64 = 10.0;
const FAR: f64 = 5.0;
const AGAIN: f64 = 1.0;

/// Logarithm of the least change, and of what the ends that two looks say may differ by.
const LITTLE: f64 = 0.04;
const ALIKE: f64 = 0.1;

/// What is to be done at a snapshot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Turn {
    /// It is not clear what the wave does, or it is clear and little.
    #[default]
    Wait,
    /// The wave stays as it is: there is nothing more to do.
    Settled,
    /// Its amplitude is to be changed by this factor.
    Change(f64),
    /// The last change has made it worse: the state before is to be taken up.
    Undo,
}

/// What a look at the last snapshots has shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// What is to be done.
    pub turn: Turn,
    /// The wave; none: nothing is clear.
    pub wave: Option<Leading>,
    /// Whether the last change is kept, where this is the look that says so.
    pub kept: Option<bool>,
}

/// A wave before its amplitude is changed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Before {
    /// Growth a period.
    rate: f64,
    amplitude: f64,
    /// What it is brought to.
    aim: f64,
    activity: f64,
    /// Looks since then at which nothing was clear.
    looks: usize,
}

impl Before {
    /// Whether the wave is nearer to where it stays: it changes by less, or is what it was brought to and grows as before.
    fn is_bettered_by(&self, now: &Leading) -> bool {
        let rate = now.rate();
        match self.rate > 0.0 {
            true => {
                let as_before =
                    rate > 0.0 && rate < 1.15 * self.rate + 0.01 && now.amplitude > 0.6 * self.aim;
                now.amplitude > 0.9 * self.amplitude && (as_before || rate.abs() < 0.9 * self.rate)
            }
            false => (rate * now.amplitude).abs() < (self.rate * self.amplitude).abs() && rate < -self.rate,
        }
    }
}

/// What is known of the wave.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settle {
    /// Mean square of what each field varied by at the first look at which one did: amplitudes of all looks are over it.
    pub(crate) scale: Vec<f64>,
    /// Squared amplitude and growth a period of the looks at which the wave was clear, since the last undoing.
    known: Vec<(f64, f64)>,
    /// The wave before a change that is still to be judged.
    before: Option<Before>,
    /// Looks one after the other at which the wave stayed as it is, and at which it nearly did.
    settled: usize,
    calm: usize,
    /// Where the last look said that the amplitude ends.
    #[serde(default)]
    end: Option<f64>,
    /// Whether the wave was clear at the last look, and not settled.
    moves: bool,
    /// Whether anything was changed, and how often that was undone.
    changed: bool,
    undone: usize,
    /// Whether there is nothing more to do.
    over: bool,
    /// Number of the snapshot of the last look.
    #[serde(default)]
    pub(crate) looked: Option<i64>,
}

impl Settle {
    /// Snapshots that a look takes at least, and that are held for an undoing.
    pub const STATES: usize = WINDOW + APART;

    /// Snapshots that it takes at most.
    pub const MOST: usize = 32;

    /// Snapshots of its fits.
    pub const WINDOW: usize = WINDOW;

    /// Snapshots of a stretch that are passed over: behind a change.
    pub(crate) fn passes(&self) -> usize {
        if self.changed { PASSES } else { 0 }
    }

    /// Whether there is to be a look behind so many snapshots without a gap, the last one of this number.
    pub fn looks(&self, stretch: usize, present: i64) -> bool {
        // By numbers: where snapshots make room for later ones, a stretch does not grow
        let is_due = self.looked.is_none_or(|looked| present >= looked + EVERY as i64);
        !self.over && stretch >= Self::STATES + self.passes() && is_due
    }

    /// Whether a jump in time would only come in between: a change is to be judged, or the wave grows or falls.
    pub fn waits(&self) -> bool {
        !self.over && (self.before.is_some() || self.moves)
    }

    /// Whether nothing more is done.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// Whether the wave stays as it is, as far as is known.
    pub fn has_settled(&self) -> bool {
        self.over && self.undone < PATIENCE
    }

    /// Whether a change is to be judged.
    pub fn is_open(&self) -> bool {
        self.before.is_some()
    }

    /// The change that was asked for last has not been made, or other states than the run's own came in between.
    pub fn missed(&mut self) {
        (self.before, self.moves) = (None, false);
    }

    /// What the last [`Settle::STATES`] to [`Settle::MOST`] snapshots of a run show.
    pub(crate) fn look(&mut self, window: &Window) -> Look {
        let Some(now) = clear(window) else { return self.unclear(window) };
        let kept = self.before.take().map(|before| before.is_bettered_by(&now));
        let turn = match kept {
            Some(false) => self.undo(),
            _ => self.decide(&now, activity(window)),
        };
        Look { turn, wave: Some(now), kept }
    }

    fn undo(&mut self) -> Turn {
        self.undone += 1;
        self.known.clear();
        (self.moves, self.over) = (false, self.undone >= PATIENCE);
        Turn::Undo
    }

    /// Nothing is clear. A change that leaves no wave has done well where it was to die.
    fn unclear(&mut self, window: &Window) -> Look {
        (self.settled, self.calm, self.moves, self.end) = (0, 0, false, None);
        let Some(before) = &mut self.before else { return Look::default() };
        before.looks += 1;
        if before.looks < LOOKS {
            return Look::default();
        }
        let kept = before.rate < 0.0 && activity(window) < before.activity;
        self.before = None;
        let turn = if kept { Turn::Wait } else { self.undo() };
        Look { turn, wave: None, kept: Some(kept) }
    }

    fn decide(&mut self, now: &Leading, activity: f64) -> Turn {
        let rate = now.rate();
        // Beside the last look those stay that are apart in amplitude: looks at a wave that waits do not push out what is known.
        let before = self.known.len().checked_sub(2).map(|i| self.known[i].0);
        if before.is_some_and(|before| (now.square / before).ln().abs() < SPACING) {
            self.known.pop();
        }
        self.known.push((now.square, rate));
        let end = self.end(now);
        let is_near = now.size() < GONE || end.map_or(rate.abs() < SETTLED, |(end, _)| end.ln().abs() < NEAR);
        let count = |counts: bool, before: usize| if counts { before + 1 } else { 0 };
        (self.settled, self.calm) = (count(is_near, self.settled), count(rate.abs() < CALM, self.calm));
        self.moves = !is_near;
        if self.settled >= SURE || self.calm > LONG {
            self.over = true;
            return Turn::Settled;
        }
        let amplitude = now.amplitude;
        let ends_at = end.map(|(factor, _)| factor * amplitude);
        let before = std::mem::replace(&mut self.end, ends_at);
        let is_alike = before.zip(ends_at).is_some_and(|(a, b)| (a / b).ln().abs() < ALIKE);
        let Some((factor, periods)) = end.filter(|_| self.moves && is_alike) else { return Turn::Wait };
        let soon = match self.changed {
            true => AGAIN,
            false if factor > 2.0 => FAR,
            false => SOON,
        };
        if factor.ln().abs() < LITTLE || periods < soon {
            return Turn::Wait;
        }
        self.changed = true;
        self.before = Some(Before { rate, amplitude, aim: factor * amplitude, activity, looks: 0 });
        Turn::Change(factor)
    }

    /// The last growth rates over squared amplitudes, as few as are far enough apart: the slope of the line through them, and whether they are.
    fn line(&self, rate: f64) -> Option<(f64, bool)> {
        let far = if rate.abs() < SLOW { FAR_APART } else { APART_ENOUGH };
        let mut found = None;
        for n in 2..=self.known.len().min(KNOWN) {
            let last = &self.known[self.known.len() - n..];
            let mean = |of: fn(&(f64, f64)) -> f64| last.iter().map(of).sum::<f64>() / n as f64;
            let (x, y) = (mean(|p| p.0), mean(|p| p.1));
            let up: f64 = last.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
            let down: f64 = last.iter().map(|p| (p.0 - x).powi(2)).sum();
            let (least, most) = last.iter().fold((f64::MAX, 0.0f64), |(a, b), p| (a.min(p.0), b.max(p.0)));
            if down > 0.0 {
                found = Some((up / down, most > far * least));
            }
            if most > far * least {
                break;
            }
        }
        found
    }

    /// By how much the amplitude will change from the present one by Stuart and Landau, and in how many periods, where the last looks are far
    /// enough apart to say it.
    fn end(&self, now: &Leading) -> Option<(f64, f64)> {
        let rate = now.rate();
        let (slope, is_clear) = self.line(rate)?;
        if let Some((factor, s)) = limit(now, slope) {
            let factor = factor.clamp(LEAST, MOST);
            return is_clear.then(|| (factor, periods(s, factor)));
        }
        // A wave that dies at any amplitude
        let mut last = self.known.iter().rev().take(KNOWN);
        let has_fallen = last.clone().any(|p| p.0 > FALLEN * now.square);
        (has_fallen && last.all(|p| p.1 < 0.0)).then(|| (LEAST, 50f64.ln() / -rate))
    }
}

/// By Stuart and Landau with this slope of the growth a period over the squared amplitude: by how much the amplitude will change from the
/// present one, and the growth a period at amplitude 0. None: there is no such amplitude.
fn limit(now: &Leading, slope: f64) -> Option<(f64, f64)> {
    let (rate, s) = (now.rate(), now.rate() - slope * now.square);
    // Where the line through the rates is 0
    let end = now.square - rate / slope;
    // The present amplitude by the same law from where the growth was taken
    let passed = (-2.0 * s * now.lag * now.angle / TAU).exp();
    let square = 1.0 + (end / now.square - 1.0) * passed;
    (slope < 0.0 && end > 0.0 && square > 0.0).then(|| (square.sqrt(), s))
}

/// Periods until the amplitude is within a fiftieth of its end, `factor` times the present one, by Stuart and Landau with a growth a period of
/// `s` at amplitude 0.
fn periods(s: f64, factor: f64) -> f64 {
    // A^2 = end^2/(1 + c exp(-2 s t)), c = factor^2 - 1
    let near = if factor > 1.0 { 1.0 / (0.98 * 0.98) - 1.0 } else { 1.0 - 1.0 / (1.02 * 1.02) };
    ((factor * factor - 1.0).abs() / near).ln().max(0.0) / (2.0 * s)
}

#[cfg(test)]
mod tests;
