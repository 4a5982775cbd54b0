//! BSMS-GNN (Cao et al. 2023): message passing on the graph, on coarser ones down to the coarsest, and up again.

use super::{Processor, flops_of_features};
use crate::grid::Grid;
use crate::kernels::{Buffer, Number};
use crate::passing::{Edges, Layer, Topology};
use crate::pool::{Parts, Pool};
use crate::profile::Phase;
use crate::scale::Scale;
use crate::weights::Weights;
use m4gn_base::Result;
use m4gn_model::Model;
use m4gn_parallel::{Comm, Element, Halo};
use m4gn_structure::{Structure, Transfer};

/// The layers of a model on a graph and its coarser ones.
pub struct BiStride<T> {
    /// Down, on the coarsest graph, up.
    layers: Vec<Layer<T>>,
    /// Of the edges' features.
    edge_scale: Scale,
    /// Of the graph itself.
    finest: Floor<T>,
    coarser: Vec<Coarser<T>>,
}

/// What a layer needs of a graph, beside its grid.
pub struct Floor<T> {
    /// Normalised features of the edges, rows of the padded width.
    features: Buffer<T>,
    /// Ws h of all local nodes, ghosts included.
    projected: Buffer<T>,
    message: Vec<T>,
    /// h of all local nodes, for the next graph.
    latents: Buffer<f32>,
}

/// A coarser graph.
struct Coarser<T> {
    /// Threads are lent to it.
    grid: Grid<T>,
    floor: Floor<T>,
    down: Transfer,
    up: Transfer,
}

impl<T: Number + Element> BiStride<T> {
    /// The layers of a model.
    pub fn new(weights: &mut Weights, model: &Model, structure: &Structure, grid: &Grid<T>) -> Result<Self> {
        let architecture = &model.spec.architecture;
        let mut coarser: Vec<Coarser<T>> = Vec::new();
        for level in structure.levels_for(architecture.needs())? {
            let pool = Pool::new(1, grid.isa);
            let own = Grid::new(&level.graph, grid.columns, pool, Vec::new(), grid.timed);
            let finer = &coarser.last().map_or(grid, |c| &c.grid).order;
            let (places, finer_places) = (own.order.places(), finer.places());
            coarser.push(Coarser {
                down: level.down.placed(&own.order.node, &finer_places),
                up: level.up.placed(&finer.node, &places),
                floor: Floor::of_nodes(&own),
                grid: own,
            });
        }
        let layers = 0..architecture.layers();
        Ok(BiStride {
            layers: layers.map(|l| Layer::new(weights, architecture, l)).collect::<Result<_>>()?,
            finest: Floor::of_nodes(grid),
            edge_scale: Scale::of_model(model, "edge")?,
            coarser,
        })
    }

    /// All that is below a graph, and the layers on it: `layers` are those of it and of the coarser ones.
    fn cycle(
        comm: &Comm,
        grid: &mut Grid<T>,
        floor: &mut Floor<T>,
        coarser: &mut [Coarser<T>],
        layers: &[Layer<T>],
    ) {
        let [first, others @ ..] = layers else { return };
        floor.pass(comm, grid, first);
        let ([inner @ .., last], [next, rest @ ..]) = (others, coarser) else {
            return;
        };
        let columns = grid.columns;
        floor.share(comm, &mut grid.halo, &grid.nodes, columns);
        grid.hand_over(&mut next.grid);
        next.grid.take(&next.down, &floor.latents);
        Self::cycle(comm, &mut next.grid, &mut next.floor, rest, inner);
        next.floor.share(comm, &mut next.grid.halo, &next.grid.nodes, columns);
        grid.hand_over(&mut next.grid);
        grid.take(&next.up, &next.floor.latents);
        floor.pass(comm, grid, last);
        // The graph's own latents from before it was left.
        grid.nodes.iter_mut().zip(&floor.latents[..]).for_each(|(h, before)| *h += before);
    }
}

impl<T: Number + Element> Grid<T> {
    /// The latents as sums of other rows.
    fn take(&mut self, transfer: &Transfer, from: &[f32]) {
        let columns = self.columns;
        self.sweep_own(|s, tile, _, h| {
            s.clock.start();
            h.fill(0.0);
            transfer.add(tile.nodes.clone(), columns, from, h);
            s.clock.stop(Phase::Project);
        });
    }
}

impl<T: Number + Element> Floor<T> {
    /// Without edges.
    pub fn of_nodes(grid: &Grid<T>) -> Self {
        Floor {
            features: Buffer::new(0),
            projected: Buffer::new(grid.n_local * grid.columns),
            message: Vec::with_capacity(grid.halo.n_sent() * grid.columns),
            latents: Buffer::new(grid.n_local * grid.columns),
        }
    }

    /// Takes the features of edges in this order.
    pub fn take(&mut self, order: &[u32], of_edges: &[f32], scale: &Scale, columns: usize) {
        if self.features.len() != order.len() * columns {
            self.features = Buffer::new(order.len() * columns);
        }
        scale.normalise_rows(of_edges, order, columns, &mut self.features);
    }

    /// One layer with its halo exchange.
    pub fn pass(&mut self, comm: &Comm, grid: &mut Grid<T>, layer: &Layer<T>) {
        let columns = grid.columns;
        let own = &mut self.projected[..grid.n_owned * columns];
        grid.on_nodes(own, |s, _, h, out| layer.project(s, h, out));
        let features = Parts::new(&mut self.features);
        grid.sweep(comm, &mut self.projected, &mut self.message, |s, tile, order, projected, h| {
            // SAFETY: tiles are disjoint.
            let features = unsafe { features.rows(&tile.edges, columns) };
            let (senders, receivers) = (&order.senders[..], &order.receivers[..]);
            let graph = Topology { senders, receivers, sums: receivers, projected };
            let edges = Edges { before: None, now: features, keep: false };
            layer.sweep(&graph, tile, s, h, edges, None);
        });
    }

    /// Latents with those of the ghosts. Collective.
    fn share(&mut self, comm: &Comm, halo: &mut Halo, nodes: &[f32], columns: usize) {
        self.latents[..nodes.len()].copy_from_slice(nodes);
        halo.exchange_f32(comm, &mut self.latents, columns);
    }
}

impl<T: Number + Element> Processor<T> for BiStride<T> {
    fn place(&mut self, grid: &mut Grid<T>, structure: &Structure) {
        let (scale, columns) = (&self.edge_scale, grid.columns);
        self.finest.take(&grid.order.edge, &structure.graph.edge_features, scale, columns);
        for (Coarser { grid, floor, .. }, level) in self.coarser.iter_mut().zip(&structure.levels) {
            floor.take(&grid.order.edge, &level.graph.edge_features, scale, columns);
        }
    }

    fn reorder(&mut self, before: &[u32], node: &[u32]) {
        let Some(first) = self.coarser.first_mut() else { return };
        let old: Vec<u32> = node.iter().map(|&i| before[i as usize]).collect();
        let mut new = vec![0; old.len()];
        (0..).zip(&old).for_each(|(place, &old)| new[old as usize] = place);
        let rows: Vec<u32> = (0..first.grid.n_owned as u32).collect();
        first.down = first.down.placed(&rows, &new);
        first.up = first.up.placed(&old, &[]);
    }

    fn run(&mut self, comm: &Comm, grid: &mut Grid<T>) {
        Self::cycle(comm, grid, &mut self.finest, &mut self.coarser, &self.layers);
    }

    fn flops(&self, grid: &Grid<T>, model: &Model) -> Vec<(Phase, f64)> {
        let grids = std::iter::once(grid).chain(self.coarser.iter().map(|c| &c.grid)).enumerate();
        let sizes = grids.map(|(l, g)| {
            let layers = if l == self.coarser.len() { 1.0 } else { 2.0 };
            (layers * g.n_owned as f64, layers * g.order.senders.len() as f64)
        });
        let both = sizes.fold((0.0, 0.0), |sum, (n, e)| (sum.0 + n, sum.1 + e));
        flops_of_features(model, self.edge_scale.channels(), both)
    }
}
