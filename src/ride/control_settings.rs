//! What a case sets of the error control of jumps.

use m4gn_base::settings;
use m4gn_base::{Error, Result, refuse};
use serde::{Deserialize, Serialize};

/// Default of [`ControlSettings::rel_tol`].
const REL_TOL: f64 = 0.2;

/// Default of [`ControlSettings::patience`].
const PATIENCE: usize = 10;

/// What happens where the surrogate stays bad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OnFailure {
    /// The solver goes on alone, and the surrogate is tried beside it.
    #[default]
    Solver,
    /// The run ends with an error.
    Stop,
}

settings! {
    /// Settings of a controller; `tolerance` suffices.
    pub struct ControlSettings in "control" {
        /// Largest error of a jump: root mean square, over the largest variation of the field so far in the run (its root mean square, of a
        /// scalar about its mean).
        pub tolerance: f64;
        // Of a flow that rests, or nearly, the change is small, and errors far within the tolerance are larger: jump by jump they would
        // make a flow of their own, a wake that sheds where the solver's does not.
        /// Largest error of a stride beside the solver, over what the solver changed in it.
        pub rel_tol: f64 = REL_TOL;
        /// Predicted fields whose errors are limited.
        pub fields: Option<Vec<String>> = None, "the first that varies; with several surrogates the first that all predict";
        /// What happens after `patience`: with `solver` it goes on alone, with the surrogate measured beside it; `stop` ends the run with
        /// an error.
        pub on_failure: OnFailure = OnFailure::default();
        /// Measured strides in a row that allow no jump, after which `onFailure` applies.
        pub patience: usize = PATIENCE;
    }
}

impl ControlSettings {
    /// The defaults with this tolerance.
    pub fn of(tolerance: f64) -> Self {
        ControlSettings {
            tolerance,
            rel_tol: REL_TOL,
            fields: None,
            on_failure: OnFailure::default(),
            patience: PATIENCE,
        }
    }

    /// Parses and checks a JSON object.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn parse(text: &str) -> Result<Self> {
        let read: Self = settings::parse("control", text, &[])?;
        read.check()?;
        Ok(read)
    }

    /// Checks the values.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn check(&self) -> Result<()> {
        refuse(!(self.tolerance.is_finite() && self.tolerance > 0.0), Error::Input, || {
            format!("control: tolerance {}: expected a relative error above 0, such as 0.05", self.tolerance)
        })?;
        refuse(self.rel_tol.is_nan() || self.rel_tol <= 0.0, Error::Input, || {
            let found = self.rel_tol;
            format!(
                "control: relTol {found}: expected an error over the solver's own change, above 0, such as 0.2"
            )
        })?;
        refuse(self.patience == 0, Error::Input, || "control: patience 0: expected at least 1 stride")?;
        refuse(
            self.fields.as_ref().is_some_and(Vec::is_empty),
            Error::Input,
            || "control: fields: expected at least one field",
        )
    }
}
