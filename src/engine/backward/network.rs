//! The whole network in one precision: forward with what is kept, and backward.

use super::dispatch::through_table;
use super::encoder_decoder::{Decoder, DecoderTape, Encoder, EncoderTape};
use super::graph::TrainGraph;
use super::layer::Shared;
use super::layout::Layout;
use super::mlp::{Work, fit};
use super::perceptron::{Perceptron, PerceptronTape};
use super::processor::Processor;
use super::weights::{Gradients, Slots};
use super::{InputGradient, Scales};
use crate::kernels::{Addend, Buffer, Function, Isa, Normed, Number, Output, Tiles, padded, product};
use crate::tiles::blocks;
use m4gn_base::Result;
use m4gn_model::ModelSpec;

/// Weights, shared by all threads; `P` is what stands between the encoder of the nodes and the decoder.
#[derive(Debug)]
pub struct Network<T, P> {
    isa: Isa,
    spec: ModelSpec,
    columns: usize,
    slots: Slots,
    nodes: Encoder<T>,
    /// f_np (section 3.4.1), which adds to the nodes' features.
    position: Option<Perceptron>,
    processor: P,
    decoder: Decoder<T>,
}

/// What one application of the network keeps for its backward pass.
#[derive(Debug)]
pub struct Tape<T, K> {
    nodes: EncoderTape<T>,
    position: PerceptronTape,
    processor: K,
    decoder: DecoderTape<T>,
}

/// What the parts of a network work on, of one thread.
#[derive(Debug)]
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
#[derive(Debug)]
pub struct Thread<T, K> {
    work: Buffers<T>,
    gradients: Gradients,
    /// What the applications of an unrolled example keep.
    tapes: Vec<Tape<T, K>>,
}

impl<T: Number, P: Processor<T>> Network<T, P> {
    /// Of a model's shape, with all weights zero until [`Network::load`].
    pub fn new(spec: &ModelSpec, isa: Isa) -> Result<Self> {
        spec.check()?;
        let mut slots = Slots::new(Layout::new(spec));
        let s = &mut slots;
        let a = &spec.architecture;
        Ok(Network {
            isa,
            spec: spec.clone(),
            columns: padded(a.width),
            nodes: Encoder::new(isa, s, "encoder.node", a)?,
            position: match a.micro.node_rwse_steps {
                0 => None,
                steps => Some(Perceptron::new(isa, s, "encoder.position", steps, a)?),
            },
            processor: P::new(isa, s, spec)?,
            decoder: Decoder::new(isa, s, spec)?,
            slots,
        })
    }

    /// The order of the flat vector.
    pub fn layout(&self) -> &Layout {
        self.slots.layout()
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.nodes.load(flat);
        self.position.iter_mut().for_each(|p| p.load(flat));
        self.processor.load(flat);
        self.decoder.load(flat);
    }

    /// Buffers of another thread.
    pub fn thread(&self) -> Thread<T, P::Tape> {
        let a = &self.spec.architecture;
        let ffn = a.segment_transformer().map_or(0, |m| m.ffn_width);
        let features =
            self.spec.n_node_features().max(self.spec.n_edge_features()).max(a.micro.node_rwse_steps);
        let position = self.spec.n_position_features().max(self.spec.n_outputs());
        let gates = if a.needs().sequences { 3 * a.width } else { 0 };
        let widest = padded(ffn.max(gates).max(features).max(position).max(a.width));
        let empty = || Buffer::new(0);
        Thread {
            work: Buffers {
                shared: Shared::new(widest, self.columns, a.edge_kinds()),
                fp32: Work::new(widest),
                latents: empty(),
                d_nodes: empty(),
                d_edges: empty(),
                table: empty(),
                d_table: empty(),
                d_segments: empty(),
                d_features: Buffer::new(super::mlp::ROWS * padded(features)),
            },
            gradients: self.slots.gradients(),
            tapes: Vec::new(),
        }
    }

    /// Adds a thread's sums to a flat gradient and clears them.
    pub fn flush(&self, thread: &mut Thread<T, P::Tape>, flat: &mut [f32]) {
        self.slots.flush(&mut thread.gradients, flat);
    }

    /// From physical node inputs `[nodes x n_field_inputs]` to normalised outputs `[cells x n_outputs]`, keeping in tape
    /// `at` of the thread what [`Network::backward`] needs.
    pub fn forward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        inputs: &[f32],
        outputs: &mut [f32],
        thread: &mut Thread<T, P::Tape>,
        at: usize,
    ) {
        let (isa, columns, n_nodes) = (self.isa, self.columns, graph.n_nodes());
        let _tiles = Tiles::new(isa);
        let Thread { work, tapes, .. } = thread;
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
        fit(&mut work.latents, n_nodes * columns);

        let k = self.spec.n_field_inputs();
        let width = self.spec.n_static_features();
        let rows = tape.nodes.features.chunks_exact_mut(self.nodes.stride);
        for (to, &node) in rows.zip(&graph.order.node) {
            let node = node as usize;
            scales.node.normalise(&inputs[node * k..(node + 1) * k], to);
            to[k..k + width].copy_from_slice(&graph.fixed[node * width..(node + 1) * width]);
        }
        if let Some(position) = &self.position {
            position.forward(&graph.walk, &mut tape.position, &mut work.fp32, &mut tape.nodes.features);
        }
        let wide = &mut work.shared.work.wide;
        for rows in blocks::<T>(n_nodes) {
            let out = &mut work.latents[rows.start * columns..rows.end * columns];
            self.nodes.forward(&mut tape.nodes, &rows, wide, Normed::Wide(out));
        }
        self.processor.forward(graph, scales, &mut tape.processor, work);
        if let (Some(weight), Some(stage)) = (&self.decoder.segment, P::segments(&tape.processor)) {
            let k = graph.n_segments();
            fit(&mut work.table, k * columns);
            let out = Output::Wide(&mut work.table[..]);
            let x = (stage, columns);
            product(isa, weight.forward(), x, k, Addend::Nothing, Function::Identity, out);
        }
        let from = (&work.latents[..], &work.table[..]);
        self.decoder.forward(graph, &mut tape.decoder, &mut work.shared, &mut work.fp32, from, outputs);
    }

    /// From dL/d normalised outputs `[cells x n_outputs]` of the application in tape `at`, which is spoilt: gradients go
    /// to the thread's sums, those of the physical inputs to `inputs`, where asked for.
    pub fn backward(
        &self,
        graph: &TrainGraph,
        scales: &Scales,
        d_outputs: &[f32],
        thread: &mut Thread<T, P::Tape>,
        at: usize,
        mut inputs: Option<&mut InputGradient>,
    ) {
        let columns = self.columns;
        let _tiles = Tiles::new(self.isa);
        let (n_nodes, k) = (graph.n_nodes(), graph.n_segments());
        let Thread { work, gradients, tapes } = thread;
        let tape = &mut tapes[at];
        for (buffer, rows) in
            [(&mut work.d_nodes, n_nodes), (&mut work.d_table, k), (&mut work.d_segments, k)]
        {
            fit(buffer, rows * columns);
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
            shared.work.wide[..n * columns]
                .copy_from_slice(&d_nodes[rows.start * columns..rows.end * columns]);
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
                    let pairs = to.iter_mut().zip(d).zip(&scales.node.inverse);
                    pairs.for_each(|((to, d), inverse)| *to = d * inverse);
                }
            }
        }
    }

    /// Bytes of the weights, of a thread's own buffers, and of each tape of it.
    pub fn memory(&self, thread: &Thread<T, P::Tape>) -> (usize, usize, usize) {
        let position = self.position.as_ref().map_or(0, |p| p.bytes());
        let weights = self.nodes.bytes() + position + self.processor.bytes() + self.decoder.bytes();
        let work = &thread.work;
        let own = [&work.latents, &work.d_nodes, &work.d_edges, &work.table];
        let own = own.map(|b| b.bytes()).iter().sum::<usize>();
        let tape = thread
            .tapes
            .iter()
            .map(|t| P::kept(&t.processor) + t.nodes.bytes() + t.position.bytes() + t.decoder.bytes());
        let shared = work.shared.bytes() + work.fp32.bytes() + thread.gradients.bytes();
        (weights, own + shared, tape.max().unwrap_or(0))
    }
}
