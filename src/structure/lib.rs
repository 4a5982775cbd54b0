//! The structure that networks live on: a graph, coarser ones, and its segments: METIS refined by SLIC on modes and positions (Algorithm 2),
//! overlap, and their adjacency (eq. 10).
//!
//! Nothing here depends on the number of ranks or on the numbering of the mesh: METIS sees cells numbered by their places, on the root,
//! and SLIC's sums are integers.

mod cell_graph;
pub mod coarse;
mod connect;
mod diameter;
mod geometry;
pub mod graph;
mod levels;
mod obstacle;
mod overlap;
mod partition;
mod parts;
mod place;
mod quality;
pub mod ranks;
mod record;
mod sequence;
mod slic;
mod structure;
mod top_k;
mod walk;
mod wall_pieces;

pub use diameter::diameter;
pub use levels::{Level, Transfer, bi_stride};
pub use obstacle::{obstacle_distance, obstacle_note};
pub use parts::parts;
pub use quality::{Quality, quality};
pub use record::{Record, misfit};
pub use sequence::Sequence;
pub use structure::Structure;
pub use top_k::Pooled;
pub use walk::{node_walk, walk_of_pairs};

use cell_graph::Root;
use graph::Graph;
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_mesh::Mesh;
use m4gn_model::modal::{ModalSource, Modes};
use m4gn_model::{MAX_SEGMENTS, SegmentSpec};
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};

/// Which segments each node belongs to, how the segments touch, and what a network reads of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Cells that are not in the segment that METIS had put them in, over all ranks; 0 for labels that were handed in.
    pub moved: usize,
    /// Cells that were given to another segment so that every segment is connected, over all ranks.
    pub reassigned: usize,
    /// Positional encoding `[K x n_position_features]`: random walk, then the centroid from the domain's centre over the
    /// centroids' rms distance from it. Empty before [`Segmentation::encode`], and where the model has none.
    pub position: Vec<f32>,
    /// `[n_owned x n_offset_features]`: a node's displacement from its segment's centroid over the rms displacement; empty
    /// as `position` is.
    pub offsets: Vec<f32>,
}

/// Cuts the mesh into `spec.count` segments. Collective; all ranks fail together.
///
/// `modes` is asked for modes where the method is made of them. `preset` gives the segment of each of this rank's cells
/// (0 to K - 1, none empty) instead of computing them; they are taken as they are, connected or not.
///
/// # Errors
/// [`Error::Input`] if K is 0 or larger than the number of cells or [`MAX_SEGMENTS`], if there are fewer modes than
/// asked for, if `spec` is out of range ([`SegmentSpec::check`]), if segments are to be connected and there are fewer
/// than components of the mesh, if a method needs an obstacle that the mesh does not have, or if a preset label is
/// out of range or missing; what the modes may fail with.
pub fn segment(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    modes: &dyn ModalSource,
    comm: &Comm,
    preset: Option<&[i32]>,
) -> Result<Segmentation> {
    let total = check(mesh, spec, comm)?;
    let any_preset = comm.any(preset.is_some());
    match preset {
        Some(labels) => {
            let cells = preset_labels(mesh, labels, spec.count, comm)?;
            overlap::complete(mesh, graph, spec, comm, cells)
        }
        None if any_preset => {
            comm.agree(Err(Error::Input("other ranks give preset segments, this one does not".into())))
        }
        None => {
            let modes = match needs_modes(spec, total) {
                true => {
                    let elastic = comm.agree(spec.is_elastic(mesh))?;
                    Some(modes.of_mesh(mesh, elastic, spec.modes, comm)?)
                }
                false => None,
            };
            compute(mesh, graph, spec, (modes.as_ref(), total), comm)
        }
    }
}

/// As [`segment`] without a preset, by `modes` that were computed before, of which all are features: many numbers of
/// segments and methods of one mesh need them once. Collective; all ranks fail together.
///
/// # Errors
/// As [`segment`].
pub fn segment_by_modes(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    modes: &Modes,
    comm: &Comm,
) -> Result<Segmentation> {
    let total = check(mesh, spec, comm)?;
    compute(mesh, graph, spec, (Some(modes), total), comm)
}

/// Whether there is something to refine by modes.
fn needs_modes(spec: &SegmentSpec, total: i64) -> bool {
    spec.method.uses_modes() && spec.count > 1 && (spec.count as i64) < total
}

/// Cells of all ranks, if the spec suits them. Collective.
fn check(mesh: &Mesh, spec: &SegmentSpec, comm: &Comm) -> Result<i64> {
    let total = comm.total(mesh.n_cells());
    if spec.count == 0 || spec.count as i64 > total {
        return Err(Error::Input(format!(
            "{} segments for {total} cells: expected 1 to {total}; set segments in the dictionary",
            spec.count
        )));
    }
    if spec.count > MAX_SEGMENTS {
        return Err(Error::Input(format!("{} segments: expected at most {MAX_SEGMENTS}", spec.count)));
    }
    spec.check()?;
    Ok(total)
}

/// METIS, SLIC where the method has it, connected pieces, overlap. Collective.
fn compute(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    (modes, total): (Option<&Modes>, i64),
    comm: &Comm,
) -> Result<Segmentation> {
    let (root, number) = Root::gather(mesh, graph, comm)?;
    let first = match &root {
        Some(root) => partition::partition(&root.graph, spec.count, spec.connected),
        None => Ok(Vec::new()),
    };
    let first = comm.agree(first)?;
    let by_metis = Root::hand_out(root.as_ref(), &first, 1, comm);
    let mut labels = by_metis.clone();
    let mut sweeps = Vec::new();
    if needs_modes(spec, total)
        && let Some(modes) = modes
    {
        (labels, sweeps) = slic::refine(mesh, spec, modes, comm, (&number, labels))?;
    }
    let mut reassigned = vec![0i64];
    if spec.connected {
        let mut all = Root::collect(root.as_ref(), &labels, comm).unwrap_or_default();
        if let Some(root) = &root {
            reassigned[0] = connect::connect(&root.graph, &mut all, spec.count) as i64;
        }
        labels = Root::hand_out(root.as_ref(), &all, 1, comm);
    }
    comm.broadcast(&mut reassigned);
    drop(root);
    let moved = comm.total(labels.iter().zip(&by_metis).filter(|(a, b)| a != b).count()) as usize;
    Ok(Segmentation {
        sweeps,
        moved,
        reassigned: reassigned[0] as usize,
        ..overlap::complete(mesh, graph, spec, comm, labels)?
    })
}

/// Labels that somebody computed before, checked.
fn preset_labels(mesh: &Mesh, labels: &[i32], count: usize, comm: &Comm) -> Result<Vec<i32>> {
    let local = || -> Result<()> {
        refuse(labels.len() != mesh.n_cells(), Error::Input, || {
            format!("{} segment labels for {} cells of rank {}", labels.len(), mesh.n_cells(), comm.rank())
        })?;
        refuse_any(labels.iter().position(|&l| l < 0 || l as usize >= count), Error::Input, |i| {
            let (rank, label, most) = (comm.rank(), labels[i], count - 1);
            format!("segment label of cell {i} on rank {rank} is {label}: expected 0 to {most}")
        })
    };
    // A rank without preset labels passes through agree as well.
    comm.agree(local())?;
    let mut sizes = vec![0i64; count];
    for &l in labels {
        sizes[l as usize] += 1;
    }
    comm.sum_i64(&mut sizes);
    refuse_any(sizes.iter().position(|&s| s == 0), Error::Input, |empty| {
        let most = count - 1;
        format!(
            "segment {empty} of {count} has no cell: expected labels 0 to {most} that all occur; recompute the segments"
        )
    })?;
    Ok(labels.to_vec())
}

impl Segmentation {
    /// Of a graph on one rank, by its members: segments of node i are `member[member_row[i]..member_row[i + 1]]`, at least
    /// one. How they touch is not known.
    pub fn of_members(count: usize, member_row: Vec<u32>, member: Vec<i32>) -> Self {
        let mut sizes = vec![0.0; count];
        member.iter().for_each(|&s| sizes[s as usize] += 1.0);
        let n = member_row.len().saturating_sub(1);
        Segmentation {
            count,
            node_segment: member_row[..n].iter().map(|&i| member[i as usize]).collect(),
            member_row,
            member,
            sizes,
            ..Segmentation::default()
        }
    }

    /// Random-walk structural encoding of the segments `[K x steps]`: the probability that a random walk over
    /// the eq. 10 graph is back where it started after 1 to `steps` steps.
    pub fn rwse(&self, steps: usize) -> Vec<f32> {
        walk::rwse(self.count, &self.adjacency, steps)
    }
}

#[cfg(test)]
mod tests;
