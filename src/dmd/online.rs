//! The surrogate: states of a run go in at uniform times; what a fit of them says of later times comes out.

use crate::choose::{DRIVEN_DELAYS, choose, driven_stretch, variations, window};
use crate::fit::{Fit, FitSettings};
use crate::outlook::{Foreseen, Outlook};
use crate::sampling::{Grid, SAME};
use crate::settle::{Look, Settle, Turn};
use crate::snapshots::{Combination, Snapshots, enters};
use crate::store::Store;
use crate::sums::Storage;
use crate::wave::leading;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_state::{Array, Role};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::time::Instant;

/// Of what a field has changed by since the first state, what counts as none: it rests.
const RESTS: f64 = 1e-4;

/// Snapshots beyond the window: those that come while a fit is in use.
const BESIDE: usize = 8;

/// Settings of a dmd surrogate.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Time between snapshots, s: the stride.
    pub interval: f64,
    /// How snapshots are kept.
    pub storage: Storage,
    /// What fits are made of.
    pub fit: FitSettings,
    /// Snapshots that are kept beside the window while an [`Outlook`] is held.
    pub held: usize,
    /// Of each field the change that counts as none, in its unit, root mean square over items and solved components; none: a ten-thousandth
    /// of the most that it has changed by since the first state. Empty: none of them.
    pub rest: Vec<Option<f64>>,
}

/// A state that was predicted, where the solver has none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Predicted {
    pub number: i64,
    pub state: Combination,
}

/// What a surrogate has beside its snapshots: with them it goes on as if it had never stopped.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Sample numbers of the kept states, and what tells them from those of another run.
    pub(crate) kept: Vec<i64>,
    pub(crate) marks: Vec<f64>,
    pub(crate) grid: Option<Grid>,
    /// Number of the file that they are in.
    pub(crate) file: u64,
    /// The sample that predictions begin from.
    pub(crate) present: Option<i64>,
    pub(crate) fit: Option<Fit>,
    pub(crate) predicted: VecDeque<Predicted>,
    /// What is prescribed from here on, as far as a fit had to know.
    #[serde(default)]
    pub(crate) foreseen: Vec<Foreseen>,
    /// Of each field the square of the most that it has changed by since the first state.
    pub(crate) changed: Vec<f64>,
}

/// A dmd surrogate of a run.
pub struct OnlineDmd {
    pub(crate) settings: Settings,
    pub(crate) snapshots: Snapshots,
    pub(crate) state: State,
    /// The last step of the solver where a sample may lie between it and the next one.
    pub(crate) last: Option<(f64, Vec<Vec<f64>>)>,
    /// Snapshots of an outlook that are to stay.
    pub(crate) held: Vec<usize>,
    /// Of each field the square of a change by 1 of all items and solved components.
    unit: Vec<f64>,
    /// Where the snapshots are on disk.
    pub(crate) store: RefCell<Option<Store>>,
}

impl OnlineDmd {
    /// Without snapshots. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that cannot be, or fields that are no state.
    pub fn new(comm: &Comm, fields: Vec<Array>, settings: Settings) -> Result<Self> {
        let checked = match settings.interval.is_finite() && settings.interval > 0.0 {
            true => settings.fit.check(),
            false => Err(Error::Input(format!(
                "dmd: snapshotInterval {}: expected a time above 0, s",
                settings.interval
            ))),
        };
        comm.agree_with(checked, &format!("dmd {settings:?}"))?;
        let weight = |f: &Array| match f.weights.is_empty() {
            true => f.items as f64,
            false => f.weights.iter().sum(),
        };
        let mut unit: Vec<f64> = fields.iter().map(|f| weight(f) * f.solved.max(1) as f64).collect();
        comm.sum_f64(&mut unit);
        let snapshots =
            Snapshots::new(comm, fields, settings.storage, settings.fit.window + settings.held + BESIDE)?;
        Ok(OnlineDmd {
            settings,
            snapshots,
            state: State::default(),
            last: None,
            held: Vec::new(),
            unit,
            store: RefCell::default(),
        })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The states that are kept.
    pub fn snapshots(&self) -> &Snapshots {
        &self.snapshots
    }

    /// The present fit.
    pub fn fitted(&self) -> Option<&Fit> {
        self.state.fit.as_ref()
    }

    /// Whether the state after a step of the solver is wanted: a sample is there, or lies between it and the step before or after.
    /// `delta_t`: the solver's next step, s, as far as is known.
    pub fn wants(&self, time: f64, delta_t: f64) -> bool {
        let Some(grid) = self.state.grid else {
            return true;
        };
        // A state that is there already, in a run that is carried on.
        if self.state.present.is_some_and(|n| grid.at(time).is_some_and(|at| at <= n)) {
            return false;
        }
        let passed = |(before, _): &(f64, Vec<Vec<f64>>)| grid.after(*before) < grid.after(time);
        grid.at(time).is_some()
            || self.last.as_ref().is_some_and(passed)
            || is_passed_next(grid, time, delta_t)
    }

    /// The fields after a step of the solver; samples between this one and the last one are interpolated. Gives the samples that came of it.
    /// Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for values that are no state, or a time that is not later than the last one.
    pub fn offer(&mut self, time: f64, delta_t: f64, fields: &[&[f64]]) -> Result<usize> {
        // Multiples of the interval: times to write are most often among them.
        let first = Grid { interval: self.settings.interval, number: 0, time: 0.0 };
        let mut grid = *self.state.grid.get_or_insert(first);
        let last = self.last.take();
        let before = last.as_ref().map(|l| l.0).or(self.state.present.map(|n| grid.time_of(n)));
        let mut next = match before {
            None => 0,
            Some(before) if before >= time => {
                return Err(Error::Input(format!("dmd: time {time} after {before}: expected a later one")));
            }
            Some(before) => grid.after(before),
        };
        if last.is_none() && before.is_some() && next < grid.after(time) && grid.at(time).is_none() {
            // A sample was passed without the fields beside it: the grid begins anew here, after a gap.
            next = grid.after(time) + 1;
            grid = Grid { number: next, time, ..grid };
            self.state.grid = Some(grid);
        }
        let (mut samples, here) = (0, grid.at(time));
        if let Some((before, old)) = &last {
            for number in next..here.unwrap_or(grid.after(time)) {
                let share = (grid.time_of(number) - before) / (time - before);
                let pairs = old.iter().zip(fields);
                let between =
                    pairs.map(|(a, b)| a.iter().zip(*b).map(|(x, y)| x + share * (y - x)).collect());
                let state: Vec<Vec<f64>> = between.collect();
                self.push(number, &state.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
                samples += 1;
            }
        }
        if let Some(number) = here {
            self.push(number, fields)?;
            samples += 1;
        }
        if is_passed_next(grid, time, delta_t) {
            self.last = Some((time, fields.iter().map(|f| f.to_vec()).collect()));
        }
        Ok(samples)
    }

    fn push(&mut self, number: i64, state: &[&[f64]]) -> Result<()> {
        let mut pinned = self.state.fit.as_ref().map(|f| f.slots.clone()).unwrap_or_default();
        pinned.extend(&self.held);
        let spare = |s: &Snapshots| s.entries.iter().position(|e| !pinned.contains(&e.slot)).unwrap_or(0);
        if self.snapshots.entries.len() == self.snapshots.capacity() {
            let goes = self.snapshots.entries[spare(&self.snapshots)].slot;
            self.state.predicted.retain(|p| p.state.0[goes] == 0.0);
        }
        self.snapshots.push(number, state, spare)?;
        if !pinned.is_empty() {
            self.complete();
        }
        self.state.present = Some(number);
        let oldest = number - self.most_delays();
        self.state.predicted.retain(|p| p.number > oldest);
        self.forget_foreseen();
        Ok(())
    }

    pub(crate) fn most_delays(&self) -> i64 {
        self.settings.fit.delays.iter().chain(&DRIVEN_DELAYS).max().map_or(1, |d| *d as i64)
    }

    fn complete(&mut self) {
        self.snapshots.complete();
        self.state.changed.resize(self.unit.len(), 0.0);
        for (changed, now) in self.state.changed.iter_mut().zip(self.snapshots.changed()) {
            *changed = changed.max(now);
        }
    }

    /// Of each field the least change that errors are over, in its unit, root mean square over items and solved components.
    pub fn least_changes(&self) -> Vec<f64> {
        let of = |(f, unit): (usize, &f64)| {
            let changed = self.state.changed.get(f).unwrap_or(&0.0) / unit.max(f64::MIN_POSITIVE);
            let rest = self.settings.rest.get(f).copied().flatten();
            rest.unwrap_or_else(|| RESTS * changed.sqrt())
        };
        self.unit.iter().enumerate().map(of).collect()
    }

    /// Of each field that is part of the inner product the square of that change, 0 where it is rounding: of what stays as it is nothing counts.
    pub(crate) fn least(&self) -> Vec<f64> {
        let all = self.least_changes().into_iter().zip(&self.unit).map(|(least, unit)| least * least * unit);
        let fields = self.snapshots.fields().iter().enumerate();
        let counts =
            |f: usize, field: &Array, square: f64| enters(field) && square > self.snapshots.rounding(f);
        all.zip(fields)
            .map(|(square, (f, field))| if counts(f, field, square) { square } else { 0.0 })
            .collect()
    }

    /// Fits the last snapshots; none where there are too few without a gap, or nothing has varied. Collective.
    pub fn fit(&mut self) -> Option<&Fit> {
        self.complete();
        self.state.foreseen.clear();
        self.state.fit = choose(&self.snapshots, &self.settings.fit, &self.least());
        self.state.fit.as_ref()
    }

    /// No mode of the fits from here on grows.
    pub fn keep_size(&mut self) {
        self.settings.fit.unstable_modes = Some(false);
    }

    /// A look at the last states for the wave that grows or falls, where one is due, and what the run goes on with where it is to be changed:
    /// how it would go on as it is, and with the change. Nothing is seen where prescribed values have changed. Collective.
    pub fn settle(&mut self, settle: &mut Settle) -> (Look, Option<[Outlook; 2]>) {
        let present = self.state.present.unwrap_or(0);
        if !settle.looks(self.stretch(), present) {
            return (Look::default(), None);
        }
        settle.looked = Some(present);
        self.complete();
        let passed = settle.passes();
        let seen = (self.stretch() - passed).clamp(Settle::STATES, Settle::MOST);
        let entries = &self.snapshots.entries[self.snapshots.entries.len() - seen..];
        let (numbers, slots): (Vec<i64>, Vec<usize>) = entries.iter().map(|e| (e.number, e.slot)).unzip();
        let mut fields = self.snapshots.fields().iter().enumerate();
        if fields.any(|(f, a)| a.role == Role::Prescribed && self.snapshots.variation(f, &slots) > 0.0) {
            // Jumps do not wait for what nobody can judge any more
            settle.missed();
            return (Look::default(), None);
        }
        // A flow that rests at its first looks has no scale yet
        if settle.scale.iter().all(|scale| *scale <= 0.0) {
            settle.scale = variations(&self.snapshots, &slots, &self.least());
        }
        let whole = window(&self.snapshots, &slots, &numbers, &settle.scale);
        let look = settle.look(&whole);
        let Turn::Change(factor) = look.turn else { return (look, None) };
        let last = whole.part(whole.len() - Settle::WINDOW..whole.len());
        let found = leading(&last).map(|(dmd, amplitudes, angle)| {
            let slots = slots[slots.len() - dmd.snapshots()..].to_vec();
            let raised = dmd.raised(&amplitudes, angle, factor);
            [amplitudes, raised].map(|amplitudes| Outlook::free(dmd.clone(), amplitudes, slots.clone()))
        });
        (look, found)
    }

    /// Strides from the present sample to a time; none: there is no sample yet.
    pub fn since(&self, time: f64) -> Option<f64> {
        Some(self.state.grid?.position(time) - self.state.present? as f64)
    }

    /// The snapshots without a gap up to the present one.
    pub fn stretch(&self) -> usize {
        let numbers: Vec<i64> = self.snapshots.numbers().collect();
        let last = numbers.last().copied().unwrap_or(0);
        let missing = numbers.iter().rev().zip(0..).take_while(|(n, i)| **n == last - i);
        if self.state.present == Some(last) { missing.count() } else { 0 }
    }

    /// The states that a fit could be made of: those without a gap up to the present one, and where inputs change, for which few of them are
    /// enough, all.
    pub fn usable(&self) -> usize {
        let stretch = self.stretch();
        let fields = self.snapshots.fields().iter().enumerate();
        let mut inputs = fields.filter(|(_, field)| field.role == Role::Prescribed).map(|(f, _)| f);
        // By what all ranks have summed: one that an input does not touch decides alike
        let changes = |f: usize| self.snapshots.entries.iter().any(|e| self.snapshots.square(f, e) > 0.0);
        match stretch >= driven_stretch(self.settings.fit.hold_out) && inputs.any(changes) {
            true => self.snapshots.entries.len(),
            false => stretch,
        }
    }

    /// Drops the fit: the states that it kept can go.
    pub fn forget(&mut self) {
        self.state.fit = None;
    }

    /// What comes next does not follow from the states so far: nothing is interpolated, and the window begins anew.
    pub fn break_off(&mut self) {
        self.forget();
        self.last = None;
        // A number is left out, so that no window reaches across.
        if let Some(grid) = &mut self.state.grid {
            grid.number += 1;
        }
    }

    /// States are so far apart from now on (s). Where that is twice as far, every second one of the last stretch stays; else those that are kept
    /// go. Collective.
    pub fn begin_anew(&mut self, interval: f64, time: f64) {
        let before = self.settings.interval;
        self.settings.interval = interval;
        // No number is used twice: files of states know them by it.
        let number = self.state.grid.map_or(0, |grid| grid.after(time) + 1);
        let mut grid = Grid { interval, number, time: (time / interval).floor() * interval };
        let mut present = None;
        match self.state.grid.filter(|_| (interval / before - 2.0).abs() < SAME) {
            Some(old) => {
                self.complete();
                let stays = self.every_second(old, interval);
                self.snapshots.thin(&stays, number);
                if let Some(last) = stays.last() {
                    grid =
                        Grid { interval, number: number + stays.len() as i64 - 1, time: old.time_of(*last) };
                    present = Some(grid.number);
                }
            }
            None => {
                self.snapshots.clear();
                self.last = None;
            }
        }
        let changed = std::mem::take(&mut self.state.changed);
        self.state = State { grid: Some(grid), present, changed, ..State::default() };
        self.held.clear();
    }

    /// Numbers of the last states without a gap that are at multiples of an interval of twice their own, s.
    fn every_second(&self, grid: Grid, interval: f64) -> Vec<i64> {
        let kept: Vec<i64> = self.snapshots.numbers().collect();
        let stretch = &kept[kept.len() - self.stretch()..];
        let is_between = |n: &i64| (0.25..0.75).contains(&(grid.time_of(*n) / interval).rem_euclid(1.0));
        let from = usize::from(stretch.first().is_some_and(is_between));
        stretch.iter().copied().skip(from).step_by(2).collect()
    }

    /// Wall time that each state of a fit's window adds to a reconstruction, s: as measured on those that are kept, mean of all ranks.
    /// Collective.
    pub fn seconds_a_state(&self) -> f64 {
        let numbers: Vec<i64> = self.snapshots.numbers().collect();
        let first = &numbers[..numbers.len().min(1)];
        let longest = self.snapshots.fields().iter().map(Array::numbers).max().unwrap_or(0);
        let mut out = vec![0.0; longest];
        let mut seconds = |numbers: &[i64]| {
            let all = self.snapshots.mean(numbers);
            let began = Instant::now();
            for (f, field) in self.snapshots.fields().iter().enumerate() {
                self.snapshots.combine(f, &all, &mut out[..field.numbers()]);
            }
            began.elapsed().as_secs_f64()
        };
        // The first pass touches memory that was not there before.
        let _ = seconds(first);
        let more = numbers.len().saturating_sub(1).max(1) as f64;
        let mut sum = [(seconds(&numbers) - seconds(first)).max(0.0) / more];
        self.snapshots.comm().sum_f64(&mut sum);
        sum[0] / f64::from(self.snapshots.comm().size())
    }

    /// Field `f` of a prediction: the same combination of states for every field. Values below the field's floor are replaced by the least
    /// of these states, unless that is below it too. Returns this rank's sum of squares of what that has changed, with the field's weights.
    ///
    /// # Panics
    /// If `out` is not as long as the field.
    pub fn field(&self, f: usize, prediction: &Combination, out: &mut [f64]) -> f64 {
        assert_eq!(out.len(), self.snapshots.fields()[f].numbers());
        self.snapshots.combine(f, prediction, out)
    }
}

/// Whether a sample may lie between this step of the solver and the next: steps may grow, and one that ends at a sample needs no other.
pub(crate) fn is_passed_next(grid: Grid, time: f64, delta_t: f64) -> bool {
    let next = grid.after(time);
    grid.is_later(time + 2.0 * delta_t, next) && grid.at(time + delta_t) != Some(next)
}
