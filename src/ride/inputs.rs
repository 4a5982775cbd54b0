//! What is prescribed from here on: what a surrogate has to know of it, and whether what a fit says agrees.

use crate::dmd::{DmdSurrogate, rounded};
use crate::ride::Ride;
use m4gn_base::{Error, Result, refuse};
use m4gn_dmd::Combination;
use m4gn_state::{Role, Values};

impl DmdSurrogate {
    /// Strides from the present snapshot to a time from now on, s.
    fn strides(&self, later: f64) -> f64 {
        rounded(self.now.offset + self.now.ahead + later / self.description.stride)
    }

    /// The times from now on, s, at which it has to [foresee](Self::foresee) what is prescribed before it predicts the state so much later.
    pub(crate) fn asks(&self, duration: f64) -> Vec<f64> {
        let here = self.strides(0.0);
        // What was prescribed before nobody says any more
        let asked = self.online.asks(self.strides(duration)).into_iter().filter(|s| *s >= here);
        asked.map(|s| (s - here) * self.description.stride).collect()
    }

    /// The prescribed arrays a time from now on, s. Collective.
    pub(crate) fn foresee(&mut self, later: f64, values: &Values) {
        let fields: Vec<&[f64]> = self.places.iter().map(|&i| values[i].as_slice()).collect();
        self.online.foresee(self.strides(later), &fields);
    }

    /// [`Error::Numerical`] where a prediction differs from what is prescribed by more than the jump tolerance of its variation. Collective.
    pub(crate) fn check_prescribed(&self, prediction: &Combination, ahead: &Values) -> Result<()> {
        let snapshots = self.online.snapshots();
        for (f, field) in snapshots.fields().iter().enumerate().filter(|(_, f)| f.role == Role::Prescribed) {
            let values = &ahead[self.places[f]];
            let mut predicted = vec![0.0; field.numbers()];
            self.online.field(f, prediction, &mut predicted);
            let off = predicted.iter().zip(values).map(|(a, b)| (a - b).powi(2));
            let mut sums = [off.sum(), values.iter().map(|v| v * v).sum::<f64>()];
            snapshots.comm().sum_f64(&mut sums);
            let variation = self.online.fitted().map_or(0.0, |fit| fit.variation(f));
            let share = (sums[0] / variation.max(1e-12 * sums[1])).sqrt();
            refuse(sums[0] > 0.0 && share > self.settings.jump_tolerance, Error::Numerical, || {
                format!("the input {} will be other than the fit says of it: the solver goes on", field.name)
            })?;
        }
        Ok(())
    }
}

impl Ride<'_> {
    /// What the prescribed arrays will be a time from now on, s, where this surrogate has to know: a fit in a jump or with inputs, which is told
    /// of the times before as well. Collective.
    pub(crate) fn ahead(&mut self, candidate: usize, jumps: bool, later: f64) -> Result<Option<Values>> {
        let surrogate = &mut self.candidates[candidate].surrogate;
        let asked = surrogate.fits().map_or(Vec::new(), |fits| fits.asks(later));
        let wanted = jumps && surrogate.fits().is_some() || !asked.is_empty();
        let wanted = wanted && self.layout.is_prescribed();
        let Some(ahead) = self.ahead.as_mut().filter(|_| wanted) else {
            return Ok(None);
        };
        let arrays = self.layout.arrays().iter();
        let lengths = arrays.map(|a| if a.role == Role::Prescribed { a.numbers() } else { 0 });
        let mut values: Values = lengths.map(|n| vec![0.0; n]).collect();
        let mut known = Ok(());
        for time in asked {
            known = known.and_then(|()| ahead(time, &mut values));
            if let Some(fits) = surrogate.fits_mut() {
                fits.foresee(time, &values);
            }
        }
        self.comm.agree(known.and_then(|()| ahead(later, &mut values)))?;
        Ok(Some(values))
    }
}
