//! Graph convolutions (Kipf & Welling 2016): h <- f(W a + b), where a is the sum over a node's neighbours and the node
//! itself of `h_s / sqrt((1 + n_s) (1 + n_r))`, n being the number of edges that a node receives.

use super::Processor;
use crate::grid::Grid;
use crate::kernels::{Buffer, Function, Isa, Number, Output, gather_add, narrow, scatter_add};
use crate::order::Order;
use crate::profile::Phase;
use crate::tiles::{Tile, numbers};
use crate::weights::{Linear, Weights};
use m4gn_base::Result;
use m4gn_model::Model;
use m4gn_parallel::{Comm, Element};
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;

/// The convolutions of a model on a graph.
pub struct Convolutions<T> {
    layers: Vec<Linear<T>>,
    function: Function,
    /// 1 / sqrt(1 + received edges) of the nodes, by place.
    scale: Vec<f32>,
    /// Latents times the scale of their node, of all local nodes.
    scaled: Buffer<f32>,
    message: Vec<f32>,
}

/// 1 / sqrt(1 + n) of the nodes that receive edges `row[i]..row[i + 1]`.
pub fn scales(row: &[u32]) -> Vec<f32> {
    let edges = row.windows(2).map(|w| w[1] - w[0]);
    edges.map(|n| (1.0 / (1.0 + f64::from(n)).sqrt()) as f32).collect()
}

/// Multiplies rows by a number each.
pub fn scale_rows(rows: &mut [f32], columns: usize, scale: &[f32]) {
    for (row, scale) in rows.chunks_exact_mut(columns).zip(scale) {
        row.iter_mut().for_each(|x| *x *= scale);
    }
}

/// a of a tile's nodes, from all latents times their scale; `rows` has room for some edges.
pub fn sum_neighbours<T: Number>(
    isa: Isa,
    (tile, order): (&Tile, &Order),
    (scaled, scale): (&[f32], &[f32]),
    rows: &mut [f32],
    sums: &mut [f32],
) {
    let (columns, first) = (sums.len() / tile.nodes.len(), tile.nodes.start);
    sums.copy_from_slice(&scaled[numbers(&tile.nodes, columns)]);
    for chunk in tile.chunks::<T>() {
        let rows = &mut rows[..chunk.len() * columns];
        rows.fill(0.0);
        gather_add(isa, rows, columns, scaled, &order.senders[chunk.clone()], 0);
        scatter_add(isa, rows, columns, sums, &order.receivers[chunk], first);
    }
    scale_rows(sums, columns, &scale[tile.nodes.clone()]);
}

impl<T: Number> Convolutions<T> {
    /// The layers of a model.
    pub fn new(
        weights: &mut Weights,
        model: &Model,
        graph: &Graph,
        grid: &Grid<T>,
        layers: usize,
    ) -> Result<Self> {
        Ok(Convolutions {
            layers: (0..layers)
                .map(|l| Linear::new(weights, &format!("processor.{l}.convolution")))
                .collect::<Result<_>>()?,
            function: model.spec.architecture.activation.into(),
            scale: Vec::new(),
            scaled: Buffer::new(grid.n_local * grid.columns),
            message: Vec::with_capacity(graph.halo.n_sent() * grid.columns),
        })
    }
}

impl<T: Number + Element> Processor<T> for Convolutions<T> {
    fn place(&mut self, grid: &mut Grid<T>, _: &Structure) {
        self.scale = scales(&grid.order.row);
    }

    fn run(&mut self, comm: &Comm, grid: &mut Grid<T>) {
        let (isa, columns, scale) = (grid.isa, grid.columns, &self.scale);
        for layer in &self.layers {
            let own = &mut self.scaled[..grid.n_owned * columns];
            grid.on_nodes(own, |s, tile, h, out| {
                s.clock.start();
                let rows = out.chunks_exact_mut(columns).zip(h.chunks_exact(columns));
                for ((out, h), scale) in rows.zip(&scale[tile.nodes.clone()]) {
                    out.iter_mut().zip(h).for_each(|(out, h)| *out = h * scale);
                }
                s.clock.stop(Phase::Project);
            });
            let message = &mut self.message;
            grid.sweep(comm, &mut self.scaled, message, |s, tile, order, scaled, h| {
                s.clock.start();
                let n = tile.nodes.len();
                let sums = &mut s.sums[..n * columns];
                sum_neighbours::<T>(isa, (tile, order), (scaled, scale), &mut s.c, sums);
                s.clock.stop(Phase::Edges);
                narrow(isa, sums, &mut s.a[..n * columns]);
                layer.run((&s.a, columns), n, self.function, Output::Wide(h));
                s.clock.stop(Phase::Nodes);
            });
        }
    }

    fn flops(&self, grid: &Grid<T>, model: &Model) -> Vec<(Phase, f64)> {
        let d = model.spec.architecture.width as f64;
        let (n, layers) = (grid.n_owned as f64, self.layers.len() as f64);
        vec![(Phase::Nodes, 2.0 * layers * n * d * d)]
    }
}
