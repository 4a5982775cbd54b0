//! What a session of bodies knows of the stride before, where its model reads what the displacement changed by over it, or is corrected by
//! what it was off by in it.

use m4gn_mesh::parallel::Comm;
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{Error, Result};

/// How far a point may be from where the last step left it, in mean edges at rest, for the state to be that step's result: far less
/// than what moves, and more than a host's own rounding.
const SLACK: f64 = 1e-4;

/// Displacement of the host's own points, and of all points of the obstacle, m.
#[derive(Clone, Debug)]
pub struct State {
    pub body: Vec<Vector>,
    pub obstacle: Vec<Vector>,
}

/// Where a state comes from.
#[derive(Debug)]
pub enum Origin {
    /// It is the result of the last step, which began here.
    Step(State),
    /// A solver handed it over; here it was one stride before.
    Solver(State),
    /// Nothing is known of the stride before.
    Unknown,
}

/// The last step, and what the host says of the stride before the next one.
#[derive(Debug)]
pub struct History {
    /// m
    slack: f64,
    /// Start and end of the last step that came to one.
    last: Option<[State; 2]>,
    /// One stride before the next step.
    given: Option<State>,
}

impl History {
    /// Of no step yet, of a body with edges of this mean length, m.
    pub fn new(edge: f64) -> Self {
        History { slack: SLACK * edge, last: None, given: None }
    }

    /// Takes what the host says of one stride before the next step.
    pub fn give(&mut self, before: State) {
        self.given = Some(before);
    }

    /// Takes note of a step.
    pub fn done(&mut self, start: State, end: State) {
        self.last = Some([start, end]);
    }

    /// Where a state comes from, and takes what the host gave with it. Collective; all ranks decide alike.
    pub fn origin(&mut self, comm: &Comm, now: &State) -> Origin {
        let given = self.given.take();
        // A rank whose points do not move cannot tell a step's result from another state.
        let mut not = [given.is_none(), !self.follows(now)].map(i64::from);
        comm.max_i64(&mut not);
        match (not, given, &self.last) {
            ([_, 0], _, Some([start, _])) => Origin::Step(start.clone()),
            ([0, _], Some(before), _) => Origin::Solver(before),
            _ => Origin::Unknown,
        }
    }

    /// Whether this rank's part of a state is the result of the last step.
    fn follows(&self, now: &State) -> bool {
        let near = |a: &[Vector], b: &[Vector]| {
            let pairs = a.as_flattened().iter().zip(b.as_flattened());
            a.len() == b.len() && pairs.into_iter().all(|(a, b)| (a - b).abs() <= self.slack)
        };
        let end = self.last.as_ref().map(|last| &last[1]);
        end.is_some_and(|end| near(&now.body, &end.body) && near(&now.obstacle, &end.obstacle))
    }

    /// The state one stride before this one: what the host gave; else, where this is the result of the last step, that step's start;
    /// else, where nothing is displaced, this state, in which the body rests. Collective; all ranks decide alike and fail together.
    ///
    /// Any other state has a past that the session does not know. A guess would be a wrong input without a sign of it: zero where a
    /// body moves, or the way of several strides where a solver has advanced it since.
    ///
    /// # Errors
    /// [`Error::Input`] for a state that the host says nothing about, and that does not follow from the last step.
    pub fn before(&mut self, comm: &Comm, now: &State) -> Result<State> {
        let follows = self.follows(now);
        let rests = now.body.iter().all(|u| *u == [0.0; 3]);
        let given = self.given.take();
        // A rank whose points do not move cannot tell a step's result from a body at rest.
        let mut not = [given.is_none(), !follows, !rests].map(i64::from);
        comm.max_i64(&mut not);
        match (not.map(|not| not == 0), given, &self.last) {
            ([true, ..], Some(given), _) => Ok(given),
            ([_, true, _], _, Some([start, _])) => Ok(start.clone()),
            ([.., true], ..) => Ok(now.clone()),
            _ => Err(Error::Input(format!(
                "the model reads what the displacement changed by over the stride before (contact.history), and this state is {}: \
                 give the displacement of one stride before (m4gn_session_set_before); of a body at rest, that is its displacement now",
                match self.last {
                    Some(_) => "not the one that the last step ended with",
                    None => "the first one, and not undeformed",
                }
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(body: f64, obstacle: f64) -> State {
        State { body: vec![[0.0; 3], [body, 0.0, 0.0]], obstacle: vec![[0.0, 0.0, obstacle]] }
    }

    /// The displacement of the point that moves, and of the obstacle, one stride before.
    fn before(history: &mut History, now: &State) -> Result<[f64; 2]> {
        let found = history.before(&Comm::serial(), now)?;
        Ok([found.body[1][0], found.obstacle[0][2]])
    }

    #[test]
    fn what_the_host_says_comes_first_and_holds_once() {
        let mut history = History::new(1.0);
        let now = state(0.3, 0.5);
        history.give(state(0.2, 0.4));
        assert_eq!(before(&mut history, &now).unwrap(), [0.2, 0.4]);
        let error = before(&mut history, &now).unwrap_err().to_string();
        assert!(error.contains("the first one, and not undeformed"), "{error}");
        assert!(error.contains("m4gn_session_set_before"), "{error}");
    }

    #[test]
    fn what_the_host_says_of_a_steps_own_result_is_no_hand_over() {
        let mut history = History::new(1.0);
        let mut origin = |now: f64, given: bool| {
            if given {
                history.give(state(0.2, 0.4));
            }
            let found = match history.origin(&Comm::serial(), &state(now, 0.5)) {
                Origin::Step(start) => start.body[1][0],
                Origin::Solver(before) => 10.0 + before.body[1][0],
                Origin::Unknown => -1.0,
            };
            history.done(state(now, 0.5), state(0.3, 0.5));
            found
        };
        assert_eq!(origin(0.3, true), 10.2);
        assert_eq!(origin(0.3, true), 0.3);
        assert_eq!(origin(0.4, false), -1.0);
        assert_eq!(origin(0.4, true), 10.2);
        assert_eq!(origin(0.3, false), 0.4);
    }

    #[test]
    fn a_step_goes_on_from_the_last_one_and_an_undeformed_body_rests() {
        let mut history = History::new(1.0);
        assert_eq!(before(&mut history, &state(0.0, 0.5)).unwrap(), [0.0, 0.5]);
        history.done(state(0.0, 0.5), state(0.3, 0.6));
        // A host's rounding, not more.
        assert_eq!(before(&mut history, &state(0.300_01, 0.6)).unwrap(), [0.0, 0.5]);
        for other in [state(0.301, 0.6), state(0.3, 0.61)] {
            let error = before(&mut history, &other).unwrap_err().to_string();
            assert!(error.contains("not the one that the last step ended with"), "{error}");
        }
        // The last step is not forgotten by that, and a run may begin anew.
        assert_eq!(before(&mut history, &state(0.3, 0.6)).unwrap(), [0.0, 0.5]);
        assert_eq!(before(&mut history, &state(0.0, 0.1)).unwrap(), [0.0, 0.1]);
    }
}
