//! A network as a surrogate: a session of its model.

use crate::surrogate::{Description, Growth, Start, Surrogate};
use m4gn_base::{Error, Result};
use m4gn_model::{Model, Output};
use m4gn_state::{Layout, Values};
use m4gn_step::{Field, FieldMut, Session};
use std::ops::DerefMut;

/// A field of the model, and where it is in the state.
struct Input {
    name: String,
    components: usize,
    nodes: usize,
    /// None: it has no boundary values (of a body).
    boundary: Option<usize>,
}

/// A session on the host's state.
pub struct Network<S> {
    session: S,
    description: Description,
    inputs: Vec<Input>,
    outputs: Vec<(String, usize)>,
}

impl<S: DerefMut<Target = Session>> Network<S> {
    /// Of a session with this model. `source`: where it is from, for people.
    ///
    /// # Errors
    /// [`Error::Input`] for a state that lacks a field of the model; what making a file of the model may fail with: its digest is taken of
    /// that.
    pub fn new(session: S, model: &Model, source: String, layout: &Layout) -> Result<Self> {
        let spec = session.spec();
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        let (mut advances, mut growth) = (Vec::new(), Vec::new());
        for field in &spec.fields {
            let components = if field.vector { 3 } else { 1 };
            let found = layout.at_nodes(&field.name);
            let nodes = found.ok_or_else(|| {
                Error::Input(format!(
                    "the state has no array '{}' at nodes, a field of the model",
                    field.name
                ))
            })?;
            let array = &layout.arrays()[nodes];
            if (array.components, array.items) != (components, session.n_cells()) {
                return Err(Error::Input(format!(
                    "array '{}': expected {} items of {components} components, as model and mesh have, found {} of {}",
                    field.name,
                    session.n_cells(),
                    array.items,
                    array.components
                )));
            }
            if spec.reads(field) {
                let boundary = layout.at_boundary(&field.name);
                let wanted = components * session.n_boundary();
                if wanted > 0 && boundary.is_none_or(|b| layout.arrays()[b].numbers() < wanted) {
                    return Err(Error::Input(format!(
                        "array '{}' at the boundary: expected at least {} faces, those of the mesh",
                        field.name,
                        session.n_boundary()
                    )));
                }
                inputs.push(Input { name: field.name.clone(), components, nodes, boundary });
            }
            if field.output != Output::None {
                if !array.is_measured() || array.solved != field.components(spec.dim) {
                    return Err(Error::Input(format!(
                        "array '{}': expected one that is solved, with {} components, as the model advances it",
                        field.name,
                        field.components(spec.dim)
                    )));
                }
                outputs.push((field.name.clone(), components));
                advances.push(nodes);
                let factors = spec.calibration.as_ref().and_then(|c| c.factors(&field.name));
                growth.push(factors.map_or(Growth::Unknown, |f| Growth::Factors(f.to_vec())));
            }
        }
        // FNV-1a
        let digest = model.to_bytes()?.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let reads = inputs.iter().flat_map(|i| [Some(i.nodes), i.boundary]).flatten();
        let description = Description {
            name: "network".into(),
            source,
            digest: format!("{digest:016x}"),
            stride: spec.stride,
            reads: reads.collect(),
            advances,
            is_whole: false,
            growth,
            segments: (session.n_segments(), session.cell_segment().to_vec()),
            note: String::new(),
        };
        Ok(Network { session, description, inputs, outputs })
    }
}

impl<S: DerefMut<Target = Session>> Surrogate for Network<S> {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()> {
        let n_boundary = self.session.n_boundary();
        let fields = self.inputs.iter().map(|i| Field {
            name: &i.name,
            components: i.components,
            cells: &start.state[i.nodes],
            boundary: i.boundary.map_or(&[][..], |b| &start.state[b][..i.components * n_boundary]),
        });
        let fields: Vec<Field> = fields.collect();
        let pairs = self.outputs.iter().zip(next.iter_mut());
        let mut out: Vec<FieldMut> = pairs
            .map(|((name, components), cells)| FieldMut { name, components: *components, cells })
            .collect();
        self.session.step(&fields, &mut out)
    }
}
