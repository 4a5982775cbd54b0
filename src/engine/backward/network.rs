//! The whole network in one precision: forward with what is kept, and backward.

use super::dispatch::through_table;
use super::encoder_decoder::EncoderTape;
use super::graph::TrainGraph;
use super::layer::Shared;
use super::mlp::Work;
use super::processor::Processor;
use super::{InputGradient, Scales, Trainable, Worker};
use crate::encoder_decoder::{Decoder, DecoderTape, Encoder};
use crate::kernels::{Addend, Buffer, Function, Isa, Normed, Number, Output, Tiles, padded};
use crate::layout::Layout;
use crate::perceptron::{Perceptron, PerceptronTape};
use crate::tiles::blocks;
use crate::tiles::numbers;
use crate::weights::{Gradients, Places, Weights};
use m4gn_base::Result;
use m4gn_model::{Activation, ModelSpec};

/// Weights, shared by all threads; `P` is what stands between the encoder of the nodes and the decoder.
pub struct Network<T, P> {
    isa: Isa,
    spec: ModelSpec,
    columns: usize,
    layout: Layout,
    places: Places,
    nodes: Encoder<T>,
    /// f_np (section 3.4.1), which adds to the nodes' features.
    position: Option<Perceptron>,
    processor: P,
    decoder: Decoder<T>,
}

/// What one application of the network keeps for its backward pass.
pub struct Tape<T, K> {
    nodes: EncoderTape<T>,
    position: PerceptronTape,
    processor: K,
    decoder: DecoderTape<T>,
}

/// What the parts of a network work on, of one thread.
pub struct Buffers<T> {
    pub shared: Shared<T>,
    pub fp32: Work<f32>,
    /// h
    pub latents: Buffer<f32>,
    pub d_nodes: Buffer<f32>,
    pub d_edges: Buffer<f32>,
    /// A row a segment: what h_S contributes to a linear layer.
    pub table: Buffer<f32>,
    pub d_table: Buffer<f32>,
    pub d_segments: Buffer<f32>,
    /// Derivatives by the features of some rows.
    pub d_features: Buffer<f32>,
}

/// One thread's buffers and sums.
pub struct Thread<T, K> {
    work: Buffers<T>,
    gradients: Gradients,
    /// What the applications of an unrolled example keep.
    tapes: Vec<Tape<T, K>>,
}

impl<T: Number, P: Processor<T>> Network<T, P> {
    /// Of a model's shape, with the weights of a flat vector.
    pub fn new(spec: &ModelSpec, isa: Isa, flat: &[f32]) -> Result<Self> {
        spec.check()?;
        let layout = Layout::new(spec);
        let mut all = Weights::trained(isa, &layout, flat);
        let weights = &mut all;
        let a = &spec.architecture;
        Ok(Network {
            isa,
            spec: spec.clone(),
            columns: padded(a.width),
            nodes: Encoder::new(weights, "encoder.node", spec.n_node_features(), a)?,
            position: match a.micro.node_rwse_steps {
                0 => None,
                steps => Some(Perceptron::new(weights, "encoder.position", steps, a)?),
            },
            processor: P::new(weights, spec)?,
            decoder: Decoder::new(weights, spec)?,
            places: all.places(),
            layout,
        })
    }

    fn of<'a>(&self, worker: &'a mut Worker) -> &'a mut Thread<T, P::Tape> {
        match worker.0.downcast_mut() {
            Some(thread) => thread,
            None => unreachable!("a worker of another network"),
        }
    }
}

impl<T: Number, P: Processor<T>> Trainable for Network<T, P> {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn load(&mut self, flat: &[f32]) -> Result<()> {
        *self = Network::new(&self.spec, self.isa, flat)?;
        Ok(())
    }

    fn worker(&self) -> Worker {
        let a = &self.spec.architecture;
        let ffn = a.segment_transformer().map_or(0, |m| m.ffn_width);
        let features =
            self.spec.n_node_features().max(self.spec.n_edge_features()).max(a.micro.node_rwse_steps);
        let position = self.spec.n_position_features().max(self.spec.n_outputs());
        let gates = if a.needs().sequences { 3 * a.width } else { 0 };
        let widest = padded(ffn.max(gates).max(features).max(position).max(a.width));
        Worker(Box::new(Thread::<T, P::Tape> {
            work: Buffers {
                shared: Shared::new(widest, self.columns, a.edge_kinds(), self.spec.n_outputs()),
                fp32: Work::new(widest),
                latents: Buffer::default(),
                d_nodes: Buffer::default(),
                d_edges: Buffer::default(),
                table: Buffer::default(),
                d_table: Buffer::default(),
                d_segments: Buffer::default(),
                d_features: Buffer::new(super::mlp::ROWS * padded(features)),
            },
            gradients: self.places.gradients(),
            tapes: Vec::new(),
        }))
    }

    fn flush(&self, worker: &mut Worker, flat: &mut [f32]) {
        self.places.flush(&mut self.of(worker).gradients, flat);
    }

    fn forward(
        &self,
        worker: &mut Worker,
        at: usize,
        graph: &TrainGraph,
        scales: &Scales,
        inputs: &[f32],
        outputs: &mut [f32],
    ) {
        let (columns, n_nodes) = (self.columns, graph.n_nodes());
        let _tiles = Tiles::new(self.isa);
        let Thread { work, tapes, .. } = self.of(worker);
        while tapes.len() <= at {
            tapes.push(Tape {
                nodes: EncoderTape::new(&self.nodes),
                position: PerceptronTape::default(),
                processor: self.processor.tape(),
                decoder: DecoderTape::new(&self.decoder),
            });
        }
        let tape = &mut tapes[at];
        tape.nodes.fit(n_nodes, &self.nodes);
        tape.decoder.fit(graph.n_cells(), columns);
        work.shared.fit(n_nodes, columns);
        work.latents.fit(n_nodes * columns);

        let k = self.spec.n_field_inputs();
        let width = self.spec.n_static_features();
        let rows = tape.nodes.features.chunks_exact_mut(self.nodes.stride);
        for (to, &node) in rows.zip(&graph.order.node) {
            let node = node as usize;
            scales.node.normalise(&inputs[node * k..(node + 1) * k], to);
            to[k..k + width].copy_from_slice(&graph.fixed[node * width..(node + 1) * width]);
        }
        if let Some(position) = &self.position {
            let wide = &mut work.fp32.wide;
            position.forward(&graph.walk, &mut tape.position, wide, &mut tape.nodes.features);
        }
        let wide = &mut work.shared.work.wide;
        for rows in blocks::<T>(n_nodes) {
            let out = &mut work.latents[numbers(&rows, columns)];
            self.nodes.forward(&mut tape.nodes, &rows, wide, Normed::Wide(out));
        }
        self.processor.forward(graph, scales, &mut tape.processor, work);
        if let (Some(weight), Some(stage)) = (&self.decoder.segment, P::segments(&tape.processor)) {
            let k = graph.n_segments();
            work.table.fit(k * columns);
            let out = Output::Wide(&mut work.table[..]);
            weight.run((stage, columns), k, Addend::Nothing, Function::Identity, out);
        }
        let from = (&work.latents[..], &work.table[..]);
        self.decoder.forward(graph, &mut tape.decoder, &mut work.shared.scratch, from, outputs);
    }

    fn backward(
        &self,
        worker: &mut Worker,
        at: usize,
        graph: &TrainGraph,
        scales: &Scales,
        d_outputs: &[f32],
        mut inputs: Option<&mut InputGradient>,
    ) {
        let columns = self.columns;
        let _tiles = Tiles::new(self.isa);
        let (n_nodes, k) = (graph.n_nodes(), graph.n_segments());
        let Thread { work, gradients, tapes } = self.of(worker);
        let tape = &mut tapes[at];
        for (buffer, rows) in
            [(&mut work.d_nodes, n_nodes), (&mut work.d_table, k), (&mut work.d_segments, k)]
        {
            buffer.fit(rows * columns);
            buffer[..rows * columns].fill(0.0);
        }
        let falls = (&mut work.d_nodes[..n_nodes * columns], &mut work.d_table[..k * columns]);
        self.decoder.backward(
            graph,
            &tape.decoder,
            &mut work.shared,
            &mut work.fp32,
            d_outputs,
            falls,
            gradients,
        );
        if let (Some(weight), Some(stage)) = (&self.decoder.segment, P::segments(&tape.processor)) {
            through_table(
                weight,
                stage,
                columns,
                &work.d_table[..k * columns],
                &mut work.d_segments[..k * columns],
                &mut work.fp32,
                gradients,
            );
        }
        let edges = inputs.as_deref_mut().and_then(|i| i.edges.as_deref_mut());
        self.processor.backward(graph, scales, &mut tape.processor, work, gradients, edges);
        let Buffers { shared, fp32, d_nodes, d_features, .. } = work;
        for rows in blocks::<T>(n_nodes) {
            let n = rows.len();
            shared.work.wide[..n * columns].copy_from_slice(&d_nodes[numbers(&rows, columns)]);
            let wanted = (inputs.is_some() || self.position.is_some()).then_some(&mut d_features[..]);
            let work = &mut shared.work;
            self.nodes.backward(&tape.nodes, &rows, work, fp32, gradients, wanted);
            if let Some(position) = &self.position {
                position.backward(&tape.position, &rows, fp32, d_features, gradients);
            }
            if let Some(inputs) = inputs.as_deref_mut() {
                let k = self.spec.n_field_inputs();
                let places = graph.order.node[rows].iter();
                for (&node, d) in places.zip(d_features.chunks_exact(self.nodes.stride)) {
                    let to = &mut inputs.nodes[node as usize * k..(node as usize + 1) * k];
                    scales.node.derivative(d, to);
                }
            }
        }
    }

    fn tape_bytes(&self, worker: &mut Worker, at: usize, graph: &TrainGraph) -> usize {
        let a = &self.spec.architecture;
        let hidden = a.hidden_layers * if a.activation == Activation::Silu { 2 } else { 1 };
        let [nodes, edges] = self.processor.passed(graph, &self.of(worker).tapes[at].processor);
        // The encoder of nodes and the decoder keep as much as a layer.
        let nodes = nodes + graph.n_nodes();
        let rows = (hidden + 2) * edges + (hidden + 2 + a.edge_kinds()) * nodes;
        rows * self.columns * size_of::<T>()
    }
}
