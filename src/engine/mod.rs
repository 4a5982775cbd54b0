//! The forward step of the network on this rank's part of the graph, in plain fp32 on the processor.
//!
//! Latents are rows of width d: h `[n_owned x d]` for nodes, e `[n_edges x d]` for edges. A message-passing layer
//! (eq. 2, 3) is one sweep over tiles of receivers and their edges, small enough to stay in cache. The first layer
//! of the edge network is linear in its three inputs, so that W [e, h_s, h_r] = We e + Ws h_s + Wr h_r: Ws h is
//! computed once a node and exchanged with the neighbouring ranks (the one exchange of a layer), then gathered.
//! Edge features do not change with time: their encoding is computed once.
//!
//! Nothing is allocated in a step on one thread.
#![allow(unsafe_code)]

mod ends;
mod kernels;
mod linear;
mod options;
mod passing;
#[cfg(test)]
mod plain;
mod tiles;
pub mod torch;
mod transformer;

use crate::graph::Graph;
use crate::model::Model;
use crate::parallel::{Comm, Halo};
use crate::{Error, Result};
use ends::{Decoder, Encoder, normaliser};
use linear::{Norm, Tail, Weight};
pub use options::{EngineOptions, Isa, Precision};
use passing::Layer;
use std::ops::Range;
use tiles::{Part, each_part};
use transformer::SegmentStage;

/// Segments as a network needs them: members of this rank, sizes over all ranks, positional encoding.
#[derive(Clone, Copy, Debug)]
pub struct SegmentView<'a> {
    /// Number of segments, K.
    pub count: usize,
    /// Segments of owned node i: `member[member_row[i]..member_row[i + 1]]`, at least one.
    pub member_row: &'a [u32],
    /// Segment numbers, 0 to K - 1.
    pub member: &'a [i32],
    /// Number of member nodes of each segment over all ranks `[K]`.
    pub sizes: &'a [f64],
    /// Positional encoding `[K x n_position_features]`; empty when the model has none.
    pub position: &'a [f32],
    /// Offsets of the owned nodes from their segment's centroid `[n_owned x n_offset_features]`; empty when the
    /// model has none.
    pub offsets: &'a [f32],
}

/// What advances the graph by one step: the native engine or another backend.
pub trait Forward {
    /// From `inputs [n_owned x n_field_inputs]`, physical, to `outputs [n_cells x n_outputs]`, physical, changes not
    /// yet added. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for slices of other lengths; what a backend may fail with.
    fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()>;
}

/// The native engine.
#[derive(Debug)]
pub struct Engine {
    isa: Isa,
    width: usize,
    n_cells: usize,
    n_owned: usize,
    n_inputs: usize,
    n_outputs: usize,
    row: Vec<u32>,
    senders: Vec<i32>,
    receivers: Vec<i32>,
    halo: Halo,
    parts: Vec<Part>,

    encoder: Encoder,
    layers: Vec<Layer>,
    layers_before: usize,
    segments: Option<SegmentStage>,
    decoder: Decoder,

    /// Encoded edge features, the same in every step.
    edges_encoded: Vec<f32>,
    /// e
    edges: Vec<f32>,
    /// h
    nodes: Vec<f32>,
    /// Ws h of all local nodes, ghosts included.
    senders_part: Vec<f32>,
}

impl Engine {
    /// Prepares a model for this graph. `segments` may be none only for a model without a macro stage.
    ///
    /// # Errors
    /// [`Error::Model`] when the model does not fit the graph (dimension, node types, segments);
    /// [`Error::Input`] for a segmentation of another graph.
    pub fn new(
        model: &Model,
        graph: &Graph,
        segments: Option<&SegmentView>,
        options: &EngineOptions,
    ) -> Result<Self> {
        if options.precision != Precision::Fp32 {
            return Err(Error::Input("precision bf16: not built into this engine".into()));
        }
        let n_threads = options.n_threads.max(1);
        let spec = &model.spec;
        let d = spec.architecture.width;
        let edge_width = spec.n_edge_features();
        if graph.edge_features.len() != graph.senders.len() * edge_width {
            let found = graph.edge_features.len() as f64 / graph.senders.len().max(1) as f64 - 1.0;
            return Err(Error::Model(format!(
                "the model was trained in {} dimensions, the mesh has {found} solved directions",
                spec.dim
            )));
        }
        let stage = match (&spec.architecture.segment_transformer, segments) {
            (Some(_), Some(view)) => Some(SegmentStage::new(model, view, graph.n_owned)?),
            (Some(_), None) => return Err(Error::Model("the model needs segments, none were given".into())),
            (None, _) => None,
        };
        let n_layers = spec.architecture.layers_before + spec.architecture.layers_after;
        let hidden = d.max(spec.n_field_inputs()).max(edge_width).max(spec.n_outputs());
        let mut engine = Engine {
            isa: options.isa.unwrap_or_else(Isa::detect),
            width: d,
            n_cells: graph.n_cells,
            n_owned: graph.n_owned,
            n_inputs: spec.n_field_inputs(),
            n_outputs: spec.n_outputs(),
            row: graph.row.clone(),
            senders: graph.senders.clone(),
            receivers: graph.receivers.clone(),
            halo: graph.halo.clone(),
            parts: tiles::cut(&graph.row, n_threads, hidden),
            encoder: Encoder::new(model, graph, segments.map_or(&[], |s| s.offsets))?,
            layers: (0..n_layers)
                .map(|l| Layer::new(model, l))
                .collect::<Result<_>>()?,
            layers_before: spec.architecture.layers_before,
            decoder: Decoder::new(model, stage.as_ref().map_or(0, |s| s.count()))?,
            segments: stage,
            edges_encoded: vec![0.0; graph.senders.len() * d],
            edges: vec![0.0; graph.senders.len() * d],
            nodes: vec![0.0; graph.n_owned * d],
            senders_part: vec![0.0; graph.n_local * d],
        };
        engine.encode_edges(model, graph)?;
        Ok(engine)
    }

    /// f_e of eq. 1, once.
    fn encode_edges(&mut self, model: &Model, graph: &Graph) -> Result<()> {
        let (isa, d, k) = (self.isa, self.width, model.spec.n_edge_features());
        let weight = Weight::whole(model, "encoder.edge.0")?;
        let tail = Tail::new(model, "encoder.edge")?;
        let norm = Norm::new(model, "encoder.edge.norm")?;
        let (mean, inverse) = normaliser(model, "edge")?;
        let features: Vec<f32> = graph
            .edge_features
            .chunks_exact(k)
            .flat_map(|row| row.iter().zip(&mean).zip(&inverse).map(|((x, m), s)| (x - m) * s))
            .collect();
        each_part(
            &mut self.parts,
            &mut [],
            0,
            &mut self.edges_encoded,
            d,
            |part, _, encoded| {
                for tile in &part.tiles {
                    let n = tile.edges.len();
                    weight.apply(&mut part.a, &features[tile.edges.start * k..], n);
                    kernels::bias_activate(isa, &mut part.a[..n * d], &tail.first_bias, tail.first_function);
                    let x = tail.run(isa, n, &mut part.a, &mut part.b);
                    let out = &mut encoded[rows(&tile.edges, part.edges.start, d)];
                    kernels::layer_norm(isa, x, &tail.last_bias, &norm.gain, &norm.shift, out);
                }
            },
        );
        Ok(())
    }

    /// f_n of eq. 1.
    fn encode_nodes(&mut self, inputs: &[f32]) {
        let (isa, d, k) = (self.isa, self.width, self.n_inputs);
        let Encoder {
            weight,
            fixed,
            fixed_row,
            tail,
            norm,
            mean,
            inverse_std,
        } = &self.encoder;
        each_part(
            &mut self.parts,
            &mut self.nodes,
            d,
            &mut [],
            0,
            |part, nodes, _| {
                for tile in &part.tiles {
                    let n = tile.nodes.len();
                    if k > 0 {
                        let raw = inputs[rows(&tile.nodes, 0, k)].chunks_exact(k);
                        for (x, raw) in part.c.chunks_exact_mut(k).zip(raw) {
                            for (((x, raw), m), s) in x.iter_mut().zip(raw).zip(mean).zip(inverse_std) {
                                *x = (raw - m) * s;
                            }
                        }
                    }
                    weight.apply(&mut part.a, &part.c, n);
                    let a = &mut part.a[..n * d];
                    kernels::table_activate(
                        isa,
                        a,
                        d,
                        fixed,
                        &fixed_row[tile.nodes.clone()],
                        tail.first_function,
                    );
                    let x = tail.run(isa, n, &mut part.a, &mut part.b);
                    let out = &mut nodes[rows(&tile.nodes, part.nodes.start, d)];
                    kernels::layer_norm(isa, x, &tail.last_bias, &norm.gain, &norm.shift, out);
                }
            },
        );
    }

    /// One message-passing layer (eq. 2, 3) with its halo exchange.
    fn pass(&mut self, comm: &Comm, l: usize) {
        let (isa, d) = (self.isa, self.width);
        let layer = &self.layers[l];
        let nodes = &self.nodes;
        let owned = &mut self.senders_part[..self.n_owned * d];
        each_part(&mut self.parts, owned, d, &mut [], 0, |part, out, _| {
            for tile in &part.tiles {
                let out = &mut out[rows(&tile.nodes, part.nodes.start, d)];
                layer.project_senders(out, &nodes[rows(&tile.nodes, 0, d)], tile.nodes.len());
            }
        });
        self.halo.exchange_f32(comm, &mut self.senders_part, d);
        let topology = passing::Topology {
            row: &self.row,
            senders: &self.senders,
            receivers: &self.receivers,
            senders_part: &self.senders_part,
        };
        let encoded = (l == 0).then_some(&self.edges_encoded[..]);
        each_part(
            &mut self.parts,
            &mut self.nodes,
            d,
            &mut self.edges,
            d,
            |part, nodes, edges| {
                if let Some(encoded) = encoded {
                    edges.copy_from_slice(&encoded[rows(&part.edges, 0, d)]);
                }
                layer.sweep(isa, d, &topology, part, nodes, edges);
            },
        );
    }

    /// h += dispatch([h, h_S]), where the model carries on after the macro stage.
    fn dispatch(&mut self) {
        let (isa, d) = (self.isa, self.width);
        let Some((weight, stage)) = self.segments.as_mut().and_then(SegmentStage::prepare_dispatch) else {
            return;
        };
        each_part(
            &mut self.parts,
            &mut self.nodes,
            d,
            &mut [],
            0,
            |part, nodes, _| {
                for tile in &part.tiles {
                    let h = &mut nodes[rows(&tile.nodes, part.nodes.start, d)];
                    weight.apply(&mut part.a, h, tile.nodes.len());
                    let a = &mut part.a[..h.len()];
                    let row = &stage.member_row[tile.nodes.start..=tile.nodes.end];
                    kernels::add_means(isa, a, d, stage.table, row, stage.member);
                    h.iter_mut().zip(a).for_each(|(h, a)| *h += *a);
                }
            },
        );
    }

    /// The decoder, on cells.
    fn decode(&mut self, outputs: &mut [f32]) {
        let (isa, d, n_cells, m) = (self.isa, self.width, self.n_cells, self.n_outputs);
        let Decoder {
            node,
            segment,
            tail,
            mean,
            std,
            table,
        } = &mut self.decoder;
        let stage = self.segments.as_ref();
        if let (Some(weight), Some(stage)) = (segment, stage) {
            weight.apply(table, stage.latents(), stage.count());
        }
        let width = tail.first_bias.len();
        // Cells are the first nodes: tile after tile, theirs are consecutive rows of the output.
        let mut rest = outputs;
        for part in &mut self.parts {
            for tile in &part.tiles {
                let cells = tile.nodes.start.min(n_cells)..tile.nodes.end.min(n_cells);
                let n = cells.len();
                node.apply(&mut part.a, &self.nodes[rows(&cells, 0, d)], n);
                let a = &mut part.a[..n * width];
                if let Some(stage) = stage {
                    let row = &stage.member_row()[cells.start..=cells.end];
                    kernels::add_means(isa, a, width, table, row, stage.member());
                }
                kernels::bias_activate(isa, a, &tail.first_bias, tail.first_function);
                let x = tail.run(isa, n, &mut part.a, &mut part.b);
                let Some(out) = rest.split_off_mut(..n * m) else {
                    return;
                };
                for (out, x) in out.chunks_exact_mut(m).zip(x.chunks_exact(m)) {
                    for (i, (out, x)) in out.iter_mut().zip(x).enumerate() {
                        *out = (x + tail.last_bias[i]) * std[i] + mean[i];
                    }
                }
            }
        }
    }
}

impl Forward for Engine {
    fn forward(&mut self, comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        let expected = (self.n_owned * self.n_inputs, self.n_cells * self.n_outputs);
        if (inputs.len(), outputs.len()) != expected {
            return Err(Error::Input(format!(
                "forward step: expected {} inputs and {} outputs, found {} and {}",
                expected.0,
                expected.1,
                inputs.len(),
                outputs.len()
            )));
        }
        self.encode_nodes(inputs);
        for l in 0..self.layers_before {
            self.pass(comm, l);
        }
        if let Some(stage) = &mut self.segments {
            stage.run(self.isa, comm, &self.nodes);
        }
        if self.layers_before < self.layers.len() {
            self.dispatch();
        }
        for l in self.layers_before..self.layers.len() {
            self.pass(comm, l);
        }
        self.decode(outputs);
        Ok(())
    }
}

/// Where rows `range` of width `width` stand in a slice that begins with row `first`.
fn rows(range: &Range<usize>, first: usize, width: usize) -> Range<usize> {
    (range.start - first) * width..(range.end - first) * width
}
