//! States at uniform times and their inner products, which all ranks have.
//!
//! A state is kept as its difference from the first one. What never changes is therefore kept to the bit by every combination
//! of states, and single precision is relative to what a field varies by, not to its level.

use crate::sums::{BLOCK, Dot, Storage, Sum, Values, sum_all, weigh};
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_parallel::{Comm, same_on_all_ranks};
use m4gn_state::{Array, Layout, Role};
use pulp::Arch;
use serde::{Deserialize, Serialize};

/// One kept state.
pub(crate) struct Entry {
    /// Its time is this many intervals after the first sample's.
    pub number: i64,
    /// Its row in the tables of inner products.
    pub slot: usize,
    /// Of each field.
    pub values: Vec<Values>,
    /// Least value of each field over all ranks, where it has a floor; infinite elsewhere.
    pub least: Vec<f64>,
}

/// A combination of kept states: the weight of each, by its slot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Combination(pub(crate) Vec<f64>);

/// The kept states, oldest first, `capacity` at most, with the inner products of each field.
pub struct Snapshots {
    comm: Comm,
    fields: Vec<Array>,
    storage: Storage,
    capacity: usize,
    pub(crate) reference: Vec<Vec<f64>>,
    /// Square of the reference, of each field.
    pub(crate) level: Vec<f64>,
    pub(crate) entries: Vec<Entry>,
    /// Of each field that is measured `capacity` times `capacity` inner products of differences from the reference, by slots; those of the
    /// last states are there once [`complete`](Self::complete) was called.
    pub(crate) products: Vec<Vec<f64>>,
    /// Last states without inner products.
    fresh: usize,
}

impl Snapshots {
    /// None yet. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that are no state, or that differ between the ranks in more than their length.
    pub fn new(comm: &Comm, fields: Vec<Array>, storage: Storage, capacity: usize) -> Result<Self> {
        comm.agree(check(&fields))?;
        let shared = Layout::new(fields.clone())?.shared();
        let single = i64::from(storage == Storage::Single);
        let options = [
            ("number of fields of the dmd surrogate", fields.len() as i64),
            ("snapshots of the dmd surrogate", capacity as i64),
            ("storage of the dmd surrogate", single),
        ];
        same_on_all_ranks(comm, &options)?;
        comm.agree_with(Ok(()), &shared)?;
        Ok(Snapshots {
            comm: comm.clone(),
            reference: Vec::new(),
            level: Vec::new(),
            entries: Vec::new(),
            products: fields
                .iter()
                .map(|f| vec![0.0; if enters(f) { capacity * capacity } else { 0 }])
                .collect(),
            fields,
            storage,
            capacity,
            fresh: 0,
        })
    }

    /// Bytes on this rank when all snapshots are there and all fields change, one more to interpolate from included.
    pub fn memory(&self) -> usize {
        let numbers: usize = self.fields.iter().map(Array::numbers).sum();
        let each = match self.storage {
            Storage::Double => 8,
            Storage::Single => 4,
        };
        let products: usize = self.products.iter().map(Vec::len).sum();
        numbers * (self.capacity * each + 2 * 8) + products * 8
    }

    /// The fields of a state.
    pub fn fields(&self) -> &[Array] {
        &self.fields
    }

    /// The ranks that have the states.
    pub fn comm(&self) -> &Comm {
        &self.comm
    }

    pub(crate) fn storage(&self) -> Storage {
        self.storage
    }

    /// Numbers of the kept states, ascending.
    pub fn numbers(&self) -> impl Iterator<Item = i64> + '_ {
        self.entries.iter().map(|e| e.number)
    }

    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    pub(crate) fn slot(&self, number: i64) -> Option<usize> {
        let found = self.entries.binary_search_by_key(&number, |e| e.number);
        found.ok().map(|i| self.entries[i].slot)
    }

    /// Drops all of them.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.fresh = 0;
    }

    /// Drops all but those of these numbers, ascending, which are then numbered from `first` on; all have their inner products.
    pub(crate) fn thin(&mut self, stays: &[i64], first: i64) {
        self.entries.retain(|e| stays.binary_search(&e.number).is_ok());
        self.entries.iter_mut().zip(first..).for_each(|(e, number)| e.number = number);
    }

    /// Keeps a state; where there is no room, `spare` names the kept one (its place, oldest first) that goes. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of values than the fields have, a value that is not finite, or a number that is not above
    /// all kept ones.
    pub fn push(&mut self, number: i64, state: &[&[f64]], spare: impl Fn(&Self) -> usize) -> Result<()> {
        let checked = self.check(number, state);
        self.comm.agree(checked)?;
        if self.reference.is_empty() {
            self.set_reference(state.iter().map(|v| v.to_vec()).collect());
        }
        let mut entry = match self.entries.len() < self.capacity {
            true => {
                let used = |slot: &usize| self.entries.iter().any(|e| e.slot == *slot);
                let slot = (0..self.capacity).find(|s| !used(s)).unwrap_or(0);
                Entry { number, slot, values: vec![Values::Same; self.fields.len()], least: Vec::new() }
            }
            false => {
                let place = spare(self).min(self.entries.len() - 1);
                self.fresh -= usize::from(place + self.fresh >= self.entries.len());
                self.entries.remove(place)
            }
        };
        entry.number = number;
        for ((to, x), r) in entry.values.iter_mut().zip(state).zip(&self.reference) {
            to.set(self.storage, x, r);
        }
        let least = |(f, x): (&Array, &&[f64])| match f.floor.is_some() {
            true => -x.iter().copied().fold(f64::INFINITY, f64::min),
            false => f64::NEG_INFINITY,
        };
        let mut negative: Vec<f64> = self.fields.iter().zip(state).map(least).collect();
        self.comm.max_f64(&mut negative);
        entry.least = negative.iter().map(|v| -v).collect();
        self.add(entry);
        Ok(())
    }

    /// Takes up a state that is later than all others.
    pub(crate) fn add(&mut self, entry: Entry) {
        self.entries.push(entry);
        self.fresh += 1;
    }

    /// Square of a field's difference from the reference, summed over all ranks; 0 before [`Self::complete`].
    pub(crate) fn square(&self, field: usize, entry: &Entry) -> f64 {
        self.products[field].get(entry.slot * (self.capacity + 1)).copied().unwrap_or(0.0)
    }

    /// Makes the inner products of the states that came since the last call: several states at once read those before them once. Collective.
    pub(crate) fn complete(&mut self) {
        if self.fresh > 0 {
            let sums = sum_all(&self.comm, &self.local_products());
            self.set_products(&sums);
            self.fresh = 0;
        }
    }

    fn check(&self, number: i64, state: &[&[f64]]) -> Result<()> {
        refuse(state.len() != self.fields.len(), Error::Input, || {
            format!("dmd: a state of {} fields: expected {}", state.len(), self.fields.len())
        })?;
        for (f, x) in self.fields.iter().zip(state) {
            refuse(x.len() != f.numbers(), Error::Input, || {
                format!("dmd: field {}: {} values: expected {}", f.name, x.len(), f.numbers())
            })?;
            refuse_any(x.iter().position(|v| !v.is_finite()), Error::Input, |i| {
                format!("dmd: field {}: value {i} is {}: expected finite numbers", f.name, x[i])
            })?;
        }
        refuse_any(self.entries.last().filter(|last| last.number >= number), Error::Input, |last| {
            format!("dmd: state number {number} after {}: expected a later one", last.number)
        })
    }

    /// Collective.
    pub(crate) fn set_reference(&mut self, reference: Vec<Vec<f64>>) {
        let square = |(f, x): (&Array, &Vec<f64>)| {
            let mut sum = Sum::default();
            let mut weighted = [0.0; BLOCK];
            for from in (0..x.len()).step_by(BLOCK) {
                let part = &x[from..x.len().min(from + BLOCK)];
                let weighted = &mut weighted[..part.len()];
                weighted.copy_from_slice(part);
                weigh(f, from, weighted);
                Arch::new().dispatch(Dot { sum: &mut sum, a: weighted, b: part });
            }
            sum
        };
        let squares: Vec<Sum> = self.fields.iter().zip(&reference).map(square).collect();
        self.level = sum_all(&self.comm, &squares);
        self.reference = reference;
    }

    /// This rank's part of the inner products of the fresh states with all up to each: of a field those of the first fresh state, of the
    /// second, and so on, then those of the next field.
    fn local_products(&self) -> Vec<Sum> {
        let n = self.entries.len();
        let mut products = vec![Sum::default(); self.fresh * n * self.fields.len()];
        let mut weighted = [0.0; BLOCK];
        for (f, (field, sums)) in
            self.fields.iter().zip(products.chunks_exact_mut(self.fresh * n)).enumerate()
        {
            if !enters(field) {
                continue;
            }
            for from in (0..field.numbers()).step_by(BLOCK) {
                let weighted = &mut weighted[..(field.numbers() - from).min(BLOCK)];
                for (last, row) in (n - self.fresh..n).zip(sums.chunks_exact_mut(n)) {
                    weighted.fill(0.0);
                    self.entries[last].values[f].add(1.0, from, weighted);
                    weigh(field, from, weighted);
                    for (sum, e) in row.iter_mut().zip(&self.entries[..=last]) {
                        e.values[f].dot(sum, weighted, from);
                    }
                }
            }
        }
        products
    }

    /// Inner products of prescribed values at another time with those of the kept states, of each field by slots; `fields` has all fields, of
    /// which those that are not prescribed are not read. Collective.
    pub(crate) fn products_with(&self, fields: &[&[f64]]) -> Vec<Vec<f64>> {
        let n = self.entries.len();
        let mut sums = vec![Sum::default(); n * self.fields.len()];
        let each = self.fields.iter().zip(sums.chunks_exact_mut(n.max(1))).enumerate();
        for (f, (field, sums)) in each.filter(|(_, (field, _))| field.role == Role::Prescribed) {
            let pairs = fields[f].iter().zip(&self.reference[f]);
            let mut weighted: Vec<f64> = pairs.map(|(x, r)| x - r).collect();
            weigh(field, 0, &mut weighted);
            for (from, part) in weighted.chunks(BLOCK).enumerate() {
                for (sum, e) in sums.iter_mut().zip(&self.entries) {
                    e.values[f].dot(sum, part, from * BLOCK);
                }
            }
        }
        let sums = sum_all(&self.comm, &sums);
        let of = |row: &[f64]| {
            let mut products = vec![0.0; self.capacity];
            self.entries.iter().zip(row).for_each(|(e, sum)| products[e.slot] = *sum);
            products
        };
        sums.chunks_exact(n.max(1)).map(of).collect()
    }

    fn set_products(&mut self, sums: &[f64]) {
        let (n, c) = (self.entries.len(), self.capacity);
        let slots: Vec<usize> = self.entries.iter().map(|e| e.slot).collect();
        for (table, sums) in self.products.iter_mut().zip(sums.chunks_exact(self.fresh * n)) {
            if table.is_empty() {
                continue;
            }
            for (last, row) in (n - self.fresh..n).zip(sums.chunks_exact(n)) {
                for (&slot, sum) in slots[..=last].iter().zip(row) {
                    table[slots[last] * c + slot] = *sum;
                    table[slot * c + slots[last]] = *sum;
                }
            }
        }
    }

    /// Of each field the square of the most that a kept state differs from the first one by.
    pub(crate) fn changed(&self) -> Vec<f64> {
        let most = |f: usize| self.entries.iter().map(|e| self.square(f, e)).fold(0.0, f64::max);
        (0..self.fields.len()).map(most).collect()
    }

    /// Square of a change of field `f` that is rounding of its level.
    pub(crate) fn rounding(&self, f: usize) -> f64 {
        f64::EPSILON * f64::EPSILON * 1e4 * self.level.get(f).unwrap_or(&0.0)
    }

    /// A number a state that has its inner products, the same on all ranks: the squares of the reference and of the difference from it, all
    /// fields together.
    pub(crate) fn marks(&self) -> Vec<f64> {
        let level: f64 = self.level.iter().sum();
        let of = |e: &Entry| (0..self.fields.len()).map(|f| self.square(f, e)).sum::<f64>() + level;
        self.entries[..self.entries.len() - self.fresh].iter().map(of).collect()
    }

    /// Mean square of what field `f` varies by about its mean over these slots; 0 where that is rounding.
    pub(crate) fn variation(&self, f: usize, slots: &[usize]) -> f64 {
        let (t, c, m) = (&self.products[f], self.capacity, slots.len() as f64);
        if t.is_empty() || slots.is_empty() {
            return 0.0;
        }
        let squares: f64 = slots.iter().map(|s| t[s * c + s]).sum::<f64>() / m;
        let mean: f64 =
            slots.iter().map(|a| slots.iter().map(|b| t[a * c + b]).sum::<f64>()).sum::<f64>() / (m * m);
        let rounding = self.rounding(f) + 16.0 * f64::EPSILON * squares;
        match squares - mean {
            v if v > rounding => v,
            _ => 0.0,
        }
    }

    /// Square of the difference of two combinations of states in field `f`.
    pub(crate) fn distance(&self, f: usize, a: &Combination, b: &Combination) -> f64 {
        let (t, c) = (&self.products[f], self.capacity);
        if t.is_empty() {
            return 0.0;
        }
        let d: Vec<(usize, f64)> = (0..c).map(|s| (s, a.0[s] - b.0[s])).filter(|(_, d)| *d != 0.0).collect();
        let sum: f64 = d.iter().map(|(i, x)| x * d.iter().map(|(j, y)| y * t[i * c + j]).sum::<f64>()).sum();
        sum.max(0.0)
    }

    /// Of each field the square of the difference of a combination from a state that is not kept; 0 where it is no part of the inner product.
    /// Collective.
    pub(crate) fn distances(&self, combination: &Combination, state: &[&[f64]]) -> Vec<f64> {
        let square = |(f, x): (usize, &&[f64])| {
            let (field, mut sum) = (&self.fields[f], Sum::default());
            if enters(field) {
                let mut off = vec![0.0; x.len()];
                self.combine(f, combination, &mut off);
                off.iter_mut().zip(*x).for_each(|(o, x)| *o -= x);
                let mut weighted = off.clone();
                weigh(field, 0, &mut weighted);
                Arch::new().dispatch(Dot { sum: &mut sum, a: &weighted, b: &off });
            }
            sum
        };
        sum_all(&self.comm, &state.iter().enumerate().map(square).collect::<Vec<Sum>>())
    }

    /// The kept state of this number as a combination.
    pub(crate) fn single(&self, number: i64) -> Option<Combination> {
        let slot = self.slot(number)?;
        let mut c = vec![0.0; self.capacity];
        c[slot] = 1.0;
        Some(Combination(c))
    }

    /// The mean of the kept states of these numbers as a combination.
    pub(crate) fn mean(&self, numbers: &[i64]) -> Combination {
        let mut c = vec![0.0; self.capacity];
        let slots = numbers.iter().filter_map(|&n| self.slot(n));
        slots.for_each(|slot| c[slot] = 1.0 / numbers.len() as f64);
        Combination(c)
    }

    /// Field `f` of a combination of kept states. A value below the field's floor is replaced by the least value of these states, unless
    /// that is below it too. Returns this rank's sum of squares of what that has changed, with the field's weights.
    pub(crate) fn combine(&self, f: usize, combination: &Combination, out: &mut [f64]) -> f64 {
        let used: Vec<(&Entry, f64)> =
            self.entries.iter().map(|e| (e, combination.0[e.slot])).filter(|(_, c)| *c != 0.0).collect();
        for (b, block) in out.chunks_mut(BLOCK).enumerate() {
            block.fill(0.0);
            for (e, c) in &used {
                e.values[f].add(*c, b * BLOCK, block);
            }
            for (o, r) in block.iter_mut().zip(&self.reference[f][b * BLOCK..]) {
                *o += r;
            }
        }
        let field = &self.fields[f];
        let Some(floor) = field.floor else { return 0.0 };
        let least = used.iter().map(|(e, _)| e.least[f]).fold(f64::INFINITY, f64::min);
        if least < floor {
            // The solver's own values are: a gauge or pore pressure, a temperature in degrees Celsius
            return 0.0;
        }
        let mut raised = 0.0;
        for (i, o) in out.iter_mut().enumerate().filter(|(_, o)| **o < floor) {
            let weight = field.weights.get(i / field.components).copied().unwrap_or(1.0);
            raised += weight * (least - *o).powi(2);
            *o = least;
        }
        raised
    }
}

/// Whether a field is part of the inner product of states.
pub(crate) fn enters(field: &Array) -> bool {
    matches!(field.role, Role::Solved | Role::Prescribed)
}

fn check(fields: &[Array]) -> Result<()> {
    match fields.iter().any(enters) {
        true => Layout::new(fields.to_vec()).map(|_| ()),
        false => Err(Error::Input("dmd: expected at least one array with an equation in time".into())),
    }
}
