//! A run that is carried on: the snapshots on disk, and what goes with them.

use crate::online::{OnlineDmd, State, is_passed_next};
use crate::store::{Store, numbers};
use m4gn_base::{Error, Result};
use std::collections::HashMap;
use std::path::Path;

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

impl OnlineDmd {
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

    /// All times are later by this, s, in a run that is carried on at a time whose name is rounded.
    pub fn shift(&mut self, later: f64) {
        self.state.grid.iter_mut().for_each(|grid| grid.time += later);
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
        if state.kept.is_empty() {
            self.settings.interval = state.grid.map_or(self.settings.interval, |grid| grid.interval);
            self.state = state;
            return Ok(Restored::Whole);
        }
        let there = numbers(path);
        let superseded = !there.contains(&state.file) && there.iter().any(|n| *n > state.file);
        if self.snapshots.comm().any(superseded) {
            self.begin_beside(path, &state);
            return Ok(Restored::Superseded);
        }
        let (mut found, mut loss) = (None, String::new());
        match Store::read(path, state.file, &self.snapshots, &state.kept) {
            Ok(stored) => {
                if !stored.damage.is_empty() {
                    loss = format!("{}: {}; it and what follows are dropped", path.display(), stored.damage);
                }
                found = Some(stored);
            }
            Err(e) => loss = e.to_string(),
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
                loss = format!("{}: expected the states of this run, found those of another", path.display());
                self.snapshots.entries.clear();
                whole = false;
            }
            *self.store.borrow_mut() = whole.then_some(stored.store);
        }
        if !whole && loss.is_empty() {
            let missing = there.iter().filter(|t| **t == 0).count();
            loss = format!("{}: {missing} of {} states are missing", path.display(), there.len());
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
        Ok(if loss.is_empty() { Restored::Whole } else { Restored::Lost(loss) })
    }
}
