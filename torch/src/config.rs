//! The training configuration: what the user writes in TOML, and the checks on it.
//!
//! Unknown keys are errors, every message names the key, the value found and the values that work.

use m4gn::model::{Activation, Architecture, ContactSpec, MacroSpec, Output, SegmentSpec};
use m4gn::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A whole configuration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Network, stride and fields.
    pub model: ModelConfig,
    /// Macro stage; leave the table out for a plain message-passing network.
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
    /// Time the model advances in one step, s; a multiple of the data's frame interval.
    pub stride: f64,
    /// Latent width d.
    pub width: usize,
    /// Hidden layers of each multi-layer perceptron.
    pub hidden_layers: usize,
    /// Activation of the multi-layer perceptrons.
    pub activation: Activation,
    /// Message-passing layers before the macro stage.
    pub layers_before: usize,
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

/// Shape of the learning rate after its constant part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decay {
    /// Geometric, the paper's.
    Exponential,
    /// Half a cosine.
    Cosine,
}

/// Arithmetic of the large matrix products; weights, sums and the optimiser stay in fp32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 32-bit products.
    Fp32,
    /// bfloat16 products: faster where the processor has them, about three decimal digits.
    Bf16,
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
    /// Arithmetic of the large matrix products.
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
    /// Decay rates of Adam's first and second moments.
    pub betas: [f64; 2],
    /// Largest norm of the gradient; larger ones are scaled down. 0: no limit.
    pub gradient_clip: f64,
    /// Decay of the running average of the weights that is validated and exported; 0: the weights themselves.
    pub ema_decay: f64,
    /// Standard deviation of the noise on the cells' input fields, in the fields' units.
    pub noise: BTreeMap<String, f64>,
    /// Weight of each predicted field's loss; 1 where none is given.
    pub loss_weights: BTreeMap<String, f64>,
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
    /// Length of the short rollouts, s.
    pub validation_horizon: f64,
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
            betas: [0.9, 0.999],
            gradient_clip: 0.0,
            ema_decay: 0.0,
            noise: BTreeMap::new(),
            loss_weights: BTreeMap::new(),
            mirror: false,
            unroll: vec![[0, 1]],
            unroll_gradient: true,
            normaliser_steps: 1000,
            normaliser_warmup: 100,
            validation_interval: 2000,
            validation_rollouts: 4,
            validation_horizon: 0.5,
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
    pub fn architecture(&self) -> Architecture {
        Architecture {
            width: self.model.width,
            hidden_layers: self.model.hidden_layers,
            activation: self.model.activation,
            layers_before: self.model.layers_before,
            layers_after: self.model.layers_after,
            segment_transformer: self.segment_transformer.clone(),
        }
    }

    fn check(&self) -> Result<()> {
        let (m, t) = (&self.model, &self.training);
        positive("model.stride", m.stride)?;
        at_least_one("model.width", m.width as u64)?;
        at_least_one("model.hidden_layers", m.hidden_layers as u64)?;
        if let Some(contact) = &self.contact {
            positive("contact.radius", contact.radius)?;
            let carried =
                matches!(&m.fields[..], [f] if f.name == "D" && !f.input && f.output == Output::Delta);
            if !carried {
                return bad(
                    "model.fields",
                    "something else beside [contact]",
                    "one field: { name = \"D\", input = false, output = \"delta\" } (edges carry the displacement)",
                );
            }
        }
        let inputs = m.fields.iter().any(|f| f.input) || self.contact.is_some();
        if !inputs || m.fields.iter().all(|f| f.output == Output::None) {
            return bad(
                "model.fields",
                "a list without an input or without an output",
                "at least one of each",
            );
        }
        for (i, f) in m.fields.iter().enumerate() {
            if m.fields[..i].iter().any(|g| g.name == f.name) {
                return bad("model.fields", &format!("`{}` twice", f.name), "each field once");
            }
        }
        match &self.segment_transformer {
            Some(s) => {
                at_least_one("macro.layers", s.layers as u64)?;
                at_least_one("macro.ffn_width", s.ffn_width as u64)?;
                if s.heads == 0 || m.width % s.heads != 0 {
                    return bad(
                        "macro.heads",
                        &s.heads.to_string(),
                        &format!("a divisor of model.width = {}", m.width),
                    );
                }
            }
            None if m.layers_after > 0 => {
                return bad(
                    "model.layers_after",
                    &m.layers_after.to_string(),
                    "0 where there is no [macro] table: there is nothing to come after",
                );
            }
            None => {}
        }
        self.segments.check()?;
        at_least_one("training.batch_size", t.batch_size as u64)?;
        at_least_one("training.micro_batch", t.micro_batch as u64)?;
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
        positive("training.validation_horizon", t.validation_horizon)?;
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

fn bad<T>(key: &str, found: &str, expected: &str) -> Result<T> {
    Err(Error::Input(format!(
        "training configuration, {key}: found {found}, expected {expected}"
    )))
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
mod tests {
    use super::*;

    const SMALL: &str = r#"
        [model]
        stride = 0.05
        width = 8
        hidden_layers = 1
        activation = "relu"
        layers_before = 1
        fields = [{ name = "U", input = true, output = "delta" }, { name = "p", input = false, output = "value" }]
        [training]
        steps = 10
        learning_rate = 1e-4
        learning_rate_end = 1e-6
        decay_start = 1000
        decay_steps = 1000
        unroll = [[0, 1], [20, 2]]
        noise = { U = 0.02 }
    "#;

    #[test]
    fn schedule_is_the_papers() {
        let t = Config::parse(SMALL).unwrap().training;
        assert_eq!(t.learning_rate_at(0), 1e-4);
        assert_eq!(t.learning_rate_at(1000), 1e-4);
        assert!((t.learning_rate_at(1500) - 1e-5).abs() < 1e-18);
        assert!((t.learning_rate_at(5000) - 1e-6).abs() < 1e-18);
        assert_eq!((t.unroll_at(19), t.unroll_at(20)), (1, 2));
    }

    #[test]
    fn a_restart_decays_to_the_last_step() {
        let text = SMALL.replace(
            "steps = 10\n",
            "steps = 6000\nrestarts = [{ step = 2000, learning_rate = 1e-3 }, { step = 5000, learning_rate = 1e-4 }]\n",
        );
        let t = Config::parse(&text).unwrap().training;
        assert!((t.learning_rate_at(1999) - 1e-6).abs() < 1e-8);
        assert_eq!((t.learning_rate_at(2000), t.learning_rate_at(5000)), (1e-3, 1e-4));
        assert!((t.learning_rate_at(4999) - 1e-6).abs() < 1e-8);
        assert!((t.learning_rate_at(5500) - 1e-5).abs() < 1e-18);
        assert!((t.learning_rate_at(6000) - 1e-6).abs() < 1e-18);
    }

    #[test]
    fn shipped_configurations_are_valid() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        for name in ["cylinder-flow.toml", "cylinder-flow-paper.toml"] {
            Config::read(&folder.join(name)).unwrap();
        }
    }

    #[test]
    fn each_wrong_value_is_named() {
        for (from, to, key) in [
            ("width = 8", "widht = 8", "widht"),
            ("width = 8", "width = 0", "model.width"),
            ("stride = 0.05", "stride = -1.0", "model.stride"),
            (
                "[training]",
                "[segments]\ncount = 0\n[training]",
                "segments.count",
            ),
            (
                "[training]",
                "[segments]\nenergy = 2.0\n[training]",
                "segments.energy",
            ),
            (
                "[training]",
                "[segments]\nmethod = \"slic-x\"\n[training]",
                "slic-mdode",
            ),
            (
                "layers_before = 1",
                "layers_before = 1\nlayers_after = 2",
                "model.layers_after",
            ),
            ("[[0, 1], [20, 2]]", "[[5, 1]]", "training.unroll"),
            ("{ U = 0.02 }", "{ p = 0.02 }", "training.noise.p"),
            ("[training]", "[training]\nema_decay = 1.0", "training.ema_decay"),
            (" steps = 10\n", " steps = 0\n", "training.steps"),
            (
                "[training]",
                "[macro]\nlayers = 1\nheads = 3\nffn_width = 8\nrwse_steps = 0\ncentroids = false\noffsets = false\n[training]",
                "macro.heads",
            ),
        ] {
            let text = SMALL.replace(from, to);
            assert_ne!(text, SMALL);
            let message = Config::parse(&text).unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }
}
