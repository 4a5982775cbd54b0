//! The two ends of the network: fields to latents, latents to fields.

use super::linear::{Norm, Tail, Weight};
use crate::graph::Graph;
use crate::model::{Model, ModelSpec};
use crate::{Error, Result};

/// f_n of eq. 1, behind the normalisation of the fields.
#[derive(Debug)]
pub struct Encoder {
    /// Of the fields `[n_field_inputs x d]`.
    pub weight: Weight,
    /// What the features that do not change with time contribute, with the bias: a row of width d a node type, or a
    /// node where the model reads offsets.
    pub fixed: Vec<f32>,
    /// Row of `fixed` of each owned node.
    pub fixed_row: Vec<i32>,
    /// Layers behind the first.
    pub tail: Tail,
    /// Layer norm at the end.
    pub norm: Norm,
    /// Mean of each field input, physical.
    pub mean: Vec<f32>,
    /// 1 / standard deviation of each field input.
    pub inverse_std: Vec<f32>,
}

/// The decoder on [h, h_S] (section 3.4.3), with the return to physical values.
#[derive(Debug)]
pub struct Decoder {
    /// Of h.
    pub node: Weight,
    /// Of h_S; none without a macro stage.
    pub segment: Option<Weight>,
    /// Layers behind the first.
    pub tail: Tail,
    /// Mean of each output, physical.
    pub mean: Vec<f32>,
    /// Standard deviation of each output.
    pub std: Vec<f32>,
    /// What h_S contributes `[K x d]`.
    pub table: Vec<f32>,
}

impl Encoder {
    /// For the nodes of this graph and their `offsets [n_owned x n_offset_features]`.
    ///
    /// # Errors
    /// [`Error::Model`] for a node type that the model does not know.
    pub fn new(model: &Model, graph: &Graph, offsets: &[f32]) -> Result<Self> {
        let ModelSpec {
            node_types,
            architecture,
            ..
        } = &model.spec;
        let (k, d) = (model.spec.n_field_inputs(), architecture.width);
        let tensor = model.tensor("encoder.node.0.weight")?;
        let tail = Tail::new(model, "encoder.node")?;
        // Without hidden layers the first layer's outputs are the last's: d either way.
        let mut types = Vec::with_capacity(node_types.len() * d);
        for t in 0..node_types.len() {
            types.extend((0..d).map(|o| tail.first_bias[o] + tensor.data[o * tensor.shape[1] + k + t]));
        }
        let kind: Vec<i32> = graph.node_types[..graph.n_owned]
            .iter()
            .map(|&code| {
                node_types
                    .iter()
                    .position(|t| *t as i32 == code)
                    .map(|t| t as i32)
                    .ok_or_else(|| {
                        let known: Vec<_> = node_types.iter().map(|t| t.name()).collect();
                        let found = crate::mesh::NodeType::from_code(code).map_or("unknown", |t| t.name());
                        Error::Model(format!(
                            "the model knows {}; the mesh has a {found} node",
                            known.join(", ")
                        ))
                    })
            })
            .collect::<Result<_>>()?;
        let n = model.spec.n_offset_features();
        let (fixed, fixed_row) = if n == 0 {
            (types, kind)
        } else {
            let column = k + node_types.len();
            let mut rows = Vec::with_capacity(kind.len() * d);
            for (t, offset) in kind.iter().zip(offsets.chunks_exact(n)) {
                rows.extend((0..d).map(|o| {
                    let w = &tensor.data[o * tensor.shape[1] + column..][..n];
                    let shift: f32 = w.iter().zip(offset).map(|(w, x)| w * x).sum();
                    types[*t as usize * d + o] + shift
                }));
            }
            (rows, (0..kind.len() as i32).collect())
        };
        let (mean, inverse_std) = normaliser(model, "node")?;
        Ok(Encoder {
            weight: Weight::columns(model, "encoder.node.0", 0..k)?,
            fixed,
            fixed_row,
            tail,
            norm: Norm::new(model, "encoder.node.norm")?,
            mean,
            inverse_std,
        })
    }
}

impl Decoder {
    /// For `n_segments` segments.
    pub fn new(model: &Model, n_segments: usize) -> Result<Self> {
        let d = model.spec.architecture.width;
        let with_segments = model.spec.architecture.segment_transformer.is_some();
        let tail = Tail::new(model, "decoder")?;
        Ok(Decoder {
            node: Weight::columns(model, "decoder.0", 0..d)?,
            segment: with_segments
                .then(|| Weight::columns(model, "decoder.0", d..2 * d))
                .transpose()?,
            table: vec![0.0; n_segments * tail.first_bias.len()],
            tail,
            mean: model.tensor("norm.output.mean")?.data.clone(),
            std: model.tensor("norm.output.std")?.data.clone(),
        })
    }
}

/// Mean and 1/std of a normaliser.
pub fn normaliser(model: &Model, name: &str) -> Result<(Vec<f32>, Vec<f32>)> {
    let mean = model.tensor(&format!("norm.{name}.mean"))?.data.clone();
    let std = &model.tensor(&format!("norm.{name}.std"))?.data;
    Ok((mean, std.iter().map(|s| 1.0 / s).collect()))
}
