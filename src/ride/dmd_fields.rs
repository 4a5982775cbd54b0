//! Fields of the dmd surrogate: predictions of them, whether they may be used, and what the waves of its fit look like.

use super::DmdSurrogate;
use m4gn_base::{Error, Result};
use m4gn_dmd::Combination;
use m4gn_state::Values;

impl DmdSurrogate {
    /// The place of an array of the layout among those that a fit knows.
    pub(super) fn own(&self, array: usize) -> usize {
        self.places.iter().position(|&place| place == array).unwrap_or(0)
    }

    /// The advanced arrays of a prediction. Collective.
    pub(super) fn put(&self, prediction: &Combination, next: &mut Values) -> Result<()> {
        let mut values: Values = next.iter().map(|v| vec![0.0; v.len()]).collect();
        let mut raised = Vec::new();
        for (v, &array) in values.iter_mut().zip(&self.description.advances) {
            raised.push(self.online.field(self.own(array), prediction, v));
        }
        let comm = self.online.snapshots().comm();
        let finite = values.iter().flatten().all(|v| v.is_finite());
        let finite = finite
            .then_some(())
            .ok_or_else(|| Error::Numerical("the prediction of dmd is not finite".into()));
        comm.agree(finite)?;
        self.check_floors(&mut raised)?;
        *next = values;
        Ok(())
    }

    /// [`Error::Numerical`] where values had to be raised to what is physical by more than the jump tolerance of what the array varies by.
    fn check_floors(&self, raised: &mut [f64]) -> Result<()> {
        if self.layout.pick(&self.description.advances).iter().all(|a| a.floor.is_none()) {
            return Ok(());
        }
        self.online.snapshots().comm().sum_f64(raised);
        let Some(fit) = self.online.fitted() else { return Ok(()) };
        for (&array, &square) in self.description.advances.iter().zip(raised.iter()) {
            let variation = fit.variation(self.own(array));
            if variation > 0.0 && square > self.settings.jump_tolerance.powi(2) * variation {
                return Err(Error::Numerical(format!(
                    "the fit lets {} fall below what is physical: the stride is not taken",
                    self.layout.arrays()[array].name
                )));
            }
        }
        Ok(())
    }

    /// In an array of the state what does not oscillate now (`part` 0), what a wave, from 0, the largest first, adds (1), and a quarter of its
    /// period before (2), and of wave 0 the root mean square of all waves (3); of an array that stays above a floor the sum of both does. None:
    /// there is no such wave.
    pub(crate) fn wave(&self, wave: usize, part: usize, array: usize) -> Option<Vec<f64>> {
        if (wave, part) == (0, 3) {
            return self.rms(array);
        }
        let mode = self.online.modes().into_iter().filter(|m| m.frequency > 0.0).nth(wave)?;
        let states = self.online.mode(mode.number, self.now.offset + self.now.ahead)?;
        let values = |state: &Combination| {
            let mut values = vec![0.0; self.layout.arrays()[array].numbers()];
            self.online.field(self.own(array), state, &mut values);
            values
        };
        let (mut found, still) = (values(states.get(part)?), values(&states[0]));
        if part > 0 {
            found.iter_mut().zip(&still).for_each(|(v, s)| *v -= s);
        }
        Some(found)
    }

    /// The root mean square of what all waves add, each over its own period and as large as it is now.
    fn rms(&self, array: usize) -> Option<Vec<f64>> {
        let waves = (0..).map_while(|wave| self.wave(wave, 1, array).zip(self.wave(wave, 2, array)));
        let squares = waves.map(|(real, imaginary)| {
            real.iter().zip(&imaginary).map(|(r, i)| 0.5 * (r * r + i * i)).collect::<Vec<f64>>()
        });
        let sum = squares.reduce(|all, one| all.iter().zip(&one).map(|(a, b)| a + b).collect())?;
        Some(sum.into_iter().map(f64::sqrt).collect())
    }
}
