//! A model learns the case that it is used in, from the solver's own steps, inside the solver's run.
//!
//! Frames of the solver are gathered in the order of the undecomposed mesh to every rank, which makes a serial graph of
//! them, as the training does of a recorded trajectory. The examples of a batch are shared out to the ranks and the
//! gradients summed, so that the weights are those of one rank up to rounding. The last frames are held back: the adapted
//! weights are used only where a rollout there is nearer to the solver than with the weights before.

mod learner;
mod round;
mod settings;
mod state;
#[cfg(test)]
mod tests;
mod window;

pub use round::Outcome;
pub use settings::{Mode, Settings};

use learner::{Knowledge, Learner};
use m4gn_base::{Error, Result};
use m4gn_domain::cells::Levels;
use m4gn_engine::backward::{Layout, Optimiser};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::samples::Sample;
use m4gn_mesh::Mesh;
use m4gn_model::{Model, SegmentSpec};
use m4gn_parallel::{Comm, everywhere};
use m4gn_step::{Field, Session};
use std::sync::Arc;
use window::Window;

/// Bytes of frames that a rank keeps at most.
const ROOM: usize = 1 << 30;

/// A model that learns its case. All methods but the ones that only look are collective, and all ranks fail together.
#[derive(Debug)]
pub struct Adaptation {
    comm: Comm,
    learner: Learner,
    /// This rank's part of the mesh.
    mesh: Mesh,
    levels: Levels,
    /// Node of the undecomposed mesh of each row that the ranks send.
    places: Vec<usize>,
    /// Whether nothing more is to be learned.
    done: bool,
}

impl Adaptation {
    /// For a model on the mesh of a session. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that ask for nothing; [`Error::Mesh`] for global numbers that are no permutation.
    pub fn new(session: &Session, mesh: &Mesh, model: &Model, settings: Settings) -> Result<Self> {
        let comm = session.comm().clone();
        comm.agree(check(&settings))?;
        let whole = m4gn_domain::whole(mesh, &comm)?;
        let (segments, labels) = segments(session, mesh);
        let (spec, resolution) = (&model.spec, session.resolution());
        let sample = comm.agree(Sample::of_mesh(&whole, spec, &segments, resolution, Some(&labels)))?;
        let n_cells = whole.cell_global.len() as i64;
        let boundary = own_boundary(mesh, comm.is_root()).map(|face| n_cells + face);
        let nodes: Vec<i64> = mesh.cell_global.iter().copied().chain(boundary).collect();
        let normaliser = comm.agree(Normaliser::of_model(model))?;
        let layout = Layout::new(&model.spec);
        let shipped = comm.agree(layout.flatten(model))?;
        let precision = settings.precision.agreed(model.spec.precision_of_runs(), &comm);
        let training = settings.training(&model.spec, &normaliser.scales().node.std, precision);
        let window = Window::new(&settings, model.spec.stride, sample.structure.graph.n_owned * sample.width);
        let threads = settings.threads.unwrap_or_else(|| session.threads());
        let optimiser = Optimiser::new(shipped.clone(), training.betas, false).with_rule(
            training.optimiser,
            &layout,
            model.spec.architecture.width,
            threads,
        );
        Ok(Adaptation {
            places: everywhere(&comm, &nodes).into_iter().map(|node| node as usize).collect(),
            mesh: mesh.clone(),
            levels: Levels::new(mesh, &model.spec, &comm),
            learner: Learner {
                threads,
                spec: model.spec.clone(),
                others: model
                    .tensors
                    .clone()
                    .into_iter()
                    .filter(|(name, _)| name.starts_with("norm."))
                    .collect(),
                sample: Arc::new(sample),
                knowledge: Knowledge::of(optimiser),
                settings,
                training,
                layout,
                shipped,
                normaliser,
                whole,
                window,
            },
            comm,
            done: false,
        })
    }

    /// Takes the fields after a step of the solver; every one of them is to be handed in. `begins`: this state does not
    /// follow from the last one by a step of the solver. Collective; all ranks fail together, and the frames are then as
    /// they were.
    ///
    /// # Errors
    /// [`Error::Input`] for a field that is missing or of another shape, times that do not increase, or a time step of
    /// which no whole number is the model's stride; [`Error::Numerical`] for a value that is not finite.
    pub fn frame(&mut self, time: f64, begins: bool, fields: &[Field]) -> Result<()> {
        if self.done {
            return Ok(());
        }
        let mut window = self.learner.window.clone();
        if !self.comm.agree(window.next(time, begins))? {
            self.learner.window = window;
            return Ok(());
        }
        let mut rows = self.comm.agree(self.rows(fields))?;
        self.levels.take_off(fields, &mut rows, &self.comm);
        let rows = everywhere(&self.comm, &rows);
        let width = self.learner.sample.width;
        let sample = Arc::get_mut(&mut self.learner.sample);
        let sample = sample.ok_or_else(|| Error::Internal("frames that are still being read".into()))?;
        let mut frame = vec![0.0; n_nodes(&self.learner.whole) * width];
        for (row, place) in rows.chunks_exact(width).zip(&self.places) {
            frame[place * width..][..width].copy_from_slice(row);
        }
        sample.push(&self.learner.whole, &self.learner.spec, frame);
        let size = sample.structure.graph.n_owned * width;
        if let Some(stays) = window.thin() {
            let kept = stays.iter().enumerate().filter(|(_, stays)| **stays);
            let mut n = 0;
            for (frame, _) in kept {
                sample.frames.copy_within(frame * size..(frame + 1) * size, n * size);
                n += 1;
            }
            sample.frames.truncate(n * size);
            sample.n_frames = n;
        }
        self.learner.window = window;
        Ok(())
    }

    /// This rank's values, cells and then boundary faces, all components of a node together.
    fn rows(&self, fields: &[Field]) -> Result<Vec<f32>> {
        let (width, cells) = (self.learner.sample.width, self.n_cells());
        let (boundary, own) = (self.n_boundary(), own_boundary(&self.mesh, self.comm.is_root()).count());
        let mut rows = vec![0f32; (cells + own) * width];
        let mut column = 0;
        for spec in &self.learner.spec.fields {
            let name = &spec.name;
            let field = fields.iter().find(|f| f.name == name);
            let field = field
                .ok_or_else(|| Error::Input(format!("adapt: field '{name}' is missing from the frame")))?;
            let c = if spec.vector { 3 } else { 1 };
            let expected = (c, c * cells, c * boundary);
            let found = (field.components, field.cells.len(), field.boundary.len());
            if found != expected {
                return Err(Error::Input(format!(
                    "adapt: field '{name}': expected {} components, {} cell and {} boundary values; found {}, {} and {}",
                    expected.0, expected.1, expected.2, found.0, found.1, found.2
                )));
            }
            let scalar = [0];
            let directions = if spec.vector { &self.mesh.directions[..] } else { &scalar };
            let values = field.cells.chunks_exact(c).chain(field.boundary.chunks_exact(c));
            for (row, value) in rows.chunks_exact_mut(width).zip(values) {
                for (i, &d) in directions.iter().enumerate() {
                    row[column + i] = value[d] as f32;
                }
            }
            column += directions.len();
        }
        match rows.iter().all(|v| v.is_finite()) {
            true => Ok(rows),
            false => Err(Error::Numerical("adapt: a frame holds a value that is not finite".into())),
        }
    }

    /// The ranks of the session.
    pub fn comm(&self) -> &Comm {
        &self.comm
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.learner.settings
    }

    /// Whether frames and rounds are of no more use.
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// Forgets the frames: nothing more is to be learned.
    fn finish(&mut self) {
        let learner = &mut self.learner;
        if let Some(sample) = Arc::get_mut(&mut learner.sample) {
            (sample.frames, sample.n_frames) = (Vec::new(), 0);
            learner.window = learner.window.emptied();
        }
        self.done = true;
    }

    /// Frames in memory.
    pub fn frames(&self) -> usize {
        self.learner.frames()
    }

    /// This rank's cells, or points of a body.
    pub fn n_cells(&self) -> usize {
        self.mesh.cell_global.len()
    }

    /// Boundary values of a component of a frame: one for each boundary face of this rank, or each point of a body's obstacle.
    pub fn n_boundary(&self) -> usize {
        match &self.mesh.obstacle {
            Some(obstacle) => obstacle.positions.len(),
            None => self.mesh.boundary.len(),
        }
    }

    /// This rank's part of the mesh, with which a session takes the weights over.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The model with the weights that are used, and where they are from.
    pub fn model(&self) -> Model {
        self.learner.model()
    }
}

fn check(settings: &Settings) -> Result<()> {
    if settings.mode == Mode::Off {
        return Err(Error::Input("adapt: mode off asks for nothing".into()));
    }
    Ok(())
}

/// Numbers of the boundary nodes that this rank sends: its boundary faces; of a body the obstacle's points, which all ranks
/// have and the first one sends.
fn own_boundary(mesh: &Mesh, first: bool) -> impl Iterator<Item = i64> {
    let obstacle = mesh.obstacle.as_ref().filter(|_| first);
    let points = 0..obstacle.map_or(0, |o| o.positions.len() as i64);
    mesh.boundary.iter().map(|face| face.global).chain(points)
}

/// Rows of a frame of an undecomposed mesh.
fn n_nodes(whole: &Mesh) -> usize {
    whole.cell_global.len() + own_boundary(whole, true).count()
}

/// The session's segmentation in the order of the undecomposed mesh; one segment where the model has no macro stage. Collective.
fn segments(session: &Session, mesh: &Mesh) -> (SegmentSpec, Vec<i32>) {
    let cells = everywhere(session.comm(), &mesh.cell_global);
    let labels = everywhere(session.comm(), session.cell_segment());
    let mut ordered = vec![0; cells.len()];
    if session.n_segments() == 0 {
        let one = SegmentSpec { count: 1, overlap: 0, ..SegmentSpec::default() };
        return (one, ordered);
    }
    for (&cell, label) in cells.iter().zip(labels) {
        ordered[cell as usize] = label;
    }
    (session.segment_spec().clone(), ordered)
}
