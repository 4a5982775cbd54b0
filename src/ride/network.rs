//! A network as a surrogate: a session.

use crate::surrogate::{Advanced, Surrogate};
use m4gn_mesh::Result;
use m4gn_model::{Model, Output};
use m4gn_step::{Field, FieldMut, Session};
use std::ops::DerefMut;

/// A session, and what is known of its model.
pub struct Network<S> {
    session: S,
    advanced: Vec<Advanced>,
    source: String,
    digest: String,
}

impl<S: DerefMut<Target = Session>> Network<S> {
    /// Of a session with this model. `source`: where it is from, for people.
    ///
    /// # Errors
    /// What making a file of the model may fail with: its digest is taken of that.
    pub fn new(session: S, model: &Model, source: String) -> Result<Self> {
        let spec = session.spec();
        let advanced = spec.fields.iter().filter(|f| f.output != Output::None);
        let advanced = advanced.map(|f| Advanced {
            name: f.name.clone(),
            components: if f.vector { 3 } else { 1 },
            solved: f.components(spec.dim),
        });
        // FNV-1a
        let digest = model.to_bytes()?.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Ok(Network { advanced: advanced.collect(), session, source, digest: format!("{digest:016x}") })
    }
}

impl<S: DerefMut<Target = Session>> Surrogate for Network<S> {
    fn name(&self) -> &str {
        "network"
    }

    fn source(&self) -> String {
        self.source.clone()
    }

    fn digest(&self) -> String {
        self.digest.clone()
    }

    fn stride(&self) -> f64 {
        self.session.spec().stride
    }

    fn advances(&self) -> &[Advanced] {
        &self.advanced
    }

    fn growth(&self, field: &str) -> Option<Vec<f64>> {
        let calibration = self.session.spec().calibration.as_ref()?;
        calibration.factors(field).map(<[f64]>::to_vec)
    }

    fn segments(&self) -> (usize, &[i32]) {
        (self.session.n_segments(), self.session.cell_segment())
    }

    fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        self.session.step(fields, out)
    }
}
