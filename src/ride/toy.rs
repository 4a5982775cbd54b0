//! A solver and surrogates whose errors are known on paper: a damped rotating vector as a field of two cells.

use crate::schedule::Step;
use crate::surrogate::{Advanced, Lesson, Surrogate};
use crate::values::Given;
use m4gn_base::{Error, Result};
use m4gn_step::{Field, FieldMut};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

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
        shown: time,
        correctors: None,
        wall: 0.0,
    }
}

/// The field of a call, with its two boundary faces, each of one of the cells: the first holds 9, the other follows its cell.
pub struct Fields {
    pub components: usize,
    cells: [f64; 2],
    boundary: [f64; 2],
}

/// The solver's field at a time.
pub fn given(time: f64) -> Fields {
    of(solver(time))
}

pub fn of(cells: [f64; 2]) -> Fields {
    Fields { components: 1, cells, boundary: [9.0, cells[1]] }
}

impl Fields {
    /// As a host hands it over.
    pub fn with<T>(&self, call: impl FnOnce(&Given) -> T) -> T {
        let fields =
            [Field { name: "a", components: self.components, cells: &self.cells, boundary: &self.boundary }];
        let held: [Option<&[i32]>; 1] = [Some(&[1, 0])];
        call(&Given { fields: &fields, held: &held, owners: &[0, 1] })
    }
}

/// What a toy has learned, to be looked at by tests.
#[derive(Debug, Default)]
pub struct Learned {
    pub frames: Vec<(f64, bool)>,
    pub rounds: Vec<usize>,
}

/// A surrogate of the solver: exact but for a bias that is added in each stride.
pub struct Toy {
    name: String,
    stride: f64,
    fields: Vec<Advanced>,
    bias: f64,
    /// Where the first component is at least this, the result is not finite.
    broken_above: Option<f64>,
    jump_by: Option<(f64, f64)>,
    growth: Option<Vec<f64>>,
    pub learned: Rc<RefCell<Learned>>,
    learns: bool,
    begun: bool,
    lesson: f64,
    /// Boundary values that the last step saw.
    pub boundary: Rc<RefCell<Vec<f64>>>,
}

impl Toy {
    pub fn new(stride: f64) -> Self {
        Toy {
            name: "toy".into(),
            stride,
            fields: vec![Advanced { name: "a".into(), components: 1, solved: 1 }],
            bias: 0.0,
            broken_above: None,
            jump_by: None,
            growth: None,
            learned: Rc::default(),
            learns: false,
            begun: false,
            lesson: 0.0,
            boundary: Rc::default(),
        }
    }

    pub fn named(mut self, name: &str) -> Self {
        self.name = name.into();
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
        self.growth = Some(factors.to_vec());
        self
    }

    /// It learns: a round takes its bias to this.
    pub fn learning(mut self, bias: f64) -> Self {
        (self.learns, self.lesson) = (true, bias);
        self
    }
}

impl Surrogate for Toy {
    fn name(&self) -> &str {
        &self.name
    }

    fn source(&self) -> String {
        format!("{}.model", self.name)
    }

    fn digest(&self) -> String {
        format!("{}-1", self.name)
    }

    fn stride(&self) -> f64 {
        self.stride
    }

    fn advances(&self) -> &[Advanced] {
        &self.fields
    }

    fn growth(&self, _: &str) -> Option<Vec<f64>> {
        self.growth.clone()
    }

    fn segments(&self) -> (usize, &[i32]) {
        (2, &[0, 1])
    }

    fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let field = fields.iter().find(|f| f.name == "a");
        let field = field.ok_or_else(|| Error::Input("no field".into()))?;
        *self.boundary.borrow_mut() = field.boundary.to_vec();
        let state = [field.cells[0], field.cells[1]];
        if self.broken_above.is_some_and(|above| state[0] > above) {
            return Err(Error::Numerical("the result is not finite".into()));
        }
        let mut next = later(state, self.stride).map(|v| v + self.bias);
        if let Some((from, by)) = self.jump_by
            && state[1] >= from
        {
            next[0] += by;
        }
        out[0].cells.copy_from_slice(&next);
        Ok(())
    }

    fn can_learn(&self) -> bool {
        self.learns
    }

    fn has_begun(&self) -> bool {
        self.begun
    }

    fn frame(&mut self, time: f64, begins: bool, _: &[Field]) -> Result<()> {
        self.begun = true;
        self.learned.borrow_mut().frames.push((time, begins));
        Ok(())
    }

    fn learn(&mut self, strides: usize) -> Result<Option<Lesson>> {
        if !self.begun {
            return Ok(None);
        }
        self.learned.borrow_mut().rounds.push(strides);
        let before = self.bias;
        self.bias = self.lesson;
        Ok(Some(Lesson {
            used: before != self.bias,
            steps: 3,
            seconds: 0.5,
            before,
            after: self.bias,
            note: format!("learned from {} frames", self.learned.borrow().frames.len()),
        }))
    }

    fn state(&self) -> Result<Option<Vec<u8>>> {
        Ok(self.begun.then(|| self.bias.to_le_bytes().to_vec()))
    }

    fn restore(&mut self, state: &[u8]) -> Result<()> {
        let bytes = state.try_into().map_err(|_| Error::Input("not eight bytes".into()))?;
        (self.bias, self.begun) = (f64::from_le_bytes(bytes), true);
        Ok(())
    }

    fn write_model(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.bias.to_string()).map_err(|e| Error::file(path, e.to_string()))
    }
}
