//! What may take the solver's place for a while: a network, a fit of the run's own states, or anything else that advances arrays of the
//! state by strides. One file and one line of [`KINDS`](crate::registry::KINDS) add another.

use crate::dmd::DmdSurrogate;
use crate::schedule::Step;
use m4gn_base::Result;
use m4gn_state::Values;

/// What is known of a surrogate from its start on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Description {
    /// What kind it is, in one word for tables: `network`.
    pub name: String,
    /// Where it is from, for people: the model's file.
    pub source: String,
    /// Identifies it: a state that was written with another one is not taken up.
    pub digest: String,
    /// Time that one step advances, s. That of a fit may change while it has no state.
    pub stride: f64,
    /// The arrays that it advances and is measured by.
    pub advances: Vec<usize>,
    /// The arrays that [`Surrogate::predict`] reads.
    pub reads: Vec<usize>,
    /// Whether it makes all arrays of a predicted state, with [`Surrogate::carry`].
    pub is_whole: bool,
    /// How the error of each advanced array grows over a jump.
    pub growth: Vec<Growth>,
    /// Segments K, and the segment of each of this rank's nodes: errors are told for each of them. (0, []): none.
    pub segments: (usize, Vec<i32>),
    /// A line for the log.
    pub note: String,
}

/// By how much the error after 1, 2, ... strides of a jump exceeds that of the stride before it.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Growth {
    /// Not known: the errors of the strides are reckoned to add up.
    #[default]
    Unknown,
    /// Not at all, as far as the surrogate may go.
    None,
    /// By these factors, and no further.
    Factors(Vec<f64>),
}

/// Where a stride begins.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// The state: of each array that the surrogate reads or advances its values.
    pub state: &'a Values,
    /// What the prescribed arrays will be at the end of the stride; none where nobody knows, or needs to.
    pub ahead: Option<&'a Values>,
    /// Time to the state that is asked for, s: the stride, but of a fit any.
    pub duration: f64,
}

/// Where a run is carried on.
#[derive(Clone, Copy, Debug)]
pub struct Resumed<'a> {
    /// The present time.
    pub step: &'a Step,
    /// All arrays of the state there.
    pub state: &'a [&'a [f64]],
    /// How much later that is than where the state was saved, s: the name of a time is rounded.
    pub later: f64,
    /// Whether the solver is at work there, and no jump.
    pub solves: bool,
    /// Whether the run goes on under the conditions that it was saved under.
    pub holds: bool,
}

/// A surrogate on the host's mesh. All methods but the ones that only look are collective, and all ranks fail together.
pub trait Surrogate {
    /// What is known of it.
    fn describe(&self) -> &Description;

    /// One stride. `next` holds the advanced arrays at its start, and at its end afterwards; components that are not solved stay.
    ///
    /// # Errors
    /// [`Error::Numerical`](m4gn_base::Error::Numerical) for a result that must not be used: `next` is then as it was. What else may fail, for arrays that do not fit.
    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()>;

    /// The other arrays of the state that was predicted last, where it makes all.
    fn carry(&self, _next: &mut [&mut [f64]]) {}

    /// Time and state have been advanced by what the last stride predicted.
    fn advanced(&mut self) {}

    /// A jump has ended at this time, s; `own`: it was this one that jumped.
    fn handed_back(&mut self, _time: f64, _own: bool) {}

    /// It as a fit of the run's own states, where it is one.
    fn fits(&self) -> Option<&DmdSurrogate> {
        None
    }

    /// The same, to be changed.
    fn fits_mut(&mut self) -> Option<&mut DmdSurrogate> {
        None
    }

    /// What it has learned of the run, for a run that is carried on; none: nothing.
    ///
    /// # Errors
    /// [`Error::File`](m4gn_base::Error::File) where it cannot be written down.
    fn save(&self) -> Result<Option<Vec<u8>>> {
        Ok(None)
    }

    /// Goes on from what another run has [`save`](Self::save)d, or begins anew beside it where that does not hold. Says why it begins anew
    /// although it holds; none: it goes on.
    ///
    /// # Errors
    /// [`Error::Input`](m4gn_base::Error::Input) for what is no such state.
    fn restore(&mut self, _saved: &[u8], _at: &Resumed) -> Result<Option<String>> {
        Ok(None)
    }
}
