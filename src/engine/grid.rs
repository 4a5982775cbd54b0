//! A graph in the engine's order, and what passes over its tiles share.

use super::kernels::{Buffer, Isa, Number};
use super::order::Order;
use super::pool::{Parts, Pool};
use super::profile::Phase;
use super::tiles::{self, Scratch, Tile};
use m4gn_parallel::{Comm, Element, Halo};
use m4gn_structure::graph::Graph;
use std::time::Instant;

/// The nodes' latents on the tiles of a graph, and who works on them.
pub struct Grid<T> {
    pub isa: Isa,
    /// The width, padded to whole vectors.
    pub columns: usize,
    pub n_owned: usize,
    /// Owned nodes and ghosts.
    pub n_local: usize,
    pub order: Order,
    pub halo: Halo,
    pub tiles: Vec<Tile>,
    /// Tiles before this one do not wait for other ranks.
    pub n_interior: usize,
    pub pool: Pool,
    pub scratch: Vec<Scratch<T>>,
    /// h
    pub nodes: Buffer<f32>,
    /// Whether phases are timed.
    pub timed: bool,
}

impl<T: Number> Grid<T> {
    /// Of a graph, with the buffers of each thread of the pool.
    pub fn new(graph: &Graph, columns: usize, pool: Pool, scratch: Vec<Scratch<T>>, timed: bool) -> Self {
        let order = Order::new(graph);
        let mut grid = Grid {
            isa: pool.isa(),
            columns,
            n_owned: graph.n_owned,
            n_local: graph.n_local,
            halo: graph.halo.renumbered(&order.places()),
            order,
            tiles: Vec::new(),
            n_interior: 0,
            pool,
            scratch,
            nodes: Buffer::new(graph.n_owned * columns),
            timed,
        };
        grid.cut();
        grid
    }

    /// The tiles of its order.
    pub fn cut(&mut self) {
        self.tiles = tiles::cut::<T>(&self.order.row, self.order.n_interior);
        let interior = |t: &&Tile| t.nodes.end <= self.order.n_interior;
        self.n_interior = self.tiles.iter().take_while(interior).count();
    }

    /// Gives the threads and their buffers to another grid, or takes them back.
    pub fn hand_over(&mut self, other: &mut Self) {
        std::mem::swap(&mut self.pool, &mut other.pool);
        std::mem::swap(&mut self.scratch, &mut other.scratch);
    }

    /// Does `work` for the nodes of each tile: what it gets are their latents, and their rows of `values`.
    pub fn on_nodes<V: Send>(
        &mut self,
        values: &mut [V],
        work: impl Fn(&mut Scratch<T>, &Tile, &[f32], &mut [V]) + Sync,
    ) {
        let (columns, tiles, nodes) = (self.columns, &self.tiles, &self.nodes);
        let values = Parts::new(values);
        let task = |s: &mut Scratch<T>, i: usize| {
            let rows = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let values = unsafe { values.rows(rows, columns) };
            work(s, &tiles[i], &nodes[rows.start * columns..rows.end * columns], values);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// As [`Grid::sweep`], of values that no ghosts have.
    pub fn sweep_own(&mut self, sweep: impl Fn(&mut Scratch<T>, &Tile, &Order, &mut [f32]) + Sync) {
        let (columns, order, tiles) = (self.columns, &self.order, &self.tiles);
        let nodes = Parts::new(&mut self.nodes);
        let task = |s: &mut Scratch<T>, i: usize| {
            // SAFETY: tiles are disjoint.
            sweep(s, &tiles[i], order, unsafe { nodes.rows(&tiles[i].nodes, columns) });
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// Fetches the ghosts' rows of `values` `[n_local x columns]` while the tiles that do not wait for them are swept, then
    /// sweeps the others: `sweep` gets the order, the values and the latents of its tile, to change them. Collective.
    pub fn sweep<V: Element + Send + Sync>(
        &mut self,
        comm: &Comm,
        values: &mut [V],
        message: &mut Vec<V>,
        sweep: impl Fn(&mut Scratch<T>, &Tile, &Order, &[V], &mut [f32]) + Sync,
    ) {
        let (columns, order) = (self.columns, &self.order);
        let (pool, scratch) = (&self.pool, &mut self.scratch);
        let nodes = Parts::new(&mut self.nodes);
        let sweep = |values: &[V], tile: &Tile, s: &mut Scratch<T>| {
            // SAFETY: tiles are disjoint.
            sweep(s, tile, order, values, unsafe { nodes.rows(&tile.nodes, columns) });
        };
        let (interior, rest) = self.tiles.split_at(self.n_interior);
        let start = self.timed.then(Instant::now);
        let mut busy = 0.0;
        self.halo.exchange_during(comm, values, columns, message, |values, progress| {
            let start = start.map(|_| Instant::now());
            pool.run(scratch, interior.len(), |s, i| sweep(values, &interior[i], s), progress);
            busy = start.map_or(0.0, |s| s.elapsed().as_secs_f64());
        });
        if let (Some(start), Some(own)) = (start, scratch.first_mut()) {
            own.clock.phases[Phase::Halo as usize] += start.elapsed().as_secs_f64() - busy;
        }
        let values = &*values;
        pool.run(scratch, rest.len(), |s, i| sweep(values, &rest[i], s), || ());
    }
}
