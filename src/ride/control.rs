//! Error control of jumps: how far a surrogate may go before it hands back.
//!
//! While the solver works, the surrogate takes the same strides beside it, from the solver's own states. What such a stride is off
//! by (Pearson correlation of 0.96 with the error of the following jump over cases inside and outside the range of training), times
//! the growth that the model was calibrated with ([`m4gn_model::Calibration`]), is the estimate of a jump's error; a jump gets
//! as many strides as keep it within the tolerance, and none where the stride's error was too large a part of what the solver changed in it.
//! Errors are root mean squares over nodes and solved components, relative to the largest variation that the field has had in the run
//! ([`StrideError::variation`]).

pub use crate::control_settings::{ControlSettings, OnFailure};
use crate::surrogate::Growth;
use m4gn_base::{Error, Result, refuse};
use serde::{Deserialize, Serialize};

/// Of the size of a field the change in a stride above which it is more than rounding.
const VARIES: f64 = 1e-9;

/// Most that a stride of a jump may change a field, over the largest change by a stride of the solver.
const MOST_CHANGE: f64 = 3.0;

/// A field over a stride that solver and surrogate both took: root mean squares over nodes and solved components.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StrideError {
    /// Of the surrogate's prediction minus the solver's state; not finite where the prediction was not.
    pub error: f64,
    /// Of what the solver changed.
    pub change: f64,
    /// Of the solver's state.
    pub size: f64,
    /// What errors are relative to: of a vector, `size`; of a scalar, whose zero may be anywhere (a temperature, a pressure), the
    /// root mean square about its mean over the nodes; at least `change`.
    pub variation: f64,
}

/// What has been measured of a predicted field; a run that is carried on has it too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Error of the last stride; none: it is not finite, or there was none.
    pub error: Option<f64>,
    /// Largest change so far.
    pub change: f64,
    /// Largest variation so far.
    pub variation: f64,
    /// Whether it has changed by more than rounding.
    pub varies: bool,
}

/// What a controller decides by, for a run that is carried on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controlled {
    /// Of each predicted field.
    pub fields: Vec<Measured>,
    /// Strides in a row that allowed no jump.
    pub bad: usize,
}

/// One predicted field.
#[derive(Clone, Debug)]
struct Track {
    name: String,
    /// Whether the tolerance holds for it: it is named, or nothing is said and it is one of those that may be watched.
    watched: bool,
    /// Growth of its errors with the strides of a jump.
    growth: Growth,
    seen: Measured,
}

impl Track {
    /// Infinite for what is no error: not a number, below 0, or infinite like the field.
    fn relative(&self, error: f64) -> f64 {
        match error {
            0.0 => 0.0,
            error if error > 0.0 && error / self.seen.variation >= 0.0 => error / self.seen.variation,
            _ => f64::INFINITY,
        }
    }

    /// Of the last stride.
    fn last(&self) -> f64 {
        self.relative(self.seen.error.unwrap_or(f64::INFINITY))
    }

    fn estimate(&self, strides: usize) -> f64 {
        let factor = match &self.growth {
            Growth::Factors(factors) => factors.get(strides.max(1) - 1).copied().unwrap_or(f64::INFINITY),
            Growth::None => 1.0,
            Growth::Unknown => strides as f64,
        };
        match self.last() {
            0.0 => 0.0,
            relative => factor * relative,
        }
    }

    /// Strides that keep the estimate within the tolerance, `most` at most.
    fn strides(&self, tolerance: f64, most: usize) -> usize {
        let within = |n: &usize| self.estimate(*n) <= tolerance;
        match (self.last(), &self.growth) {
            (0.0, _) => most,
            (_, Growth::None) if within(&1) => most,
            (_, Growth::None) => 0,
            (_, Growth::Factors(factors)) => (1..=most.min(factors.len())).take_while(within).count(),
            (relative, Growth::Unknown) => {
                // The quotient may be one off by rounding.
                let near = (tolerance / relative) as usize;
                let candidates = [near.saturating_add(1), near, near.saturating_sub(1)];
                let allowed = candidates.into_iter().find(|n| *n > 0 && within(n));
                allowed.unwrap_or(0).min(most)
            }
        }
    }
}

/// The controller of a session's jumps. All ranks give it the same numbers, and it has no part that is collective.
#[derive(Clone, Debug)]
pub struct Control {
    settings: ControlSettings,
    tracks: Vec<Track>,
    measured: bool,
    /// Strides in a row that allowed no jump.
    bad: usize,
}

impl Control {
    /// Where nothing is said the first of these is watched that varies; unknown names are none.
    pub fn among(mut self, names: &[String]) -> Self {
        if self.settings.fields.is_none() {
            self.tracks.iter_mut().for_each(|t| t.watched = names.contains(&t.name));
        }
        self
    }

    /// The tracks that the tolerance holds for, and their places.
    fn watched(&self) -> impl Iterator<Item = (usize, &Track)> {
        let all = self.tracks.iter().enumerate().filter(|(_, t)| t.watched);
        let first = all.clone().find(|(_, t)| t.seen.varies).or(all.clone().next()).map(|(i, _)| i);
        let named = self.settings.fields.is_some();
        all.filter(move |(i, _)| named || Some(*i) == first)
    }

    /// For the fields that a surrogate advances, in its order, each with the growth of its errors where that is known.
    ///
    /// # Errors
    /// [`Error::Input`] for a field that it does not advance.
    pub fn new(fields: Vec<(String, Growth)>, settings: ControlSettings) -> Result<Self> {
        let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
        let watched: Vec<&str> = match &settings.fields {
            Some(fields) => fields.iter().map(String::as_str).collect(),
            None => names.clone(),
        };
        if let Some(unknown) = watched.iter().find(|w| !names.contains(w)) {
            return Err(Error::Input(format!(
                "control: fields: {unknown} is not predicted by the model; expected some of {}",
                names.join(", ")
            )));
        }
        let marks: Vec<bool> = names.iter().map(|name| watched.contains(name)).collect();
        let track = |((name, growth), watched)| Track { name, watched, growth, seen: Measured::default() };
        Ok(Control {
            tracks: fields.into_iter().zip(marks).map(track).collect(),
            settings,
            measured: false,
            bad: 0,
        })
    }

    /// What was set.
    pub fn settings(&self) -> &ControlSettings {
        &self.settings
    }

    /// Names of the fields that the tolerance holds for.
    pub fn held(&self) -> Vec<&str> {
        self.watched().map(|(_, t)| t.name.as_str()).collect()
    }

    /// Names of the watched fields whose growth the model does not know; their errors are reckoned to add up.
    pub fn not_calibrated(&self) -> Vec<&str> {
        let watched = self.watched().filter(|(_, t)| t.growth == Growth::Unknown);
        watched.map(|(_, t)| t.name.as_str()).collect()
    }

    /// Takes up a stride that solver and surrogate both took, a row for each predicted field.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of fields; [`Error::Numerical`] where the surrogate stays bad and the settings say
    /// `stop`.
    pub fn measure(&mut self, strides: &[StrideError]) -> Result<()> {
        self.check(strides.len())?;
        for (seen, stride) in self.tracks.iter_mut().map(|t| &mut t.seen).zip(strides) {
            seen.error = Some(stride.error).filter(|e| e.is_finite());
            seen.change = seen.change.max(stride.change);
            seen.variation = seen.variation.max(stride.variation);
            seen.varies |= stride.change > VARIES * stride.size;
        }
        self.measured = true;
        let loses = |stride: &StrideError| stride.error > self.settings.rel_tol * stride.change;
        let loses = self.watched().any(|(i, _)| loses(&strides[i]));
        self.bad = match loses || self.within_tolerance(1) == 0 {
            true => self.bad + 1,
            false => 0,
        };
        if self.stays_bad() {
            return Err(Error::Numerical(format!(
                "the error of the surrogate beside the solver was above what the tolerance {} allows, or above {} (relTol) of what the \
                 solver changed, in {} strides in a row, the last one by {:.2e}: its model does not fit this case. Train it for this case, \
                 raise the tolerance, or say onFailure solver",
                self.settings.tolerance,
                self.settings.rel_tol,
                self.bad,
                self.error()
            )));
        }
        Ok(())
    }

    /// Whether the surrogate stays bad, and the settings say stop.
    pub fn stays_bad(&self) -> bool {
        self.settings.on_failure == OnFailure::Stop && self.bad >= self.settings.patience
    }

    /// Relative error of the last stride, the largest of the watched fields; infinite before there was one.
    pub fn error(&self) -> f64 {
        self.largest(Track::last)
    }

    /// Relative error that is expected after a jump of so many strides, the largest of the watched fields.
    pub fn estimate(&self, strides: usize) -> f64 {
        self.largest(|t| t.estimate(strides))
    }

    fn largest(&self, of: impl Fn(&Track) -> f64) -> f64 {
        match self.measured {
            true => self.watched().map(|(_, t)| of(t)).fold(0.0, f64::max),
            false => f64::INFINITY,
        }
    }

    /// Strides of the next jump, `most` at most; 0: the surrogate must not jump.
    pub fn strides(&self, most: usize) -> usize {
        match self.bad {
            0 => self.within_tolerance(most),
            _ => 0,
        }
    }

    fn within_tolerance(&self, most: usize) -> usize {
        let watched = self.watched().filter(|_| self.measured);
        watched.map(|(_, t)| t.strides(self.settings.tolerance, most)).min().unwrap_or(0)
    }

    /// Why a stride of a jump that changes the predicted fields by so much (root mean squares) cannot be true: by more than three times what
    /// a stride of the solver has; none: it may be.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of fields.
    pub fn refuses(&self, changes: &[f64]) -> Result<Option<String>> {
        self.check(changes.len())?;
        let within = |(track, change): &(&Track, &f64)| **change <= MOST_CHANGE * track.seen.change;
        let beyond = self.tracks.iter().zip(changes).find(|pair| !within(pair));
        Ok(beyond.map(|(track, change)| {
            format!(
                "a stride would change {} by {change:.2e}, more than {MOST_CHANGE} times the most that the solver has in one, {:.2e}",
                track.name, track.seen.change
            )
        }))
    }

    /// Relative error of the watched fields, the largest, where their errors are these (root mean squares, of all predicted fields).
    ///
    /// # Errors
    /// [`Error::Input`] for another number of fields.
    pub fn relative(&self, errors: &[f64]) -> Result<f64> {
        self.check(errors.len())?;
        Ok(self.watched().map(|(i, t)| t.relative(errors[i])).fold(0.0, f64::max))
    }

    /// What the controller decides by; none before a stride was measured.
    pub fn state(&self) -> Option<Controlled> {
        // JSON, which the state is kept in, has no infinity.
        let row = |Track { seen, .. }: &Track| Measured {
            change: seen.change.min(f64::MAX),
            variation: seen.variation.min(f64::MAX),
            ..*seen
        };
        self.measured.then(|| Controlled { fields: self.tracks.iter().map(row).collect(), bad: self.bad })
    }

    /// Goes on from the [`state`](Self::state) of another run.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of fields, and for changes and variations that are no such figures.
    pub fn restore(&mut self, saved: &Controlled) -> Result<()> {
        self.check(saved.fields.len())?;
        let usable = |figure: f64| figure.is_finite() && figure >= 0.0;
        if let Some(row) = saved.fields.iter().find(|r| !(usable(r.change) && usable(r.variation))) {
            return Err(Error::Input(format!(
                "control: expected a change and a variation that are finite and not below 0, found {} and {}",
                row.change, row.variation
            )));
        }
        self.tracks.iter_mut().zip(&saved.fields).for_each(|(track, row)| track.seen = *row);
        (self.measured, self.bad) = (true, saved.bad);
        Ok(())
    }

    fn check(&self, found: usize) -> Result<()> {
        let expected = self.tracks.len();
        refuse(found != expected, Error::Input, || {
            format!(
                "control: expected figures of the {expected} fields that the model predicts, found {found}"
            )
        })
    }
}

#[cfg(test)]
#[path = "control_tests.rs"]
mod tests;
