//! The two ends of the network: features to latents, latents to fields.
//!
//! Layers that see physical fields compute in fp32 in either precision: the first of an encoder, whose inputs are
//! the fields, and the last of the decoder, whose outputs are their changes.

use super::kernels::{
    Addend, Function, Isa, Norm, Normed, Number, Output, Packed, layer_norm, narrow, padded, product,
};
use super::linear::{self, Linear, Tail};
use super::scale::Scale;
use super::tiles::{Scratch, blocks};
use m4gn_base::Result;
use m4gn_model::{Model, ModelSpec};
use m4gn_structure::Structure;

/// A perceptron on features, with a layer norm at the end (eq. 1).
pub struct Encoder<T> {
    isa: Isa,
    /// Of the features.
    first: Packed<f32>,
    tail: Tail<T>,
    norm: Norm,
    columns: usize,
}

impl<T: Number> Encoder<T> {
    /// Perceptron `name` on its first `n` inputs; what the others contribute is left to the caller.
    pub fn new(isa: Isa, model: &Model, name: &str, n: usize) -> Result<Self> {
        Ok(Encoder {
            isa,
            first: linear::columns(isa, model, &format!("{name}.0"), 0..n)?,
            tail: Tail::new(isa, model, name)?,
            norm: linear::norm(model, &format!("{name}.norm"))?,
            columns: padded(model.spec.architecture.width),
        })
    }

    /// Latents of n rows of `features`, normalised and `stride` numbers apart, with `addend` at the first layer; `a`,
    /// `b` and `c` are buffers.
    pub fn run(
        &self,
        (features, stride): (&[f32], usize),
        n: usize,
        addend: Addend<f32>,
        (a, b, c): (&mut [T], &mut [T], &mut [f32]),
        out: Normed<T>,
    ) {
        let size = n * self.columns;
        let wide = Output::Wide(&mut c[..size]);
        product(self.isa, &self.first, (features, stride), n, addend, self.tail.function(), wide);
        narrow(self.isa, &c[..size], &mut a[..size]);
        self.tail.run(self.isa, n, a, b, c);
        layer_norm(self.isa, &self.norm, c, n, out);
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
    pub fn new(isa: Isa, model: &Model, structure: &Structure) -> Result<Self> {
        let graph = &structure.graph;
        let offsets = structure.segments.as_ref().map_or(&[][..], |s| &s.offsets);
        let ModelSpec { node_types, architecture, .. } = &model.spec;
        let (k, columns) = (model.spec.n_field_inputs(), padded(architecture.width));
        let tensor = model.tensor("encoder.node.0.weight")?;
        let bias = linear::bias(model, "encoder.node.0")?;
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
            rows = positioned(isa, model, walk, rows)?;
        }
        Ok(Fixed { rows, row: (0..kinds.len() as u32).collect() })
    }
}

/// These rows, and what f_np (section 3.4.1) of the nodes' random walks contributes beside them.
fn positioned(isa: Isa, model: &Model, walk: &[f32], mut rows: Vec<f32>) -> Result<Vec<f32>> {
    let ModelSpec { architecture, .. } = &model.spec;
    let (columns, steps) = (padded(architecture.width), architecture.micro.node_rwse_steps);
    let features = padded(model.spec.n_node_features());
    let first: Linear<f32> = Linear::new(isa, model, "encoder.position.0")?;
    let tail: Tail<f32> = Tail::new(isa, model, "encoder.position")?;
    let node: Packed<f32> = linear::whole(isa, model, "encoder.node.0")?;
    let widest = f32::ROWS * columns.max(features);
    let [mut a, mut b, mut c] = [0; 3].map(|_| vec![0.0; widest]);
    let count = rows.len() / columns;
    for range in blocks::<f32>(count) {
        let n = range.len();
        let x = (&walk[range.start * steps..], steps);
        first.run(isa, x, n, tail.function(), Output::Wide(&mut a));
        tail.run(isa, n, &mut a, &mut b, &mut c);
        let own = &mut rows[range.start * columns..range.end * columns];
        product(isa, &node, (&c, features), n, Addend::Rows(own), Function::Identity, Output::Wide(&mut a));
        own.copy_from_slice(&a[..n * columns]);
    }
    Ok(rows)
}

/// The decoder on [h, h_S] (section 3.4.3), with the return to physical values.
pub struct Decoder<T> {
    isa: Isa,
    /// On latents.
    first: Packed<T>,
    inner: Vec<Linear<T>>,
    last: Linear<f32>,
    function: Function,
    /// Bias of the first layer.
    pub bias: Vec<f32>,
    /// Of h_S in the first layer; none without a macro stage.
    pub segment: Option<Packed<f32>>,
    /// Of the outputs.
    scale: Scale,
}

impl<T: Number> Decoder<T> {
    /// The decoder of a model.
    pub fn new(isa: Isa, model: &Model) -> Result<Self> {
        let a = &model.spec.architecture;
        let (d, h) = (a.width, a.hidden_layers);
        let bias = linear::bias(model, "decoder.0")?;
        let inner = (1..h).map(|i| Linear::new(isa, model, &format!("decoder.{i}")));
        Ok(Decoder {
            isa,
            first: linear::columns(isa, model, "decoder.0", 0..d)?,
            inner: inner.collect::<Result<_>>()?,
            last: Linear::new(isa, model, &format!("decoder.{h}"))?,
            function: model.spec.architecture.activation.into(),
            bias,
            segment: a
                .decodes_segments()
                .then(|| linear::columns(isa, model, "decoder.0", d..2 * d))
                .transpose()?,
            scale: Scale::of_model(model, "output")?,
        })
    }

    /// Columns of the first layer's output, padded.
    pub fn columns(&self) -> usize {
        self.bias.len()
    }

    /// From n rows of latents in `scratch.c`, and what h_S and the bias add to the first layer in `scratch.sums`, to
    /// rows of physical outputs in `scratch.raw`; returns how far apart they stand.
    pub fn run(&self, scratch: &mut Scratch<T>, n: usize) -> usize {
        let isa = self.isa;
        let Scratch { x, a, b, c, sums, raw, .. } = scratch;
        let columns = self.first.columns();
        let size = n * columns;
        narrow(isa, &c[..size], &mut x[..size]);
        let (mut from, mut to) = (a, b);
        let f = self.function;
        let place = match self.inner.is_empty() {
            true => Output::Wide(c),
            false => Output::Narrow(from),
        };
        let rows = Addend::Rows(sums);
        product(isa, &self.first, (x, columns), n, rows, f, place);
        for (i, layer) in self.inner.iter().enumerate() {
            let place = match i + 1 == self.inner.len() {
                true => Output::Wide(c),
                false => Output::Narrow(to),
            };
            layer.run(isa, (from, columns), n, f, place);
            std::mem::swap(&mut from, &mut to);
        }
        let stride = padded(self.last.weight.inputs());
        self.last.run(isa, (c, stride), n, Function::Identity, Output::Wide(raw));
        let width = self.last.weight.columns();
        for row in raw.chunks_exact_mut(width).take(n) {
            self.scale.to_physical(&mut row[..self.scale.channels()]);
        }
        width
    }
}
