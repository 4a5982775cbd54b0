//! A solver and surrogates whose errors are known on paper: a damped rotating vector as a field of two cells.

use crate::schedule::Step;
use crate::surrogate::{Description, Growth, Start, Surrogate};
use m4gn_base::{Error, Result};
use m4gn_state::{Array, Layout, Place, Role, Values};
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

/// Angular velocity and damping of the vector, 1/s.
const OMEGA: f64 = 0.7;
const DAMPING: f64 = 0.05;

/// The solver at a time: the two components of the vector.
pub fn solver(time: f64) -> [f64; 2] {
    let size = 2.0 * (-DAMPING * time).exp();
    [size * (OMEGA * time).cos(), size * (OMEGA * time).sin()]
}

/// The state so much later than another one.
pub fn later(state: [f64; 2], time: f64) -> [f64; 2] {
    let (s, c) = (OMEGA * time).sin_cos();
    let size = (-DAMPING * time).exp();
    [size * (c * state[0] - s * state[1]), size * (s * state[0] + c * state[1])]
}

pub fn rms_of(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// What a host tells of a time.
pub fn at(time: f64, delta_t: f64, end_time: f64, index: i64) -> Step {
    Step {
        time,
        delta_t,
        end_time,
        index,
        name: format!("{time:.6}").trim_end_matches('0').trim_end_matches('.').into(),
        output_time: time,
        correctors: None,
        within: 0.0,
    }
}

/// The field `a` in two cells, and at two boundary faces, each of one of the cells: the first holds 9, the other follows its cell.
pub fn layout() -> Arc<Layout> {
    let boundary = |role| Array { place: Place::Boundary, role, ..Array::carried("a", 2) };
    let arrays = vec![Array::solved("a", 1, vec![1.0; 2]), boundary(Role::Carried), boundary(Role::Held)];
    Arc::new(Layout::new(arrays).unwrap())
}

/// The solver's state at a time.
pub fn state(time: f64) -> Values {
    of(solver(time))
}

pub fn of(cells: [f64; 2]) -> Values {
    vec![cells.to_vec(), vec![9.0, cells[1]], vec![1.0, 0.0]]
}

/// A surrogate of the solver: exact but for a bias that is added in each stride.
pub struct Toy {
    description: Description,
    bias: f64,
    /// Where the first component is at least this, the result is not finite.
    broken_above: Option<f64>,
    jump_by: Option<(f64, f64)>,
    /// Boundary values that the last step saw.
    pub boundary: Rc<RefCell<Vec<f64>>>,
}

impl Toy {
    pub fn new(stride: f64) -> Self {
        let description = Description {
            stride,
            advances: vec![0],
            reads: vec![0, 1],
            growth: vec![Growth::Unknown],
            segments: (2, vec![0, 1]),
            ..Description::default()
        };
        let toy = Toy { description, bias: 0.0, broken_above: None, jump_by: None, boundary: Rc::default() };
        toy.named("toy")
    }

    pub fn named(mut self, name: &str) -> Self {
        self.description.name = name.into();
        self.description.source = format!("{name}.model");
        self.description.digest = format!("{name}-1");
        self
    }

    pub fn biased(mut self, bias: f64) -> Self {
        self.bias = bias;
        self
    }

    /// From states of which the second component is this large on, the result is another one by so much.
    pub fn jumping(mut self, from: f64, by: f64) -> Self {
        self.jump_by = Some((from, by));
        self
    }

    /// Not finite where the first component is above.
    pub fn broken_above(mut self, value: f64) -> Self {
        self.broken_above = Some(value);
        self
    }

    pub fn growing(mut self, factors: &[f64]) -> Self {
        self.description.growth = vec![Growth::Factors(factors.to_vec())];
        self
    }
}

impl Surrogate for Toy {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()> {
        *self.boundary.borrow_mut() = start.state[1].clone();
        let state = [start.state[0][0], start.state[0][1]];
        if self.broken_above.is_some_and(|above| state[0] > above) {
            return Err(Error::Numerical("the result is not finite".into()));
        }
        let mut later = later(state, self.description.stride).map(|v| v + self.bias);
        if let Some((from, by)) = self.jump_by
            && state[1] >= from
        {
            later[0] += by;
        }
        next[0].copy_from_slice(&later);
        Ok(())
    }
}
