//! A session: one model on one mesh, stepping fields by name.
//!
//! This is what the C ABI and `m4gn validate` drive. Building one makes graph, modes and segments once; a step
//! turns fields into node features, runs the network, and turns its outputs into fields again.

mod opening;
mod options;
mod outputs;
mod stepper;

pub use m4gn_domain::{Field, FieldMut};
pub use opening::read_model;
pub use options::{Backend, SessionOptions};
pub use stepper::Stepper;

use m4gn_base::Result;
use m4gn_domain::Host;
use m4gn_model::{Extent, ModelSpec, Ranges, Solid};
use m4gn_parallel::Comm;

/// One model on one mesh: fields at the cells of a mesh that does not move, or the displacement of a body at points.
pub struct Session {
    comm: Comm,
    spec: ModelSpec,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    n_segments: usize,
    cell_segment: Vec<i32>,
    /// How they were computed, to be stored with them; empty if they were handed in.
    segment_record: String,
    /// Mean distance of neighbouring cells, m.
    cell_size: f64,
    host: Box<dyn Host>,
    stepper: Stepper,
    /// What the host's solver says of a solid at cells.
    solid: Option<Solid>,
    /// Fields at the end of the step, solved components only `[n_cells x n_outputs]`.
    result: Vec<f64>,
    /// Whether a step has been done, so that there are fields to look at.
    stepped: bool,
}

impl Session {
    /// The model's description.
    pub fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    /// Cells of this rank.
    pub fn n_cells(&self) -> usize {
        self.n_cells
    }

    /// Boundary faces of this rank.
    pub fn n_boundary(&self) -> usize {
        self.n_boundary
    }

    /// Segments K; 0 for a model without a macro stage.
    pub fn n_segments(&self) -> usize {
        self.n_segments
    }

    /// Segment of each of this rank's cells; empty for a model without a macro stage.
    pub fn cell_segment(&self) -> &[i32] {
        &self.cell_segment
    }

    /// Groups of cells that the network lives on, of all ranks; 0 where it lives on the cells themselves.
    pub fn n_groups(&self) -> usize {
        self.host.groups().map_or(0, |groups| groups.n_groups)
    }

    /// Group of each of this rank's cells, the same on any number of ranks; none where the network lives on the cells.
    pub fn cell_group(&self) -> Option<&[i32]> {
        self.host.groups().map(|groups| &groups.group[..])
    }

    /// How the segments were computed, to be stored with them ([`segments::Record`]); empty if they were handed in.
    pub fn segment_record(&self) -> &str {
        &self.segment_record
    }

    /// The ranks of this session.
    pub fn comm(&self) -> &Comm {
        &self.comm
    }

    /// Looks at a recorded state. At points of walls a vector that differs from one such state to another is predicted, as in a training on
    /// these states; else it stays as the host has it.
    pub fn see(&mut self, fields: &[Field]) {
        self.host.see(fields);
    }

    /// One step: reads every input field at time t, writes every output field's cells at t + stride. Collective;
    /// all ranks fail together, and nothing is written then.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that are missing or have other components or lengths; [`Error::Numerical`] for
    /// values that are not finite, going in or coming out.
    pub fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let checked = self.check_outputs(out);
        self.advance(fields, checked)?;
        for o in out {
            self.write(o);
        }
        Ok(())
    }

    /// The part of [`Session::step`] that reads: computes the result and keeps it. `checked` is the caller's own
    /// finding so far, that the ranks agree on with theirs. Collective.
    ///
    /// # Errors
    /// As [`Session::step`].
    pub fn advance(&mut self, fields: &[Field], checked: Result<()>) -> Result<()> {
        let (comm, network) = (&self.comm, &mut self.stepper);
        let done = self.host.step(comm, network, fields, checked, &mut self.result);
        self.stepped |= done.is_ok();
        done
    }

    /// One step of a body: [`Session::set_obstacle`], then [`Session::step`] of the displacement of this rank's points,
    /// m, in place. Collective; all ranks fail together, and `displacement` is then as it was.
    ///
    /// # Errors
    /// As both.
    pub fn step_body(&mut self, displacement: &mut [[f64; 3]], obstacle: [&[[f64; 3]]; 2]) -> Result<()> {
        self.set_obstacle(obstacle[0], obstacle[1])?;
        let name = self.spec.fields[0].name.clone();
        let before = displacement.to_vec();
        let field = Field { name: &name, components: 3, cells: before.as_flattened(), boundary: &[] };
        let after = FieldMut { name: &name, components: 3, cells: displacement.as_flattened_mut() };
        self.step(&[field], &mut [after])
    }

    /// Takes the displacement of the obstacle's points `[Q]` at the start and at the end of the next step, m; that of
    /// the first rank counts. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths, or a session without body; [`Error::Numerical`] for values that are not
    /// finite.
    pub fn set_obstacle(&mut self, now: &[[f64; 3]], after: &[[f64; 3]]) -> Result<()> {
        self.host.set_obstacle(&self.comm, [now, after])
    }

    /// In which respects the mesh, the solid and the fields of the last step lie outside of what the model was trained on, one
    /// an entry, for people; empty too for a model that does not say. Before the first step there are no fields to look at.
    /// Collective.
    pub fn outside(&self) -> Vec<String> {
        let Some(trained_on) = &self.spec.trained_on else {
            return Vec::new();
        };
        let solid = self.host.solid().or(self.solid.as_ref()).cloned();
        let case = match self.stepped {
            true => {
                let mut ranges = Ranges::new(&self.spec);
                ranges.see(self.host.seen());
                ranges.extent(self.cell_size, solid, &self.comm)
            }
            false => Extent { cell_size: self.cell_size, speed: None, inputs: Vec::new(), solid },
        };
        trained_on.outside(&case, self.spec.stride)
    }
}

#[cfg(test)]
mod body_tests;
#[cfg(test)]
extern crate self as m4gn_step;
#[cfg(test)]
#[path = "../../tests/samples/flow.rs"]
mod flow;
#[cfg(test)]
mod tests;
