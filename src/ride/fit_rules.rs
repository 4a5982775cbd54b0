//! By what rules a fit is made, used and dropped.

/// The rules of one kind of fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRules {
    /// Error of the held-back snapshots below which a fit is used at once.
    pub fit_tolerance: f64,
    /// Largest error of the held-back snapshots, and of a stride after a jump.
    pub jump_tolerance: f64,
    /// Strides of the first jump of a fit.
    pub initial_jump: usize,
    /// How much longer the next may be.
    pub jump_growth: f64,
    /// Strides of a jump at most.
    pub max_jump: usize,
    /// Strides of the solver between tries of a fit.
    pub refit_interval: usize,
    /// Snapshots without a gap that a fit needs.
    pub min_snapshots: usize,
    /// Snapshots in a fit at most.
    pub window: usize,
}

impl FitRules {
    /// Those of a fit with inputs: its errors are those of what the inputs do by chance, so that waiting betters nothing, and what adds up over
    /// a jump does not show in the stride after it.
    pub(crate) fn driven(self) -> Self {
        FitRules { fit_tolerance: self.jump_tolerance, max_jump: self.initial_jump, ..self }
    }
}
