//! A graph as the backward pass reads it: in the engine's order, with its segments.

use crate::check as check_graph;
use crate::kernels::Number;
use crate::members::Members;
use crate::order::Order;
use crate::recurrence::{Together, together};
use crate::tiles::{self, Tile};
use m4gn_base::{Error, Result};
use m4gn_model::{Model, ModelSpec};
use m4gn_structure::{Structure, Transfer};

/// Segments of the nodes, and what a network reads of them.
#[derive(Clone, Debug)]
pub struct Segments {
    pub members: Members,
    /// Nodes as a recurrence reads them, by place; empty where the network has none.
    pub together: Vec<Together>,
    /// Positional encoding `[K x n_position_features]`.
    pub position: Vec<f32>,
}

/// A coarser graph.
#[derive(Clone, Debug)]
pub struct Coarser {
    pub order: Order,
    /// Physical, a row an edge of the graph.
    pub edge_features: Vec<f32>,
    /// From the finer graph's nodes to this one's, by place; also the derivative of `up`.
    pub down: Transfer,
    /// The transpose.
    pub up: Transfer,
}

/// One serial graph, its node features that do not change, and its segments.
#[derive(Clone, Debug)]
pub struct TrainGraph {
    pub(super) order: Order,
    /// Place and number of each cell, by place.
    pub(super) cells: Vec<(u32, u32)>,
    /// Features that do not change with time, a row a node of the graph.
    pub(super) fixed: Vec<f32>,
    /// Physical, a row an edge of the graph.
    pub(super) edge_features: Vec<f32>,
    pub(super) segments: Option<Segments>,
    /// The finest first.
    pub(super) coarser: Vec<Coarser>,
    /// Positional encoding of the nodes, a row a place.
    pub(super) walk: Vec<f32>,
    /// By what nodes are chosen beside their scores ([`Structure::choice`]).
    pub(super) choice: Vec<[u32; 2]>,
}

impl TrainGraph {
    /// Of a structure on one rank.
    ///
    /// # Errors
    /// [`Error::Model`] for a graph that the model does not know: directions, node types, segments, coarser graphs.
    pub fn new(spec: &ModelSpec, structure: &Structure) -> Result<Self> {
        let graph = &structure.graph;
        check_graph(&Model { spec: spec.clone(), tensors: Default::default() }, graph)?;
        if graph.n_local != graph.n_owned {
            return Err(Error::Internal("a graph that is learned from stands on one rank".into()));
        }
        let order = Order::new(graph);
        let (width, n_offsets) = (spec.n_static_features(), spec.n_offset_features());
        let mut fixed = vec![0.0; graph.n_owned * width];
        for (node, row) in fixed.chunks_exact_mut(width).enumerate() {
            row[spec.place_of_type(graph.node_types[node])?] = 1.0;
        }
        let segments = match structure.segments_for(spec.architecture.needs())? {
            None => None,
            Some(view) => {
                let members = Members::new(view, spec, &order.node)?;
                for (row, offset) in
                    fixed.chunks_exact_mut(width).zip(view.offsets.chunks_exact(n_offsets.max(1)))
                {
                    row[width - n_offsets..].copy_from_slice(&offset[..n_offsets]);
                }
                let sequence = structure.sequence_for(spec.architecture.needs())?;
                Some(Segments {
                    members,
                    together: sequence.map_or(Vec::new(), |s| together(s, &order.places())),
                    position: view.position.clone(),
                })
            }
        };
        let mut coarser: Vec<Coarser> = Vec::new();
        for level in structure.levels_for(spec.architecture.needs())? {
            let (own, finer) = (Order::new(&level.graph), coarser.last().map_or(&order, |c| &c.order));
            coarser.push(Coarser {
                down: level.down.placed(&own.node, &finer.places()),
                up: level.up.placed(&finer.node, &own.places()),
                edge_features: level.graph.edge_features.clone(),
                order: own,
            });
        }
        let (walk, steps) = (structure.walk_for(spec.architecture.needs())?, spec.architecture.needs().walk);
        let rows = order.node.iter().flat_map(|&i| &walk[i as usize * steps..][..steps]);
        let walk = rows.copied().collect();
        let numbered = (0..).zip(&order.node).map(|(p, &i)| (p, i));
        Ok(TrainGraph {
            cells: numbered.filter(|(_, i)| (*i as usize) < graph.n_cells).collect(),
            order,
            fixed,
            edge_features: graph.edge_features.clone(),
            segments,
            coarser,
            walk,
            choice: if spec.architecture.needs().whole { structure.choice() } else { Vec::new() },
        })
    }

    /// The same nodes with other edges, and coarser graphs with other features of theirs: those of a structure that changes with time.
    pub fn with_edges(&self, structure: &Structure) -> Self {
        let mut moved = self.clone();
        // On one rank no node waits for ghosts, so that the order of the nodes stays.
        moved.order = Order::of(&structure.graph, &self.order.search);
        moved.edge_features.clone_from(&structure.graph.edge_features);
        for (coarser, level) in moved.coarser.iter_mut().zip(&structure.levels) {
            coarser.edge_features.clone_from(&level.graph.edge_features);
        }
        moved
    }

    /// The nodes in tiles for this kind of number.
    pub(super) fn tiles<T: Number>(&self) -> Vec<Tile> {
        tiles::cut::<T>(&self.order.row, self.order.n_interior)
    }

    /// Nodes.
    pub fn n_nodes(&self) -> usize {
        self.order.node.len()
    }

    /// Cells, or points of a body.
    pub fn n_cells(&self) -> usize {
        self.cells.len()
    }

    /// Directed edges.
    pub fn n_edges(&self) -> usize {
        self.order.senders.len()
    }

    /// Physical features, a row an edge of the graph.
    pub fn edge_features(&self) -> &[f32] {
        &self.edge_features
    }

    /// Zeros for the derivatives by the features of the graph's edges, and by those of each coarser one.
    pub fn no_edge_gradient(&self) -> Vec<Vec<f32>> {
        let all = std::iter::once(&self.edge_features).chain(self.coarser.iter().map(|c| &c.edge_features));
        all.map(|features| vec![0.0; features.len()]).collect()
    }

    /// Sender and receiver of each edge, by the graph's numbers.
    pub(super) fn ends(&self) -> (Vec<i32>, Vec<i32>) {
        let order = &self.order;
        let (mut senders, mut receivers) = (vec![0; self.n_edges()], vec![0; self.n_edges()]);
        for (&edge, (&s, &r)) in order.edge.iter().zip(order.senders.iter().zip(&order.receivers)) {
            let number = |place: i32| order.node[place as usize] as i32;
            (senders[edge as usize], receivers[edge as usize]) = (number(s), number(r));
        }
        (senders, receivers)
    }

    /// Segments, 0 without a macro stage.
    pub fn n_segments(&self) -> usize {
        self.segments.as_ref().map_or(0, |s| s.members.count)
    }
}
