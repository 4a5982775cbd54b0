//! Start-ups cut short, of a fit: what is done where a look at the wave says so.

use crate::decisions::Decisions;
use crate::dmd::{DmdSurrogate, rounded};
use crate::schedule::Step;
use crate::tables::Digits;
use m4gn_base::{Error, Result};
use m4gn_dmd::{Combination, Turn};
use serde_json::json;
use std::f64::consts::TAU;

impl DmdSurrogate {
    /// A look at the wave of the start-up. Tells what is done about it, and says it for people. Collective.
    pub(crate) fn look(&mut self, step: &Step, decisions: &mut Decisions) -> String {
        let (look, outlooks) = self.online.settle(&mut self.now.settle);
        let (stride, digits) = (self.description.stride, Digits(3));
        let figures = look.wave.map(|w| [w.angle / (TAU * stride), w.growth / stride, w.size()]);
        let [frequency, growth, amplitude] = figures.map_or([None; 3], |f| f.map(Some));
        let (decision, factor, done) = match (look.turn, outlooks) {
            (Turn::Change(factor), Some([before, cut])) => {
                (self.now.before, self.now.cut) = (Some(before), Some(cut));
                let done = format!(
                    ": its amplitude is brought to {}, {} times as much",
                    digits.of(factor * amplitude.unwrap_or(0.0)),
                    digits.of(factor)
                );
                ("changed", Some(factor), done)
            }
            (Turn::Undo, _) => {
                self.now.cut = self.now.before.clone();
                let last = self.now.settle.is_over();
                let more = if last { ", and it is left alone from here on" } else { "" };
                let done = ": the last change has not bettered it; the state before is taken up again";
                ("undone", None, format!("{done}{more}"))
            }
            (Turn::Settled, _) => {
                self.online.keep_size();
                ("settled", None, ": it stays as it is, and no more is changed".into())
            }
            _ => (if look.kept.is_some() { "kept" } else { "seen" }, None, String::new()),
        };
        if (look.kept == Some(true) || !self.now.settle.is_open()) && self.now.cut.is_none() {
            self.now.before = None;
        }
        self.online.hold(self.now.before.as_ref());
        if figures.is_none() && look.kept.is_none() {
            return String::new();
        }
        let decided = json!({
            "decision": decision, "kept": look.kept, "frequency": frequency, "growth_rate": growth, "amplitude": amplitude, "factor": factor,
        });
        decisions.tell(step, "start_up", &decided);
        // A wave that is only seen is data, and no line
        if decision == "seen" {
            return String::new();
        }
        let seen = match figures {
            Some([frequency, growth, amplitude]) => format!(
                "a wave of period {} s, growth {} 1/s, amplitude {}",
                digits.of(1.0 / frequency),
                digits.of(growth),
                digits.of(amplitude)
            ),
            None => "no wave is clear".into(),
        };
        let kept = if look.kept == Some(true) { ": the last change is kept" } else { "" };
        format!("m4gn: time {}: start-up: {seen}{kept}{done}\n\n", step.name)
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
