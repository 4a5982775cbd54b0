//! What may take the solver's place for a while: a network, or anything else that advances fields by strides.

use crate::schedule::Step;
use m4gn_base::{Error, Result};
use m4gn_step::{Field, FieldMut};
use std::path::Path;

/// A field that a surrogate advances.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Advanced {
    /// Name, as the host knows the field.
    pub name: String,
    /// Values a row: 1 or 3.
    pub components: usize,
    /// How many of them are solved: 1 of a scalar, the solved directions of a vector.
    pub solved: usize,
}

/// What came of a round of learning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lesson {
    /// Whether the surrogate is another one now.
    pub used: bool,
    /// Optimisation steps.
    pub steps: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Error on frames that were held back over that of holding their first one: as it was.
    pub before: f64,
    /// As it is now.
    pub after: f64,
    /// All of this, or why nothing was done, for people.
    pub note: String,
}

/// A surrogate on the host's mesh. All methods but the ones that only look are collective, and all ranks fail together.
pub trait Surrogate {
    /// What kind it is, in one word for tables: `network`.
    fn name(&self) -> &str;

    /// Where it is from, for people: the model's file.
    fn source(&self) -> String;

    /// Identifies it: a state that was written with another one is not taken up.
    fn digest(&self) -> String;

    /// Time that one step advances, s.
    fn stride(&self) -> f64;

    /// The fields that it advances.
    fn advances(&self) -> &[Advanced];

    /// By how much the error of this field after 1, 2, ... strides of a jump exceeds that of the stride before it; none: not known.
    fn growth(&self, field: &str) -> Option<Vec<f64>>;

    /// One stride: `fields` are the host's at the start. `out` holds the advanced fields there in the order of
    /// [`advances`](Self::advances), and at the end of the stride afterwards; values that are not solved stay.
    ///
    /// # Errors
    /// [`Error::Numerical`] for a result that is not finite: `out` is then as it was. What else may fail, for fields that do not fit.
    fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()>;

    /// A rollout beside the solver begins at the present state, with the stride that [`step`](Self::step) takes from it.
    fn begin_rollout(&mut self) {}

    /// One of its further strides, the second or a later one: `fields` are those that the one before has predicted. As
    /// [`step`](Self::step).
    ///
    /// # Errors
    /// As there.
    fn follow(&mut self, stride: usize, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let _ = stride;
        self.step(fields, out)
    }

    /// Whether a stride can be taken from the state at this time, s.
    fn is_ready(&self, time: f64) -> bool {
        let _ = time;
        true
    }

    /// Whether the solver is to go on where another surrogate would jump, so that this one can be fitted.
    fn wants_solver(&self) -> bool {
        false
    }

    /// Strides that it lets itself jump, `most` at most, beside what control allows.
    fn allows(&self, most: usize) -> usize {
        most
    }

    /// Whether the arrays of the state after this step of the solver are wanted by [`record`](Self::record).
    fn records(&self, step: &Step) -> bool {
        let _ = step;
        false
    }

    /// Takes the arrays of the state after a step of the solver. Says what came of it, for people.
    ///
    /// # Errors
    /// [`Error::Input`] for arrays that do not fit.
    fn record(&mut self, step: &Step, arrays: &[&[f64]]) -> Result<String> {
        let _ = (step, arrays);
        Ok(String::new())
    }

    /// Takes what the arrays that are inputs will be at the end of the next stride.
    ///
    /// # Errors
    /// [`Error::Input`] where there are no such arrays.
    fn inputs(&mut self, arrays: &[&[f64]]) -> Result<()> {
        let _ = arrays;
        Err(Error::Input(format!("a surrogate of kind {} has no arrays", self.name())))
    }

    /// The arrays of the state that the last step predicted; `before` above 0: of one so many seconds before the present.
    ///
    /// # Errors
    /// [`Error::Input`] where it has none.
    fn arrays(&self, before: f64, out: &mut [&mut [f64]]) -> Result<()> {
        let _ = (before, out);
        Err(Error::Input(format!("a surrogate of kind {} has no arrays", self.name())))
    }

    /// Time and fields have been advanced by what the last step predicted.
    fn advanced(&mut self) {}

    /// A jump has ended at this time, s; `own`: it was this one that jumped.
    fn handed_back(&mut self, time: f64, own: bool) {
        let _ = (time, own);
    }

    /// Segments K, and the segment of each of this rank's cells: errors are told for each of them. (0, []): none.
    fn segments(&self) -> (usize, &[i32]) {
        (0, &[])
    }

    /// Whether it learns from the solver's steps at all.
    fn can_learn(&self) -> bool {
        false
    }

    /// Whether it has begun to.
    fn has_begun(&self) -> bool {
        false
    }

    /// Whether more frames and rounds are of use.
    fn learns(&self) -> bool {
        self.can_learn()
    }

    /// Takes the fields after a step of the solver. `begins`: they do not follow from the last ones by a step of the solver.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that do not fit, and times that do not increase.
    fn frame(&mut self, time: f64, begins: bool, fields: &[Field]) -> Result<()> {
        let _ = (time, begins, fields);
        Ok(())
    }

    /// Learns from the frames, for jumps of so many strides; none where there was nothing to do.
    ///
    /// # Errors
    /// What the learning may fail with.
    fn learn(&mut self, strides: usize) -> Result<Option<Lesson>> {
        let _ = strides;
        Ok(None)
    }

    /// What it has learned, and its frames, for a run that is carried on; none: nothing.
    ///
    /// # Errors
    /// [`Error::Internal`] where it cannot be written down.
    fn state(&self) -> Result<Option<Vec<u8>>> {
        Ok(None)
    }

    /// Goes on from the [`state`](Self::state) of another run.
    ///
    /// # Errors
    /// [`Error::Input`] for what is no such state.
    fn restore(&mut self, state: &[u8]) -> Result<()> {
        let _ = state;
        Err(Error::Input(format!("a surrogate of kind {} has no state", self.name())))
    }

    /// Writes it as a model file, as it has become.
    ///
    /// # Errors
    /// [`Error::File`] where that fails; [`Error::Input`] for a surrogate that is no model.
    fn write_model(&self, path: &Path) -> Result<()> {
        let _ = path;
        Err(Error::Input(format!("a surrogate of kind {} is no model", self.name())))
    }
}
