//! Graph convolutions (Kipf & Welling 2016), forward with what is kept, and backward.

use super::Scales;
use super::graph::TrainGraph;
use super::network::Buffers;
use super::processor::Processor;
use crate::activations::Activated;
use crate::kernels::{
    Buffer, Function, Isa, Number, activation_backward, gather_add, narrow, padded, scatter_add,
};
use crate::processor::{scale_rows, scales as scales_of, sum_neighbours};
use crate::tiles::numbers;
use crate::weights::{Gradients, Linear, Weights};
use m4gn_base::Result;
use m4gn_model::ModelSpec;

/// The convolutions of a model.
pub struct Convolutions<T> {
    isa: Isa,
    columns: usize,
    function: Function,
    layers: Vec<Linear<T>>,
}

/// What the convolutions keep.
pub struct ConvolutionsTape<T> {
    layers: Vec<Layer<T>>,
    /// 1 / sqrt(1 + received edges) of the nodes.
    scale: Vec<f32>,
    /// Latents times their scale; backward, derivatives by these.
    scaled: Buffer<f32>,
}

/// What one of them keeps, a row a node.
struct Layer<T> {
    /// What the weight is applied to.
    sums: Buffer<T>,
    value: Activated<T>,
}

impl<T: Number> Processor<T> for Convolutions<T> {
    type Tape = ConvolutionsTape<T>;

    fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        let isa = weights.isa;
        let layer = |l: usize| Linear::new(weights, &format!("processor.{l}.convolution"));
        Ok(Convolutions {
            isa,
            columns: padded(a.width),
            function: a.activation.into(),
            layers: (0..a.layers()).map(layer).collect::<Result<_>>()?,
        })
    }

    fn tape(&self) -> ConvolutionsTape<T> {
        let layer = |_| Layer { sums: Buffer::default(), value: Activated::new(self.function) };
        ConvolutionsTape {
            layers: self.layers.iter().map(layer).collect(),
            scale: Vec::new(),
            scaled: Buffer::default(),
        }
    }

    fn passed(&self, graph: &TrainGraph, _: &ConvolutionsTape<T>) -> [usize; 2] {
        [self.layers.len() * graph.n_nodes(), 0]
    }

    fn forward(&self, graph: &TrainGraph, _: &Scales, tape: &mut ConvolutionsTape<T>, work: &mut Buffers<T>) {
        let (isa, columns, order) = (self.isa, self.columns, &graph.order);
        let size = graph.n_nodes() * columns;
        let ConvolutionsTape { layers, scale, scaled } = tape;
        let tiles = graph.tiles::<T>();
        *scale = scales_of(&order.row);
        scaled.fit(size);
        let work_rows = &mut work.shared.work;
        for (layer, kept) in self.layers.iter().zip(layers) {
            kept.sums.fit(size);
            kept.value.fit(size);
            scaled[..size].copy_from_slice(&work.latents[..size]);
            scale_rows(&mut scaled[..size], columns, scale);
            for tile in &tiles {
                let own = numbers(&tile.nodes, columns);
                let sums = &mut work.latents[own.clone()];
                sum_neighbours::<T>(isa, (tile, order), (scaled, scale), &mut work_rows.wide, sums);
                narrow(isa, sums, &mut kept.sums[own.clone()]);
                let (x, place) = ((&kept.sums[own.clone()], columns), kept.value.place(own.clone()));
                place.fill(&layer.weight, x, tile.nodes.len(), layer.bias(), &mut work_rows.wide);
                let values = sums.iter_mut().zip(&kept.value.value[own]);
                values.for_each(|(h, value)| *h = value.to_f32());
            }
        }
    }

    fn backward(
        &self,
        graph: &TrainGraph,
        _: &Scales,
        tape: &mut ConvolutionsTape<T>,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
        edges: Option<&mut [Vec<f32>]>,
    ) {
        let (isa, columns, order) = (self.isa, self.columns, &graph.order);
        let size = graph.n_nodes() * columns;
        let ConvolutionsTape { layers, scale, scaled } = tape;
        let tiles = graph.tiles::<T>();
        let rows_at_a_time = &mut work.shared.work;
        for (layer, kept) in self.layers.iter().zip(layers).rev() {
            scaled[..size].fill(0.0);
            for tile in &tiles {
                let (n, first) = (tile.nodes.len(), tile.nodes.start);
                let own = numbers(&tile.nodes, columns);
                let d = &mut work.d_nodes[own.clone()];
                let dy = &mut rows_at_a_time.narrow[..n * columns];
                let sum = gradients.block(layer.bias.slot);
                activation_backward(isa, kept.value.saved(own.clone()), (n, columns), d, dy, sum);
                let (dy, x) = ((&*dy, columns), (&kept.sums[own.clone()], columns));
                layer.weight.learn(dy, x, n, gradients, &mut rows_at_a_time.pairs);
                layer.weight.back(dy, n, d);
                scale_rows(d, columns, &scale[tile.nodes.clone()]);
                let sums = scaled[own].iter_mut().zip(&*d);
                sums.for_each(|(sum, d)| *sum += d);
                for chunk in tile.chunks::<T>() {
                    let rows = &mut rows_at_a_time.wide[..chunk.len() * columns];
                    rows.fill(0.0);
                    let receivers = &order.receivers[chunk.clone()];
                    gather_add(isa, rows, columns, d, receivers, first);
                    scatter_add(isa, rows, columns, &mut scaled[..size], &order.senders[chunk], 0);
                }
            }
            work.d_nodes[..size].copy_from_slice(&scaled[..size]);
            scale_rows(&mut work.d_nodes[..size], columns, scale);
        }
        edges.into_iter().flatten().for_each(|e| e.fill(0.0));
    }
}
