//! Recorded trajectories as samples, and those whose frames stay on disk and are read when they are needed: data sets may be
//! larger than the memory.

use m4gn_base::{Error, Result};
use m4gn_data::{States, Trajectory};
use m4gn_domain::{as_seen, faces_seen_as_their_cells};
use m4gn_learn::samples::{FrameSource, Sample};
use m4gn_model::{FieldSpec, ModelSpec, Ranges, Solid};
use m4gn_parallel::Comm;
use serde::Deserialize;
use std::sync::Arc;

/// A trajectory and the fields of it that a model has.
#[derive(Clone, Debug)]
pub struct Recorded {
    trajectory: Trajectory,
    fields: Vec<FieldSpec>,
    dim: usize,
    /// Faces on which networks see their cells' vectors, with these cells.
    as_cells: Vec<(usize, usize)>,
}

impl Recorded {
    fn new(trajectory: &Trajectory, spec: &ModelSpec) -> Self {
        Recorded {
            as_cells: faces_seen_as_their_cells(trajectory.mesh()),
            trajectory: trajectory.clone(),
            fields: spec.fields.clone(),
            dim: spec.dim,
        }
    }

    /// Opens the file for a while.
    fn open(&self) -> Result<States<'_>> {
        let names: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
        self.trajectory.states(&names)
    }

    /// All fields of a frame: cells, boundary faces, points of the obstacle `[nodes x components]`.
    fn read(&self, states: &States, frame: usize) -> Result<Vec<f32>> {
        let (values, motion) = states.read(frame)?;
        let widths: Vec<usize> = self.fields.iter().map(|f| f.components(self.dim)).collect();
        let width: usize = widths.iter().sum();
        let mesh = self.trajectory.mesh();
        let nodes = mesh.cell_global.len() + mesh.boundary.len() + motion.len();
        let mut all = vec![0f32; nodes * width];
        let mut first = 0;
        for (field, n) in values.iter().zip(widths) {
            let parts = [&field.cells[..], &field.boundary, motion.as_flattened()];
            let rows = parts.into_iter().flat_map(|p| p.chunks_exact(n));
            for (to, row) in all.chunks_exact_mut(width).zip(rows) {
                to[first..first + n].copy_from_slice(row);
            }
            first += n;
        }
        as_seen(&self.as_cells, &self.fields, self.dim, mesh.cell_global.len(), &mut all);
        Ok(all)
    }
}

impl FrameSource for Recorded {
    // Opened for each frame: of thousands of trajectories there are fewer descriptors than files.
    fn frame(&self, frame: usize) -> Result<Vec<f32>> {
        self.read(&self.open()?, frame)
    }
}

/// Reads a trajectory into memory and makes its graph and segments. Of a body, the obstacle's points are the boundary.
///
/// # Errors
/// [`Error::File`] for a trajectory that cannot be read, or that no graph or segments can be made of.
pub fn read(trajectory: &Trajectory, spec: &ModelSpec) -> Result<Sample> {
    read_within(trajectory, spec, u64::MAX)
}

/// As [`read`]; frames that take more than `room` bytes stay on disk, and are read when they are needed. All of them
/// are read here once, so that a damaged file is noticed before anything is learned.
///
/// # Errors
/// As [`read`].
pub fn read_within(trajectory: &Trajectory, spec: &ModelSpec, room: u64) -> Result<Sample> {
    let mesh = trajectory.mesh();
    let made = Sample::of_mesh(mesh, spec, &spec.segments, spec.resolution);
    let mut sample = made.map_err(|e| Error::file(trajectory.path(), e.to_string()))?;
    sample.n_frames = trajectory.times().len();
    let recorded = Recorded::new(trajectory, spec);
    let keep = sample.frame_bytes() <= room;
    let mut frames = Vec::new();
    if keep {
        frames.reserve_exact(sample.n_frames * sample.structure.graph.n_owned * sample.width);
    }
    let mut ranges = Ranges::new(spec);
    let states = recorded.open()?;
    for number in 0..sample.n_frames {
        let frame = sample.at_nodes(recorded.read(&states, number)?);
        sample.domain.boundary_mut().see(&frame);
        ranges.see(sample.domain.ranging(&frame));
        if keep {
            frames.extend(frame);
        }
    }
    drop(states);
    sample.domain.boundary_mut().settle();
    sample.extent = Some(ranges.extent(sample.cell_size, solid(trajectory)?, &Comm::serial()));
    sample.frames = frames;
    sample.source = match keep {
        true => None,
        false => Some(Arc::new(recorded)),
    };
    Ok(sample)
}

/// What a trajectory says of its solid: a body by its elements, a solver's case by the provenance that `m4gnRecorder` writes.
///
/// # Errors
/// [`Error::File`] for a provenance that has something else under this name.
fn solid(trajectory: &Trajectory) -> Result<Option<Solid>> {
    if let Some(body) = trajectory.body() {
        return Ok(Some(Solid::of_body(body)));
    }
    let recorded = &trajectory.provenance()["solid"];
    if recorded.is_null() {
        return Ok(None);
    }
    let found = Solid::deserialize(recorded).map_err(|e| e.to_string());
    let checked = found.and_then(|solid| match solid.fault() {
        Some(fault) => Err(fault),
        None => Ok(solid),
    });
    checked.map(Some).map_err(|e| Error::file(trajectory.path(), format!("provenance, entry solid: {e}")))
}

#[cfg(test)]
#[path = "recorded_tests.rs"]
mod tests;
