//! Scalar fields beside the velocity.

use crate::foam_case::FoamCase;
use crate::validate::rmse::{SquaredError, cumulative};
use m4gn_mesh::Result;
use serde::Serialize;

/// Errors of a scalar field, one entry a common time, in the field's unit.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FieldComparison {
    /// RMSE over times 1 to i.
    pub rmse: Vec<f64>,
    /// The same for the full run's field at the takeover, held.
    pub hold_last_rmse: Vec<f64>,
    /// RMSE at each time alone.
    pub error: Vec<f64>,
}

/// Scalar fields that surrogates of flows predict.
const SCALARS: [&str; 3] = ["p", "p_rgh", "T"];

/// A field while the times go by.
pub(super) struct Track {
    pub name: &'static str,
    held: Vec<f64>,
    errors: [Vec<SquaredError>; 2],
}

impl Track {
    /// The fields that both cases have at all times.
    pub fn all(
        a: &mut FoamCase,
        b: &mut FoamCase,
        hold: (usize, usize),
        pairs: &[(usize, usize)],
    ) -> Result<Vec<Self>> {
        let mut tracks = Vec::new();
        for name in SCALARS {
            let mut stored = true;
            for &(i, j) in std::iter::once(&hold).chain(pairs) {
                stored = stored && a.has_field(name, i)? && b.has_field(name, j)?;
            }
            if stored {
                tracks.push(Track {
                    name,
                    held: a.scalar_field(name, hold.0)?,
                    errors: Default::default(),
                });
            }
        }
        Ok(tracks)
    }

    pub fn add(&mut self, full: &[f64], hybrid: &[f64]) {
        self.errors[0].push(SquaredError::between(full, hybrid));
        self.errors[1].push(SquaredError::between(full, &self.held));
    }

    pub fn finish(self) -> (String, FieldComparison) {
        let [hybrid, held] = self.errors;
        let compared = FieldComparison {
            rmse: cumulative(&hybrid),
            hold_last_rmse: cumulative(&held),
            error: hybrid.iter().map(SquaredError::rmse).collect(),
        };
        (self.name.to_string(), compared)
    }
}
