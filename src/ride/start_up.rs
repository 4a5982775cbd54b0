//! Start-ups cut short, of a fit: what is done where a look at the wave says so.

use crate::dmd::{DmdSurrogate, rounded};
use crate::surrogate::{Cut, Wave};
use m4gn_base::{Error, Result};
use m4gn_dmd::{Combination, Turn};
use std::f64::consts::TAU;

impl DmdSurrogate {
    /// A look at the wave of the start-up. Collective.
    pub(crate) fn look(&mut self) -> Option<Wave> {
        let (look, outlooks) = self.online.settle(&mut self.now.settle);
        let cut = match (look.turn, outlooks) {
            (Turn::Change(factor), Some([before, cut])) => {
                (self.now.before, self.now.cut) = (Some(before), Some(cut));
                Cut::Changed(factor)
            }
            (Turn::Undo, _) => {
                self.now.cut = self.now.before.clone();
                Cut::Undone(self.now.settle.is_over())
            }
            (Turn::Settled, _) => {
                self.online.keep_size();
                Cut::Settled
            }
            _ => Cut::None,
        };
        if (look.kept == Some(true) || !self.now.settle.is_open()) && self.now.cut.is_none() {
            self.now.before = None;
        }
        self.online.hold(self.now.before.as_ref());
        let stride = self.description.stride;
        let figures = look.wave.map(|w| [w.angle / (TAU * stride), w.growth / stride, w.size()]);
        (figures.is_some() || look.kept.is_some()).then_some(Wave { cut, kept: look.kept, figures })
    }

    /// Nothing is left of a change that was to be judged.
    pub(crate) fn release(&mut self) {
        self.now.settle.missed();
        if self.now.before.take().is_some() {
            self.online.hold(None);
        }
    }

    /// The state so many strides after the present snapshot, of the jump that is due.
    ///
    /// # Errors
    /// [`Error::Numerical`] where there is nothing to predict with, or it must not be used so far.
    pub(crate) fn later(&self, strides: f64) -> Result<Combination> {
        let none = || Error::Numerical("dmd has no fit to predict with".into());
        let strides = rounded(strides);
        match &self.now.cut {
            Some(cut) => self.online.later(cut, strides),
            None => self.online.later(&self.online.outlook().ok_or_else(none)?, strides),
        }
    }
}
