//! The surrogate: states of a run go in at uniform times; what a fit of them says of later times comes out.

use crate::choose::{FieldError, Fit, FitSettings, choose, spread, variations, window};
use crate::dmd::Dmd;
use crate::sampling::{Grid, SAME};
use crate::settle::{Look, Settle, Turn};
use crate::snapshots::{Combination, Snapshots, Storage, enters};
use crate::spectrum::Mode;
use crate::store::{Store, numbers};
use crate::wave::leading;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_state::{Array, Role};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::path::Path;
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

/// What a fit says of the times after a sample, whatever comes after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outlook {
    pub(crate) dmd: Dmd,
    pub(crate) amplitudes: Vec<[f64; 2]>,
    /// Of the window's snapshots.
    pub(crate) slots: Vec<usize>,
}

/// A state that was predicted, where the solver has none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Predicted {
    number: i64,
    state: Combination,
}

/// What a surrogate has beside its snapshots: with them it goes on as if it had never stopped.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Sample numbers of the kept states, and what tells them from those of another run.
    kept: Vec<i64>,
    marks: Vec<f64>,
    grid: Option<Grid>,
    /// Number of the file that they are in.
    file: u64,
    /// The sample that predictions begin from.
    present: Option<i64>,
    fit: Option<Fit>,
    predicted: VecDeque<Predicted>,
    /// Of each field the square of the most that it has changed by since the first state.
    changed: Vec<f64>,
}

/// What came of taking up a state.
#[derive(Clone, Debug, PartialEq)]
pub enum Restored {
    /// All of it.
    Whole,
    /// Its snapshots have made room for later ones: the window begins anew.
    Superseded,
    /// What could not be read, or is of another run.
    Lost(String),
}

/// A dmd surrogate of a run.
pub struct OnlineDmd {
    settings: Settings,
    snapshots: Snapshots,
    state: State,
    /// The last step of the solver where a sample may lie between it and the next one.
    last: Option<(f64, Vec<Vec<f64>>)>,
    /// Snapshots of an outlook that are to stay.
    held: Vec<usize>,
    /// Of each field the square of a change by 1 of all items and solved components.
    unit: Vec<f64>,
    /// Where the snapshots are on disk.
    store: RefCell<Option<Store>>,
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
        Ok(())
    }

    fn most_delays(&self) -> i64 {
        self.settings.fit.delays.iter().max().map_or(1, |d| *d as i64)
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
            let given = self.settings.rest.get(f).copied().flatten();
            given.unwrap_or_else(|| RESTS * changed.sqrt())
        };
        self.unit.iter().enumerate().map(of).collect()
    }

    /// Of each field that is part of the inner product the square of that change, 0 where it is rounding: of what stays as it is nothing counts.
    fn least(&self) -> Vec<f64> {
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
        if !settle.looks(self.stretch()) {
            return (Look::default(), None);
        }
        self.complete();
        let passed = settle.passes();
        let seen = (self.stretch() - passed).clamp(Settle::STATES, Settle::MOST);
        let entries = &self.snapshots.entries[self.snapshots.entries.len() - seen..];
        let (numbers, slots): (Vec<i64>, Vec<usize>) = entries.iter().map(|e| (e.number, e.slot)).unzip();
        let mut fields = self.snapshots.fields().iter().enumerate();
        if fields.any(|(f, a)| a.role == Role::Prescribed && self.snapshots.variation(f, &slots) > 0.0) {
            return (Look::default(), None);
        }
        if settle.scale.is_empty() {
            settle.scale = variations(&self.snapshots, &slots, &self.least());
        }
        let whole = window(&self.snapshots, &slots, &numbers, &settle.scale);
        let look = settle.look(&whole);
        let Turn::Change(factor) = look.turn else { return (look, None) };
        let last = whole.part(whole.len() - Settle::WINDOW..whole.len());
        let found = leading(&last).map(|(dmd, amplitudes, angle)| {
            let slots = slots[slots.len() - dmd.snapshots()..].to_vec();
            let raised = dmd.raised(&amplitudes, angle, factor);
            [amplitudes, raised].map(|amplitudes| Outlook {
                dmd: dmd.clone(),
                amplitudes,
                slots: slots.clone(),
            })
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

    /// The state at `strides` after the present one, as a combination of kept states. None without a fit, or where
    /// one of the last states that it begins from is missing.
    pub fn predict(&self, strides: f64) -> Option<Combination> {
        Some(self.later(&self.outlook()?, strides))
    }

    /// What the fit says of the times after the present sample. None as for [`predict`](Self::predict).
    pub fn outlook(&self) -> Option<Outlook> {
        let fit = self.state.fit.as_ref()?;
        let present = self.state.present?;
        let first = present - fit.dmd.shape.delays as i64 + 1;
        let rows = (first..=present).map(|n| self.products(n, fit)).collect::<Option<Vec<Vec<f64>>>>()?;
        let history: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
        let (dmd, slots) = (fit.dmd.clone(), fit.slots.clone());
        Some(Outlook { amplitudes: dmd.amplitudes(&history), dmd, slots })
    }

    /// The modes of the fit at present, largest share of the energy first; none as for [`predict`](Self::predict).
    pub fn modes(&self) -> Vec<Mode> {
        let of = |o: Outlook| o.dmd.spectrum(&o.amplitudes, self.settings.interval);
        self.outlook().map(of).unwrap_or_default()
    }

    /// The state at `strides` after an outlook's sample.
    pub fn later(&self, outlook: &Outlook, strides: f64) -> Combination {
        spread(&self.snapshots, &outlook.slots, &outlook.dmd.weights(&outlook.amplitudes, strides))
    }

    /// Keeps the snapshots that an outlook needs; none: of no outlook any more.
    pub fn hold(&mut self, outlook: Option<&Outlook>) {
        self.held = outlook.map(|o| o.slots.clone()).unwrap_or_default();
    }

    /// Products of a state of the run with the snapshots of the window, each field over its variation.
    fn products(&self, number: i64, fit: &Fit) -> Option<Vec<f64>> {
        let state = match self.snapshots.single(number) {
            Some(state) => state,
            None => self.state.predicted.iter().find(|p| p.number == number)?.state.clone(),
        };
        let c = self.snapshots.capacity();
        let used: Vec<(usize, f64)> =
            state.0.iter().copied().enumerate().filter(|(_, w)| *w != 0.0).collect();
        let mut products = vec![0.0; fit.slots.len()];
        for (table, v) in self.snapshots.products.iter().zip(&fit.variation).filter(|(_, v)| **v > 0.0) {
            for (p, slot) in products.iter_mut().zip(&fit.slots) {
                *p += used.iter().map(|(s, w)| w * table[s * c + slot]).sum::<f64>() / v;
            }
        }
        Some(products)
    }

    /// The run goes on from the prediction `strides` after the present one, which is that of `time`, and the next step is one of `delta_t`.
    pub fn jump(&mut self, strides: f64, time: f64, delta_t: f64) -> bool {
        let (Some(present), Some(grid), Some(outlook)) =
            (self.state.present, self.state.grid, self.outlook())
        else {
            return false;
        };
        let whole = (strides + SAME) as usize;
        let first = whole.saturating_sub(self.most_delays() as usize) + 1;
        for s in first..=whole {
            let state = self.later(&outlook, s as f64);
            self.state.predicted.push_back(Predicted { number: present + s as i64, state });
        }
        let end = present + whole as i64;
        let oldest = end - self.most_delays();
        self.state.predicted.retain(|p| p.number > oldest);
        self.state.present = Some(end);
        // The solver's own steps are interpolated from the state that it goes on from.
        self.last = is_passed_next(grid, time, delta_t).then(|| {
            let state = self.later(&outlook, strides);
            let mut fields: Vec<Vec<f64>> =
                self.snapshots.fields().iter().map(|f| vec![0.0; f.numbers()]).collect();
            for (f, values) in fields.iter_mut().enumerate() {
                self.field(f, &state, values);
            }
            (time, fields)
        });
        true
    }

    /// States are so far apart from now on (s); those that are kept go.
    pub fn begin_anew(&mut self, interval: f64, time: f64) {
        // No number is used twice: files of states know them by it.
        let number = self.state.grid.map_or(0, |grid| grid.after(time) + 1);
        self.snapshots.clear();
        self.settings.interval = interval;
        let grid = Grid { interval, number, time: (time / interval).floor() * interval };
        let changed = std::mem::take(&mut self.state.changed);
        self.state = State { grid: Some(grid), changed, ..State::default() };
        (self.last, self.held) = (None, Vec::new());
    }

    /// How far a prediction is off from the kept state of the present, field by field; `from`: where it began, in strides before.
    pub fn errors(&self, prediction: &Combination, before: usize) -> Option<Vec<FieldError>> {
        let fit = self.state.fit.as_ref()?;
        let present = self.state.present?;
        let state = self.snapshots.single(present)?;
        let from = self.at(present - before as i64)?;
        let least = self.least();
        let fields = self.snapshots.fields().iter().enumerate().zip(&fit.variation);
        let errors = fields.filter(|(_, v)| **v > 0.0).map(|((f, field), v)| {
            let error = self.snapshots.distance(f, prediction, &state);
            let change = self.snapshots.distance(f, &from, &state);
            let over = |square: f64| (square / v).sqrt();
            FieldError { name: field.name.clone(), error: over(error), hold: over(change.max(least[f])) }
        });
        Some(errors.collect())
    }

    fn at(&self, number: i64) -> Option<Combination> {
        let predicted = || Some(self.state.predicted.iter().find(|p| p.number == number)?.state.clone());
        self.snapshots.single(number).or_else(predicted)
    }

    /// Writes the snapshots that are not on disk yet to this rank's file, and gives what else there is. Collective.
    ///
    /// # Errors
    /// [`Error::File`]: the file is then begun anew next time.
    pub fn save(&self, path: &Path) -> Result<State> {
        let number = self.state.file;
        let saved = match self.snapshots.entries.is_empty() {
            true => Ok(None),
            false => Store::save(self.store.borrow_mut().take(), path, number, &self.snapshots).map(Some),
        };
        let store = self.snapshots.comm().agree(saved)?;
        let file = store.as_ref().map_or(number, |store| store.number);
        *self.store.borrow_mut() = store;
        let (kept, marks) = (self.snapshots.numbers().collect(), self.snapshots.marks());
        Ok(State { kept, marks, file, ..self.state.clone() })
    }

    /// Begins anew in a run of which another part wrote `state`: beside its files, which earlier times are carried on from. Collective.
    pub fn begin_beside(&mut self, path: &Path, state: &State) {
        let there = numbers(path).into_iter().max().unwrap_or(0).max(state.file);
        let mut last = [there as f64];
        self.snapshots.comm().max_f64(&mut last);
        self.state.file = last[0] as u64 + 1;
    }

    /// The solver stands at this time with these fields, in a run that is carried on: the next sample may lie before its next step.
    pub fn stand(&mut self, time: f64, delta_t: f64, fields: &[&[f64]]) {
        if self.state.grid.is_some_and(|grid| is_passed_next(grid, time, delta_t)) {
            self.last = Some((time, fields.iter().map(|f| f.to_vec()).collect()));
        }
    }

    /// Goes on from what [`save`](Self::save) gave and wrote. Where snapshots are missing, the fit is dropped and the window has those that
    /// are there; those of another run are not taken. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] where there are snapshots already.
    pub fn restore(&mut self, path: &Path, state: State) -> Result<Restored> {
        if !self.snapshots.entries.is_empty() {
            return Err(Error::Input("dmd: a state is restored before the first snapshot".into()));
        }
        let Some(&last) = state.kept.last() else {
            self.settings.interval = state.grid.map_or(self.settings.interval, |grid| grid.interval);
            self.state = state;
            return Ok(Restored::Whole);
        };
        let there = numbers(path);
        let superseded = !there.contains(&state.file) && there.iter().any(|n| *n > state.file);
        let mut anywhere = [i64::from(!superseded)];
        self.snapshots.comm().min_i64(&mut anywhere);
        if anywhere == [0] {
            self.begin_beside(path, &state);
            return Ok(Restored::Superseded);
        }
        let (mut found, mut said) = (None, String::new());
        match Store::read(path, state.file, &self.snapshots, last) {
            Ok(stored) => {
                if !stored.damage.is_empty() {
                    said = format!("{}: {}; it and what follows are dropped", path.display(), stored.damage);
                }
                found = Some(stored);
            }
            Err(e) => said = e.to_string(),
        }
        let number = |n: &i64| found.as_ref().is_some_and(|f| f.entries.iter().any(|e| e.number == *n));
        let mut there: Vec<i64> = state.kept.iter().map(|n| i64::from(number(n))).collect();
        self.snapshots.comm().min_i64(&mut there);
        let mut whole = !there.contains(&0);
        let kept: Vec<i64> =
            state.kept.iter().zip(&there).filter(|(_, t)| **t == 1).map(|(n, _)| *n).collect();
        if let Some(stored) = found.filter(|_| !kept.is_empty()) {
            self.snapshots.set_reference(stored.reference);
            for entry in stored.entries.into_iter().filter(|e| kept.binary_search(&e.number).is_ok()) {
                self.snapshots.add(entry);
            }
            self.snapshots.complete();
            let expected: HashMap<i64, f64> =
                state.kept.iter().copied().zip(state.marks.iter().copied()).collect();
            let other =
                |(n, mark): (i64, f64)| expected.get(&n).is_some_and(|e| (mark - e).abs() > 1e-9 * e.abs());
            if self.snapshots.numbers().zip(self.snapshots.marks()).any(other) {
                said = format!("{}: expected the states of this run, found those of another", path.display());
                self.snapshots.entries.clear();
                whole = false;
            }
            *self.store.borrow_mut() = whole.then_some(stored.store);
        }
        if !whole && said.is_empty() {
            let missing = there.iter().filter(|t| **t == 0).count();
            said = format!("{}: {missing} of {} states are missing", path.display(), there.len());
        }
        self.settings.interval = state.grid.map_or(self.settings.interval, |grid| grid.interval);
        self.state = match whole {
            true => State { kept: Vec::new(), marks: Vec::new(), ..state },
            false => State {
                grid: state.grid,
                present: state.present,
                file: state.file,
                changed: state.changed,
                ..State::default()
            },
        };
        Ok(if said.is_empty() { Restored::Whole } else { Restored::Lost(said) })
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
    /// of these states. Returns this rank's sum of squares of what that has changed, with the field's weights.
    ///
    /// # Panics
    /// If `out` is not as long as the field.
    pub fn field(&self, f: usize, prediction: &Combination, out: &mut [f64]) -> f64 {
        assert_eq!(out.len(), self.snapshots.fields()[f].numbers());
        self.snapshots.combine(f, prediction, out)
    }
}

/// Whether a sample may lie between this step of the solver and the next: steps may grow, and one that ends at a sample needs no other.
fn is_passed_next(grid: Grid, time: f64, delta_t: f64) -> bool {
    let next = grid.after(time);
    grid.is_later(time + 2.0 * delta_t, next) && grid.at(time + delta_t) != Some(next)
}
