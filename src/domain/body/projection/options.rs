//! What may be set.

use m4gn_base::{Error, Result};

/// How contact is restored. Lengths are in mean rest edges of the body.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProjectionOptions {
    /// Gap that is left between body and obstacle.
    pub clearance: f64,
    /// Penetration below the clearance that is let pass.
    pub tolerance: f64,
    /// How far a push is felt in the body.
    pub radius: f64,
    /// Whether a part of the body is pushed out of itself as well. Parts that share no point are always kept out of each other.
    pub self_contact: bool,
    /// Times the gaps are measured again, at most.
    pub sweeps: usize,
}

impl Default for ProjectionOptions {
    fn default() -> Self {
        ProjectionOptions { clearance: 0.0, tolerance: 0.005, radius: 6.0, self_contact: false, sweeps: 12 }
    }
}

impl ProjectionOptions {
    /// Checks what does not need a body.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was expected and what was found.
    pub fn check(&self) -> Result<()> {
        let wrong = |name: &str, value: f64, expected: &str| {
            Err(Error::Input(format!("projection: {name} {value}, expected {expected} mean edges")))
        };
        if !(0.0..=1.0).contains(&self.clearance) {
            return wrong("clearance", self.clearance, "0 to 1");
        }
        if !(1e-6..=1.0).contains(&self.tolerance) {
            return wrong("tolerance", self.tolerance, "1e-6 to 1");
        }
        if !(1.0..=1e3).contains(&self.radius) {
            return wrong("radius", self.radius, "1 to 1000");
        }
        if !(1..=1000).contains(&self.sweeps) {
            return Err(Error::Input(format!("projection: {} sweeps, expected 1 to 1000", self.sweeps)));
        }
        Ok(())
    }
}
