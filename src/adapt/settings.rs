//! What a case may set of an adaptation: one JSON object, with one check.

use m4gn_base::{Error, Result};
use m4gn_engine::backward::UpdateRule;
use m4gn_engine::{Precision, PrecisionChoice};
use m4gn_learn::{Decay, TrainingConfig};
use m4gn_model::ModelSpec;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most threads a rank may be given: a larger number is a slip of the pen.
const MAX_THREADS: usize = 1024;

/// When the model learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Never.
    Off,
    /// Once, before its first jump.
    #[default]
    Before,
    /// Before its first jump, and after each stretch of the solver.
    During,
}

/// Settings of an adaptation; `mode` suffices. Keys are written as in OpenFOAM's dictionaries (`learningRate`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields, default)]
pub struct Settings {
    /// When the model learns.
    pub mode: Mode,
    /// Only the frames of the last so many seconds are kept; none: all.
    pub window: Option<f64>,
    /// Most frames that are kept in memory.
    pub max_frames: usize,
    /// Optimisation steps before the first jump.
    pub steps: u64,
    /// Optimisation steps after each later stretch of the solver.
    pub steps_each: u64,
    /// Graphs an optimisation step.
    pub batch: usize,
    /// Learning rate of the first step; it falls to a tenth along half a cosine.
    pub learning_rate: f64,
    /// Standard deviation of the noise on each input, as a share of the field's own over the model's training data.
    pub noise: f64,
    /// Share of the frames, the last ones, that no gradient sees and that decide whether the adapted weights are used.
    pub held_back: f64,
    /// Most wall time of all adaptation together, s; none: no limit.
    pub budget: Option<f64>,
    /// Arithmetic of the large products.
    pub precision: PrecisionChoice,
    /// Seed of examples and noise.
    pub seed: u64,
    /// Threads of each rank; none: those of the session.
    pub threads: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            mode: Mode::Before,
            window: None,
            max_frames: 400,
            steps: 300,
            steps_each: 20,
            batch: 2,
            learning_rate: 2e-4,
            noise: 0.01,
            held_back: 0.1,
            budget: None,
            precision: PrecisionChoice::Auto,
            seed: 1,
            threads: None,
        }
    }
}

impl Settings {
    /// Parses and checks a JSON object.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn parse(json: &str) -> Result<Self> {
        let settings: Settings = serde_json::from_str(json)
            .map_err(|e| Error::Input(format!("adapt: not valid settings: {e}")))?;
        settings.check()?;
        Ok(settings)
    }

    fn check(&self) -> Result<()> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let not_negative = |x: f64| x.is_finite() && x >= 0.0;
        for (key, value, fits, expected) in [
            ("window", self.window, self.window.is_none_or(positive), "a time above 0"),
            ("budget", self.budget, self.budget.is_none_or(not_negative), "seconds, 0 or more"),
            ("learningRate", Some(self.learning_rate), positive(self.learning_rate), "above 0"),
            ("noise", Some(self.noise), not_negative(self.noise), "0 or more"),
            (
                "heldBack",
                Some(self.held_back),
                self.held_back > 0.0 && self.held_back < 1.0,
                "a share above 0 and below 1",
            ),
        ] {
            if !fits {
                return bad(key, value.unwrap_or(f64::NAN), expected);
            }
        }
        for (key, value, least, most) in [
            ("maxFrames", self.max_frames as u64, 3, 1 << 20),
            ("steps", self.steps, 1, 1 << 32),
            ("stepsEach", self.steps_each, 1, 1 << 32),
            ("batch", self.batch as u64, 1, 4096),
            ("threads", self.threads.unwrap_or(1) as u64, 1, MAX_THREADS as u64),
        ] {
            if !(least..=most).contains(&value) {
                return bad(key, value, &format!("{least} to {most}"));
            }
        }
        Ok(())
    }

    /// The training that these settings mean for a model: noise in the fields' units; weights of the losses, and whether
    /// half of the examples are reflected, as the model was trained.
    pub(super) fn training(
        &self,
        spec: &ModelSpec,
        input_std: &[f32],
        precision: Precision,
    ) -> TrainingConfig {
        let mut noise = BTreeMap::new();
        let mut column = 0;
        for field in spec.fields.iter().filter(|f| f.input) {
            let n = field.components(spec.dim);
            // A component that hardly varies has as much noise as the others.
            let largest = input_std[column..column + n].iter().fold(0f32, |m, s| m.max(*s));
            noise.insert(field.name.clone(), self.noise * f64::from(largest));
            column += n;
        }
        let own = |key: &str| spec.training.pointer(&format!("/config/training/{key}"));
        if let Some(trained) = own("noise").and_then(|n| n.as_object()) {
            // What is read and no input by itself: as much noise as the model was trained with.
            let usable = |v: &serde_json::Value| v.as_f64().filter(|v| v.is_finite() && *v >= 0.0);
            let moved = |name: &str| spec.fields.iter().any(|f| f.name == name && spec.reads(f) && !f.input);
            let known = trained.iter().filter(|(name, _)| moved(name));
            noise.extend(known.filter_map(|(name, v)| Some((name.clone(), usable(v)?))));
        }
        let of_losses = own("loss_weights");
        let weights = |name: &str| of_losses.and_then(|w| w.get(name)).and_then(serde_json::Value::as_f64);
        let weight =
            |name: &String| Some((name.clone(), weights(name).filter(|w| w.is_finite() && *w >= 0.0)?));
        TrainingConfig {
            seed: self.seed,
            batch_size: self.batch,
            precision,
            optimiser: UpdateRule::Muon,
            learning_rate: self.learning_rate,
            learning_rate_end: 0.1 * self.learning_rate,
            decay: Decay::Cosine,
            decay_steps: self.steps,
            betas: [0.9, 0.99],
            gradient_clip: 1.0,
            mirror: own("mirror").and_then(serde_json::Value::as_bool).unwrap_or(false),
            noise,
            loss_weights: spec.fields.iter().filter_map(|f| weight(&f.name)).collect(),
            ..TrainingConfig::default()
        }
    }
}

fn bad<T>(key: &str, found: impl std::fmt::Display, expected: &str) -> Result<T> {
    Err(Error::Input(format!("adapt, {key}: found {found}, expected {expected}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_suffices_and_what_is_wrong_is_named() {
        assert_eq!(Settings::parse(r#"{"mode": "before"}"#).unwrap(), Settings::default());
        for (text, named) in [
            (r#"{"mode": "after"}"#, "before"),
            (r#"{"learning_rate": 1}"#, "learningRate"),
            (r#"{"steps": 0}"#, "steps"),
            (r#"{"method": "ridge"}"#, "method"),
            (r#"{"heldBack": 1}"#, "heldBack"),
            (r#"{"heldBack": 1e999}"#, "adapt"),
            (r#"{"maxFrames": 2}"#, "maxFrames"),
            (r#"{"threads": 5000}"#, "threads"),
        ] {
            let error = Settings::parse(text).unwrap_err().to_string();
            assert!(error.contains(named), "{text}: {error}");
        }
    }

    #[test]
    fn noise_is_a_share_of_the_fields_deviation_and_the_rest_is_the_models() {
        let mut spec = m4gn_samples::model::spec();
        spec.training =
            serde_json::json!({ "config": { "training": { "mirror": true, "loss_weights": { "p": 0.3 } } } });
        let t = Settings::default().training(&spec, &[2.0, 0.5, 4.0], Precision::Fp32);
        assert!((t.noise["U"] - 0.02).abs() < 1e-12, "{:?}", t.noise);
        // The rest is as the model was trained.
        assert!(t.mirror && t.loss_weights["p"] == 0.3 && t.loss_weights.len() == 1);
    }

    #[test]
    fn bodies_get_the_noise_of_their_training() {
        let mut spec = m4gn_samples::model::bodies();
        let noise = serde_json::json!({"D": 2e-5, "of no field": 1.0});
        spec.training = serde_json::json!({"config": {"training": {"noise": noise}}});
        let t = Settings::default().training(&spec, &[], Precision::Fp32);
        assert_eq!(t.noise, BTreeMap::from([("D".to_string(), 2e-5)]));
    }
}
