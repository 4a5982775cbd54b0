//! A jump: strides of a surrogate, from the decision to the hand-back.

use crate::answer::{Action, Answer, Phase};
use crate::ride::Ride;
use crate::schedule::{Step, duration, steps_of};
use crate::shadow::{advanced, predict};
use crate::surrogate::Start;
use crate::values::rms;
use m4gn_base::{Error, Result, refuse};
use m4gn_state::Role;
use serde_json::json;

/// A jump that is going on.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Jump {
    pub surrogate: usize,
    pub strides: usize,
    /// Strides that have been taken, and the time that they and a part of the next one took, s.
    pub done: usize,
    pub gone: f64,
    /// Whether these strides are the rest of a jump in which an earlier run was.
    pub carried_on: bool,
    /// The solver's time step, s.
    pub delta_t: f64,
    /// Whether the last of its strides has been taken.
    pub over: bool,
    /// What ended it before its last stride.
    pub cut: Option<String>,
    /// Seconds of surrogate and hand-over when it began.
    pub began: [f64; 2],
    /// What made it no longer.
    pub limited: &'static str,
    /// What was measured before, and what was expected of it.
    pub expected: Option<[f64; 2]>,
}

impl Jump {
    /// A stride is taken where no more than this part of it is left.
    const NEAR: f64 = 1e-6;

    /// Whether nothing of it has been taken.
    pub fn is_new(&self) -> bool {
        self.gone == 0.0 && !self.carried_on
    }

    /// It has gone on by a time, s. Gives the strides that this completes.
    fn goes_on(&mut self, duration: f64, stride: f64) -> usize {
        self.gone += duration;
        let before = self.done;
        self.done = (self.gone / stride + Self::NEAR) as usize;
        self.done - before
    }

    /// Time that has gone of the present stride, s.
    pub fn part(&self, stride: f64) -> f64 {
        (self.gone - self.done as f64 * stride).max(0.0)
    }

    /// Time that is left of the present stride, s.
    fn rest(&self, stride: f64) -> f64 {
        (self.done + 1) as f64 * stride - self.gone
    }
}

impl Ride<'_> {
    /// A stride of the jump, from the present state; of a fit up to the time at which the next state is wanted. `next`: where the arrays of
    /// the predicted state go; those that the surrogate does not make stay. The answer is [`Action::Advance`], or what follows where the
    /// stride must not be used: `next` is then as it was. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for places that do not fit.
    pub fn stride(&mut self, next: &mut [&mut [f64]]) -> Result<Answer> {
        let Phase::Jumping(mut jump) = self.phase.clone() else {
            return Err(self.out_of_turn("stride"));
        };
        let duration = self.duration(&jump);
        let ahead = self.ahead(jump.surrogate, true, duration)?;
        let candidate = &mut self.candidates[jump.surrogate];
        let stride = candidate.stride();
        if !self.schedule.fits(&self.step, jump.delta_t, duration, 1.0) {
            return self.end_early(jump, "end");
        }
        let arrays = self.layout.arrays();
        let fits = |(a, place): (&m4gn_state::Array, &&mut [f64])| {
            matches!(a.role, Role::Prescribed | Role::Held) || a.numbers() == place.len()
        };
        let fit = next.len() == arrays.len() && arrays.iter().zip(next.iter()).all(fits);
        self.comm.agree(refuse(
            !fit,
            Error::Input,
            || "ride: the places for the prediction are not those of the state's arrays",
        ))?;
        let old = advanced(candidate.surrogate.as_ref(), &self.present);
        let mut predicted = old.clone();
        let start = Start { state: &self.present, ahead: ahead.as_ref(), duration };
        let bad = predict(candidate.surrogate.as_mut(), start, &mut predicted)?;
        let why = if bad.is_none() { "not_accepted" } else { "not_finite" };
        self.stepped |= bad.is_none();
        self.log.not_finite(&self.step.name, bad.clone());
        jump.cut = bad;
        let advances = candidate.describe().advances.clone();
        // What cuts a start-up short changes more than the solver does.
        let cuts = candidate.surrogate.fits().is_some_and(|fits| fits.cuts());
        if let Some(control) = candidate.control.as_ref().filter(|_| jump.cut.is_none() && !cuts) {
            let pairs = predicted.iter().zip(&old);
            let changes = pairs.map(|(new, old)| new.iter().zip(old).map(|(a, b)| a - b));
            let picked = self.layout.pick(&advances);
            let mut changes = rms(&self.comm, &picked, changes);
            for (array, change) in picked.iter().zip(&mut changes) {
                // A fit carries along what follows, with the noise of the tolerance that the solver has for it
                if candidate.is_fit() && array.role == Role::Follows {
                    *change = 0.0;
                }
            }
            jump.cut = control.refuses(&changes)?;
        }
        if jump.cut.is_some() {
            self.totals.ended_early += 1;
            return self.end_early(jump, why);
        }
        for (&array, values) in advances.iter().zip(predicted) {
            next[array].copy_from_slice(&values);
            self.present[array] = values;
        }
        candidate.surrogate.carry(next);
        if jump.is_new() {
            self.totals.begin_jump(jump.surrogate, self.candidates.len(), self.step.time);
        }
        self.totals.steps += jump.goes_on(duration, stride);
        self.totals.replaced += duration;
        self.totals.by[jump.surrogate].1 += duration;
        let solver_steps = steps_of(duration, jump.delta_t);
        self.phase = Phase::Advancing(jump);
        Ok(Answer { duration, solver_steps, ..self.answer(Action::Advance) })
    }

    /// Time to the next state of a jump, s.
    pub(crate) fn duration(&self, jump: &Jump) -> f64 {
        let candidate = &self.candidates[jump.surrogate];
        match candidate.is_fit() {
            true => duration(self.step.within, jump.rest(candidate.stride()), jump.delta_t),
            false => candidate.stride(),
        }
    }

    /// Tells that a jump has had its last stride, and why.
    fn tell_ended(&mut self, jump: &Jump, why: &str) {
        let name = &self.candidates[jump.surrogate].describe().name;
        let decided = json!({"surrogate": name, "strides": jump.done, "of": jump.strides, "why": why});
        self.decisions.tell(&self.step, "jump_ended", &decided);
    }

    /// A jump ends before its last stride, or does not begin. Collective.
    fn end_early(&mut self, jump: Jump, why: &str) -> Result<Answer> {
        self.tell_ended(&jump, why);
        if jump.is_new() {
            self.phase = Phase::Solving;
            if let Some(fits) = self.candidates[jump.surrogate].surrogate.fits_mut() {
                fits.leave_uncut();
            }
            if let Some(cut) = &jump.cut {
                let who = self.who(jump.surrogate);
                self.log.text += &format!("m4gn: no jump at time {}: {who}: {cut}\n\n", self.step.name);
            }
            if self.is_controlled() {
                self.begin_shadows(false)?;
            }
            return Ok(self.answer(Action::Solve));
        }
        self.phase = Phase::HandingBack(jump);
        Ok(self.answer(Action::HandBack))
    }

    /// Time and state have been advanced by the stride that was predicted. The state is needed where the answer before says so: the host may
    /// have made more of the prediction. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] where no stride was predicted, and for a state that does not fit or is missing.
    pub fn advanced(&mut self, step: Step, state: Option<&[&[f64]]>) -> Result<Answer> {
        let Phase::Advancing(mut jump) = self.phase.clone() else {
            return Err(self.out_of_turn("advanced"));
        };
        let wanted = !self.candidates[jump.surrogate].describe().is_whole;
        if let Some(state) = self.checked("advanced", state, wanted)?.filter(|_| wanted) {
            self.keep(state);
        }
        self.step = Step { delta_t: jump.delta_t, ..step };
        let surrogate = &mut self.candidates[jump.surrogate].surrogate;
        surrogate.advanced();
        let duration = self.duration(&jump);
        let fits = |strides: f64| self.schedule.fits(&self.step, jump.delta_t, duration, strides);
        jump.over = jump.done >= jump.strides || !fits(1.0);
        let last_but_one = jump.done + 1 == jump.strides || !fits(2.0);
        if jump.over {
            self.tell_ended(&jump, if jump.done == jump.strides { "length" } else { "end" });
        }
        Ok(Answer { last_but_one, ..self.behind_stride(jump) })
    }

    /// What follows a stride: the next one, or the way back to the solver.
    pub(crate) fn behind_stride(&mut self, jump: Jump) -> Answer {
        let (action, phase) = match jump.over {
            true => (Action::HandBack, Phase::HandingBack(jump)),
            false => (Action::Stride, Phase::Jumping(jump)),
        };
        self.phase = phase;
        self.answer(action)
    }

    /// Wall time that went into strides, and into handing over, since the last time that it was told, s.
    pub fn spent(&mut self, surrogate: f64, hand_over: f64) {
        self.totals.seconds[0] += surrogate;
        self.totals.seconds[1] += hand_over;
    }

    /// The state has been handed back, and the solver goes on from here: it is the one that it begins from, and needed where the answer before
    /// says so. `quantities` are told with the jump. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] where no jump has ended, and for a state that does not fit or is missing.
    pub fn handed_back(
        &mut self,
        step: Step,
        state: Option<&[&[f64]]>,
        quantities: &[(String, f64)],
    ) -> Result<Answer> {
        let Phase::HandingBack(jump) = self.phase.clone() else {
            return Err(self.out_of_turn("handed_back"));
        };
        let wanted = self.is_controlled();
        if let Some(state) = self.checked("handed_back", state, wanted)?.filter(|_| wanted) {
            self.keep(state);
        }
        self.step = Step { delta_t: jump.delta_t, ..step };
        self.handed_back = self.step.index;
        for (i, candidate) in self.candidates.iter_mut().enumerate() {
            candidate.surrogate.handed_back(self.step.time, i == jump.surrogate);
        }
        let strides = self.totals.last_jump().max(1);
        self.watch.handed_back(strides);
        self.quantities.handed_back(strides, self.step.time);
        if jump.done > 0 || !jump.over || !jump.carried_on {
            self.log_jump(&jump, quantities);
        } else {
            self.tell_back_at_restart(jump.surrogate);
        }
        self.phase = Phase::Solving;
        if self.is_controlled() {
            self.begin_shadows(true)?;
        }
        Ok(self.answer(Action::Solve))
    }

    /// All arrays of the state so many seconds before the present one, within a jump of a fit: an old level of the solver's time scheme.
    /// Arrays that are prescribed stay, and those without a place. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] outside of a jump, and for a surrogate that is no fit.
    pub fn old_level(&self, before: f64, out: &mut [&mut [f64]]) -> Result<()> {
        let Some(jump) = self.phase.jump() else {
            return Err(self.out_of_turn("old_level"));
        };
        let surrogate = &self.candidates[jump.surrogate].surrogate;
        match surrogate.fits() {
            Some(fits) => fits.earlier(before, out),
            None => Err(Error::Input(format!(
                "ride: the surrogate {} knows no state between its strides",
                surrogate.describe().name
            ))),
        }
    }

    /// Of the fit that a surrogate has in use, in an array that it advances: what does not oscillate now (`part` 0), what a wave, from 0, the
    /// largest first, adds (1), and a quarter of its period before (2), and of wave 0 the root mean square of all waves (3). None: there is no
    /// such wave. Not collective.
    pub fn wave(&self, surrogate: usize, wave: usize, part: usize, array: usize) -> Option<Vec<f64>> {
        let surrogate = &self.candidates.get(surrogate)?.surrogate;
        let advances = surrogate.describe().advances.contains(&array);
        surrogate.fits().filter(|_| advances)?.wave(wave, part, array)
    }

    /// What the settings' quantities are after the present state, in their order; no number where there is none: behind
    /// [`solved`](Self::solved), and after each stride. A state that a run is carried on from may be reported again. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of them.
    pub fn reported(&mut self, values: &[f64]) -> Result<()> {
        let expected = self.settings.quantities.len();
        refuse(values.len() != expected, Error::Input, || {
            format!("ride: {} quantities: expected {expected}, those of the settings", values.len())
        })?;
        let index = Some(self.step.index);
        if std::mem::replace(&mut self.quantities.index, index) == index {
            return Ok(());
        }
        let solver = match &self.phase {
            Phase::Solving => true,
            Phase::Jumping(jump) => jump.is_new(),
            Phase::Advancing(_) | Phase::HandingBack(_) => false,
        };
        let time = (self.step.time, &self.step.name[..]);
        let judgement = self.quantities.reported(&self.settings.quantities, values, solver, time);
        self.log.judged(&self.step, "quantities", judgement, &mut self.decisions);
        Ok(())
    }

    /// Strides of the jump that a run has to take which is carried on from here; -1: the solver goes on.
    pub(crate) fn left(&self) -> i64 {
        let rest = |jump: &Jump| jump.strides.saturating_sub(jump.done) as i64;
        match &self.phase {
            Phase::Solving => -1,
            Phase::Jumping(jump) | Phase::Advancing(jump) => rest(jump),
            Phase::HandingBack(jump) => {
                // A run that is stopped in a jump goes on with the rest of it.
                match self.schedule.is_stopped(&self.step, jump.delta_t, self.duration(jump)) {
                    true => rest(jump),
                    false => 0,
                }
            }
        }
    }
}
