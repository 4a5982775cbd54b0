//! The native engine as a backend of the training: an example is one thread's work.

use super::backend::{Backend, Batch, Example, Learned, Rollout};
use super::config::TrainingConfig;
use super::normaliser::Normaliser;
use super::workload::Workload;
use m4gn_base::{Error, Result};
use m4gn_domain::{Components, Domain};
use m4gn_engine as engine;
use m4gn_engine::Precision;
use m4gn_engine::backward::{TrainGraph, Trainable, Worker, trainable};
use m4gn_model::{Model, ModelSpec};
use m4gn_parallel::{Comm, panic_text};
use m4gn_structure::Structure;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A domain to learn on, and its graph; of a domain whose edges move at rest.
pub(crate) struct Live {
    pub domain: Box<dyn Domain>,
    pub graph: TrainGraph,
    /// Of each predicted field which nodes count in the loss, and how many; none where all do.
    pub free: Vec<Option<(Vec<bool>, usize)>>,
    /// The same graphs for who gives them other edges.
    moving: Option<Structure>,
}

/// The graphs with the edges of a state, as the backward pass and as the domain reads them.
pub(crate) type Moved = (TrainGraph, Structure);

impl Live {
    fn new(spec: &ModelSpec, domain: Box<dyn Domain>, structure: &Structure) -> Result<Self> {
        Ok(Live {
            graph: TrainGraph::new(spec, structure)?,
            moving: domain.moves().then(|| structure.graphs()),
            free: domain.components().predicted().map(|field| counted(domain.free(field))).collect(),
            domain,
        })
    }

    /// The graph at a state; none where it stays.
    pub fn at(&self, state: &mut [f32]) -> Result<Option<Moved>> {
        let Some(structure) = &self.moving else {
            return Ok(None);
        };
        let mut structure = structure.clone();
        self.domain.set_edges(&Comm::serial(), state, &mut structure)?;
        Ok(Some((self.graph.with_edges(&structure), structure)))
    }
}

/// Nodes that count with their number, where some do not.
fn counted(free: Vec<bool>) -> Option<(Vec<bool>, usize)> {
    let count = free.iter().filter(|free| **free).count();
    (count < free.len()).then_some((free, count.max(1)))
}

/// Network, domains and threads.
pub struct NativeBackend<'a> {
    pub(crate) spec: ModelSpec,
    pub(crate) work: &'a Workload,
    pub(crate) components: Components,
    pub(crate) network: Box<dyn Trainable>,
    workers: Vec<Worker>,
    /// Each training trajectory, and its reflection where the training has reflected examples.
    pub(crate) lives: Vec<Vec<Live>>,
    /// Noise of each component, physical units.
    pub(crate) noise: Vec<f64>,
    /// How many times smaller it may be in an example.
    pub(crate) noise_spread: f64,
    /// First output, number of outputs, and weight of the loss of each predicted field.
    pub(crate) groups: Vec<(usize, usize, f64)>,
    /// Of the training's products, and of its rollouts': the phase of a long rollout holds for one precision alone.
    pub(crate) precision: Precision,
}

impl<'a> NativeBackend<'a> {
    /// For a data set in memory, on this many threads.
    ///
    /// # Errors
    /// [`Error::Model`] for a model that cannot be trained, or a graph that it does not know.
    pub fn new(t: &TrainingConfig, spec: &ModelSpec, work: &'a Workload, threads: usize) -> Result<Self> {
        let components = Components::new(spec);
        let network = trainable(spec, t.precision, None)?;
        let lives = work.train.iter().map(|sample| {
            let mut lives = vec![Live::new(spec, sample.domain.clone(), &sample.structure)?];
            if t.mirror {
                let reflected = sample.structure.reflected(spec);
                lives.push(Live::new(spec, sample.domain.reflected(), &reflected)?);
            }
            Ok(lives)
        });
        Ok(NativeBackend {
            lives: lives.collect::<Result<_>>()?,
            workers: (0..threads.max(1)).map(|_| network.worker()).collect(),
            network,
            noise: t.noise_of(spec, &components),
            noise_spread: t.noise_spread,
            groups: t.groups(spec, &components),
            precision: t.precision,
            spec: spec.clone(),
            work,
            components,
        })
    }

    /// The model with these weights.
    pub fn model(&self, weights: &[f32], normaliser: &Normaliser) -> Model {
        let mut tensors = self.network.layout().unflatten(weights);
        tensors.extend(normaliser.tensors());
        Model { spec: self.spec.clone(), tensors }
    }
}

/// Does `task` for each of n, whoever is free the next one; results in order. A panic becomes an error.
///
/// # Errors
/// Those of the first task that has one.
pub fn share_out<S: Send, R: Send>(
    workers: &mut [S],
    n: usize,
    task: impl Fn(&mut S, usize) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<Result<R>>>> = Mutex::new((0..n).map(|_| None).collect());
    let work = |worker: &mut S| {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= n {
                break;
            }
            let result = catch_unwind(AssertUnwindSafe(|| task(worker, i)))
                .unwrap_or_else(|panic| Err(Error::Internal(panic_text(&*panic).into())));
            if let Ok(mut done) = done.lock() {
                done[i] = Some(result);
            }
        }
    };
    let most = workers.len().min(n.max(1));
    match &mut workers[..most] {
        [own] => work(own),
        [own, others @ ..] => std::thread::scope(|scope| {
            for worker in others {
                // Fewer where the system gives no more.
                let _ = std::thread::Builder::new().spawn_scoped(scope, || work(worker));
            }
            work(own);
        }),
        [] => {}
    }
    let done = done.into_inner().unwrap_or_default();
    done.into_iter()
        .map(|r| r.unwrap_or_else(|| Err(Error::Internal("a training thread ended early".into()))))
        .collect()
}

impl Backend for NativeBackend<'_> {
    fn name(&self) -> String {
        let precision = self.precision.name();
        let isa = engine::Isa::detect();
        let advice = match self.precision == Precision::Bf16 && !isa.bf16_pays() {
            true => "; fp32 is faster on this processor",
            false => "",
        };
        format!("{} threads of the native engine ({precision}, {}{advice})", self.workers.len(), isa.name())
    }

    fn learn(&mut self, weights: &[f32], normaliser: &Normaliser, batch: &Batch) -> Result<Learned> {
        if batch.learn {
            self.network.load(weights)?;
        }
        let scales = normaliser.scales();
        // An example's share of the batch: its piece's, by cells.
        let shares: Vec<f64> = batch
            .examples
            .chunks(batch.micro)
            .flat_map(|piece| {
                let cells = |e: &Example| self.work.train[e.sample].n_cells() as f64;
                let all: f64 = piece.iter().map(cells).sum();
                let part = piece.len() as f64 / batch.total as f64;
                piece.iter().map(move |e| e.weight * part * cells(e) / all)
            })
            .collect();
        let mut workers = std::mem::take(&mut self.workers);
        let pieces = share_out(&mut workers, batch.examples.len(), |worker, i| {
            self.learn_one(worker, &scales, &batch.examples[i], batch, shares[i])
        });
        self.workers = workers;
        Ok(Learned::sum(&self.spec, weights.len(), batch, pieces?))
    }

    fn roll_out(
        &mut self,
        weights: &[f32],
        normaliser: &Normaliser,
        plan: &[Rollout],
    ) -> Result<Vec<Vec<[f64; 2]>>> {
        let model = self.model(weights, normaliser);
        let mut threads = vec![(); self.workers.len()];
        share_out(&mut threads, plan.len(), |_, i| self.roll_one(&model, &plan[i]))
    }
}
