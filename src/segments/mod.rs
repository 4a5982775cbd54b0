//! Segments: METIS refined by SLIC on modes and positions (Algorithm 2), overlap, and their adjacency (eq. 10).
//!
//! Nothing here depends on the number of ranks: METIS sees the canonical numbering on the root, and SLIC's sums
//! are integers.

mod geometry;
mod overlap;
mod partition;
mod quality;
pub mod ranks;
mod slic;
mod walk;

pub use geometry::{SegmentFeatures, features};
pub use quality::{Dissimilarity, Quality, quality};

use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::model::{SegmentMethod, SegmentSpec};
use crate::parallel::Comm;
use crate::{Error, Result};

/// Most segments: their adjacency is dense and replicated, 0.5 GB at this number.
pub const MAX_SEGMENTS: usize = 8192;

/// Which segments each node belongs to, and how the segments touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// Number of segments K.
    pub count: usize,
    /// Segment of each owned node; a boundary face has its owner cell's.
    pub node_segment: Vec<i32>,
    /// Owned node i belongs to segments `member[member_row[i]..member_row[i + 1]]`; length n_owned + 1.
    pub member_row: Vec<u32>,
    /// Segments of the owned nodes, ascending for each node; with overlap 0 the node's own alone.
    pub member: Vec<i32>,
    /// Member nodes of each segment, over all ranks.
    pub sizes: Vec<f64>,
    /// `[K x K]` directed edges from members of one segment to members of another, over all ranks (eq. 10); the
    /// diagonal counts a segment's inner edges.
    pub adjacency: Vec<f64>,
    /// Cells that each SLIC sweep moved, over all ranks: its length is the number of sweeps, and it ends with 0 if
    /// they converged. Empty for METIS alone and for labels that were handed in.
    pub sweeps: Vec<usize>,
    /// Cells that were given to another segment so that every segment is connected, over all ranks.
    pub reassigned: usize,
}

/// Cuts the mesh into `spec.count` segments. Collective; all ranks fail together.
///
/// `preset` gives the segment of each of this rank's cells (0 to K - 1, none empty) instead of computing them.
/// Errors: [`Error::Input`] if K is 0 or larger than the number of cells or [`MAX_SEGMENTS`], if there are fewer modes than asked
/// for, or if a preset label is out of range or missing.
pub fn segment(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    comm: &Comm,
    preset: Option<&[i32]>,
) -> Result<Segmentation> {
    let mut total = [mesh.n_cells() as i64];
    comm.sum_i64(&mut total);
    if spec.count == 0 || spec.count as i64 > total[0] {
        return Err(Error::Input(format!(
            "{} segments for {} cells: expected 1 to {}; set segments in the dictionary",
            spec.count, total[0], total[0]
        )));
    }
    if spec.count > MAX_SEGMENTS {
        return Err(Error::Input(format!(
            "{} segments: expected at most {MAX_SEGMENTS}",
            spec.count
        )));
    }
    let mut any_preset = [preset.is_some() as i64];
    comm.max_i64(&mut any_preset);
    let cells = match preset {
        Some(labels) => preset_labels(mesh, labels, spec.count, comm)?,
        None if any_preset[0] != 0 => {
            return comm.agree(Err(Error::Input(
                "other ranks give preset segments, this one does not".into(),
            )));
        }
        None => {
            let labels = partition::partition(mesh, graph, spec.count, comm)?;
            match spec.method {
                SegmentMethod::Metis => labels,
                _ => slic::refine(mesh, graph, spec, comm, labels)?,
            }
        }
    };
    overlap::complete(mesh, graph, spec, comm, cells)
}

/// Labels that somebody computed before, checked.
fn preset_labels(mesh: &Mesh, labels: &[i32], count: usize, comm: &Comm) -> Result<Vec<i32>> {
    let local = || {
        if labels.len() != mesh.n_cells() {
            return Err(Error::Input(format!(
                "{} segment labels for {} cells of rank {}",
                labels.len(),
                mesh.n_cells(),
                comm.rank()
            )));
        }
        match labels.iter().position(|&l| l < 0 || l as usize >= count) {
            Some(i) => Err(Error::Input(format!(
                "segment label of cell {i} on rank {} is {}: expected 0 to {}",
                comm.rank(),
                labels[i],
                count - 1
            ))),
            None => Ok(()),
        }
    };
    // A rank without preset labels passes through agree as well.
    comm.agree(local())?;
    let mut sizes = vec![0i64; count];
    for &l in labels {
        sizes[l as usize] += 1;
    }
    comm.sum_i64(&mut sizes);
    match sizes.iter().position(|&s| s == 0) {
        Some(empty) => Err(Error::Input(format!(
            "segment {empty} of {count} has no cell: expected labels 0 to {} that all occur; recompute the segments",
            count - 1
        ))),
        None => Ok(labels.to_vec()),
    }
}

impl Segmentation {
    /// Random-walk structural encoding of the segments `[K x steps]`: the probability that a random walk over
    /// the eq. 10 graph is back where it started after 1 to `steps` steps.
    pub fn rwse(&self, steps: usize) -> Vec<f32> {
        walk::rwse(self.count, &self.adjacency, steps)
    }
}

#[cfg(test)]
mod tests;
