//! The two ends of the network: features to latents, latents to fields.
//!
//! Layers that see physical fields compute in fp32 in either precision: the first of an encoder, whose inputs are
//! the fields, and the last of the decoder, whose outputs are their changes.

use super::activations::{Activated, Activations, Place};
use super::kernels::{Addend, Buffer, Function, Isa, Normed, Number, Output, narrow, padded};
use super::members::Members;
use super::mlp::{Mlp, MlpRows};
use super::perceptron::Perceptron;
use super::tiles::{Scratch, blocks, numbers};
use super::weights::{Dense, Linear, Vector, Weights};
use m4gn_base::Result;
use m4gn_model::{Architecture, Model, ModelSpec};
use m4gn_structure::Structure;
use std::ops::Range;

/// A perceptron on features, with a layer norm at the end (eq. 1).
pub struct Encoder<T> {
    /// Of the features.
    pub first: Dense<f32>,
    pub rest: Mlp<T>,
    /// Features, padded.
    pub stride: usize,
}

impl<T: Number> Encoder<T> {
    /// Perceptron `name` on its first `n` inputs; what the others contribute is left to the caller.
    pub fn new(weights: &mut Weights, name: &str, n: usize, a: &Architecture) -> Result<Self> {
        Ok(Encoder {
            first: Dense::part(weights, &format!("{name}.0"), 0, n)?,
            rest: Mlp::new(weights, name, a)?,
            stride: padded(n),
        })
    }

    /// The bias of the first layer.
    pub fn bias(&self) -> Addend<'_, f32> {
        Addend::Bias(&self.rest.first_bias.data)
    }

    /// Latents of n rows of normalised features, with `addend` at the first layer; `wide` has room for the rows.
    pub fn run(
        &self,
        features: (&[f32], usize),
        n: usize,
        addend: Addend<f32>,
        mut rows: MlpRows<T>,
        wide: &mut [f32],
        out: Normed<T>,
    ) {
        let (_, place) = rows.activations.of(0, self.rest.columns);
        place.round(&self.first, features, n, addend, wide);
        self.rest.forward(n, rows, wide, out);
    }
}

/// What the node features that do not change with time contribute to the first layer of the node encoder, with its
/// bias: a row a node type, or a row a node where the model reads offsets, or encodes the nodes' positions.
pub struct Fixed {
    /// Rows of the padded width.
    pub rows: Vec<f32>,
    /// Row of each owned node of the graph.
    pub row: Vec<u32>,
}

impl Fixed {
    /// For the nodes of this structure.
    ///
    /// # Errors
    /// [`m4gn_base::Error::Model`] for a node type that the model does not know, or positions that are not there.
    pub fn new(weights: &mut Weights, model: &Model, structure: &Structure) -> Result<Self> {
        let graph = &structure.graph;
        let offsets = structure.segments.as_ref().map_or(&[][..], |s| &s.offsets);
        let ModelSpec { node_types, architecture, .. } = &model.spec;
        let (k, columns) = (model.spec.n_field_inputs(), padded(architecture.width));
        let tensor = model.tensor("encoder.node.0.weight")?;
        let bias = Vector::new(weights, "encoder.node.0.bias")?.data;
        let weight = |output: usize, input: usize| match output < tensor.shape[0] {
            true => tensor.data[output * tensor.shape[1] + input],
            false => 0.0,
        };
        let mut types = Vec::with_capacity(node_types.len() * columns);
        for t in 0..node_types.len() {
            types.extend((0..columns).map(|o| bias[o] + weight(o, k + t)));
        }
        let kind = |code: &i32| Ok(model.spec.place_of_type(*code)? as u32);
        let kinds: Vec<u32> = graph.node_types[..graph.n_owned].iter().map(kind).collect::<Result<_>>()?;
        let n = model.spec.n_offset_features();
        let walk = structure.walk_for(architecture.needs())?;
        if n == 0 && walk.is_empty() {
            return Ok(Fixed { rows: types, row: kinds });
        }
        let first = k + node_types.len();
        let mut rows = Vec::with_capacity(kinds.len() * columns);
        for (i, t) in kinds.iter().enumerate() {
            let offset = &offsets[i * n..(i + 1) * n];
            let own = &types[*t as usize * columns..][..columns];
            rows.extend(own.iter().enumerate().map(|(o, own)| {
                let shift: f32 = offset.iter().enumerate().map(|(i, x)| weight(o, first + i) * x).sum();
                own + shift
            }));
        }
        if !walk.is_empty() {
            rows = positioned(weights, model, walk, rows)?;
        }
        Ok(Fixed { rows, row: (0..kinds.len() as u32).collect() })
    }
}

/// These rows, and what f_np (section 3.4.1) of the nodes' random walks contributes beside them.
fn positioned(weights: &mut Weights, model: &Model, walk: &[f32], mut rows: Vec<f32>) -> Result<Vec<f32>> {
    let a = &model.spec.architecture;
    let (columns, features) = (padded(a.width), padded(model.spec.n_node_features()));
    let steps = a.micro.node_rwse_steps;
    let position = Perceptron::new(weights, "encoder.position", steps, a)?;
    let node: Dense<f32> = Dense::whole(weights, "encoder.node.0")?;
    let mut out = vec![0.0; f32::ROWS * columns];
    for range in blocks::<f32>(rows.len() / columns) {
        let (n, own) = (range.len(), &mut rows[numbers(&range, columns)]);
        // Some nodes at a time, so that the activations of all need no room.
        let mut encoded = vec![0.0; n * features];
        position.run(&walk[numbers(&range, steps)], &mut encoded);
        let x = (&encoded[..], features);
        node.run(x, n, Addend::Rows(own), Function::Identity, Output::Wide(&mut out));
        own.copy_from_slice(&out[..n * columns]);
    }
    Ok(rows)
}

/// The decoder on [h, h_S] (section 3.4.3), to normalised outputs.
pub struct Decoder<T> {
    pub isa: Isa,
    /// Columns of the latents, padded.
    pub columns: usize,
    pub n_outputs: usize,
    function: Function,
    /// On latents.
    pub first: Dense<T>,
    pub first_bias: Vector,
    /// Of h_S in the first layer; none without a macro stage.
    pub segment: Option<Dense<f32>>,
    pub inner: Vec<Linear<T>>,
    pub last: Linear<f32>,
}

/// What the decoder keeps for its derivative, a row a cell.
pub struct DecoderTape<T> {
    pub latents: Buffer<T>,
    pub values: Vec<Activated<T>>,
    /// The last layer's input.
    pub last: Activated<f32>,
}

impl<T: Number> DecoderTape<T> {
    pub fn new(decoder: &Decoder<T>) -> Self {
        DecoderTape {
            latents: Buffer::default(),
            values: decoder.inner.iter().map(|_| Activated::new(decoder.function)).collect(),
            last: Activated::new(decoder.function),
        }
    }

    /// Room for this many cells.
    pub fn fit(&mut self, cells: usize, columns: usize) {
        self.latents.fit(cells * columns);
        self.values.iter_mut().for_each(|v| v.fit(cells * columns));
        self.last.fit(cells * columns);
    }
}

impl<T: Number> Decoder<T> {
    /// The decoder of a model.
    pub fn new(weights: &mut Weights, spec: &ModelSpec) -> Result<Self> {
        let a = &spec.architecture;
        let (d, h) = (a.width, a.hidden_layers);
        let name = |i: usize| format!("decoder.{i}");
        Ok(Decoder {
            isa: weights.isa,
            columns: padded(d),
            n_outputs: spec.n_outputs(),
            function: a.activation.into(),
            first: Dense::part(weights, &name(0), 0, d)?,
            first_bias: Vector::new(weights, "decoder.0.bias")?,
            segment: match a.decodes_segments() {
                true => Some(Dense::part(weights, &name(0), d, d)?),
                false => None,
            },
            inner: (1..h).map(|i| Linear::new(weights, &name(i))).collect::<Result<_>>()?,
            last: Linear::new(weights, &name(h))?,
        })
    }

    /// From latents of all nodes to rows of outputs of `cells`, places and numbers, in `scratch.raw`; they are rows `rows` of all cells,
    /// where a tape is kept. `table` is what h_S contributes to the first layer, a row a segment. Returns how far apart they stand.
    pub fn run(
        &self,
        nodes: &[f32],
        table: Option<(&[f32], &Members)>,
        cells: &[(u32, u32)],
        scratch: &mut Scratch<T>,
        tape: Option<(&mut DecoderTape<T>, Range<usize>)>,
    ) -> usize {
        let (isa, columns, n) = (self.isa, self.columns, cells.len());
        let Scratch { x, a, b, c, sums, raw, .. } = scratch;
        let (latents, mut inner, last, wide) = match tape {
            None => {
                let last = Place { function: self.function, value: &mut c[..], slope: None };
                // All of the buffer: tiles of AMX read sixteen rows where there are fewer.
                (&mut x[..], Activations::Passing(self.function, [a, b]), last, &mut [][..])
            }
            Some((DecoderTape { latents, values, last }, rows)) => {
                let range = numbers(&rows, columns);
                (&mut latents[range.clone()], Activations::Kept(values, rows), last.place(range), &mut c[..])
            }
        };
        let both = latents.chunks_exact_mut(columns).zip(sums.chunks_exact_mut(columns));
        for (&(place, _), (to, sum)) in cells.iter().zip(both) {
            let place = place as usize;
            narrow(isa, &nodes[place * columns..(place + 1) * columns], to);
            sum.copy_from_slice(&self.first_bias.data);
            if let Some((rows, members)) = table {
                members.add_means(isa, sum, columns, rows, place..place + 1);
            }
        }
        let (mut weight, mut addend) = (&self.first, Addend::Rows(sums));
        for (i, layer) in self.inner.iter().enumerate() {
            let (before, place) = inner.of(i, columns);
            let x = if i == 0 { &*latents } else { before };
            place.fill(weight, (x, columns), n, addend, wide);
            (weight, addend) = (&layer.weight, layer.bias());
        }
        let x = self.inner.len().checked_sub(1).map_or(&*latents, |i| inner.values(i, columns));
        let hidden = last.fill_wide(weight, (x, columns), n, addend, wide);
        self.last.run((hidden, columns), n, Function::Identity, Output::Wide(raw));
        self.last.weight.columns()
    }
}
