//! The settings of an optimisation: `[training]` of a configuration file.

use m4gn_domain::Components;
use m4gn_engine::Precision;
use m4gn_engine::backward::UpdateRule;
use m4gn_model::ModelSpec;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the best weights are best at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BestOf {
    /// The short rollouts and the whole ones.
    #[default]
    Rollouts,
    /// Nothing: the last weights are taken. Where the learning rate ends at almost nothing and few trajectories are there to
    /// validate on, their differences are accidents.
    Last,
}

/// What a training goes through learning rates, unrolls and restarts by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Schedule {
    /// Its updates.
    #[default]
    Updates,
    /// The share of `max_minutes` that has passed: fast and slow networks come to the end of the decay alike.
    Time,
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
    /// Optimisation steps; with [`Schedule::Time`] the length of the schedule in them, however many are made.
    pub steps: u64,
    /// Stop after this many minutes of training, whatever the step.
    pub max_minutes: Option<f64>,
    /// What the schedule goes by.
    pub schedule: Schedule,
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
    /// Standard deviation of the noise on the cells' input fields, in the fields' units. The wanted change takes it away (section 3.2;
    /// Godwin et al. 2022).
    pub noise: BTreeMap<String, f64>,
    /// How many times smaller the noise of an example may be: its deviations are drawn between `noise / noise_spread` and `noise`,
    /// evenly in their logarithm. 1: all examples have `noise`. On the native backend.
    pub noise_spread: f64,
    /// Weight of each predicted field's loss; 1 where none is given.
    pub loss_weights: BTreeMap<String, f64>,
    /// How far trajectories of small changes weigh up to those of large ones in the loss: 0 not at all, so that fast flows
    /// decide, 1 almost wholly. See [`Workload::weights`](crate::Workload::weights).
    pub balance: f64,
    /// Reflect half of the samples in the second direction (y -> -y). Right for geometries whose law is symmetric.
    pub mirror: bool,
    /// `[[from_step, model_steps], ...]`: how many model steps are unrolled in the loss.
    pub unroll: Vec<[u64; 2]>,
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
            schedule: Schedule::default(),
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
            loss_weights: BTreeMap::new(),
            balance: 0.0,
            mirror: false,
            unroll: vec![[0, 1]],
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
    /// Place in the schedule, in steps of it, of step `step` after so many seconds of training.
    pub fn place(&self, step: u64, seconds: f64) -> u64 {
        match (self.schedule, self.max_minutes) {
            (Schedule::Time, Some(most)) => (self.steps as f64 * (seconds / (60.0 * most)).min(1.0)) as u64,
            _ => step,
        }
    }

    /// Learning rate at step `step` (0-based) of the schedule.
    pub fn learning_rate_at(&self, step: u64) -> f64 {
        let warm = if step < self.warmup_steps { (step + 1) as f64 / self.warmup_steps as f64 } else { 1.0 };
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

    /// Model steps unrolled in the loss at step `step` of the schedule.
    pub fn unroll_at(&self, step: u64) -> usize {
        self.unroll.iter().filter(|u| u[0] <= step).map(|u| u[1] as usize).next_back().unwrap_or(1)
    }

    /// What of the schedule lies behind the last step, in words: `steps` moves none of it.
    pub fn unreached(&self) -> Vec<String> {
        let mut found = Vec::new();
        let first_decay = self.decay_start + self.decay_steps;
        if self.restarts.is_empty() && first_decay > self.steps {
            found.push(format!("the decay of the learning rate ends at step {first_decay}"));
        }
        let stage = self.unroll.iter().find(|u| u[0] >= self.steps && u[0] > 0);
        found.extend(stage.map(|u| format!("unroll has {} strides from step {} on", u[1], u[0])));
        let restart = self.restarts.iter().find(|r| r.step >= self.steps);
        found.extend(restart.map(|r| format!("restarts has one at step {}", r.step)));
        found
    }

    /// Standard deviation of the noise of each component, in the fields' units.
    pub fn noise_of(&self, spec: &ModelSpec, components: &Components) -> Vec<f64> {
        let of = |&field: &usize| match &spec.fields[field] {
            field if spec.reads(field) => self.noise.get(&field.name).copied().unwrap_or(0.0),
            _ => 0.0,
        };
        components.field.iter().map(of).collect()
    }

    /// First output, number of outputs, and weight of the loss of each predicted field.
    pub fn groups(&self, spec: &ModelSpec, components: &Components) -> Vec<(usize, usize, f64)> {
        let mut first = 0;
        let group = |part: &[usize]| {
            let name = &spec.fields[components.field[part[0]]].name;
            first += part.len();
            (first - part.len(), part.len(), self.loss_weights.get(name).copied().unwrap_or(1.0))
        };
        components.predicted().map(group).collect()
    }

    /// The longest unrolling of the whole schedule.
    pub fn longest_unroll(&self) -> usize {
        self.unroll.iter().map(|u| u[1] as usize).max().unwrap_or(1)
    }
}
