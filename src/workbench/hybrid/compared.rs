//! The comparison of a run with the full one, by what the case is of.

use super::score::Score;
use crate::compare::{self, Options, displacement};
use crate::foam_case::FoamCase;
use m4gn_mesh::Result;
use serde_json::Value;

/// A run beside the full one.
pub(super) struct Compared {
    pub score: Score,
    /// Last time that both have, s.
    pub last: f64,
    /// The whole comparison.
    pub whole: Value,
}

impl Compared {
    /// Compares B with the full run A: displacement and forces of solids, velocity and forces of flows.
    pub fn new(
        a: &mut FoamCase,
        b: &mut FoamCase,
        options: &Options,
        stride: f64,
        strides: f64,
    ) -> Result<Self> {
        let last = |times: &[f64]| times.last().copied().unwrap_or(f64::NAN);
        if displacement::is_solid(a)? {
            let motion = displacement::compare(a, b, options, |_, _| {})?;
            return Ok(Compared {
                score: Score::of_solid(&motion, stride, strides),
                last: last(&motion.times),
                whole: motion.json()?,
            });
        }
        let (comparison, _) = compare::compare(a, b, options, |_, _| {})?;
        Ok(Compared {
            score: Score::of_flow(&comparison, stride, strides),
            last: last(&comparison.times),
            whole: comparison.json()?,
        })
    }
}
