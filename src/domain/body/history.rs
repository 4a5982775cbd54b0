//! What a session of bodies knows of the stride before, by what its model was off by in which it is corrected.

use m4gn_mesh::vector::Vector;
use m4gn_parallel::Comm;

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
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(body: f64, obstacle: f64) -> State {
        State { body: vec![[0.0; 3], [body, 0.0, 0.0]], obstacle: vec![[0.0, 0.0, obstacle]] }
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
    fn a_hosts_rounding_is_no_other_state() {
        let mut history = History::new(1.0);
        history.done(state(0.0, 0.5), state(0.3, 0.6));
        let mut follows = |body, obstacle| {
            matches!(history.origin(&Comm::serial(), &state(body, obstacle)), Origin::Step(_))
        };
        assert!(follows(0.300_01, 0.6));
        assert!(!follows(0.301, 0.6) && !follows(0.3, 0.61));
    }
}
