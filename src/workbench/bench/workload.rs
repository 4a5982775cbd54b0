//! A network, a graph, and the programs that run one on the other.

use super::{hexahedra, o_mesh_structure};
use m4gn_base::{Error, Result};
use m4gn_engine::torch::TorchBackend;
use m4gn_engine::{Engine, EngineOptions};
use m4gn_mesh::Mesh;
use m4gn_model::Model;
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;
use rand::{RngExt, SeedableRng};
use serde_json::{Value, json};

/// Where the graph comes from.
#[derive(Debug)]
pub enum Source {
    /// An O-mesh of triangles of about so many nodes.
    OMesh(usize),
    /// The cells and boundary faces of a mesh.
    Mesh(Box<Mesh>),
}

impl Source {
    /// A made graph of about so many nodes: of a cube of hexahedra, or an O-mesh.
    ///
    /// # Errors
    /// [`Error::Input`] for a number whose graph cannot be numbered.
    pub fn made(nodes: usize, hex: bool) -> Result<Self> {
        match hex {
            true => Ok(Source::Mesh(Box::new(hexahedra(nodes)?))),
            false => Ok(Source::OMesh(nodes)),
        }
    }

    /// Solved directions.
    pub fn dim(&self) -> usize {
        match self {
            Source::OMesh(_) => 2,
            Source::Mesh(mesh) => mesh.dim(),
        }
    }
}

/// A network and what it is run on.
pub struct Workload {
    /// The network.
    pub model: Model,
    /// What it is run on.
    pub source: Source,
    /// This process alone.
    pub comm: Comm,
}

impl Workload {
    /// What the network lives on.
    ///
    /// # Errors
    /// What makes them.
    pub fn structure(&self) -> Result<Structure> {
        let spec = &self.model.spec;
        match &self.source {
            Source::OMesh(nodes) => o_mesh_structure(spec, *nodes, &self.comm),
            Source::Mesh(mesh) => {
                let modal = Modal(spec.segments.modal());
                Structure::new(mesh, spec, &spec.segments, &modal, None, &self.comm)
            }
        }
    }

    /// The native engine on a structure.
    ///
    /// # Errors
    /// As [`Engine::new`].
    pub fn engine(&self, structure: &Structure, options: &EngineOptions) -> Result<Engine> {
        Engine::new(&self.model, structure, options)
    }

    /// The model on libtorch, which takes its number of threads from the environment when it is loaded.
    ///
    /// # Errors
    /// As [`TorchBackend::new`]; [`Error::Input`] where the environment says another number.
    pub fn torch(&self, structure: &Structure, device: Option<&str>, threads: usize) -> Result<TorchBackend> {
        if std::env::var("OMP_NUM_THREADS").ok().as_deref() != Some(&threads.to_string()) {
            return Err(Error::Input(format!(
                "backend torch takes its threads from the environment: set OMP_NUM_THREADS={threads}"
            )));
        }
        let lengths = self.lengths(&structure.graph);
        TorchBackend::new(&self.model, structure, lengths, device, &self.comm)
    }

    /// Lengths of the inputs and the outputs of a step.
    fn lengths(&self, graph: &Graph) -> (usize, usize) {
        let spec = &self.model.spec;
        (graph.n_owned * spec.n_field_inputs(), graph.n_cells * spec.n_outputs())
    }

    /// Physical inputs of the size that the model was trained on, and room for the outputs.
    ///
    /// # Errors
    /// None for a model that was checked.
    pub fn values(&self, graph: &Graph) -> Result<(Vec<f32>, Vec<f32>)> {
        let mean = &self.model.tensor("norm.node.mean")?.data;
        let std = &self.model.tensor("norm.node.std")?.data;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let ((n, m), k) = (self.lengths(graph), mean.len().max(1));
        let inputs = (0..n).map(|i| mean[i % k] + std[i % k] * rng.random_range(-1.7f32..1.7));
        Ok((inputs.collect(), vec![0.0; m]))
    }

    fn parameters(&self) -> usize {
        let weights = self.model.tensors.iter().filter(|(name, _)| !name.starts_with("norm."));
        weights.map(|(_, t)| t.data.len()).sum()
    }

    /// Sizes of the network and its graph, for people and programs.
    pub fn describe(&self, graph: &Graph) -> Value {
        let a = &self.model.spec.architecture;
        json!({
            "nodes": graph.n_owned, "cells": graph.n_cells, "edges": graph.senders.len(),
            "parameters": self.parameters(), "width": a.width, "hidden_layers": a.hidden_layers,
            "layers": a.layers(),
        })
    }
}
