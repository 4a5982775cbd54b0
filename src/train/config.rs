//! The training configuration: what the user writes in TOML, and the checks on it.
//!
//! Unknown keys are errors, every message names the key, the value found and the values that work.

use m4gn_engine::Precision;
use m4gn_engine::backward::UpdateRule;
use m4gn_mesh::NodeType;
use m4gn_mesh::{Error, Result};
use m4gn_model::{
    Activation, Architecture, ArchitectureKeys, ContactSpec, FieldSpec, KindName, MacroSpec, ModelSpec,
    Output, SegmentSpec,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Most graphs in a batch, and most model steps unrolled: far beyond any sensible training, small enough that no product
/// overflows and a slip of the hand does not ask for more memory than there is.
const MAX_BATCH: u64 = 1 << 16;
const MAX_UNROLL: u64 = 1 << 12;

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
    /// Layers of a network without a macro stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers: Option<usize>,
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
}

/// What the best weights are best at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BestOf {
    /// The short rollouts and the whole ones.
    #[default]
    Rollouts,
    /// Single strides and the short rollouts: where phases are lost over a whole rollout, its error is an accident.
    Strides,
    /// Nothing: the last weights are taken. Where the learning rate ends at almost nothing and few trajectories are there to
    /// validate on, their differences are accidents.
    Last,
}

/// Shape of the learning rate after its constant part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decay {
    /// Geometric, the paper's.
    Exponential,
    /// Half a cosine.
    Cosine,
}

/// `[training]`: optimisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// Seed of weights, batches and noise.
    pub seed: u64,
    /// Graphs an optimisation step.
    pub batch_size: usize,
    /// Graphs a forward pass; a batch is cut into such pieces, which worker threads share.
    pub micro_batch: usize,
    /// Arithmetic of the large matrix products; weights, sums and the optimiser stay in fp32.
    pub precision: Precision,
    /// Optimisation steps.
    pub steps: u64,
    /// Stop after this many minutes of training, whatever the step; the schedule depends on steps only.
    pub max_minutes: Option<f64>,
    /// Learning rate before the decay.
    pub learning_rate: f64,
    /// Learning rate at the end of the decay and after it.
    pub learning_rate_end: f64,
    /// Steps over which the learning rate grows linearly from 0.
    pub warmup_steps: u64,
    /// Step at which the decay starts.
    pub decay_start: u64,
    /// Steps the decay takes.
    pub decay_steps: u64,
    /// Shape of the decay.
    pub decay: Decay,
    /// Further decays, each from a step with a rate of its own down to `learning_rate_end` where the next one starts or
    /// at the last step: for the stages in which many model steps are unrolled. Ascending steps.
    pub restarts: Vec<Restart>,
    /// What makes updates of gradients.
    pub optimiser: UpdateRule,
    /// Decay rates of Adam's first and second moments.
    pub betas: [f64; 2],
    /// Largest norm of the gradient; larger ones are scaled down. 0: no limit.
    pub gradient_clip: f64,
    /// Decay of the running average of the weights that is validated and exported; 0: the weights themselves.
    pub ema_decay: f64,
    /// Standard deviation of the noise on the cells' input fields, in the fields' units.
    pub noise: BTreeMap<String, f64>,
    /// How many times smaller the noise of an example may be: its deviations are drawn between `noise / noise_spread` and `noise`,
    /// evenly in their logarithm. 1: all examples have `noise`. On the native backend.
    pub noise_spread: f64,
    /// Of models with a history (`contact.history`) the part of examples whose body came to where it is in another time: in 0 to 2
    /// strides, 0 being at rest. Right where the law knows neither inertia nor rates: few frames of a trajectory are at rest, from
    /// which rollouts begin.
    pub history_pace: f64,
    /// Of models with a history, the deviation of the share of another stride's change, of the same trajectory, that is added to the
    /// change over the stride before; `noise_spread` holds for it too. 0: none.
    pub history_noise: f64,
    /// Weight of each predicted field's loss; 1 where none is given.
    pub loss_weights: BTreeMap<String, f64>,
    /// How far trajectories of small changes weigh up to those of large ones in the loss: 0 not at all, so that fast flows
    /// decide, 1 almost wholly. See [`Workload::weights`](crate::Workload::weights).
    pub balance: f64,
    /// What the square of an error's smooth part counts in the loss beside that of the error itself: averages over
    /// `smooth_hops` hops of neighbouring nodes. On the native backend.
    pub smooth_loss: f64,
    /// Hops of these averages.
    pub smooth_hops: usize,
    /// Reflect half of the samples in the second direction (y -> -y). Right for geometries whose law is symmetric.
    pub mirror: bool,
    /// `[[from_step, model_steps], ...]`: how many model steps are unrolled in the loss.
    pub unroll: Vec<[u64; 2]>,
    /// Whether gradients flow through the unrolled states.
    pub unroll_gradient: bool,
    /// Batches from which the normalisers are accumulated; then they are frozen.
    pub normaliser_steps: u64,
    /// The first of these steps only accumulate and do not change the weights.
    pub normaliser_warmup: u64,
    /// Steps between validations.
    pub validation_interval: u64,
    /// Trajectories that are rolled out in a validation.
    pub validation_rollouts: usize,
    /// By which of their errors the best weights are chosen.
    pub best_of: BestOf,
    /// Steps between checkpoints.
    pub checkpoint_interval: u64,
    /// Steps between rows of the log.
    pub log_interval: u64,
}

/// Where a further decay of the learning rate starts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Restart {
    /// Its first step.
    pub step: u64,
    /// Learning rate there.
    pub learning_rate: f64,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        TrainingConfig {
            seed: 1,
            batch_size: 2,
            micro_batch: 1,
            precision: Precision::Fp32,
            steps: 100_000,
            max_minutes: None,
            learning_rate: 1e-3,
            learning_rate_end: 1e-5,
            warmup_steps: 0,
            decay_start: 0,
            decay_steps: 100_000,
            decay: Decay::Exponential,
            restarts: vec![],
            optimiser: UpdateRule::default(),
            betas: [0.9, 0.999],
            gradient_clip: 0.0,
            ema_decay: 0.0,
            noise: BTreeMap::new(),
            noise_spread: 1.0,
            history_pace: 0.0,
            history_noise: 0.0,
            loss_weights: BTreeMap::new(),
            balance: 0.0,
            smooth_loss: 0.0,
            smooth_hops: 8,
            mirror: false,
            unroll: vec![[0, 1]],
            unroll_gradient: true,
            normaliser_steps: 1000,
            normaliser_warmup: 100,
            validation_interval: 2000,
            validation_rollouts: 4,
            best_of: BestOf::default(),
            checkpoint_interval: 1000,
            log_interval: 100,
        }
    }
}

impl TrainingConfig {
    /// Learning rate of step `step` (0-based).
    pub fn learning_rate_at(&self, step: u64) -> f64 {
        let warm = if step < self.warmup_steps {
            (step + 1) as f64 / self.warmup_steps as f64
        } else {
            1.0
        };
        let next = self.restarts.partition_point(|r| r.step <= step);
        let (first, from, steps) = match next.checked_sub(1) {
            Some(current) => {
                let r = &self.restarts[current];
                let end = self.restarts.get(next).map_or(self.steps, |r| r.step);
                (r.learning_rate, r.step, end.saturating_sub(r.step))
            }
            None => (self.learning_rate, self.decay_start, self.decay_steps),
        };
        let part = (step.saturating_sub(from) as f64 / steps.max(1) as f64).min(1.0);
        let rate = match self.decay {
            Decay::Exponential => first * (self.learning_rate_end / first).powf(part),
            Decay::Cosine => {
                let half = 0.5 * (1.0 + (std::f64::consts::PI * part).cos());
                self.learning_rate_end + (first - self.learning_rate_end) * half
            }
        };
        warm * rate
    }

    /// Model steps unrolled in the loss of step `step`.
    pub fn unroll_at(&self, step: u64) -> usize {
        self.unroll
            .iter()
            .filter(|u| u[0] <= step)
            .map(|u| u[1] as usize)
            .next_back()
            .unwrap_or(1)
    }

    /// What of the schedule lies behind the last step, in words: `steps` moves none of it.
    pub fn unreached(&self) -> Vec<String> {
        let mut found = Vec::new();
        let first_decay = self.decay_start + self.decay_steps;
        if self.restarts.is_empty() && first_decay > self.steps {
            found.push(format!(
                "the decay of the learning rate ends at step {first_decay}"
            ));
        }
        let stage = self.unroll.iter().find(|u| u[0] >= self.steps && u[0] > 0);
        found.extend(stage.map(|u| format!("unroll has {} strides from step {} on", u[1], u[0])));
        let restart = self.restarts.iter().find(|r| r.step >= self.steps);
        found.extend(restart.map(|r| format!("restarts has one at step {}", r.step)));
        found
    }

    /// The longest unrolling of the whole schedule.
    pub fn longest_unroll(&self) -> usize {
        self.unroll.iter().map(|u| u[1] as usize).max().unwrap_or(1)
    }
}

impl Config {
    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| Error::file(path, format!("cannot read the training configuration: {e}")))?;
        Self::parse(&text).map_err(|e| Error::file(path, e.to_string()))
    }

    /// Parses and checks TOML text.
    pub fn parse(text: &str) -> Result<Self> {
        let config: Config = toml::from_str(text).map_err(|e| {
            Error::Input(format!(
                "not a valid training configuration: {}",
                e.to_string().trim()
            ))
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
            kind: m.kind,
            width: m.width,
            hidden_layers: m.hidden_layers,
            activation: m.activation,
            layers: m.layers,
            layers_before: m.layers_before,
            layers_after: Some(m.layers_after),
            segment_transformer: self.segment_transformer.clone(),
        };
        Architecture::try_from(keys).map_err(|e| fault(&e.to_string()))
    }

    /// The model as far as it is known without data: vectors and dimensions of the fields, and the node types, are
    /// stand-ins.
    fn draft(&self) -> Result<ModelSpec> {
        let bodies = self.contact.is_some();
        let fields = self.model.fields.iter().map(|f| FieldSpec {
            name: f.name.clone(),
            vector: bodies,
            dimensions: [0; 7],
            input: f.input,
            output: f.output,
        });
        Ok(ModelSpec {
            format: 1,
            dim: if bodies { 3 } else { 2 },
            stride: self.model.stride,
            fields: fields.collect(),
            node_types: vec![if bodies { NodeType::Body } else { NodeType::Fluid }],
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
        let (m, t) = (&self.model, &self.training);
        self.draft()?.verify().map_err(|e| fault(&e))?;
        at_least_one("training.batch_size", t.batch_size as u64)?;
        at_least_one("training.micro_batch", t.micro_batch as u64)?;
        for (key, value, most) in [
            ("training.batch_size", t.batch_size as u64, MAX_BATCH),
            ("training.micro_batch", t.micro_batch as u64, MAX_BATCH),
            ("training.unroll", t.longest_unroll() as u64, MAX_UNROLL),
            ("training.unroll", t.unroll.len() as u64, MAX_UNROLL),
            ("training.restarts", t.restarts.len() as u64, MAX_UNROLL),
        ] {
            if value > most {
                return bad(key, &value.to_string(), &format!("at most {most}"));
            }
        }
        at_least_one("training.steps", t.steps)?;
        for (key, value) in [
            ("training.validation_interval", t.validation_interval),
            ("training.checkpoint_interval", t.checkpoint_interval),
            ("training.log_interval", t.log_interval),
            ("training.normaliser_steps", t.normaliser_steps),
            ("training.normaliser_warmup", t.normaliser_warmup),
        ] {
            at_least_one(key, value)?;
        }
        if t.normaliser_warmup > t.normaliser_steps {
            return bad(
                "training.normaliser_warmup",
                &t.normaliser_warmup.to_string(),
                &format!("at most training.normaliser_steps = {}", t.normaliser_steps),
            );
        }
        positive("training.learning_rate", t.learning_rate)?;
        positive("training.learning_rate_end", t.learning_rate_end)?;
        for restart in &t.restarts {
            positive("training.restarts.learning_rate", restart.learning_rate)?;
        }
        if !t.restarts.is_sorted_by(|a, b| a.step < b.step) {
            return Err(Error::Input("training.restarts: expected ascending steps".into()));
        }
        if let Some(minutes) = t.max_minutes {
            positive("training.max_minutes", minutes)?;
        }
        for (key, value) in [
            ("training.ema_decay", t.ema_decay),
            ("training.betas", t.betas[0]),
            ("training.betas", t.betas[1]),
        ] {
            if !(0.0..1.0).contains(&value) {
                return bad(key, &value.to_string(), "0 or more, below 1");
            }
        }
        if !(t.gradient_clip.is_finite() && t.gradient_clip >= 0.0) {
            return bad(
                "training.gradient_clip",
                &t.gradient_clip.to_string(),
                "a norm, or 0 for no limit",
            );
        }
        if !(t.noise_spread.is_finite() && t.noise_spread >= 1.0) {
            return bad(
                "training.noise_spread",
                &t.noise_spread.to_string(),
                "a number, 1 or more",
            );
        }
        let history = self.contact.is_some_and(|contact| contact.history > 0);
        for (key, value, most, expected) in [
            (
                "training.history_pace",
                t.history_pace,
                1.0,
                "a part of the examples, 0 to 1",
            ),
            (
                "training.history_noise",
                t.history_noise,
                f64::MAX,
                "a deviation, 0 or more",
            ),
        ] {
            if !(0.0..=most).contains(&value) {
                return bad(key, &value.to_string(), expected);
            }
            if value > 0.0 && !history {
                return bad(key, &value.to_string(), "0 without [contact] history = 1");
            }
        }
        if !(t.smooth_loss.is_finite() && t.smooth_loss >= 0.0) {
            return bad(
                "training.smooth_loss",
                &t.smooth_loss.to_string(),
                "a weight, 0 or more",
            );
        }
        if !(1..=1024).contains(&t.smooth_hops) {
            return bad("training.smooth_hops", &t.smooth_hops.to_string(), "1 to 1024");
        }
        if !(0.0..=1.0).contains(&t.balance) {
            return bad("training.balance", &t.balance.to_string(), "a number from 0 to 1");
        }
        for (key, table) in [
            ("training.noise", &t.noise),
            ("training.loss_weights", &t.loss_weights),
        ] {
            for (name, &value) in table {
                let fits = m.fields.iter().any(|f| {
                    &f.name == name
                        && if key == "training.noise" {
                            f.input || self.contact.is_some()
                        } else {
                            f.output != Output::None
                        }
                });
                if !fits {
                    let what = if key == "training.noise" {
                        "an input"
                    } else {
                        "an output"
                    };
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

fn positive(key: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        bad(key, &value.to_string(), "a positive number")
    }
}

fn at_least_one(key: &str, value: u64) -> Result<()> {
    if value >= 1 {
        Ok(())
    } else {
        bad(key, "0", "at least 1")
    }
}

#[cfg(test)]
#[path = "config_tests.rs"]
mod tests;
