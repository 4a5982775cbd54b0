//! A jump: strides of a surrogate, from the decision to the hand-back.

use crate::ride::{Action, Answer, Phase, Ride};
use crate::schedule::{Step, steps_of};
use crate::shadow::predict;
use crate::values::{Given, rms};
use m4gn_base::{Error, Result};
use m4gn_step::FieldMut;

/// A jump that is going on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Jump {
    pub surrogate: usize,
    pub strides: usize,
    pub done: usize,
    /// Whether these strides are the rest of a jump in which an earlier run was.
    pub carried_on: bool,
    /// The solver's time step, s.
    pub delta_t: f64,
    /// Whether the last of its strides has been taken.
    pub over: bool,
    /// Seconds of surrogate and hand-over when it began.
    pub began: [f64; 2],
    /// What was measured before, and what was expected of it.
    pub expected: Option<[f64; 2]>,
}

impl Ride<'_> {
    /// A stride of the jump, from the fields as they are now. `out`: where the advanced fields of the surrogate go, in its order. The
    /// answer is [`Action::Advance`], or what follows where the stride must not be used: `out` is then as it was. Collective; all ranks
    /// fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that do not fit.
    pub fn stride(&mut self, given: &Given, out: &mut [FieldMut]) -> Result<Answer> {
        let Phase::Jumping(mut jump) = self.phase.clone() else {
            return Err(self.out_of_turn("stride"));
        };
        let rider = &mut self.riders[jump.surrogate];
        let stride = rider.surrogate.stride();
        if !self.schedule.fits(&self.step, jump.delta_t, stride, 1.0) {
            return self.end_early(jump, given);
        }
        let advanced = rider.surrogate.advances().to_vec();
        let old = given.values(&self.comm, &advanced)?;
        let shapes = out.iter().map(|o| (o.name, o.cells.len()));
        let own = advanced.iter().zip(&old).map(|(a, v)| (a.name.as_str(), v.len()));
        let checked = match shapes.eq(own) {
            true => Ok(()),
            false => Err(Error::Input(
                "ride: the places for the prediction are not those of the fields that the surrogate advances"
                    .into(),
            )),
        };
        self.comm.agree(checked)?;
        let mut predicted = old.clone();
        let bad = predict(rider.surrogate.as_mut(), given, &mut predicted)?;
        let mut used = bad.is_none();
        self.stepped |= used;
        self.log.not_finite(&self.step.name, bad);
        if let Some(control) = rider.control.as_ref().filter(|_| used) {
            let pairs = predicted.iter().zip(&old);
            let changes = pairs.map(|(new, old)| new.iter().zip(old).map(|(a, b)| a - b));
            used = control.accepts(&rms(&self.comm, &advanced, changes))?;
        }
        if !used {
            self.totals.ended_early += 1;
            return self.end_early(jump, given);
        }
        for (place, values) in out.iter_mut().zip(&predicted) {
            place.cells.copy_from_slice(values);
        }
        if jump.done == 0 && !jump.carried_on {
            self.totals.begin_jump(jump.surrogate, self.riders.len(), self.step.time);
        }
        jump.done += 1;
        self.totals.steps += 1;
        self.totals.replaced += stride;
        self.totals.by[jump.surrogate].1 += stride;
        let solver_steps = steps_of(stride, jump.delta_t);
        self.phase = Phase::Advancing(jump);
        Ok(Answer { duration: stride, solver_steps, ..self.answer(Action::Advance) })
    }

    /// A jump ends before its last stride, or does not begin. Collective.
    fn end_early(&mut self, jump: Jump, given: &Given) -> Result<Answer> {
        if jump.done == 0 && !jump.carried_on {
            if self.is_controlled() {
                self.begin_shadows(false, given)?;
            }
            self.phase = Phase::Solving;
            return Ok(self.answer(Action::Solve));
        }
        self.phase = Phase::HandingBack(jump);
        Ok(self.answer(Action::HandBack))
    }

    /// Time and fields have been advanced by the stride that was predicted. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] where no stride was predicted.
    pub fn advanced(&mut self, step: Step) -> Result<Answer> {
        let Phase::Advancing(mut jump) = self.phase.clone() else {
            return Err(self.out_of_turn("advanced"));
        };
        self.step = Step { delta_t: jump.delta_t, ..step };
        let surrogate = &mut self.riders[jump.surrogate].surrogate;
        surrogate.advanced();
        let stride = surrogate.stride();
        let fits = |strides: f64| self.schedule.fits(&self.step, jump.delta_t, stride, strides);
        jump.over = jump.done == jump.strides || !fits(1.0);
        let last_but_one = jump.done + 1 == jump.strides || !fits(2.0);
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

    /// The state has been handed back, and the solver goes on from here: the fields are those that it begins from. `quantities` are told
    /// with the jump. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] where no jump has ended, and for fields that do not fit.
    pub fn handed_back(&mut self, step: Step, quantities: &[(String, f64)], given: &Given) -> Result<Answer> {
        let Phase::HandingBack(jump) = self.phase.clone() else {
            return Err(self.out_of_turn("handed_back"));
        };
        self.step = Step { delta_t: jump.delta_t, ..step };
        self.handed_back = self.step.index;
        for (i, rider) in self.riders.iter_mut().enumerate() {
            rider.surrogate.handed_back(self.step.time, i == jump.surrogate);
        }
        self.watch.handed_back(self.totals.steps);
        self.quantities.handed_back(jump.done);
        if jump.done > 0 || !jump.over {
            self.log_jump(&jump, quantities);
        }
        self.frame(true, given)?;
        if self.is_controlled() {
            self.begin_shadows(true, given)?;
        }
        self.tell_waiting();
        self.phase = Phase::Solving;
        Ok(self.answer(Action::Solve))
    }

    /// Strides of the jump that a run has to take which is carried on from here; -1: the solver goes on.
    pub(crate) fn left(&self) -> i64 {
        let rest = |jump: &Jump| (jump.strides - jump.done) as i64;
        match &self.phase {
            Phase::Solving | Phase::Deciding => -1,
            Phase::Jumping(jump) | Phase::Advancing(jump) => rest(jump),
            Phase::HandingBack(jump) => {
                let stride = self.riders[jump.surrogate].surrogate.stride();
                // A run that is stopped in a jump goes on with the rest of it.
                match self.schedule.is_stopped(&self.step, jump.delta_t, stride) {
                    true => rest(jump),
                    false => 0,
                }
            }
        }
    }
}
