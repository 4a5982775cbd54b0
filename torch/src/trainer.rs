//! The training loop: batches, updates, validation, checkpoints, log, interruption.

use crate::checkpoint::{Checkpoint, Progress, write_atomically};
use crate::config::Config;
use crate::journal::{Journal, Row, Validation};
use crate::learner::{Example, Job, Learner, Outcome};
use crate::normaliser::Normaliser;
use crate::optimiser::{Optimiser, to_host};
use crate::pool::Pool;
use crate::report::Report;
use crate::request::Request;
use crate::samples::Components;
use crate::weights::Layout;
use crate::workload::Workload;
use m4gn::model::{Model, ModelSpec, SegmentSpec};
use m4gn::{Error, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Instant;
use tch::{Device, Tensor};

/// A training under way.
struct Trainer<'a> {
    request: &'a Request,
    config: Arc<Config>,
    spec: Arc<ModelSpec>,
    layout: Layout,
    work: Workload,
    pool: Pool,
    device: Device,
    optimiser: Optimiser,
    normaliser: Normaliser,
    progress: Progress,
    best: Option<(Vec<f32>, Normaliser)>,
    resumed_seconds: f64,
    started: Instant,
}

/// Trains as asked; returns the figures of the end.
pub fn train(request: &Request, stop: &AtomicU8) -> Result<serde_json::Value> {
    let config = request.config()?;
    let device = request.device()?;
    let path = request.checkpoint();
    if path.exists() && !request.resume {
        return Err(Error::Input(format!(
            "{} holds an earlier training of this model: carry it on with --resume, or delete it, or give another --out",
            path.display()
        )));
    }
    let earlier = if path.exists() {
        Some(Checkpoint::read(&path)?)
    } else {
        None
    };
    // One libtorch thread a worker: graphs are small, and the order of sums stays the same.
    tch::set_num_threads(1);
    let report = Report::new();
    let (work, spec) = Workload::load(&request.data, &config, device, &report, stop)?;
    let pieces = config.training.batch_size.div_ceil(config.training.micro_batch);
    let threads = request.threads(pieces, device);
    let (config, spec) = (Arc::new(config), Arc::new(spec));
    let learner = Learner::new(
        config.clone(),
        spec.clone(),
        work.train.iter().map(|s| s.share()).collect(),
        work.valid.iter().map(|s| s.share()).collect(),
        work.frames_a_step,
        device,
    );
    let layout = Layout::new(&spec);
    let t = &config.training;
    let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
    let optimiser = Optimiser::new(
        &layout.initial(&spec, &mut rng),
        t.betas,
        t.ema_decay > 0.0,
        device,
    );
    let progress = Progress {
        version: 1,
        step: 0,
        updates: 0,
        samples: 0,
        seconds: 0.0,
        seed: t.seed,
        config: serde_json::to_value(&*config).map_err(|e| Error::Internal(e.to_string()))?,
        data: work.names.clone(),
        best: None,
        interval: (0, 0.0, 0.0, vec![]),
    };
    report.line(&format!(
        "training {} weights on {} trajectories ({} nodes, {} frames each at most), {} to validate; {} threads on {device:?}",
        layout.len(),
        work.train.len(),
        work.train.iter().map(|s| s.hosts[0].cells + s.hosts[0].boundary).max().unwrap_or(0),
        work.train.iter().map(|s| s.n_frames).max().unwrap_or(0),
        work.valid.len(),
        threads
    ));
    let mut trainer = Trainer {
        request,
        normaliser: Normaliser::new(&spec, &Components::new(&spec)),
        config: config.clone(),
        spec,
        layout,
        work,
        pool: Pool::new(learner, threads)?,
        device,
        optimiser,
        progress,
        best: None,
        resumed_seconds: 0.0,
        started: Instant::now(),
    };
    if let Some(earlier) = earlier {
        trainer.resume(earlier, &report)?;
    }
    trainer.run(stop, &report)
}

impl Trainer<'_> {
    /// Takes up a checkpoint.
    fn resume(&mut self, earlier: Checkpoint, report: &Report) -> Result<()> {
        let path = self.request.checkpoint();
        let misfit = |what: &str| {
            Error::file(
                &path,
                format!("made with another {what}: resume with what it was made with, or give another --out"),
            )
        };
        let table = |c: &serde_json::Value, name: &str| c.get(name).cloned().unwrap_or_default();
        let segments = |c: &serde_json::Value| {
            let entries = table(c, "segments").as_object().cloned().unwrap_or_default();
            SegmentSpec::of_training(entries).ok()
        };
        for name in ["model", "macro", "segments"] {
            let (old, new) = (&earlier.progress.config, &self.progress.config);
            let same = match name {
                "segments" => segments(old) == segments(new),
                _ => table(old, name) == table(new, name),
            };
            if !same {
                return Err(misfit(&format!("[{name}] table in the configuration")));
            }
        }
        if earlier.progress.data != self.progress.data {
            return Err(misfit("data set"));
        }
        if earlier.weights.len() != self.layout.len() {
            return Err(misfit("network"));
        }
        let (old, new) = (
            table(&earlier.progress.config, "training"),
            table(&self.progress.config, "training"),
        );
        let changed: Vec<String> = new
            .as_object()
            .into_iter()
            .flatten()
            .filter(|(key, value)| {
                old.get(key.as_str()) != Some(value) && *key != "steps" && *key != "max_minutes"
            })
            .map(|(key, _)| key.clone())
            .collect();
        if !changed.is_empty() {
            report.line(&format!(
                "note: [training] differs from the checkpoint's in {}",
                changed.join(", ")
            ));
        }
        let t = &self.config.training;
        let flat = |v: &[f32]| Tensor::from_slice(v).to_device(self.device);
        self.optimiser.weights = flat(&earlier.weights);
        self.optimiser.first = flat(&earlier.first);
        self.optimiser.second = flat(&earlier.second);
        self.optimiser.updates = earlier.progress.updates;
        if t.ema_decay > 0.0 {
            self.optimiser.average = Some(flat(earlier.average.as_ref().unwrap_or(&earlier.weights)));
        }
        self.normaliser = earlier.normaliser;
        self.best = earlier.best.zip(earlier.best_normaliser);
        self.resumed_seconds = earlier.progress.seconds;
        let config = std::mem::take(&mut self.progress.config);
        self.progress = Progress {
            config,
            seed: t.seed,
            ..earlier.progress
        };
        report.line(&format!("resumed at step {}", self.progress.step));
        Ok(())
    }

    fn run(&mut self, stop: &AtomicU8, report: &Report) -> Result<serde_json::Value> {
        let config = self.config.clone();
        let t = &config.training;
        let fields: Vec<String> = self
            .spec
            .fields
            .iter()
            .filter(|f| f.output != m4gn::model::Output::None)
            .map(|f| f.name.clone())
            .collect();
        let mut journal = Journal::open(&self.request.log(), &fields, self.progress.step)?;
        report.begin(t.steps, self.progress.step);
        while self.progress.step < t.steps {
            if stop.load(Ordering::Relaxed) != 0 {
                report.end();
                self.save()?;
                return Err(Error::Interrupted(format!(
                    "interrupted at step {} of {}; saved in {}. Carry on with the same command and --resume",
                    self.progress.step,
                    t.steps,
                    self.request.checkpoint().display()
                )));
            }
            self.step()?;
            let step = self.progress.step;
            let out_of_time = t.max_minutes.is_some_and(|most| self.seconds() >= 60.0 * most);
            let last = step == t.steps || out_of_time;
            let validated = last || step.is_multiple_of(t.validation_interval);
            let validation = if validated {
                Some(self.validate(report)?)
            } else {
                None
            };
            if validated || step.is_multiple_of(t.log_interval) {
                let row = self.row(validation);
                if !row.loss.is_finite() {
                    report.end();
                    return Err(Error::Numerical(format!(
                        "the loss is not finite at step {step}; the last checkpoint is kept. Lower learning_rate, or set gradient_clip"
                    )));
                }
                journal.append(&row)?;
                report.row(&row);
            }
            report.advance(step);
            if last || step.is_multiple_of(t.checkpoint_interval) {
                self.save()?;
            }
            if out_of_time {
                report.line(&format!("stopped at step {step}: max_minutes reached"));
                break;
            }
        }
        report.end();
        self.summary(report)
    }

    /// One step: a batch, its gradient, an update.
    fn step(&mut self) -> Result<()> {
        let config = self.config.clone();
        let t = &config.training;
        let step = self.progress.step;
        // Random numbers belong to the step, not to a stream that would have to be saved.
        let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
        rng.set_stream(step + 1);
        let unroll = t.unroll_at(step);
        let span = unroll * self.work.frames_a_step;
        let examples: Vec<Example> = (0..t.batch_size)
            .map(|_| {
                let sample = rng.random_range(0..self.work.train.len());
                let frame = rng.random_range(0..self.work.train[sample].n_frames - span);
                Example {
                    sample,
                    frame,
                    mirror: t.mirror && rng.random::<bool>(),
                    seed: rng.random(),
                }
            })
            .collect();
        let accumulate = step < t.normaliser_steps;
        let learn = step >= t.normaliser_warmup;
        let jobs = examples
            .chunks(t.micro_batch)
            .map(|piece| Job::Learn {
                weights: self.optimiser.weights.shallow_clone(),
                normaliser: self.normaliser.clone(),
                examples: piece.to_vec(),
                unroll,
                accumulate,
                learn,
            })
            .collect();
        let mut sum: Option<Tensor> = None;
        let mut losses = Vec::new();
        for outcome in self.pool.run(jobs)? {
            let Outcome::Learned {
                gradient,
                losses: piece,
                moments,
                examples,
            } = outcome
            else {
                continue;
            };
            let part = examples as f64 / t.batch_size as f64;
            if let Some(moments) = moments {
                self.normaliser.add(&moments);
            }
            losses.resize(piece.len(), 0.0);
            losses
                .iter_mut()
                .zip(&piece)
                .for_each(|(sum, loss)| *sum += part * loss);
            if let Some(gradient) = gradient {
                let gradient = gradient * part;
                sum = Some(match sum {
                    Some(sum) => sum + gradient,
                    None => gradient,
                });
            }
        }
        self.progress.step += 1;
        let Some(gradient) = sum else { return Ok(()) };
        let norm = self
            .optimiser
            .update(&gradient, t.learning_rate_at(step), t.gradient_clip, t.ema_decay);
        self.progress.updates = self.optimiser.updates;
        self.progress.samples += (t.batch_size * unroll) as u64;
        let weighted: f64 = losses.iter().zip(&self.loss_weights()).map(|(l, w)| l * w).sum();
        let (rows, loss, gradient, sums) = &mut self.progress.interval;
        *rows += 1;
        *loss += weighted;
        *gradient += norm;
        sums.resize(losses.len(), 0.0);
        sums.iter_mut().zip(&losses).for_each(|(sum, l)| *sum += l);
        Ok(())
    }

    fn loss_weights(&self) -> Vec<f64> {
        let t = &self.config.training;
        let predicted = self
            .spec
            .fields
            .iter()
            .filter(|f| f.output != m4gn::model::Output::None);
        predicted
            .map(|f| t.loss_weights.get(&f.name).copied().unwrap_or(1.0))
            .collect()
    }

    /// The log row of the interval that ends here.
    fn row(&mut self, validation: Option<Validation>) -> Row {
        let seconds = self.seconds();
        let (rows, loss, gradient, sums) = std::mem::take(&mut self.progress.interval);
        let n = rows.max(1) as f64;
        let outputs = self.loss_weights().len();
        Row {
            step: self.progress.step,
            samples: self.progress.samples,
            seconds,
            learning_rate: self
                .config
                .training
                .learning_rate_at(self.progress.step.saturating_sub(1)),
            loss: loss / n,
            losses: (0..outputs).map(|i| sums.get(i).map_or(0.0, |s| s / n)).collect(),
            gradient: gradient / n,
            validation,
        }
    }

    fn seconds(&self) -> f64 {
        self.resumed_seconds + self.started.elapsed().as_secs_f64()
    }

    /// Rolls out the validation trajectories and keeps the weights if they are the best so far.
    fn validate(&mut self, report: &Report) -> Result<Validation> {
        let t = &self.config.training;
        let weights = self.optimiser.best_guess().copy();
        let stride = self.work.frames_a_step;
        let short = ((t.validation_horizon / self.config.model.stride).round() as usize).max(1);
        // (kind of rollout, job); the long ones first, so that the threads end together.
        let mut plan = Vec::new();
        for (sample, s) in self.work.valid.iter().enumerate() {
            let steps = (s.n_frames - 1) / stride;
            plan.push((2, sample, 0, steps));
            let short = short.min(steps);
            for part in 1..3 {
                plan.push((1, sample, (s.n_frames - 1 - short * stride) * part / 2, short));
            }
            for part in 0..8 {
                plan.push((0, sample, (s.n_frames - 1 - stride) * part / 7, 1));
            }
        }
        plan.sort_by_key(|p| std::cmp::Reverse(p.0));
        let job = |&(_, sample, frame, steps): &(usize, usize, usize, usize)| Job::Rollout {
            weights: weights.shallow_clone(),
            normaliser: self.normaliser.clone(),
            sample,
            frame,
            steps,
        };
        let outcomes = self.pool.run(plan.iter().map(job).collect())?;
        // Sums of (model, persistence) squared errors and counts, of the three figures.
        let mut sums = [[0.0; 3]; 3];
        for (plan, outcome) in plan.iter().zip(outcomes) {
            let Outcome::Rolled(errors) = outcome else {
                continue;
            };
            let mut add = |figure: usize, errors: &[(f64, f64)]| {
                for (model, held) in errors {
                    let parts = [*model, *held, 1.0];
                    sums[figure].iter_mut().zip(parts).for_each(|(sum, x)| *sum += x);
                }
            };
            add(plan.0, &errors);
            if plan.0 == 2 {
                add(1, &errors[..short.min(errors.len())]);
            }
        }
        let root = |[model, held, n]: [f64; 3]| [(model / n).sqrt(), (held / n).sqrt()];
        let validation = Validation {
            rmse_1: root(sums[0]),
            rmse_horizon: root(sums[1]),
            rmse_all: root(sums[2]),
        };
        let better = match &self.progress.best {
            Some((_, best)) => validation.score() < best.score(),
            None => true,
        };
        if better {
            self.progress.best = Some((self.progress.step, validation));
            self.best = Some((to_host(&weights), self.normaliser.clone()));
            self.export()?;
        }
        report.validation(self.progress.step, &validation, better);
        Ok(validation)
    }

    /// Writes the best weights as a model file.
    fn export(&self) -> Result<()> {
        let Some((weights, normaliser)) = &self.best else {
            return Ok(());
        };
        let mut tensors = self.layout.unflatten(weights);
        tensors.extend(normaliser.tensors());
        let mut spec = (*self.spec).clone();
        let best = self
            .progress
            .best
            .map(|(step, v)| serde_json::json!({ "step": step, "validation": v }));
        spec.training = serde_json::json!({
            "config": self.progress.config,
            "seed": self.progress.seed,
            "trajectories": self.work.train.len(),
            "best": best,
            "version": env!("CARGO_PKG_VERSION"),
        });
        Model { spec, tensors }.write(&self.request.out)
    }

    fn save(&mut self) -> Result<()> {
        self.progress.seconds = self.seconds();
        let checkpoint = Checkpoint {
            progress: self.progress.clone(),
            weights: to_host(&self.optimiser.weights),
            first: to_host(&self.optimiser.first),
            second: to_host(&self.optimiser.second),
            average: self.optimiser.average.as_ref().map(to_host),
            best: self.best.as_ref().map(|b| b.0.clone()),
            normaliser: self.normaliser.clone(),
            best_normaliser: self.best.as_ref().map(|b| b.1.clone()),
        };
        checkpoint.write(&self.request.checkpoint())
    }

    fn summary(&self, report: &Report) -> Result<serde_json::Value> {
        let (step, v) = self
            .progress
            .best
            .ok_or_else(|| Error::Internal("training ended without a validation".into()))?;
        report.line(&format!(
            "best at step {step}: RMSE-1 {:.4} ({:.4} persistence), RMSE-50 {:.4} ({:.4}), RMSE-all {:.4} ({:.4}); {}",
            v.rmse_1[0],
            v.rmse_1[1],
            v.rmse_horizon[0],
            v.rmse_horizon[1],
            v.rmse_all[0],
            v.rmse_all[1],
            self.request.out.display()
        ));
        let figures = serde_json::json!({
            "model": { "rmse_1": v.rmse_1[0], "rmse_50": v.rmse_horizon[0], "rmse_all": v.rmse_all[0] },
            "persistence": { "rmse_1": v.rmse_1[1], "rmse_50": v.rmse_horizon[1], "rmse_all": v.rmse_all[1] },
            "best_step": step,
            "steps": self.progress.step,
            "samples": self.progress.samples,
            "seconds": self.seconds(),
            "weights": self.layout.len(),
            "out": self.request.out,
        });
        if let Some(path) = &self.request.json {
            let text = serde_json::to_string_pretty(&figures).map_err(|e| Error::Internal(e.to_string()))?;
            write_atomically(path, format!("{text}\n").as_bytes())?;
        }
        Ok(figures)
    }
}
