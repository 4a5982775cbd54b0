//! What a worker thread does: gradients of pieces of a batch, and rollouts for validation.

use crate::contact;
use crate::network::{Network, Topology};
use crate::normaliser::Scales;
use crate::rollout::{Boundary, State, Stepper};
use crate::samples::{HostGraph, Sample};
use crate::weights::Weights;
use m4gn_base::Result;
use m4gn_domain::{Components, Domain};
use m4gn_engine::Precision;
use m4gn_engine::backward::{Layout, normal};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::{Batch, Example, Learned, Rollout, TrainingConfig};
use m4gn_model::ModelSpec;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use tch::{Device, Kind, Tensor};

/// Everything a worker needs; each thread has its own, tensors share their storage.
pub struct Learner {
    training: Arc<TrainingConfig>,
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
    groups: Vec<(usize, usize, f64)>,
}

impl Learner {
    /// Puts a worker together.
    pub fn new(
        training: Arc<TrainingConfig>,
        spec: Arc<ModelSpec>,
        train: Vec<Sample>,
        valid: Vec<Sample>,
        frames_a_step: usize,
        device: Device,
    ) -> Self {
        let components = Components::new(&spec);
        let signs: Vec<f32> = components.odd.iter().map(|&odd| if odd { -1.0 } else { 1.0 }).collect();
        Learner {
            layout: Layout::new(&spec),
            stepper: Stepper::new(&spec, &components, device),
            reflect: Tensor::from_slice(&signs).to_device(device),
            noise: training.noise_of(&spec, &components),
            groups: training.groups(&spec, &components),
            training,
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
        Learner::new(
            self.training.clone(),
            self.spec.clone(),
            self.train.clone(),
            self.valid.clone(),
            self.frames_a_step,
            self.device,
        )
    }

    /// The model.
    pub fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    fn half(&self) -> bool {
        self.training.precision == Precision::Bf16
    }

    /// Loss and gradient of a few examples, one union: a piece of a batch.
    ///
    /// Errors: [`Error::Internal`] where libtorch cannot hand out a state.
    pub fn learn(
        &self,
        weights: &[f32],
        normaliser: &Normaliser,
        examples: &[Example],
        batch: &Batch,
    ) -> Result<Learned> {
        let (fixed, boundary) = match examples {
            [one] => {
                let sample = &self.train[one.sample];
                (sample.topologies[usize::from(one.mirror)].clone(), sample.boundary.clone())
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
        if batch.accumulate {
            let next = self.state(examples, 1)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let target = self.stepper.target(&state, &next.cells);
            // The normalisers see the finest graph.
            let of_edges = edges.narrow(0, 0, graph.senders.size()[0]);
            let [inputs, of_edges, target] = [&inputs, &of_edges, &target].map(contact::host);
            moments = Some(Normaliser::of_example(&self.spec, &inputs?, &of_edges?, &target?));
        }
        let mut losses = vec![0.0; self.groups.len()];
        if !batch.learn {
            return Ok(Learned { gradient: None, losses, moments });
        }
        let leaf = Tensor::from_slice(weights).to_device(self.device).set_requires_grad(true);
        let views = Weights::new(&self.layout, &leaf, self.half());
        let network = Network::new(&self.spec.architecture, &views);
        let scales = Scales::new(&normaliser.scales(), self.device);
        let mut total = Tensor::zeros([], (Kind::Float, self.device));
        let mut sums: Vec<Tensor> = Vec::new();
        let weights = self.weights(examples);
        let counts = self.counts(examples);
        for step in 1..=batch.unroll {
            let next = self.state(examples, step)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let output = self.stepper.predict(&network, &graph, (&inputs, &edges), &scales);
            let target = (self.stepper.target(&state, &next.cells) - &scales.output.0) / &scales.output.1;
            let square = (&output - target).square() * &weights;
            for (i, &(first, count, weight)) in self.groups.iter().enumerate() {
                let square = square.narrow(1, first as i64, count as i64);
                let loss = match &counts {
                    Some(counts) => (square * &counts[i]).mean(Kind::Float),
                    None => square.mean(Kind::Float),
                };
                total += &loss * (weight / batch.unroll as f64);
                let loss = loss.detach() / batch.unroll as f64;
                match sums.get_mut(i) {
                    Some(sum) => *sum += loss,
                    None => sums.push(loss),
                }
            }
            if step < batch.unroll {
                let new = self.stepper.advance(&scales, &boundary, &state, &output, &next);
                state = Stepper::without_levels(&domains, new);
                graph = contact::at_state(graph, &domains, &state)?;
                edges = contact::edge_features(&graph, &state);
            }
        }
        total.backward();
        let part = examples.len() as f64 / batch.total as f64;
        losses.iter_mut().zip(&sums).for_each(|(loss, sum)| *loss = part * sum.double_value(&[]));
        Ok(Learned { gradient: Some(contact::host(&(leaf.grad() * part))?), losses, moments })
    }

    /// For each step of a rollout, of each predicted field: the mean squared errors of the model and of holding the first frame.
    ///
    /// Errors: as [`Learner::learn`].
    pub fn roll_out(
        &self,
        weights: &[f32],
        normaliser: &Normaliser,
        rollout: &Rollout,
    ) -> Result<Vec<[f64; 2]>> {
        let sample = &self.valid[rollout.sample];
        // Validation measures the model that is exported, which the engine runs in fp32.
        let flat = Tensor::from_slice(weights).to_device(self.device);
        let views = Weights::new(&self.layout, &flat, false);
        let network = Network::new(&self.spec.architecture, &views);
        let scales = Scales::new(&normaliser.scales(), self.device);
        let read = |step: usize| sample.frame(rollout.frame + step * self.frames_a_step, self.device);
        let domains = [sample.domain(false)];
        // Of each predicted field the nodes that count: those that are not held.
        let free = self.components.predicted().map(|field| {
            let free = (0..).zip(domains[0].free(field)).filter(|(_, free)| *free);
            Tensor::from_slice(&free.map(|(node, _)| node).collect::<Vec<i64>>()).to_device(self.device)
        });
        let free: Vec<Tensor> = free.collect();
        let error = |(field, free): (&[usize], &Tensor), a: &Tensor, b: &Tensor| {
            let physical = |x: &Tensor| {
                let part = x.index_select(0, free).narrow(1, field[0] as i64, field.len() as i64);
                match self.components.floor(field[0]) {
                    Some(floor) => part.exp().clamp_min(floor),
                    None => part,
                }
            };
            (physical(a) - physical(b)).square().mean(Kind::Double).double_value(&[])
        };
        let mut state = read(0)?;
        let mut start = state.cells.shallow_clone();
        let mut errors = Vec::new();
        for step in 1..=rollout.steps {
            let graph = contact::at_state(sample.topologies[0].clone(), &domains, &state)?;
            let edges = contact::edge_features(&graph, &state);
            let next = read(step)?;
            let inputs = self.stepper.inputs(&domains, &state, &next)?;
            let output = self.stepper.predict(&network, &graph, (&inputs, &edges), &scales);
            let new = self.stepper.advance(&scales, &sample.boundary, &state, &output, &next);
            state = Stepper::without_levels(&domains, new);
            let both = |field| [&state.cells, &start].map(|from| error(field, from, &next.cells));
            errors.extend(self.components.predicted().zip(&free).map(both));
            if rollout.single {
                start = next.cells.shallow_clone();
                state = next;
            }
        }
        Ok(errors)
    }

    /// Of each predicted field how much its value at a cell counts in the mean over its example, `[C x 1]`: 0 where it is held, more than 1
    /// elsewhere. None where nothing is held.
    fn counts(&self, examples: &[Example]) -> Option<Vec<Tensor>> {
        let samples: Vec<&Sample> = examples.iter().map(|e| &self.train[e.sample]).collect();
        samples.iter().find(|s| s.boundary.held.is_some())?;
        let of = |field: &[usize]| {
            let parts = samples.iter().map(|s| match &s.boundary.held {
                Some(held) => {
                    let free: Tensor = 1.0 - held.narrow(1, field[0] as i64, 1);
                    let share = free.mean(Kind::Float).clamp_min(1e-12);
                    free / share
                }
                None => Tensor::ones([s.hosts[0].cells as i64, 1], (Kind::Float, self.device)),
            });
            Tensor::cat(&parts.collect::<Vec<_>>(), 0)
        };
        Some(self.components.predicted().map(of).collect())
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
        let read = |e: &Example| -> Result<(Tensor, Tensor)> {
            let frame = e.frame + step * self.frames_a_step;
            let State { cells, boundary } = self.train[e.sample].frame(frame, self.device)?;
            Ok(match e.mirror {
                true => (cells * &self.reflect, boundary * &self.reflect),
                false => (cells, boundary),
            })
        };
        let states = examples.iter().map(read).collect::<Result<Vec<_>>>()?;
        let (cells, boundary): (Vec<Tensor>, Vec<Tensor>) = states.into_iter().unzip();
        Ok(State { cells: Tensor::cat(&cells, 0), boundary: Tensor::cat(&boundary, 0) })
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
                let mut draw = |&std: &f64| if std > 0.0 { (std * normal(&mut rng)) as f32 } else { 0.0 };
                values.extend(self.noise.iter().map(&mut draw));
            }
        }
        let noise = Tensor::from_slice(&values).view_as(&state.cells).to_device(self.device);
        let noise = match &boundary.held {
            Some(held) => noise * (1.0 - &**held),
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
                let owners = &*s.boundary.owners + first;
                first += s.hosts[0].cells as i64;
                owners
            })
            .collect();
        let copies: Vec<&Tensor> = samples.iter().map(|s| &*s.boundary.copies).collect();
        let width = self.components.count as i64;
        let free = |s: &Sample| Tensor::zeros([s.hosts[0].cells as i64, width], (Kind::Float, self.device));
        let held = |s: &&Sample| s.boundary.held.as_deref().map_or_else(|| free(s), Tensor::shallow_clone);
        let held: Option<Vec<Tensor>> =
            samples.iter().any(|s| s.boundary.held.is_some()).then(|| samples.iter().map(held).collect());
        (
            topology,
            Boundary {
                owners: Tensor::cat(&owners, 0).into(),
                copies: Tensor::cat(&copies, 0).into(),
                held: held.map(|held| Tensor::cat(&held, 0).into()),
            },
        )
    }
}
