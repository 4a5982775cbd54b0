//! The training loop: batches, updates, validation, checkpoints, log, interruption; the same for every backend.

use super::checkpoint::{self, Progress};
use super::config::Config;
use super::diagnostics::{self, Advice};
use super::errors::HORIZON;
use super::log::{Journal, Row, Validation};
use super::report::Report;
use super::request::Request;
use super::start::load;
use m4gn_base::{Error, Result};
use m4gn_engine::backward::{Layout, Optimiser, norm};
use m4gn_learn::Workload;
use m4gn_learn::data_parallel::learn_together;
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::{Backend, Batch, Example, Learned, Schedule, TrainingConfig};
use m4gn_model::{Model, ModelSpec, Output};
use m4gn_parallel::Comm;
use m4gn_report::number;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Instant;

/// What a backend is made from.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// Settings of the optimisation.
    pub training: &'a TrainingConfig,
    /// The model.
    pub spec: &'a ModelSpec,
    /// The data.
    pub work: &'a Workload,
    /// Threads of this rank.
    pub threads: usize,
}

/// A training under way.
pub(super) struct Trainer<'a> {
    pub(super) request: &'a Request,
    pub(super) config: &'a Config,
    pub(super) spec: &'a ModelSpec,
    pub(super) work: &'a Workload,
    /// Of the training trajectories.
    weights: Vec<f64>,
    pub(super) comm: &'a Comm,
    pub(super) backend: Box<dyn Backend + 'a>,
    pub(super) layout: Layout,
    pub(super) optimiser: Optimiser,
    pub(super) normaliser: Normaliser,
    /// Whether the normalisers are those of the model that the training started from.
    pub(super) frozen: bool,
    pub(super) progress: Progress,
    pub(super) best: Option<(Vec<f32>, Normaliser)>,
    pub(super) resumed_seconds: f64,
    started: Instant,
}

/// Trains as asked, on a backend that `make` puts together; returns the figures of the end. Collective: every rank takes
/// its share of each batch, the first one writes.
///
/// # Errors
/// What the configuration, the data, the checkpoint or the backend may be at fault with; [`Error::Interrupted`] after
/// `stop` was raised, with a checkpoint saved. All ranks fail together.
pub fn train(
    request: &Request,
    stop: &AtomicU8,
    comm: &Comm,
    make: impl for<'a> FnOnce(&Task<'a>) -> Result<Box<dyn Backend + 'a>>,
) -> Result<serde_json::Value> {
    let report = Report::new(comm.is_root());
    let mut loaded = comm.agree(load(request, stop, comm, &report))?;
    // A file that was just written or removed may be another elsewhere on a network's disk.
    let step = loaded.earlier.as_ref().map_or("none".into(), |earlier| earlier.progress.step.to_string());
    let seen = format!("checkpoint {step}\ntrajectories {}", loaded.work.names.len());
    comm.agree_with(Ok(()), &seen).map_err(|e| match e {
        Error::Input(m) => Error::Input(format!("{m}, and files on a disk that all ranks see alike")),
        other => other,
    })?;
    let (config, work, spec) = (&loaded.config, &loaded.work, &loaded.spec);
    let t = &config.training;
    if let (0, Some(model)) = (t.steps, &loaded.from) {
        return describe(request, model, spec, comm, &report);
    }
    let share = t.batch_size.div_ceil(comm.size() as usize);
    let threads = request.threads(share.max(work.valid.len()));
    let task = Task { training: t, spec, work, threads };
    let backend = comm.agree(make(&task))?;
    let layout = Layout::new(spec);
    let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
    let (weights, normaliser) = match &loaded.from {
        Some(model) => (layout.flatten(model)?, Normaliser::of_model(model)?),
        None => (layout.initial(spec, &mut rng), Normaliser::new(spec)),
    };
    let progress = Progress {
        version: checkpoint::VERSION,
        step: 0,
        updates: 0,
        samples: 0,
        seconds: 0.0,
        seed: t.seed,
        config: serde_json::to_value(config).map_err(|e| Error::Internal(e.to_string()))?,
        data: work.names.clone(),
        best: None,
        interval: (0, 0.0, 0.0, vec![]),
        from: request.from.as_ref().map(|p| p.display().to_string()),
    };
    report.line(&format!(
        "training {} weights on {} trajectories ({} nodes, {} frames each at most), {} to validate (RMSE-50 over {} s); {}{}",
        layout.len(),
        work.train.len(),
        work.train.iter().map(|s| s.structure.graph.n_owned).max().unwrap_or(0),
        work.train.iter().map(|s| s.n_frames).max().unwrap_or(0),
        work.valid.len(),
        number(HORIZON as f64 * config.model.stride / work.frames_a_step as f64, 3),
        backend.name(),
        match comm.size() {
            1 => String::new(),
            n => format!(" on each of {n} ranks"),
        }
    ));
    let mut trainer = Trainer {
        request,
        comm,
        optimiser: Optimiser::new(weights, t.betas, t.ema_decay > 0.0).with_rule(
            t.optimiser,
            &layout,
            spec.architecture.width,
            threads,
        ),
        normaliser,
        frozen: loaded.from.is_some(),
        config,
        spec,
        layout,
        weights: comm.agree(work.weights(spec, t.balance))?,
        work,
        backend,
        progress,
        best: None,
        resumed_seconds: 0.0,
        started: Instant::now(),
    };
    if let Some(earlier) = loaded.earlier.take() {
        comm.agree(trainer.resume(earlier, &report))?;
    }
    trainer.run(stop, &report)
}

/// Writes the model that was to be trained further as it is, with the ranges of the data. Collective.
fn describe(
    request: &Request,
    model: &Model,
    spec: &ModelSpec,
    comm: &Comm,
    report: &Report,
) -> Result<serde_json::Value> {
    let mut model = model.clone();
    model.spec.trained_on = spec.trained_on.clone();
    let written = match comm.is_root() {
        true => model.write(&request.out),
        false => Ok(()),
    };
    comm.agree(written)?;
    report.line(&format!("not trained: the ranges of the data are in {}", request.out.display()));
    let figures = serde_json::json!({ "trained_on": model.spec.trained_on, "steps": 0, "out": request.out });
    request.write_json(comm, &figures)?;
    Ok(figures)
}

impl Trainer<'_> {
    /// The steps that are left, and the figures of the end.
    fn run(&mut self, stop: &AtomicU8, report: &Report) -> Result<serde_json::Value> {
        let fields: Vec<String> = self.predicted().map(String::from).collect();
        let open = || match self.comm.is_root() {
            true => Journal::open(&self.request.log(), &fields, self.progress.step).map(Some),
            false => Ok(None),
        };
        let mut journal = self.comm.agree(open())?;
        let t = &self.config.training;
        let mut advice = Advice::default();
        report.begin(t.steps, self.progress.step);
        let end = if t.schedule == Schedule::Time { u64::MAX } else { t.steps };
        while self.progress.step < end {
            if self.comm.any(stop.load(Ordering::Relaxed) != 0) {
                report.end();
                self.save()?;
                return Err(Error::Interrupted(format!(
                    "interrupted at step {}; saved in {}. Carry on with the same command and --resume",
                    self.progress.step,
                    self.request.checkpoint().display()
                )));
            }
            if let Err(error) = self.step() {
                report.end();
                return Err(error);
            }
            let step = self.progress.step;
            self.progress.seconds = self.seconds_of_all();
            let out_of_time = t.max_minutes.is_some_and(|most| self.progress.seconds >= 60.0 * most);
            let last = step == end || out_of_time;
            let validated = last || step.is_multiple_of(t.validation_interval);
            let validations = if validated { self.validate(report)? } else { Vec::new() };
            if validated || step.is_multiple_of(t.log_interval) {
                let row = self.row(validations);
                let written = journal.as_mut().map_or(Ok(()), |journal| journal.append(&row));
                self.comm.agree(written)?;
                report.row(&row, &self.predicted().collect::<Vec<_>>());
                if let Some(journal) = &journal {
                    let told = advice.look(journal.rows(), t);
                    told.iter().for_each(|text| report.line(text));
                }
            }
            report.advance(self.place(step));
            if last || step.is_multiple_of(t.checkpoint_interval) {
                self.save()?;
            }
            if out_of_time {
                report.line(&diagnostics::stopped(t, step));
                break;
            }
        }
        report.end();
        self.summary(report)
    }

    /// Names of the fields that have a loss and validations each; the best weights are best at the first one.
    pub(super) fn predicted(&self) -> impl Iterator<Item = &str> {
        let outputs = self.spec.fields.iter().filter(|f| f.output != Output::None);
        outputs.map(|f| f.name.as_str())
    }

    /// Loss and gradient of the batch of a step, of all ranks together. Collective.
    pub(super) fn learn(&mut self, step: u64) -> Result<Learned> {
        let t = &self.config.training;
        // Random numbers belong to the step, not to a stream that would have to be saved.
        let mut rng = ChaCha8Rng::seed_from_u64(t.seed);
        rng.set_stream(step + 1);
        let unroll = t.unroll_at(self.place(step));
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
                    weight: self.weights[sample],
                }
            })
            .collect();
        let batch = Batch {
            examples: &examples,
            micro: t.micro_batch,
            total: t.batch_size,
            unroll,
            accumulate: !self.frozen && step < t.normaliser_steps,
            learn: self.learns(step),
        };
        let (weights, normaliser) = (&self.optimiser.weights, &self.normaliser);
        // Before anything is changed or saved: what is on disk stays as good as it was.
        let diverged = |what: String| {
            Error::Numerical(format!(
                "the training has diverged: {what} at step {}; the checkpoint and the best model written before are kept. \
                 Lower learning_rate, or set gradient_clip, and carry on with --resume",
                step + 1
            ))
        };
        let learned = learn_together(self.comm, &mut *self.backend, weights, normaliser, &batch);
        let learned = learned.map_err(|e| match e {
            // A body that is unrolled beyond all numbers has no edges.
            Error::Numerical(what) => diverged(what),
            other => other,
        })?;
        if let Some(gradient) = &learned.gradient {
            let (loss, length) = (self.weighted(&learned.losses), norm(gradient));
            if !(loss.is_finite() && length.is_finite()) {
                return Err(diverged(format!("loss {loss:e} and norm of the gradient {length:e}")));
            }
        }
        Ok(learned)
    }

    /// Whether a step changes the weights, or only accumulates normalisers.
    pub(super) fn learns(&self, step: u64) -> bool {
        self.frozen || step >= self.config.training.normaliser_warmup
    }

    /// One step: a batch, its gradient, an update.
    fn step(&mut self) -> Result<()> {
        let step = self.progress.step;
        let learned = self.learn(step)?;
        if let Some(moments) = &learned.moments {
            self.normaliser.add(moments);
        }
        self.progress.step += 1;
        let Some(gradient) = learned.gradient else {
            return Ok(());
        };
        let t = &self.config.training;
        let (length, losses) = (norm(&gradient), learned.losses);
        let place = self.place(step);
        let rate = t.learning_rate_at(place);
        self.optimiser.update(&gradient, length, rate, t.gradient_clip, t.ema_decay);
        self.progress.updates = self.optimiser.updates;
        self.progress.samples += (t.batch_size * t.unroll_at(place)) as u64;
        let weighted = self.weighted(&losses);
        let (rows, loss, gradient, sums) = &mut self.progress.interval;
        *rows += 1;
        *loss += weighted;
        *gradient += length;
        sums.resize(losses.len(), 0.0);
        sums.iter_mut().zip(&losses).for_each(|(sum, l)| *sum += l);
        Ok(())
    }

    /// Weighted sum of the fields' losses.
    fn weighted(&self, losses: &[f64]) -> f64 {
        losses.iter().zip(&self.loss_weights()).map(|(l, w)| l * w).sum()
    }

    fn loss_weights(&self) -> Vec<f64> {
        let t = &self.config.training;
        let predicted = self.spec.fields.iter().filter(|f| f.output != Output::None);
        predicted.map(|f| t.loss_weights.get(&f.name).copied().unwrap_or(1.0)).collect()
    }

    /// The log row of the interval that ends here.
    fn row(&mut self, validations: Vec<Validation>) -> Row {
        let seconds = self.seconds();
        let (rows, loss, gradient, sums) = std::mem::take(&mut self.progress.interval);
        let n = rows.max(1) as f64;
        let outputs = self.loss_weights().len();
        let place = self.place(self.progress.step.saturating_sub(1));
        Row {
            step: self.progress.step,
            samples: self.progress.samples,
            seconds,
            learning_rate: self.config.training.learning_rate_at(place),
            loss: loss / n,
            losses: (0..outputs).map(|i| sums.get(i).map_or(0.0, |s| s / n)).collect(),
            gradient: gradient / n,
            validations,
        }
    }

    pub(super) fn seconds(&self) -> f64 {
        self.resumed_seconds + self.started.elapsed().as_secs_f64()
    }

    /// [`Self::seconds`] of the first rank: the clocks of ranks differ. Collective.
    pub(super) fn seconds_of_all(&self) -> f64 {
        let mut seconds = [if self.comm.is_root() { self.seconds() } else { 0.0 }];
        self.comm.max_f64(&mut seconds);
        seconds[0]
    }

    /// Place of a step in the schedule, the same on all ranks.
    fn place(&self, step: u64) -> u64 {
        self.config.training.place(step, self.progress.seconds)
    }
}
