//! A network on a domain, which sessions and rollouts of trainings step with.

use m4gn_base::Result;
use m4gn_domain::{Domain, Predict};
use m4gn_engine::Forward;
use m4gn_model::ModelSpec;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;

/// A network on what it lives on.
pub struct Stepper {
    network: Box<dyn Forward>,
    /// Of a domain whose edges move, with those of the last state.
    moving: Option<Structure>,
    inputs: Vec<f32>,
    outputs: Vec<f32>,
}

impl Stepper {
    /// Of a network that was made on the structure.
    pub fn new(
        domain: &dyn Domain,
        structure: &Structure,
        spec: &ModelSpec,
        network: Box<dyn Forward>,
    ) -> Self {
        let graph = &structure.graph;
        Stepper {
            network,
            inputs: Vec::with_capacity(graph.n_owned * spec.n_field_inputs()),
            outputs: vec![0.0; graph.n_cells * spec.n_outputs()],
            moving: domain.moves().then(|| structure.graphs()),
        }
    }

    /// The network's outputs in the last step.
    pub fn outputs(&self) -> &[f32] {
        &self.outputs
    }
}

impl Predict for Stepper {
    fn predict(
        &mut self,
        comm: &Comm,
        domain: &dyn Domain,
        state: &mut [f32],
        next: &[f32],
    ) -> Result<&[f32]> {
        if let Some(structure) = &mut self.moving {
            domain.set_edges(comm, state, structure)?;
            comm.agree(self.network.set_edges(structure))?;
        }
        domain.inputs(state, next, &mut self.inputs);
        let done = self.network.forward(comm, &self.inputs, &mut self.outputs);
        match &self.moving {
            Some(_) => comm.agree(done)?,
            // The ranks agree on it with what becomes of the outputs.
            None => done?,
        }
        Ok(&self.outputs)
    }
}
