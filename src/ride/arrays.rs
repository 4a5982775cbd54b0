//! What a host gives and takes beside the fields: the arrays of the state, inputs ahead, reported quantities.

use crate::ride::{Phase, Ride};
use m4gn_base::{Error, Result};

impl Ride<'_> {
    /// The arrays of the state after the solver's step, where an answer asked for them. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] in a jump, and for arrays that do not fit.
    pub fn record(&mut self, arrays: &[&[f64]]) -> Result<()> {
        if self.phase != Phase::Deciding {
            return Err(self.out_of_turn("record"));
        }
        for rider in &mut self.riders {
            if rider.surrogate.records(&self.step) {
                self.log.text += &rider.surrogate.record(&self.step, arrays)?;
            }
        }
        Ok(())
    }

    /// What the arrays that are inputs will be at the end of the next stride, in their order.
    ///
    /// # Errors
    /// [`Error::Input`] where no stride is to be taken, or for arrays that do not fit.
    pub fn inputs(&mut self, arrays: &[&[f64]]) -> Result<()> {
        match &self.phase {
            Phase::Jumping(jump) => self.riders[jump.surrogate].surrogate.inputs(arrays),
            _ => Err(self.out_of_turn("inputs")),
        }
    }

    /// The arrays of the state that was predicted last: what the host advances to. `before` above 0, s: once it has been advanced to, those of
    /// a state so long before, which is an old level of the solver's time scheme.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing was predicted, or the surrogate that jumps has no arrays.
    pub fn arrays(&self, before: f64, out: &mut [&mut [f64]]) -> Result<()> {
        match &self.phase {
            Phase::Advancing(jump) | Phase::Jumping(jump) | Phase::HandingBack(jump) => {
                self.riders[jump.surrogate].surrogate.arrays(before, out)
            }
            _ => Err(self.out_of_turn("arrays")),
        }
    }

    /// What the settings' quantities are after the present state, in their order; no number where there is none: behind
    /// [`decide`](Self::decide), and after each stride. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of them.
    pub fn reported(&mut self, values: &[f64]) -> Result<()> {
        let expected = self.settings.quantities.len();
        if values.len() != expected {
            return Err(Error::Input(format!(
                "ride: {} quantities: expected {expected}, those of the settings",
                values.len()
            )));
        }
        let solver = match &self.phase {
            Phase::Solving | Phase::Deciding => true,
            Phase::Jumping(jump) => jump.done == 0 && !jump.carried_on,
            Phase::Advancing(_) | Phase::HandingBack(_) => false,
        };
        let held = self.quantities.reported(&self.settings.quantities, values, solver, &self.step.name);
        self.log.text += &held.note;
        self.log.warnings.extend(held.warning);
        Ok(())
    }
}
