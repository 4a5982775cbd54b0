//! What a host is to do next, and where the run is.

use crate::jump::Jump;
use crate::ride::Ride;
use m4gn_base::Error;

/// What a host is to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Let the solver make a step, and tell with [`Ride::solved`].
    Solve,
    /// Take a stride with [`Ride::stride`].
    Stride,
    /// Advance the time and the fields to what was predicted, and tell with [`Ride::advanced`].
    Advance,
    /// Leave the fields as a state that the solver carries on from, and tell with [`Ride::handed_back`].
    HandBack,
}

/// An answer of the ride.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What to do next.
    pub action: Action,
    /// Which surrogate jumps.
    pub surrogate: usize,
    /// Strides of the jump that are left; of [`Action::HandBack`] those that a run which is carried on from here takes: it was stopped.
    pub strides: usize,
    /// Of [`Action::Advance`]: time by which the stride advances, s; of [`Action::Stride`] the length of one.
    pub duration: f64,
    /// Of [`Action::Advance`] the steps of the solver that it stands for.
    pub solver_steps: i64,
    /// Whether one stride is left of the jump: the next state is handed back.
    pub last_but_one: bool,
    /// Whether the next call of [`Ride::advanced`] or [`Ride::handed_back`] is to be given the state.
    pub state: bool,
    /// Of [`Action::Advance`] whether all arrays were made, or those alone that the surrogate advances.
    pub whole: bool,
    /// Within a jump the solver's time step, s; else 0.
    pub delta_t: f64,
    /// Whether a surrogate has taken a stride, beside the solver or in its place.
    pub stepped: bool,
}

/// Where the run is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Phase {
    /// The solver works.
    Solving,
    /// Strides are taken.
    Jumping(Jump),
    /// A stride was predicted.
    Advancing(Jump),
    /// The state is being handed back.
    HandingBack(Jump),
}

impl Phase {
    /// The jump that is going on.
    pub fn jump(&self) -> Option<&Jump> {
        match self {
            Phase::Jumping(jump) | Phase::Advancing(jump) | Phase::HandingBack(jump) => Some(jump),
            Phase::Solving => None,
        }
    }
}

impl Ride<'_> {
    /// An answer with what is known anywhere.
    pub(crate) fn answer(&self, action: Action) -> Answer {
        let jump = self.phase.jump();
        let jumper = jump.map(|jump| self.candidates[jump.surrogate].describe());
        Answer {
            action,
            surrogate: jump.map_or(0, |jump| jump.surrogate),
            strides: jump.map_or(0, |_| self.left().max(0) as usize),
            delta_t: jump.map_or(0.0, |jump| jump.delta_t),
            stepped: self.stepped,
            duration: jump.filter(|_| action == Action::Stride).map_or(0.0, |jump| self.duration(jump)),
            solver_steps: 0,
            last_but_one: false,
            state: match action {
                Action::Advance => jumper.is_some_and(|d| !d.is_whole),
                Action::HandBack => self.is_controlled(),
                _ => false,
            },
            whole: jumper.is_some_and(|d| d.is_whole),
        }
    }

    pub(crate) fn out_of_turn(&self, call: &str) -> Error {
        let expected = match self.phase {
            Phase::Solving => "solved",
            Phase::Jumping(_) => "stride",
            Phase::Advancing(_) => "advanced",
            Phase::HandingBack(_) => "handed_back",
        };
        Error::Input(format!("ride: {call} was called where {expected} is due"))
    }
}
