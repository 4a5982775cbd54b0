//! What a case of a solid says beside its displacement.

use super::FoamCase;
use m4gn_base::{Error, Result};
use serde_json::json;

/// The force on a patch of a solid at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reaction {
    /// Integral of the traction over the patch, as it is deformed: what is outside pulls the body with, N.
    Force([f64; 3]),
    /// Why its fields do not say it.
    Unknown(Unknown),
}

/// Why the fields of a time do not say the force on a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Unknown {
    /// No `sigma` is stored.
    Missing,
    /// The surrogate did not advance `sigma`: it has the values of the solver's last step.
    Stale,
    /// `sigma` is over the density, of which the case is not asked.
    Kinematic,
    /// The mesh moves with the body (an updated Lagrangian model), and is not read at each time.
    Moved,
}

impl Unknown {
    /// In words, after "where".
    pub fn text(self) -> &'static str {
        match self {
            Unknown::Missing => "no sigma is stored",
            Unknown::Stale => "sigma was not advanced by the surrogate",
            Unknown::Kinematic => "sigma is a stress over the density, expected one in Pa",
            Unknown::Moved => "the mesh moves with the body (updated Lagrangian model)",
        }
    }
}

impl FoamCase {
    /// Stress at the cells at time number `time`, all nine components; none where no `sigma` is stored, or the surrogate did not
    /// advance it.
    ///
    /// # Errors
    /// OpenFOAM's message for a broken file; a non-finite value.
    pub fn stress(&mut self, time: usize) -> Result<Option<Vec<f64>>> {
        let values = self.handle.query(&json!({ "query": "stress", "time": time }))?;
        Ok(Some(self.finite(values, "sigma", time)?).filter(|v| !v.is_empty()))
    }

    /// Force on a patch at time number `time`, from the stored `sigma`; with the large strains of solids4foam's total
    /// Lagrangian models, on the deformed areas, by the stored `F` or else the gradient of `D`.
    ///
    /// # Errors
    /// OpenFOAM's message for an unknown patch or a broken file; a non-finite value.
    pub fn reaction(&mut self, patch: &str, time: usize) -> Result<Reaction> {
        let answer = self.handle.query(&json!({ "query": "reaction", "patch": patch, "time": time }))?;
        let unknown = match answer[..] {
            [0.0, x, y, z] => {
                let force = self.finite(vec![x, y, z], &format!("force on {patch}"), time)?;
                return Ok(Reaction::Force([force[0], force[1], force[2]]));
            }
            [1.0] => Unknown::Missing,
            [2.0] => Unknown::Stale,
            [3.0] => Unknown::Kinematic,
            [4.0] => Unknown::Moved,
            _ => {
                return Err(Error::Internal(format!(
                    "force on a patch: the bridge to OpenFOAM answered {answer:?}"
                )));
            }
        };
        Ok(Reaction::Unknown(unknown))
    }
}
