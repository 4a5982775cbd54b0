//! The training configuration: what the user writes in TOML, and the checks on it.
//!
//! Unknown keys are errors, every message names the key, the value found and the values that work.

use crate::delta;
use m4gn_base::{Error, Result};
use m4gn_learn::{Schedule, TrainingConfig};
use m4gn_mesh::NodeType;
use m4gn_model::{
    Activation, Architecture, ArchitectureKeys, ContactSpec, FieldSpec, KindName, MacroSpec, ModelSpec,
    NodeSums, Output, SegmentSpec, WorldEdges,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most graphs in a batch, and most model steps unrolled: far beyond any sensible training, small enough that no product
/// overflows and a slip of the hand does not ask for more memory than there is.
const MAX_BATCH: u64 = 1 << 16;
const MAX_UNROLL: u64 = 1 << 12;

/// What numbers have to be, in code and in words.
type Rule = (fn(f64) -> bool, &'static str);
const POSITIVE: Rule = (|v| v.is_finite() && v > 0.0, "a positive number");
const DECAY: Rule = (|v| (0.0..1.0).contains(&v), "0 or more, below 1");
const NORM: Rule = (|v| v.is_finite() && v >= 0.0, "a norm, or 0 for no limit");
const SPREAD: Rule = (|v| v.is_finite() && v >= 1.0, "a number, 1 or more");
const SHARE: Rule = (|v| (0.0..=1.0).contains(&v), "a number from 0 to 1");

/// A whole configuration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Network, stride and fields.
    pub model: ModelConfig,
    /// Macro stage of kind `m4gn`.
    #[serde(rename = "macro", default, skip_serializing_if = "Option::is_none")]
    pub segment_transformer: Option<MacroSpec>,
    /// Bodies at points and their contact; leave the table out for fields at cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactSpec>,
    /// How meshes are cut into segments.
    #[serde(default)]
    pub segments: SegmentSpec,
    /// Optimisation.
    pub training: TrainingConfig,
}

/// `[model]`: network, stride and fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Which network; where it is not given, `m4gn` with a `[macro]` table and `mesh-graph-net` without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<KindName>,
    /// Time the model advances in one step, s; a multiple of the data's frame interval.
    pub stride: f64,
    /// Mean distance of neighbouring nodes, m: finer meshes are agglomerated to it. None: the nodes are the cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<f64>,
    /// Latent width d.
    pub width: usize,
    /// Hidden layers of each multi-layer perceptron.
    pub hidden_layers: usize,
    /// Activation of the multi-layer perceptrons.
    pub activation: Activation,
    /// Which latents of its edges a node sums: `after` or `before` the layer.
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub node_sums: NodeSums,
    /// Whether world edges have an encoder and sums of their own: `together` or `apart`.
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub world_edges: WorldEdges,
    /// Random-walk steps of the nodes' positional encoding; 0: none.
    #[serde(default, skip_serializing_if = "m4gn_base::settings::is_default")]
    pub node_rwse_steps: usize,
    /// Layers of a network without a macro stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers: Option<usize>,
    /// Coarser graphs of kinds `bsms-gnn` and `g-u-net`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub levels: Option<usize>,
    /// Message-passing layers before the macro stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers_before: Option<usize>,
    /// Message-passing layers after it.
    #[serde(default)]
    pub layers_after: usize,
    /// Fields in the order of their features.
    pub fields: Vec<FieldConfig>,
}

/// One entry of `model.fields`; whether it is a vector and its dimensions come from the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// Name in the data set, `U` or `p`.
    pub name: String,
    /// Whether the field is a node feature.
    pub input: bool,
    /// `none`, `delta` or `value`.
    pub output: Output,
    /// As [`FieldSpec::floor`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<f64>,
}

impl Config {
    /// Reads and checks a file, which may have a `base` ([`delta`]).
    pub fn read(path: &Path) -> Result<Self> {
        let config: Config = delta::read(path)?;
        config.check().map_err(|e| Error::file(path, e.to_string()))?;
        Ok(config)
    }

    /// Parses and checks TOML text.
    pub fn parse(text: &str) -> Result<Self> {
        let config: Config = toml::from_str(text).map_err(|e| {
            Error::Input(format!("not a valid training configuration: {}", e.to_string().trim()))
        })?;
        config.check()?;
        Ok(config)
    }

    /// The network's shape.
    ///
    /// # Errors
    /// [`Error::Input`] naming the key that is missing, or that the kind does not have.
    pub fn architecture(&self) -> Result<Architecture> {
        let m = &self.model;
        let keys = ArchitectureKeys {
            kind: m.kind.unwrap_or(match self.segment_transformer {
                Some(_) => KindName::M4gn,
                None => KindName::MeshGraphNet,
            }),
            width: m.width,
            hidden_layers: m.hidden_layers,
            activation: m.activation,
            node_sums: m.node_sums,
            world_edges: m.world_edges,
            node_rwse_steps: m.node_rwse_steps,
            layers: m.layers,
            levels: m.levels,
            layers_before: m.layers_before,
            layers_after: Some(m.layers_after),
            segment_transformer: self.segment_transformer.clone(),
        };
        Architecture::try_from(keys).map_err(|e| fault(&e.to_string()))
    }

    /// The model as far as it is known without data: directions, vectors and dimensions of the fields, and the node types, are
    /// stand-ins.
    pub(crate) fn draft(&self) -> Result<ModelSpec> {
        let fields = self.model.fields.iter().map(|f| FieldSpec {
            name: f.name.clone(),
            vector: f.floor.is_none(),
            dimensions: [0; 7],
            input: f.input,
            output: f.output,
            floor: f.floor,
        });
        Ok(ModelSpec {
            format: 1,
            dim: 3,
            stride: self.model.stride,
            fields: fields.collect(),
            node_types: NodeType::ALL.to_vec(),
            architecture: self.architecture()?,
            contact: self.contact,
            resolution: self.model.resolution,
            segments: self.segments.clone(),
            precision: self.training.precision,
            trained_on: None,
            calibration: None,
            training: serde_json::Value::Null,
        })
    }

    fn check(&self) -> Result<()> {
        let t = &self.training;
        let draft = self.draft()?;
        draft.verify().map_err(|e| fault(&e))?;
        for (key, value, least, most) in [
            ("batch_size", t.batch_size as u64, 1, MAX_BATCH),
            ("micro_batch", t.micro_batch as u64, 1, MAX_BATCH),
            ("unroll", t.longest_unroll() as u64, 0, MAX_UNROLL),
            ("unroll", t.unroll.len() as u64, 0, MAX_UNROLL),
            ("restarts", t.restarts.len() as u64, 0, MAX_UNROLL),
            ("steps", t.steps, 1, u64::MAX),
            ("validation_interval", t.validation_interval, 1, u64::MAX),
            ("validation_rollouts", t.validation_rollouts as u64, 1, u64::MAX),
            ("checkpoint_interval", t.checkpoint_interval, 1, u64::MAX),
            ("log_interval", t.log_interval, 1, u64::MAX),
            ("normaliser_steps", t.normaliser_steps, 1, u64::MAX),
            ("normaliser_warmup", t.normaliser_warmup, 1, u64::MAX),
        ] {
            if !(least..=most).contains(&value) {
                let expected =
                    if value < least { format!("at least {least}") } else { format!("at most {most}") };
                return bad(&format!("training.{key}"), &value.to_string(), &expected);
            }
        }
        if t.normaliser_warmup > t.normaliser_steps {
            return bad(
                "training.normaliser_warmup",
                &t.normaliser_warmup.to_string(),
                &format!("at most training.normaliser_steps = {}", t.normaliser_steps),
            );
        }
        let rates = t.restarts.iter().map(|r| ("restarts.learning_rate", r.learning_rate, POSITIVE));
        let minutes = t.max_minutes.map(|minutes| ("max_minutes", minutes, POSITIVE));
        let numbers = [
            ("learning_rate", t.learning_rate, POSITIVE),
            ("learning_rate_end", t.learning_rate_end, POSITIVE),
            ("ema_decay", t.ema_decay, DECAY),
            ("betas", t.betas[0], DECAY),
            ("betas", t.betas[1], DECAY),
            ("gradient_clip", t.gradient_clip, NORM),
            ("noise_spread", t.noise_spread, SPREAD),
            ("balance", t.balance, SHARE),
        ];
        for (key, value, (fits, expected)) in numbers.into_iter().chain(rates).chain(minutes) {
            if !fits(value) {
                return bad(&format!("training.{key}"), &value.to_string(), expected);
            }
        }
        if t.schedule == Schedule::Time && t.max_minutes.is_none() {
            return bad("training.schedule", "\"time\" without max_minutes", "max_minutes");
        }
        if !t.restarts.is_sorted_by(|a, b| a.step < b.step) {
            return Err(Error::Input("training.restarts: expected ascending steps".into()));
        }
        let noise = ("training.noise", &t.noise, "an input");
        let weights = ("training.loss_weights", &t.loss_weights, "an output");
        for (key, table, what) in [noise, weights] {
            let fits = |f: &FieldSpec| match key == noise.0 {
                true => draft.reads(f),
                false => f.output != Output::None,
            };
            for (name, &value) in table {
                if !draft.fields.iter().any(|f| &f.name == name && fits(f)) {
                    return bad(
                        &format!("{key}.{name}"),
                        "a field that is not there",
                        &format!("{what} of model.fields"),
                    );
                }
                if !(value.is_finite() && value >= 0.0) {
                    return bad(&format!("{key}.{name}"), &value.to_string(), "0 or more");
                }
            }
        }
        if t.unroll.first().map(|u| u[0]) != Some(0)
            || t.unroll.iter().any(|u| u[1] == 0)
            || t.unroll.windows(2).any(|w| w[0][0] >= w[1][0])
        {
            return bad(
                "training.unroll",
                &format!("{:?}", t.unroll),
                "[[0, n], [step, n], ...] with growing steps that start at 0 and n of at least 1",
            );
        }
        Ok(())
    }
}

fn fault(message: &str) -> Error {
    Error::Input(format!("training configuration, {message}"))
}

fn bad<T>(key: &str, found: &str, expected: &str) -> Result<T> {
    Err(fault(&format!("{key}: found {found}, expected {expected}")))
}

#[cfg(test)]
#[path = "config_tests.rs"]
mod tests;
