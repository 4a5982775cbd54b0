//! The weights: names, shapes, and their check against the description.

use super::{Activation, Architecture, Kind, M4gn, ModelSpec};
use m4gn_base::{Error, Result, refuse};
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;

/// Weights of one layer, row-major fp32.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Extents, slowest first; a linear layer's weight is `[outputs, inputs]`.
    pub shape: Vec<usize>,
    /// Values.
    pub data: Vec<f32>,
}

/// A description and its weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What the network is.
    pub spec: ModelSpec,
    /// Its weights and normalisers under the names of [`Model::tensor_shapes`].
    pub tensors: BTreeMap<String, Tensor>,
}

impl Model {
    /// Names and shapes of all tensors of a model.
    ///
    /// A multi-layer perceptron `NAME` has the linear layers `NAME.0` to `NAME.h` (h = `hidden_layers`), each with
    /// `weight [out, in]` and `bias [out]`, and, where the paper normalises, `NAME.norm.weight`/`bias [d]`.
    pub fn tensor_shapes(spec: &ModelSpec) -> BTreeMap<String, Vec<usize>> {
        let a = &spec.architecture;
        let d = a.width;
        let mut list = Shapes { hidden_layers: a.hidden_layers, width: d, shapes: BTreeMap::new() };
        list.mlp("encoder.node", spec.n_node_features(), d, true);
        if a.micro.node_rwse_steps > 0 {
            list.mlp("encoder.position", a.micro.node_rwse_steps, spec.n_node_features(), false);
        }
        match &a.kind {
            Kind::M4gn(m) | Kind::Eagle(m) => {
                list.messages(spec);
                list.macro_stage(spec, m);
            }
            Kind::MeshGraphNet { .. } => list.messages(spec),
            Kind::BsmsGnn { .. } => list.layers(spec.n_edge_features(), a),
            Kind::GUNet { levels } => {
                list.layers(spec.n_edge_features(), a);
                (0..*levels).for_each(|l| list.add(format!("processor.{l}.score.weight"), &[1, d]));
            }
            Kind::Gcn { layers } => {
                (0..*layers).for_each(|l| list.linear(&format!("processor.{l}.convolution"), d, d));
            }
        }
        let decoder_inputs = if a.decodes_segments() { 2 * d } else { d };
        list.mlp("decoder", decoder_inputs, spec.n_outputs(), false);
        for (name, n) in
            [("node", spec.n_field_inputs()), ("edge", spec.n_edge_features()), ("output", spec.n_outputs())]
        {
            list.add(format!("norm.{name}.mean"), &[n]);
            list.add(format!("norm.{name}.std"), &[n]);
        }
        list.shapes
    }

    /// Numbers in each tensor of a model; what overflows is as many as there can be.
    pub fn tensor_sizes(spec: &ModelSpec) -> Vec<usize> {
        let shapes = Self::tensor_shapes(spec);
        let size = |shape: &Vec<usize>| shape.iter().fold(1usize, |n, extent| n.saturating_mul(*extent));
        shapes.values().map(size).collect()
    }

    /// A model with its tensors checked against the description.
    ///
    /// # Errors
    /// [`Error::Model`] naming the first tensor that is missing, has another shape, holds a value that is not
    /// finite, is not part of the network, or is a standard deviation that is not positive.
    pub fn new(spec: ModelSpec, tensors: BTreeMap<String, Tensor>) -> Result<Self> {
        let model = Model { spec, tensors };
        model.check()?;
        Ok(model)
    }

    /// The checks of [`Model::new`], for a model that was changed since.
    pub(super) fn check(&self) -> Result<()> {
        let (spec, tensors) = (&self.spec, &self.tensors);
        spec.check()?;
        let found = tensors.iter().map(|(name, t)| (&name[..], &t.shape[..]));
        Self::check_shapes(spec, found.collect())?;
        for (name, tensor) in tensors {
            refuse(tensor.data.len() != tensor.shape.iter().product::<usize>(), Error::Model, || {
                format!("tensor '{name}': {} values for the shape {:?}", tensor.data.len(), tensor.shape)
            })?;
            if let Some(i) = tensor.data.iter().position(|v| !v.is_finite()) {
                return Err(Error::Model(format!("tensor '{name}': value {i} is {}", tensor.data[i])));
            }
            if name.ends_with(".std")
                && let Some(i) = tensor.data.iter().position(|v| *v <= 0.0)
            {
                let found = tensor.data[i];
                return Err(Error::Model(format!("tensor '{name}': value {i}: expected > 0, found {found}")));
            }
        }
        Ok(())
    }

    /// Whether these are the tensors of a description, by name and shape.
    pub(super) fn check_shapes(spec: &ModelSpec, found: BTreeMap<&str, &[usize]>) -> Result<()> {
        let shapes = Self::tensor_shapes(spec);
        for (name, shape) in &shapes {
            let Some(found) = found.get(&name[..]) else {
                return Err(Error::Model(format!("tensor '{name}' {shape:?} is missing")));
            };
            if found != shape {
                return Err(Error::Model(format!("tensor '{name}': expected {shape:?}, found {found:?}")));
            }
        }
        match found.keys().find(|name| !shapes.contains_key(**name)) {
            Some(name) => Err(Error::Model(format!("tensor '{name}' is not part of this network"))),
            None => Ok(()),
        }
    }

    /// A model with random weights (uniform within 1/sqrt(inputs), norms near identity), the same for the same
    /// seed: for tests and measurements of speed.
    ///
    /// # Errors
    /// [`Error::Model`] for a description that is not one.
    pub fn random(spec: ModelSpec, seed: u64) -> Result<Self> {
        spec.check()?;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let gain = match spec.architecture.activation {
            Activation::Relu => 1.4,
            Activation::Silu => 1.6,
        };
        let mut tensors = BTreeMap::new();
        for (name, shape) in Self::tensor_shapes(&spec) {
            let n = shape.iter().product();
            let (centre, radius) = match &shape[..] {
                [_, inputs] => (0.0, gain / (*inputs as f32).sqrt()),
                // One-dimensional weights are those of layer norms.
                _ if name.ends_with(".std") || name.ends_with(".weight") => (1.0, 0.3),
                _ => (0.0, 0.3),
            };
            let data = (0..n).map(|_| centre + radius * rng.random_range(-1.0f32..1.0)).collect();
            tensors.insert(name, Tensor { shape, data });
        }
        Model::new(spec, tensors)
    }

    /// The tensor of this name.
    ///
    /// # Errors
    /// [`Error::Model`] when the model has none.
    pub fn tensor(&self, name: &str) -> Result<&Tensor> {
        self.tensors.get(name).ok_or_else(|| Error::Model(format!("tensor '{name}' is missing")))
    }
}

/// The list under construction.
struct Shapes {
    hidden_layers: usize,
    width: usize,
    shapes: BTreeMap<String, Vec<usize>>,
}

impl Shapes {
    /// The encoders of edges and the networks of message-passing layers (eq. 1 to 4).
    fn messages(&mut self, spec: &ModelSpec) {
        let d = self.width;
        for name in spec.architecture.edge_encoders() {
            self.mlp(name, spec.n_edge_features(), d, true);
        }
        self.layers(d, &spec.architecture);
    }

    /// Message-passing layers that read so many numbers of an edge.
    fn layers(&mut self, edge: usize, a: &Architecture) {
        let d = self.width;
        for l in 0..a.layers() {
            if l < a.edge_networks() {
                self.mlp(&format!("processor.{l}.edge"), edge + 2 * d, d, true);
            }
            self.mlp(&format!("processor.{l}.node"), (1 + a.edge_kinds()) * d, d, true);
        }
    }

    /// The macro stage (eq. 9 to 13), and the dispatch where layers follow.
    fn macro_stage(&mut self, spec: &ModelSpec, m: &M4gn) {
        let (d, stage) = (self.width, &m.segment_transformer);
        if spec.architecture.needs().sequences {
            // Gates one after another, as PyTorch has them: reset, update, new.
            self.linear("segment.recurrence.input", d, 3 * d);
            self.linear("segment.recurrence.hidden", d, 3 * d);
        }
        self.mlp("segment.encoder", d, d, true);
        if spec.n_position_features() > 0 {
            self.mlp("segment.position", spec.n_position_features(), d, false);
        }
        for l in 0..stage.layers {
            let name = format!("segment.transformer.{l}");
            self.norm(&format!("{name}.norm1"), d);
            for projection in ["q", "k", "v"] {
                self.add(format!("{name}.{projection}.weight"), &[d, d]);
            }
            self.linear(&format!("{name}.o"), d, d);
            self.norm(&format!("{name}.norm2"), d);
            self.linear(&format!("{name}.ffn.0"), d, stage.ffn_width);
            self.linear(&format!("{name}.ffn.1"), stage.ffn_width, d);
        }
        if m.layers_after > 0 {
            self.linear("segment.dispatch", 2 * d, d);
        }
    }

    fn add(&mut self, name: String, shape: &[usize]) {
        self.shapes.insert(name, shape.to_vec());
    }

    fn linear(&mut self, name: &str, inputs: usize, outputs: usize) {
        self.add(format!("{name}.weight"), &[outputs, inputs]);
        self.add(format!("{name}.bias"), &[outputs]);
    }

    fn norm(&mut self, name: &str, n: usize) {
        self.add(format!("{name}.weight"), &[n]);
        self.add(format!("{name}.bias"), &[n]);
    }

    fn mlp(&mut self, name: &str, inputs: usize, outputs: usize, norm: bool) {
        let (h, d) = (self.hidden_layers, self.width);
        for i in 0..=h {
            self.linear(
                &format!("{name}.{i}"),
                if i == 0 { inputs } else { d },
                if i == h { outputs } else { d },
            );
        }
        if norm {
            self.norm(&format!("{name}.norm"), outputs);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::spec;
    use crate::{MicroSpec, NodeSums};

    #[test]
    fn names_and_shapes_of_a_small_network() {
        let shapes = Model::tensor_shapes(&spec());
        assert_eq!(shapes["encoder.node.0.weight"], [8, 2 + 1 + 4 + 2]);
        assert_eq!(shapes["encoder.edge.0.weight"], [8, 3]);
        assert_eq!(shapes["processor.2.edge.0.weight"], [8, 24]);
        assert_eq!(shapes["processor.2.node.1.weight"], [8, 8]);
        assert_eq!(shapes["segment.position.0.weight"], [8, 5 + 2]);
        assert_eq!(shapes["segment.transformer.0.ffn.1.weight"], [8, 12]);
        assert_eq!(shapes["segment.dispatch.weight"], [8, 16]);
        assert_eq!(shapes["decoder.0.weight"], [8, 16]);
        assert_eq!(shapes["decoder.1.weight"], [3, 8]);
        assert!(!shapes.contains_key("decoder.norm.weight"));
        assert!(!shapes.contains_key("segment.position.norm.weight"));
        // Two encoders and 2 x 3 processors of 6 tensors each, segment encoder 6, position 4, transformer 13,
        // dispatch 2, decoder 4, normalisers 6.
        assert_eq!(shapes.len(), 8 * 6 + 6 + 4 + 13 + 2 + 4 + 6);
    }

    #[test]
    fn other_kinds_have_tensors_of_their_own() {
        let mut s = spec();
        s.architecture.kind = Kind::MeshGraphNet { layers: 2 };
        let shapes = Model::tensor_shapes(&s);
        assert_eq!(shapes["decoder.0.weight"], [8, 8]);
        assert_eq!(shapes.len(), 6 * 6 + 4 + 6);
        s.architecture.micro.node_sums = NodeSums::Before;
        let shapes = Model::tensor_shapes(&s);
        assert!(shapes.contains_key("processor.0.edge.0.weight"));
        assert_eq!(shapes.len(), 5 * 6 + 4 + 6, "the last layer has no edge network");
        s.architecture.micro = MicroSpec { node_rwse_steps: 6, ..MicroSpec::default() };
        let shapes = Model::tensor_shapes(&s);
        assert_eq!(shapes["encoder.position.0.weight"], [8, 6]);
        assert_eq!(shapes["encoder.position.1.weight"], [2 + 1 + 4, 8]);
        s.architecture.micro = Default::default();
        s.architecture.kind = Kind::Gcn { layers: 2 };
        let shapes = Model::tensor_shapes(&s);
        assert_eq!(shapes["encoder.node.0.weight"], [8, 3 + 4]);
        assert_eq!(shapes["processor.1.convolution.weight"], [8, 8]);
        assert_eq!(shapes.len(), 6 + 2 * 2 + 4 + 6);
        s.architecture.kind = Kind::Eagle(spec().architecture.m4gn().unwrap().clone());
        let shapes = Model::tensor_shapes(&s);
        assert_eq!(shapes["segment.recurrence.hidden.weight"], [3 * 8, 8]);
        assert_eq!((&shapes["decoder.0.weight"][..], shapes.len()), (&[8, 8][..], 83 + 4));
        s.architecture.kind = Kind::BsmsGnn { levels: 2 };
        let shapes = Model::tensor_shapes(&s);
        assert_eq!(shapes["processor.4.edge.0.weight"], [8, 3 + 16]);
        assert_eq!(shapes.len(), 6 + 5 * 12 + 4 + 6);
        s.architecture.kind = Kind::GUNet { levels: 2 };
        let shapes = Model::tensor_shapes(&s);
        assert_eq!((&shapes["processor.1.score.weight"][..], shapes.len()), (&[1, 8][..], 76 + 2));
    }

    #[test]
    fn random_is_reproducible_and_checked() {
        let a = Model::random(spec(), 7).unwrap();
        assert_eq!(a, Model::random(spec(), 7).unwrap());
        assert_ne!(a, Model::random(spec(), 8).unwrap());
        type Damage = fn(&mut BTreeMap<String, Tensor>);
        let damages: [(&str, Damage); 5] = [
            ("'decoder.0.bias' [8] is missing", |t| drop(t.remove("decoder.0.bias"))),
            ("expected [8, 16], found [16, 8]", |t| {
                t.get_mut("decoder.0.weight").unwrap().shape = vec![16, 8]
            }),
            ("value 2 is NaN", |t| t.get_mut("decoder.0.bias").unwrap().data[2] = f32::NAN),
            ("expected > 0", |t| t.get_mut("norm.edge.std").unwrap().data[0] = 0.0),
            ("not part of", |t| drop(t.insert("x".into(), Tensor { shape: vec![0], data: vec![] }))),
        ];
        for (message, damage) in damages {
            let mut tensors = a.tensors.clone();
            damage(&mut tensors);
            m4gn_samples::fails(Model::new(spec(), tensors), &[message]);
        }
    }
}
