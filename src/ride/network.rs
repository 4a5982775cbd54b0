//! A network as a surrogate: a session, and its model's adaptation to the run.

use crate::surrogate::{Advanced, Lesson, Surrogate};
use m4gn_adapt::{Adaptation, Settings};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, Output};
use m4gn_step::{Field, FieldMut, Session};
use std::ops::DerefMut;
use std::path::Path;
use std::sync::Arc;

/// A session, and what its model learns in the run.
pub struct Network<S> {
    session: S,
    advanced: Vec<Advanced>,
    source: String,
    digest: String,
    learning: Option<Learning>,
}

/// What is needed to learn, until it begins.
enum Learning {
    Waiting(Box<(Mesh, Arc<Model>, Settings)>),
    Begun(Box<Adaptation>),
}

impl<S: DerefMut<Target = Session>> Network<S> {
    /// Of a session with this model. `source`: where it is from, for people. `adapt`: the mesh of the session and settings, where it is
    /// to learn.
    ///
    /// # Errors
    /// What making a file of the model may fail with: its digest is taken of that.
    pub fn new(
        session: S,
        model: Arc<Model>,
        source: String,
        adapt: Option<(Mesh, Settings)>,
    ) -> Result<Self> {
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
        Ok(Network {
            advanced: advanced.collect(),
            learning: adapt.map(|(mesh, settings)| Learning::Waiting(Box::new((mesh, model, settings)))),
            session,
            source,
            digest: format!("{digest:016x}"),
        })
    }

    /// The adaptation, which begins with its first frame or state. Collective.
    fn adaptation(&mut self) -> Result<&mut Adaptation> {
        if let Some(Learning::Waiting(waiting)) = &self.learning {
            let (mesh, model, settings) = &**waiting;
            let begun = Adaptation::new(&self.session, mesh, model, settings.clone())?;
            self.learning = Some(Learning::Begun(Box::new(begun)));
        }
        match &mut self.learning {
            Some(Learning::Begun(adaptation)) => Ok(adaptation),
            _ => Err(Error::Internal("a network that was not to learn".into())),
        }
    }

    fn begun(&self) -> Option<&Adaptation> {
        match &self.learning {
            Some(Learning::Begun(adaptation)) => Some(adaptation),
            _ => None,
        }
    }

    /// Hands the adapted weights to the session. Collective.
    fn hand_over(&mut self) -> Result<()> {
        let Some(Learning::Begun(adaptation)) = &self.learning else {
            return Ok(());
        };
        self.session.set_weights(adaptation.mesh(), &adaptation.model())
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

    fn can_learn(&self) -> bool {
        self.learning.is_some()
    }

    fn has_begun(&self) -> bool {
        self.begun().is_some()
    }

    fn learns(&self) -> bool {
        self.can_learn() && self.begun().is_none_or(|a| !a.is_done())
    }

    fn frame(&mut self, time: f64, begins: bool, fields: &[Field]) -> Result<()> {
        self.adaptation()?.frame(time, begins, fields)
    }

    fn learn(&mut self, strides: usize) -> Result<Option<Lesson>> {
        let Some(Learning::Begun(adaptation)) = &mut self.learning else {
            return Ok(None);
        };
        let outcome = adaptation.run(strides)?;
        if outcome.used {
            self.hand_over()?;
        }
        Ok(Some(Lesson {
            used: outcome.used,
            steps: outcome.steps,
            seconds: outcome.seconds,
            before: outcome.before,
            after: outcome.after,
            note: outcome.note,
        }))
    }

    fn state(&self) -> Result<Option<Vec<u8>>> {
        // The first rank writes it.
        let bytes = |adaptation: &Adaptation| match self.session.comm().is_root() {
            true => adaptation.bytes(),
            false => Ok(Vec::new()),
        };
        self.begun().map(bytes).transpose()
    }

    fn restore(&mut self, state: &[u8]) -> Result<()> {
        self.adaptation()?.restore(state)?;
        self.hand_over()
    }

    fn write_model(&self, path: &Path) -> Result<()> {
        let Some(adaptation) = self.begun() else {
            return Err(Error::Input("the network has not begun to learn".into()));
        };
        let comm = self.session.comm();
        let written = match comm.is_root() {
            true => adaptation.model().write(path),
            false => Ok(()),
        };
        comm.agree(written)
    }
}
