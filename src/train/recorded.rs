//! A trajectory on disk, whose frames are read when they are needed: data sets may be larger than the memory.

use super::samples::Sample;
use m4gn_data::{States, Trajectory};
use m4gn_mesh::Result;
use m4gn_model::{FieldSpec, ModelSpec};
use m4gn_step::faces_seen_as_their_cells;
use std::borrow::Cow;

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
    pub(super) fn new(trajectory: &Trajectory, spec: &ModelSpec) -> Self {
        Recorded {
            as_cells: faces_seen_as_their_cells(trajectory.mesh()),
            trajectory: trajectory.clone(),
            fields: spec.fields.clone(),
            dim: spec.dim,
        }
    }

    /// Opens the file for a while.
    ///
    /// # Errors
    /// As [`Trajectory::states`].
    pub(super) fn open(&self) -> Result<States<'_>> {
        let names: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
        self.trajectory.states(&names)
    }

    /// All fields of a frame: cells, boundary faces, points of the obstacle `[nodes x components]`.
    ///
    /// # Errors
    /// As [`States::read`].
    pub(super) fn frame(&self, states: &States, frame: usize) -> Result<Vec<f32>> {
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
        see_as_cells(&self.as_cells, &self.fields, self.dim, mesh.n_cells(), &mut all);
        Ok(all)
    }
}

/// Gives faces that a network sees as their cells the cells' vectors.
pub(super) fn see_as_cells(
    as_cells: &[(usize, usize)],
    fields: &[FieldSpec],
    dim: usize,
    cells: usize,
    frame: &mut [f32],
) {
    let width: usize = fields.iter().map(|f| f.components(dim)).sum();
    let mut first = 0;
    for field in fields {
        let n = field.components(dim);
        for &(face, cell) in as_cells.iter().filter(|_| field.vector) {
            let at = |node: usize| node * width + first;
            frame.copy_within(at(cell)..at(cell) + n, at(cells + face));
        }
        first += n;
    }
}

impl Sample {
    /// All fields of a frame: cells, then boundary nodes.
    ///
    /// # Errors
    /// [`Error::File`](m4gn_mesh::Error::File) where the frame has to be read, and cannot be.
    pub fn frame(&self, frame: usize) -> Result<Cow<'_, [f32]>> {
        let size = self.structure.graph.n_owned * self.width;
        match &self.recorded {
            // Opened for each frame: of thousands of trajectories there are fewer descriptors than files.
            Some(recorded) => {
                let read = recorded.frame(&recorded.open()?, frame)?;
                Ok(Cow::Owned(self.at_nodes(read)))
            }
            None => Ok(Cow::Borrowed(&self.frames[frame * size..(frame + 1) * size])),
        }
    }

    /// Whether its frames are read from the file when they are needed.
    pub fn is_streamed(&self) -> bool {
        self.recorded.is_some()
    }

    /// Bytes of all its frames in memory.
    pub fn frame_bytes(&self) -> u64 {
        (self.n_frames * self.structure.graph.n_owned * self.width * size_of::<f32>()) as u64
    }
}

#[cfg(test)]
#[path = "recorded_tests.rs"]
mod tests;
