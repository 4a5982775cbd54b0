//! What a worker thread does: gradients of pieces of a batch, and rollouts for validation.

use crate::config::Config;
use crate::contact;
use crate::network::{Network, Topology};
use crate::normaliser::{Scales, of_example};
use crate::rollout::{Boundary, State, Stepper};
use crate::samples::{HostGraph, Sample};
use crate::weights::Layout;
use m4gn_base::Result;
use m4gn_domain::{Components, Domain};
use m4gn_engine::Precision;
use m4gn_engine::backward::normal;
use m4gn_learn::Example;
use m4gn_learn::normaliser::Normaliser;
use m4gn_model::ModelSpec;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use tch::{Device, Kind, Tensor};

/// Work for one thread.
pub enum Job {
    /// Loss and gradient of a few examples.
    Learn {
        /// Flat weights.
        weights: Tensor,
        /// Normalisers to use.
        normaliser: Normaliser,
        /// The examples, one union.
        examples: Vec<Example>,
        /// Model steps in the loss.
        unroll: usize,
        /// Whether to return what the normalisers need.
        accumulate: bool,
        /// Whether to compute the loss and its gradient.
        learn: bool,
    },
    /// Squared errors of a rollout of a validation trajectory.
    Rollout {
        /// Flat weights.
        weights: Tensor,
        /// Normalisers to use.
        normaliser: Normaliser,
        /// Index of the validation trajectory.
        sample: usize,
        /// First frame.
        frame: usize,
        /// Model steps.
        steps: usize,
    },
}

/// What came of a job.
pub enum Outcome {
    /// Of [`Job::Learn`].
    Learned {
        /// Gradient of the examples' mean loss, `[weights]`.
        gradient: Option<Tensor>,
        /// Mean squared normalised error of each predicted field, over the unrolled steps.
        losses: Vec<f64>,
        /// Moments of these examples.
        moments: Option<Box<Normaliser>>,
        /// Examples in the piece.
        examples: usize,
    },
    /// Of [`Job::Rollout`], as the backend's `roll_out` has them.
    Rolled(Vec<[f64; 2]>),
}

/// Everything a worker needs; each thread has its own, tensors share their storage.
pub struct Learner {
    config: Arc<Config>,
    spec: Arc<ModelSpec>,
    components: Components,
    layout: Layout,
    stepper: Stepper,
    train: Vec<Sample>,
    valid: Vec<Sample>,
    frames_a_step: usize,
    device: Device,
    /// Sign of each component under reflection.
    reflect: Tensor,
    /// Noise of each component, physical units.
    noise: Vec<f64>,
    /// Predicted fields: first output, number of outputs, weight of the loss.
    groups: Vec<(i64, i64, f64)>,
}

impl Learner {
    /// Puts a worker together.
    pub fn new(
        config: Arc<Config>,
        spec: Arc<ModelSpec>,
        train: Vec<Sample>,
        valid: Vec<Sample>,
        frames_a_step: usize,
        device: Device,
    ) -> Self {
        let components = Components::new(&spec);
        let signs: Vec<f32> = components.odd.iter().map(|&odd| if odd { -1.0 } else { 1.0 }).collect();
        let name = |c: &usize| spec.fields[components.field[*c]].name.as_str();
        let noise = (0..components.count)
            .map(|c| {
                if spec.reads(&spec.fields[components.field[c]]) {
                    config.training.noise.get(name(&c)).copied().unwrap_or(0.0)
                } else {
                    0.0
                }
            })
            .collect();
        let mut groups: Vec<(i64, i64, f64)> = Vec::new();
        let mut last = usize::MAX;
        for (row, c) in components.outputs.iter().enumerate() {
            if components.field[*c] == last {
                if let Some(group) = groups.last_mut() {
                    group.1 += 1;
                }
            } else {
                groups.push((
                    row as i64,
                    1,
                    config.training.loss_weights.get(name(c)).copied().unwrap_or(1.0),
                ));
                last = components.field[*c];
            }
        }
        Learner {
            layout: Layout::new(&spec),
            stepper: Stepper::new(&spec, &components, device),
            reflect: Tensor::from_slice(&signs).to_device(device),
            noise,
            groups,
            config,
            spec,
            components,
            train,
            valid,
            frames_a_step,
            device,
        }
    }

    /// Another worker on the same data.
    pub fn share(&self) -> Self {
        let share = |samples: &[Sample]| samples.iter().map(Sample::share).collect();
        Learner::new(
            self.config.clone(),
            self.spec.clone(),
            share(&self.train),
            share(&self.valid),
            self.frames_a_step,
            self.device,
        )
    }

    /// Does a job.
    ///
    /// Errors: [`Error::Internal`] where libtorch cannot hand out a state.
    pub fn run(&self, job: Job) -> Result<Outcome> {
        match job {
            Job::Learn { weights, normaliser, examples, unroll, accumulate, learn } => {
                self.learn(&weights, &normaliser, &examples, unroll, (accumulate, learn))
            }
            Job::Rollout { weights, normaliser, sample, frame, steps } => {
                tch::no_grad(|| self.roll_out(&weights, &normaliser, sample, frame, steps))
            }
        }
    }

    fn half(&self) -> bool {
        self.config.training.precision == Precision::Bf16
    }

    fn learn(
        &self,
        weights: &Tensor,
        normaliser: &Normaliser,
        examples: &[Example],
        unroll: usize,
        (accumulate, learn): (bool, bool),
    ) -> Result<Outcome> {
        let (fixed, boundary) = match examples {
            [one] => {
                let sample = &self.train[one.sample];
                (sample.topologies[usize::from(one.mirror)].share(), sample.boundary())
            }
            _ => self.union(examples),
        };
        let domains: Vec<&dyn Domain> =
            examples.iter().map(|e| self.train[e.sample].domain(e.mirror)).collect();
        let mut state = self.state(examples, 0)?;
        self.add_noise(examples, &boundary, &mut state);
        let mut graph = contact::at_state(fixed, &domains, &state)?;
        let mut edges = contact::edge_features(&graph, &state);
        let mut moments = None;
        if accumulate {
            let next = self.state(examples, 1)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let target = self.stepper.target(&state, &next.cells);
            // The normalisers see the finest graph.
            let of_edges = edges.narrow(0, 0, graph.senders.size()[0]);
            moments = Some(Box::new(of_example(&self.spec, [&inputs, &of_edges, &target])?));
        }
        if !learn {
            return Ok(Outcome::Learned {
                gradient: None,
                losses: vec![0.0; self.groups.len()],
                moments,
                examples: examples.len(),
            });
        }
        let leaf = weights.detach().set_requires_grad(true);
        let views = self.layout.views(&leaf, self.half());
        let network = Network::new(&self.spec.architecture, &views);
        let scales = Scales::new(normaliser, self.device);
        let mut total = Tensor::zeros([], (Kind::Float, self.device));
        let mut losses = Vec::new();
        let weights = self.weights(examples);
        for step in 1..=unroll {
            let next = self.state(examples, step)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let output = self.stepper.predict(&network, &graph, (&inputs, &edges), &scales);
            let target = (self.stepper.target(&state, &next.cells) - &scales.output.0) / &scales.output.1;
            let square = (&output - target).square() * &weights;
            for (i, &(first, count, weight)) in self.groups.iter().enumerate() {
                let loss = square.narrow(1, first, count).mean(Kind::Float);
                total += &loss * (weight / unroll as f64);
                let loss = loss.detach() / unroll as f64;
                match losses.get_mut(i) {
                    Some(sum) => *sum += loss,
                    None => losses.push(loss),
                }
            }
            if step < unroll {
                state = self.stepper.advance(&scales, &boundary, &state, &output, &next);
                graph = contact::at_state(graph, &domains, &state)?;
                edges = contact::edge_features(&graph, &state);
            }
        }
        total.backward();
        Ok(Outcome::Learned {
            gradient: Some(leaf.grad()),
            losses: losses.iter().map(|l| l.double_value(&[])).collect(),
            moments,
            examples: examples.len(),
        })
    }

    fn roll_out(
        &self,
        weights: &Tensor,
        normaliser: &Normaliser,
        sample: usize,
        frame: usize,
        steps: usize,
    ) -> Result<Outcome> {
        let sample = &self.valid[sample];
        // Validation measures the model that is exported, which the engine runs in fp32.
        let views = self.layout.views(weights, false);
        let network = Network::new(&self.spec.architecture, &views);
        let scales = Scales::new(normaliser, self.device);
        let boundary = sample.boundary();
        let read = |step: usize| -> Result<State> {
            let (cells, boundary) = sample.frame(frame + step * self.frames_a_step, self.device)?;
            Ok(State { cells, boundary })
        };
        let error = |field: &[usize], a: &Tensor, b: &Tensor| {
            let physical = |x: &Tensor| {
                let part = x.narrow(1, field[0] as i64, field.len() as i64);
                match self.components.floor(field[0]) {
                    Some(floor) => part.exp().clamp_min(floor),
                    None => part,
                }
            };
            (physical(a) - physical(b)).square().mean(Kind::Double).double_value(&[])
        };
        let mut state = read(0)?;
        let start = state.cells.shallow_clone();
        let mut errors = Vec::new();
        let domains = [sample.domain(false)];
        for step in 1..=steps {
            let graph = contact::at_state(sample.topologies[0].share(), &domains, &state)?;
            let edges = contact::edge_features(&graph, &state);
            let next = read(step)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let output = self.stepper.predict(&network, &graph, (&inputs, &edges), &scales);
            state = self.stepper.advance(&scales, &boundary, &state, &output, &next);
            let both = |field| [&state.cells, &start].map(|from| error(field, from, &next.cells));
            errors.extend(self.components.predicted().map(both));
        }
        Ok(Outcome::Rolled(errors))
    }

    /// The examples' weights, one a cell.
    fn weights(&self, examples: &[Example]) -> Tensor {
        let cells = examples.iter().map(|e| {
            let n = self.train[e.sample].hosts[0].cells as i64;
            Tensor::full([n, 1], e.weight, (Kind::Float, self.device))
        });
        Tensor::cat(&cells.collect::<Vec<_>>(), 0)
    }

    /// The examples' recorded fields, `step` model steps after their first frame, reflected where asked.
    fn state(&self, examples: &[Example], step: usize) -> Result<State> {
        let (mut cells, mut boundary) = (Vec::new(), Vec::new());
        for e in examples {
            let frame = e.frame + step * self.frames_a_step;
            let (c, b) = self.train[e.sample].frame(frame, self.device)?;
            let (c, b) = match e.mirror {
                true => (c * &self.reflect, b * &self.reflect),
                false => (c, b),
            };
            cells.push(c);
            boundary.push(b);
        }
        Ok(match (&cells[..], &boundary[..]) {
            ([c], [b]) => State { cells: c.shallow_clone(), boundary: b.shallow_clone() },
            _ => State { cells: Tensor::cat(&cells, 0), boundary: Tensor::cat(&boundary, 0) },
        })
    }

    /// Noise on the cells' inputs; boundary nodes that copy their owner copy the noise.
    fn add_noise(&self, examples: &[Example], boundary: &Boundary, state: &mut State) {
        if self.noise.iter().all(|&n| n == 0.0) {
            return;
        }
        let mut values = Vec::with_capacity(state.cells.numel());
        for example in examples {
            let mut rng = ChaCha8Rng::seed_from_u64(example.seed);
            for _ in 0..self.train[example.sample].hosts[0].cells {
                values.extend(
                    self.noise.iter().map(
                        |&std| {
                            if std > 0.0 { (std * normal(&mut rng)) as f32 } else { 0.0 }
                        },
                    ),
                );
            }
        }
        let noise = Tensor::from_slice(&values).view_as(&state.cells).to_device(self.device);
        let noise = match &boundary.held {
            Some(held) => noise * (1.0 - held),
            None => noise,
        };
        state.cells = &state.cells + noise;
        state.boundary =
            Stepper::boundary_values(&state.cells, &boundary.owners, &boundary.copies, &state.boundary);
    }

    /// Several graphs as one, with their boundary nodes.
    fn union(&self, examples: &[Example]) -> (Topology, Boundary) {
        let samples: Vec<&Sample> = examples.iter().map(|e| &self.train[e.sample]).collect();
        let hosts: Vec<&HostGraph> =
            examples.iter().zip(&samples).map(|(e, s)| &*s.hosts[usize::from(e.mirror)]).collect();
        let topology = HostGraph::union(&hosts, &self.spec, self.device);
        let mut first = 0;
        let owners: Vec<Tensor> = samples
            .iter()
            .map(|s| {
                let owners = &s.owners + first;
                first += s.hosts[0].cells as i64;
                owners
            })
            .collect();
        let copies: Vec<&Tensor> = samples.iter().map(|s| &s.copies).collect();
        let free = |s: &Sample| Tensor::zeros([s.hosts[0].cells as i64, 1], (Kind::Float, self.device));
        let held = |s: &&Sample| s.held.as_ref().map_or_else(|| free(s), Tensor::shallow_clone);
        let held: Option<Vec<Tensor>> =
            samples.iter().any(|s| s.held.is_some()).then(|| samples.iter().map(held).collect());
        (
            topology,
            Boundary {
                owners: Tensor::cat(&owners, 0),
                copies: Tensor::cat(&copies, 0),
                held: held.map(|held| Tensor::cat(&held, 0)),
            },
        )
    }
}
