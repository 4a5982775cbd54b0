//! What a network lives on.

use super::graph::Graph;
use super::levels::{Level, bi_stride};
use super::place::line;
use super::{Segmentation, Sequence, node_walk, segment};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_mesh::vector::Vector;
use m4gn_model::modal::ModalSource;
use m4gn_model::{ModelSpec, Needs, SegmentSpec};
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};

/// A graph, and what else networks may need of it ([`Needs`]). What a kind of network needs beyond that is another field here and another
/// of its needs; what takes a structure stays as it is.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Structure {
    /// This rank's part of the graph.
    pub graph: Graph,
    /// Segments of its nodes; none where the network needs none.
    pub segments: Option<Segmentation>,
    /// The order of the nodes within their segments; none where the network needs none.
    pub sequence: Option<Sequence>,
    /// Coarser graphs, the finest first; as many as the network needs.
    pub levels: Vec<Level>,
    /// Positional encoding of the nodes `[n_owned x node_rwse_steps]`; empty where the network needs none.
    pub walk: Vec<f32>,
    /// Numbers of the nodes in the order of their places, by which networks that choose among nodes do so where they are equal; empty
    /// where the network chooses none.
    #[serde(default)]
    pub place: Vec<u32>,
}

impl Structure {
    /// Of the cells of a mesh, for the network that `spec` describes. `settings` say how segments are cut, by the segment of each of
    /// this rank's cells if `labels` give it. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a mesh that no graph can be made of; [`Error::Model`] for a network that needs all nodes on one rank, where there
    /// are several; as [`segment`].
    pub fn new(
        mesh: &Mesh,
        spec: &ModelSpec,
        settings: &SegmentSpec,
        modes: &dyn ModalSource,
        labels: Option<&[i32]>,
        comm: &Comm,
    ) -> Result<Self> {
        Self::check_ranks(spec, comm)?;
        let needs = spec.architecture.needs();
        let mut graph = Graph::new(mesh, comm)?;
        let levels = bi_stride(mesh, &mut graph, needs.levels, comm)?;
        let segments = match needs.segments {
            true => {
                let mut segments = segment(mesh, &mut graph, settings, modes, comm, labels)?;
                segments.encode(spec, mesh, comm);
                Some(segments)
            }
            false => None,
        };
        let sequence = Self::sequence_of(segments.as_ref(), needs, mesh, comm)?;
        let walk = node_walk(mesh, needs.walk, comm)?;
        let place = Self::places(needs, mesh);
        Ok(Structure { graph, segments, sequence, levels, walk, place })
    }

    /// Numbers of the nodes of an undecomposed mesh, its cells and boundary faces, in the order of their places, for a network that needs
    /// them.
    pub fn places(needs: Needs, mesh: &Mesh) -> Vec<u32> {
        match needs.whole {
            true => {
                let places = node_places(mesh);
                let number: Vec<i64> = (0..places.len() as i64).collect();
                line(&places, &number).into_iter().map(|i| i as u32).collect()
            }
            false => Vec::new(),
        }
    }

    /// Of each node of a graph on one rank which part it is of, 0, and its number in the order of places.
    pub fn choice(&self) -> Vec<[u32; 2]> {
        let by_number = self.place.len() != self.graph.n_owned;
        let place = |i: usize| if by_number { i as u32 } else { self.place[i] };
        (0..self.graph.n_owned).map(|i| [0, place(i)]).collect()
    }

    /// Whether the network that `spec` describes can be on so many ranks.
    ///
    /// # Errors
    /// [`Error::Model`] for one that needs all nodes on one.
    pub fn check_ranks(spec: &ModelSpec, comm: &Comm) -> Result<()> {
        match spec.architecture.needs().whole && comm.size() > 1 {
            true => Err(Error::Model(format!(
                "kind {}: its coarser graphs are made of the scores of all nodes, in each step, on one rank; found {}: run the solver in \
                 serial, or train another kind",
                spec.architecture.name().name(),
                comm.size()
            ))),
            false => Ok(()),
        }
    }

    /// The order of the nodes of a mesh, its cells and boundary faces, within their segments, for a network that needs it. Collective;
    /// all ranks fail together.
    ///
    /// # Errors
    /// As [`Sequence::new`].
    pub fn sequence_of(
        segments: Option<&Segmentation>,
        needs: Needs,
        mesh: &Mesh,
        comm: &Comm,
    ) -> Result<Option<Sequence>> {
        let Some(segments) = segments.filter(|_| needs.sequences) else { return Ok(None) };
        Sequence::new(segments, &node_places(mesh), comm).map(Some)
    }

    /// The order of the nodes within their segments, for a network that needs it; none for one that does not.
    ///
    /// # Errors
    /// [`Error::Model`] where it is needed and not there, or of other segments.
    pub fn sequence_for(&self, needs: Needs) -> Result<Option<&Sequence>> {
        let fits = |s: &&Sequence| {
            let known = self.graph.n_owned + s.halo.n_ghosts();
            s.row.len() == self.n_segments() + 1
                && s.row.windows(2).all(|w| w[0] <= w[1])
                && s.row.last().is_some_and(|&n| n as usize == s.node.len())
                && s.node.iter().all(|&i| usize::try_from(i).is_ok_and(|i| i < known))
        };
        match (needs.sequences, self.sequence.as_ref().filter(fits)) {
            (true, None) => Err(Error::Model(
                "the model needs the order of the nodes in their segments, none was given".into(),
            )),
            (true, sequence) => Ok(sequence),
            (false, _) => Ok(None),
        }
    }

    /// The positional encoding of the nodes, as far as a network needs it.
    ///
    /// # Errors
    /// [`Error::Model`] for one of other nodes, or of another number of steps.
    pub fn walk_for(&self, needs: Needs) -> Result<&[f32]> {
        let expected = self.graph.n_owned * needs.walk;
        match needs.walk {
            0 => Ok(&[]),
            _ if self.walk.len() == expected => Ok(&self.walk),
            steps => Err(Error::Model(format!(
                "the model needs {steps} random-walk steps of each of {} nodes, {expected} numbers; {} were given",
                self.graph.n_owned,
                self.walk.len()
            ))),
        }
    }

    /// The coarser graphs that a network needs.
    ///
    /// # Errors
    /// [`Error::Model`] where there are not so many.
    pub fn levels_for(&self, needs: Needs) -> Result<&[Level]> {
        self.levels.get(..needs.levels).ok_or_else(|| {
            let (needed, found) = (needs.levels, self.levels.len());
            Error::Model(format!("the model needs {needed} coarser graphs, {found} were given"))
        })
    }

    /// The segments, for a network that needs them; none for one that does not.
    ///
    /// # Errors
    /// [`Error::Model`] for segments that are needed and not there.
    pub fn segments_for(&self, needs: Needs) -> Result<Option<&Segmentation>> {
        match (needs.segments, &self.segments) {
            (true, None) => Err(Error::Model("the model needs segments, none were given".into())),
            (true, segments) => Ok(segments.as_ref()),
            (false, _) => Ok(None),
        }
    }

    /// Segments, 0 without them.
    pub fn n_segments(&self) -> usize {
        self.segments.as_ref().map_or(0, |s| s.count)
    }

    /// The graph and its coarser ones alone, for who gives them other edges.
    pub fn graphs(&self) -> Self {
        let place = self.place.clone();
        Structure { place, ..Structure::of_graphs(self.graph.clone(), self.levels.clone()) }
    }

    /// Of a graph and coarser ones, without segments.
    pub fn of_graphs(graph: Graph, levels: Vec<Level>) -> Self {
        Structure { graph, levels, segments: None, sequence: None, walk: Vec::new(), place: Vec::new() }
    }

    /// Reflected in the second direction, as the network that `spec` describes reads it: of edges that stay, in cells.
    pub fn reflected(&self, spec: &ModelSpec) -> Self {
        let mut reflected = self.clone();
        let graphs =
            std::iter::once(&mut reflected.graph).chain(reflected.levels.iter_mut().map(|l| &mut l.graph));
        graphs.for_each(|graph| negate(&mut graph.edge_features, spec.n_edge_features(), 1));
        reflected.reflect_segments(spec);
        reflected
    }

    /// As [`Structure::reflected`], of the segments alone.
    pub fn reflect_segments(&mut self, spec: &ModelSpec) {
        let (Some(segments), Some(stage)) = (&mut self.segments, spec.architecture.segment_transformer())
        else {
            return;
        };
        if stage.offsets {
            negate(&mut segments.offsets, spec.n_offset_features(), 1);
        }
        if stage.centroids {
            let width = spec.n_position_features();
            negate(&mut segments.position, width, stage.rwse_steps + 1);
        }
    }
}

/// Where this rank's cells and boundary faces are, m.
fn node_places(mesh: &Mesh) -> Vec<Vector> {
    mesh.cell_centres.iter().copied().chain(mesh.boundary.iter().map(|b| b.centre)).collect()
}

/// Changes the sign of a column of rows of `width` numbers.
fn negate(values: &mut [f32], width: usize, column: usize) {
    let column = values.iter_mut().skip(column).step_by(width.max(1));
    column.for_each(|v| *v = -*v);
}
