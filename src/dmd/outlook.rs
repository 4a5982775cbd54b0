//! What a fit says of later times, what it has to be told of them for that, and how far it was off.

use crate::choose::{prescribed, spread, typical};
use crate::dmd::Dmd;
use crate::driven::Driven;
use crate::fit::{FieldError, Fit, Model, errors, relative};
use crate::online::{OnlineDmd, Predicted, is_passed_next};
use crate::sampling::SAME;
use crate::snapshots::Combination;
use crate::spectrum::Mode;
use m4gn_base::{Error, Result, refuse};
use serde::{Deserialize, Serialize};

/// How far inputs halfway between samples may be off the samples' mean, root mean squares over what they vary by: a wave of three samples a
/// period is by a half, one of fourteen by a fortieth.
const UNRESOLVED: f64 = 0.5;

/// Part of a stride behind which a fit is compared with the solver between samples: waves of one, two, three ... periods a stride, which
/// samples take for slow ones, are far from these there.
const BETWEEN: f64 = 0.35;

/// Error there, over that of holding the sample, from which on a fit is wrong: such a wave has about 1.
const WRONG: f64 = 0.5;

/// What a fit says of the times after a sample, whatever comes after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outlook {
    course: Course,
    /// Of the window's snapshots.
    slots: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Course {
    Free {
        dmd: Dmd,
        amplitudes: Vec<[f64; 2]>,
    },
    Driven {
        driven: Driven,
        /// The sample.
        from: i64,
        /// Of the last samples, oldest first.
        rests: Vec<Vec<f64>>,
        inputs: Vec<Vec<f64>>,
        /// Of each field what it varies by where it is prescribed; 0 for the others.
        prescribed: Vec<f64>,
    },
}

impl Outlook {
    pub(crate) fn free(dmd: Dmd, amplitudes: Vec<[f64; 2]>, slots: Vec<usize>) -> Self {
        Outlook { course: Course::Free { dmd, amplitudes }, slots }
    }

    /// Slots of the window's snapshots.
    pub(crate) fn slots(&self) -> &[usize] {
        &self.slots
    }

    /// The modes and their amplitudes; none with inputs.
    pub(crate) fn waves(&self) -> Option<(&Dmd, &[[f64; 2]])> {
        match &self.course {
            Course::Free { dmd, amplitudes } => Some((dmd, amplitudes)),
            Course::Driven { .. } => None,
        }
    }
}

/// What is prescribed at a later time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Foreseen {
    /// In samples.
    position: f64,
    /// Of each field that is prescribed its products with the kept states, by slots.
    products: Vec<Vec<f64>>,
}

/// Values at `n` times, one apart from 0 on, at a time between: the weight of each (Lagrange).
fn between(t: f64, n: usize) -> Vec<f64> {
    let times = || (0..n).map(|time| time as f64);
    let weight = |own: f64| {
        times().filter(|other| *other != own).map(|other| (t - other) / (own - other)).product::<f64>()
    };
    times().map(weight).collect()
}

fn combined(of: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    (0..of[0].len()).map(|i| of.iter().zip(weights).map(|(v, w)| w * v[i]).sum()).collect()
}

/// The whole number of strides in these, and whether a part of one is left.
fn whole(strides: f64) -> (i64, bool) {
    let whole = (strides + SAME).floor();
    (whole as i64, strides - whole > SAME)
}

/// The last sample that a state so many strides later is made of, and whether it is interpolated: between four, two of them later where the
/// inputs are known so far.
fn last(strides: f64) -> (i64, bool) {
    match whole(strides) {
        (0.., false) => (whole(strides).0, false),
        (whole, _) => ((whole + 2).max(2), true),
    }
}

impl OnlineDmd {
    /// The state at `strides` after the present one, as a combination of kept states. None without a fit, where one of the last states that
    /// it begins from is missing, or inputs from there on were not [foreseen](Self::foresee).
    pub fn predict(&self, strides: f64) -> Option<Combination> {
        self.later(&self.outlook()?, strides).ok()
    }

    /// What the fit says of the times after the present sample; none without a fit, or where one of the states that it begins from is missing.
    pub fn outlook(&self) -> Option<Outlook> {
        let fit = self.state.fit.as_ref()?;
        let from = self.state.present?;
        let numbers = from - fit.model.delays() as i64 + 1..=from;
        let rows = numbers.clone().map(|n| Some(self.row(&self.at(n)?, &fit.slots, &fit.variation)));
        let rows = rows.collect::<Option<Vec<Vec<f64>>>>()?;
        let slots = fit.slots.clone();
        let course = match &fit.model {
            Model::Free(dmd) => {
                let history: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
                Course::Free { amplitudes: dmd.amplitudes(&history), dmd: dmd.clone() }
            }
            Model::Driven(driven) => {
                let prescribed = prescribed(&self.snapshots, &fit.variation);
                let inputs = numbers.map(|n| self.input(driven, &slots, &prescribed, n as f64));
                let inputs = inputs.collect::<Option<Vec<Vec<f64>>>>()?;
                let rests = rows.iter().zip(&inputs).map(|(row, v)| driven.rest(row, v)).collect();
                Course::Driven { driven: driven.clone(), from, rests, inputs, prescribed }
            }
        };
        Some(Outlook { course, slots })
    }

    /// The modes of the fit at present, largest share of the energy first; none as for [`predict`](Self::predict), and with inputs.
    pub fn modes(&self) -> Vec<Mode> {
        let outlook = self.outlook();
        let waves = outlook.as_ref().and_then(Outlook::waves);
        let (Some((dmd, amplitudes)), Some(fit)) = (waves, &self.state.fit) else { return Vec::new() };
        let fields = fit.variation.iter().filter(|v| **v > 0.0).count();
        dmd.spectrum(amplitudes, self.settings.interval, fields)
    }

    /// The state at `strides` after an outlook's sample.
    ///
    /// # Errors
    /// [`Error::Numerical`] where the inputs up to there are not known, or the fit must not be used so far.
    pub fn later(&self, outlook: &Outlook, strides: f64) -> Result<Combination> {
        let (driven, from, rests, inputs, prescribed) = match &outlook.course {
            Course::Free { dmd, amplitudes } => {
                return Ok(spread(&self.snapshots, &outlook.slots, &dmd.weights(amplitudes, strides)));
            }
            Course::Driven { driven, from, rests, inputs, prescribed } => {
                (driven, *from, rests, inputs, prescribed)
            }
        };
        let input = |position: f64| self.input(driven, &outlook.slots, prescribed, position);
        let mut inputs = inputs.clone();
        let (last, interpolated) = last(strides);
        for n in 1..=last {
            match input((from + n) as f64) {
                Some(v) => inputs.push(v),
                // An old level of a state at the last sample that is known
                None if (n - 1) as f64 >= strides => break,
                None => {
                    return Err(Error::Numerical(
                        "what is prescribed from here on is not known: the solver goes on".into(),
                    ));
                }
            }
        }
        let rests = driven.follow(rests, &inputs).map_err(Error::Numerical)?;
        let place = (driven.shape.delays - 1) as i64 + whole(strides).0;
        let weights = match interpolated {
            true => {
                let n = rests.len().min(4);
                let first = (place - 1).clamp(0, (rests.len() - n) as i64) as usize;
                let at = between(strides + (driven.shape.delays - 1) as f64 - first as f64, n);
                let known = input(from as f64 + strides);
                let v = known.unwrap_or_else(|| combined(&inputs[first..first + n], &at));
                driven.weights(&combined(&rests[first..first + n], &at), &v)
            }
            false => driven.weights(&rests[place as usize], &inputs[place as usize]),
        };
        Ok(spread(&self.snapshots, &outlook.slots, &weights))
    }

    /// Whether the samples up to `strides` after the present one tell what is prescribed between them, as far as that was
    /// [foreseen](Self::foresee). To be asked before a stride is taken: one that was taken stays, whatever is foreseen for the next.
    ///
    /// # Errors
    /// [`Error::Numerical`] where what is prescribed changes faster.
    pub fn resolves(&self, strides: f64) -> Result<()> {
        let (Some(fit), Some(from)) = (&self.state.fit, self.state.present) else { return Ok(()) };
        let Model::Driven(driven) = &fit.model else { return Ok(()) };
        let variation = prescribed(&self.snapshots, &fit.variation);
        let input = |position: f64| self.input(driven, &fit.slots, &variation, position);
        let mut off = Vec::new();
        let mut before = input(from as f64);
        for n in 1..=last(strides).0 {
            let position = (from + n) as f64;
            let (half, next) = (input(position - 0.5), input(position));
            if let (Some(a), Some(half), Some(b)) = (before, half, next.clone()) {
                off.push(driven.square(&half, &combined(&[a, b], &[0.5, 0.5])));
            }
            before = next;
        }
        let unresolved = off.iter().sum::<f64>() > UNRESOLVED * UNRESOLVED * off.len() as f64;
        refuse(
            unresolved,
            Error::Numerical,
            || "what is prescribed changes faster than states are apart: the solver goes on; expected a snapshotInterval of a tenth of its period",
        )
    }

    /// The times, in strides after the present sample, at which the fit has to [foresee](Self::foresee) what is prescribed, for the state at
    /// `strides`.
    pub fn asks(&self, strides: f64) -> Vec<f64> {
        let (Some(Fit { model: Model::Driven(_), .. }), Some(from)) = (&self.state.fit, self.state.present)
        else {
            return Vec::new();
        };
        let (last, interpolated) = last(strides);
        // Those between say whether the samples tell of what is prescribed
        let mut all: Vec<f64> = (1..=last).flat_map(|n| [n as f64 - 0.5, n as f64]).collect();
        if interpolated && strides > 0.0 && !all.iter().any(|s| (s - strides).abs() < SAME) {
            all.push(strides);
        }
        all.retain(|s| !self.state.foreseen.iter().any(|f| (f.position - from as f64 - s).abs() < SAME));
        all
    }

    /// What is prescribed `strides` after the present sample: `fields` has the values of the prescribed ones. Collective.
    pub fn foresee(&mut self, strides: f64, fields: &[&[f64]]) {
        let Some(present) = self.state.present else { return };
        let products = self.snapshots.products_with(fields);
        self.state.foreseen.push(Foreseen { position: present as f64 + strides, products });
    }

    /// What was foreseen of samples that are there is not needed any more.
    pub(crate) fn forget_foreseen(&mut self) {
        let present = self.state.present.unwrap_or(i64::MIN) as f64;
        self.state.foreseen.retain(|f| f.position > present + SAME);
    }

    /// Keeps the snapshots that an outlook needs; none: of no outlook any more.
    pub fn hold(&mut self, outlook: Option<&Outlook>) {
        self.held = outlook.map(|o| o.slots.clone()).unwrap_or_default();
    }

    /// Products of a state with those in these slots, each field over its variation.
    fn row(&self, state: &Combination, slots: &[usize], variation: &[f64]) -> Vec<f64> {
        let c = self.snapshots.capacity();
        let used: Vec<(usize, f64)> =
            state.0.iter().copied().enumerate().filter(|(_, w)| *w != 0.0).collect();
        let mut products = vec![0.0; slots.len()];
        for (table, v) in self.snapshots.products.iter().zip(variation).filter(|(_, v)| **v > 0.0) {
            for (p, slot) in products.iter_mut().zip(slots) {
                *p += used.iter().map(|(s, w)| w * table[s * c + slot]).sum::<f64>() / v;
            }
        }
        products
    }

    /// The same of what is prescribed at a time, in samples; none where that is not known.
    fn prescribed_row(&self, position: f64, slots: &[usize], variation: &[f64]) -> Option<Vec<f64>> {
        if (position - position.round()).abs() < SAME
            && let Some(state) = self.at(position.round() as i64)
        {
            return Some(self.row(&state, slots, variation));
        }
        let foreseen = self.state.foreseen.iter().find(|f| (f.position - position).abs() < SAME)?;
        let mut row = vec![0.0; slots.len()];
        for (products, v) in foreseen.products.iter().zip(variation).filter(|(_, v)| **v > 0.0) {
            row.iter_mut().zip(slots).for_each(|(p, slot)| *p += products[*slot] / v);
        }
        Some(row)
    }

    /// The inputs there, as [`prescribed_row`](Self::prescribed_row).
    fn input(&self, driven: &Driven, slots: &[usize], variation: &[f64], position: f64) -> Option<Vec<f64>> {
        Some(driven.input(&self.prescribed_row(position, slots, variation)?))
    }

    /// The run goes on from the prediction `strides` after the present one, which is that of `time`, and the next step is one of `delta_t`.
    pub fn jump(&mut self, strides: f64, time: f64, delta_t: f64) -> bool {
        let (Some(present), Some(grid), Some(outlook)) =
            (self.state.present, self.state.grid, self.outlook())
        else {
            return false;
        };
        let Ok(end) = self.later(&outlook, strides) else { return false };
        let whole = (strides + SAME) as usize;
        let first = whole.saturating_sub(self.most_delays() as usize) + 1;
        for s in first..=whole {
            let Ok(state) = self.later(&outlook, s as f64) else { return false };
            self.state.predicted.push_back(Predicted { number: present + s as i64, state });
        }
        let number = present + whole as i64;
        let oldest = number - self.most_delays();
        self.state.predicted.retain(|p| p.number > oldest);
        self.state.present = Some(number);
        self.forget_foreseen();
        // The solver's own steps are interpolated from the state that it goes on from.
        self.last = is_passed_next(grid, time, delta_t).then(|| {
            let mut fields: Vec<Vec<f64>> =
                self.snapshots.fields().iter().map(|f| vec![0.0; f.numbers()]).collect();
            for (f, values) in fields.iter_mut().enumerate() {
                self.field(f, &end, values);
            }
            (time, fields)
        });
        true
    }

    /// How far a prediction is off from the kept state of the present, field by field; `before`: where it began, in strides before.
    pub fn errors(&self, prediction: &Combination, before: usize) -> Option<Vec<FieldError>> {
        let fit = self.state.fit.as_ref()?;
        let present = self.state.present?;
        let state = self.snapshots.single(present)?;
        let from = self.at(present - before as i64)?;
        let least = self.least();
        let squares = |f| {
            let change = self.snapshots.distance(f, &from, &state);
            let typical = match fit.model {
                Model::Free(_) => 0.0,
                Model::Driven(_) => typical(&self.snapshots, (&fit.numbers, &fit.slots), f, before as i64),
            };
            [self.snapshots.distance(f, prediction, &state), change.max(least[f]).max(typical)]
        };
        Some(errors(self.snapshots.fields(), &fit.variation, squares))
    }

    /// Whether the fit is to be compared with the solver's state at this time, to which its last step, s, has led: behind the last of its
    /// samples, as what changes later says nothing of them. One with inputs asks for what is prescribed itself ([`resolves`](Self::resolves)).
    pub fn is_between(&self, time: f64, delta_t: f64) -> bool {
        let new = |fit: &Fit| fit.numbers.last().copied() == self.state.present;
        let free = |fit: &&Fit| matches!(fit.model, Model::Free(_));
        let (Some(before), Some(here)) = (self.since(time - delta_t), self.since(time)) else { return false };
        self.state.fit.as_ref().filter(free).is_some_and(new)
            && before < BETWEEN
            && (BETWEEN..1.0 - SAME).contains(&here)
    }

    /// The error of the fit where it [is between](Self::is_between) samples, over that of holding the last one, if it is wrong there: its
    /// samples have missed faster waves. None elsewhere. Collective.
    pub fn wrong_between(&self, time: f64, delta_t: f64, state: &[&[f64]]) -> Option<f64> {
        let fit = self.state.fit.as_ref().filter(|_| self.is_between(time, delta_t))?;
        let prediction = self.predict(self.since(time)?)?;
        let off = self.snapshots.distances(&prediction, state);
        let changes = self.snapshots.distances(&self.at(self.state.present?)?, state);
        let least = self.least();
        let squares = |f: usize| [off[f], changes[f].max(least[f])];
        let errors = errors(self.snapshots.fields(), &fit.variation, squares);
        Some(relative(&errors)).filter(|error| *error >= WRONG)
    }

    fn at(&self, number: i64) -> Option<Combination> {
        let predicted = || Some(self.state.predicted.iter().find(|p| p.number == number)?.state.clone());
        self.snapshots.single(number).or_else(predicted)
    }
}
