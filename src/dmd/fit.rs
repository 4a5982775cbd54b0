//! A fit: what it is made of, what it says of later times, how far it is off.

use crate::dmd::Dmd;
use crate::driven::Driven;
use m4gn_base::{Error, Result};
use m4gn_state::Array;
use serde::{Deserialize, Serialize};

/// What fits are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSettings {
    /// Snapshots in a fit at most.
    pub window: usize,
    /// Snapshots without a gap, the last one included, that a fit needs at least.
    pub min_snapshots: usize,
    /// Snapshots at the end of the window that the choice is made by.
    pub hold_out: usize,
    /// Delays to choose from.
    pub delays: Vec<usize>,
    /// Ranks to choose from.
    pub svd_rank: Vec<usize>,
    /// Whether modes may grow; none: the tail says.
    pub unstable_modes: Option<bool>,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            window: 40,
            min_snapshots: 40,
            hold_out: 5,
            delays: vec![5, 8, 12],
            svd_rank: vec![12, 30],
            unstable_modes: None,
        }
    }
}

impl FitSettings {
    /// Checks the numbers against each other.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn check(&self) -> Result<()> {
        let bad = |text: String| Err(Error::Input(format!("dmd: {text}")));
        if self.hold_out == 0 {
            return bad("holdOut 0: expected at least 1 snapshot".into());
        }
        if self.delays.is_empty() || self.delays.contains(&0) {
            return bad(format!("delays {:?}: expected numbers of states, at least 1", self.delays));
        }
        if self.svd_rank.is_empty() || self.svd_rank.contains(&0) {
            return bad(format!("svdRank {:?}: expected numbers of directions, at least 1", self.svd_rank));
        }
        let fewest =
            self.hold_out.saturating_add(2).saturating_add(self.delays.iter().min().copied().unwrap_or(1));
        if self.min_snapshots < fewest {
            return bad(format!(
                "minSnapshots {}: expected at least {fewest}: holdOut, the fewest delays, and 2 states to learn from",
                self.min_snapshots
            ));
        }
        if self.window < self.min_snapshots || self.window > 1000 {
            return bad(format!(
                "window {}: expected minSnapshots ({}) to 1000 snapshots",
                self.window, self.min_snapshots
            ));
        }
        Ok(())
    }
}

/// How far a prediction of a field is off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldError {
    /// The field.
    pub name: String,
    /// Root mean square of prediction minus solver, over the field's variation in the window.
    pub error: f64,
    /// The same of the state that the prediction began from: the error of holding it, at least the least change that errors are over.
    pub hold: f64,
}

/// What a window says of later times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Model {
    /// By itself.
    Free(Dmd),
    /// With what is prescribed from now on.
    Driven(Driven),
}

impl Model {
    /// States that it begins from.
    pub fn delays(&self) -> usize {
        match self {
            Model::Free(dmd) => dmd.shape.delays,
            Model::Driven(driven) => driven.shape.delays,
        }
    }

    /// Directions that it has.
    pub fn rank(&self) -> usize {
        match self {
            Model::Free(dmd) => dmd.shape.rank,
            Model::Driven(driven) => driven.shape.rank,
        }
    }

    /// Whether modes that grow go on growing; with inputs nothing is changed of them.
    pub fn growing(&self) -> bool {
        match self {
            Model::Free(dmd) => dmd.shape.growing,
            Model::Driven(_) => true,
        }
    }

    /// Inputs that it has.
    pub fn inputs(&self) -> usize {
        match self {
            Model::Free(_) => 0,
            Model::Driven(driven) => driven.inputs(),
        }
    }

    /// Eigenvalues of a stride; none with inputs.
    pub fn eigenvalues(&self) -> &[[f64; 2]] {
        match self {
            Model::Free(dmd) => dmd.eigenvalues(),
            Model::Driven(_) => &[],
        }
    }
}

/// A decomposition of a window, and what it was chosen by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// That of the whole window.
    pub model: Model,
    /// Sample numbers of the window.
    pub numbers: Vec<i64>,
    /// Their slots.
    pub(crate) slots: Vec<usize>,
    /// Mean square of what each field varies by, at least the least change that errors are over; 0 for those that do not or are not measured.
    pub(crate) variation: Vec<f64>,
    /// Snapshots of the held-back tail.
    pub held_back: usize,
    /// Of the held-back tail, over all its snapshots.
    pub tail: Vec<FieldError>,
}

impl Fit {
    /// Mean square of what a field varies by, at least the least change that errors are over; 0 for one that does not.
    pub fn variation(&self, field: usize) -> f64 {
        self.variation[field]
    }

    /// Error of the tail over that of holding, all fields that vary together.
    pub fn tail_error(&self) -> f64 {
        relative(&self.tail)
    }
}

/// The fields that vary, of the mean squares that the prediction of each is off by, and that holding a state is.
pub(crate) fn errors(
    fields: &[Array],
    variation: &[f64],
    squares: impl Fn(usize) -> [f64; 2],
) -> Vec<FieldError> {
    let fields = fields.iter().enumerate().zip(variation).filter(|(_, v)| **v > 0.0);
    let error = |((f, field), v): ((usize, &Array), &f64)| {
        let [error, hold] = squares(f).map(|square| (square / v).sqrt());
        FieldError { name: field.name.clone(), error, hold }
    };
    fields.map(error).collect()
}

/// Errors over that of holding, of all fields together; 0 where nothing changes.
pub fn relative(errors: &[FieldError]) -> f64 {
    let sum = |of: fn(&FieldError) -> f64| errors.iter().map(|e| of(e).powi(2)).sum::<f64>();
    match (sum(|e| e.error), sum(|e| e.hold)) {
        (e, h) if h > 0.0 => (e / h).sqrt(),
        (0.0, _) => 0.0,
        _ => f64::INFINITY,
    }
}
