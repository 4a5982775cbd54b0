//! A model on libtorch for one graph: the core crate's `backend torch`, and the reference of its tests.

use crate::network::{Network, Topology};
use crate::samples::HostGraph;
use crate::weights::{Layout, Weights};
use m4gn_base::{Error, Result};
use m4gn_model::{Model, ModelSpec};
use m4gn_structure::Structure;
use tch::{Device, Tensor};

/// A loaded model, its graph and its normalisers.
pub struct Inference {
    spec: ModelSpec,
    weights: Weights,
    graph: Topology,
    /// Normalised edge features.
    edges: Tensor,
    /// Mean and deviation of inputs and outputs.
    node: (Tensor, Tensor),
    output: (Tensor, Tensor),
    device: Device,
}

impl Inference {
    /// Takes a copy of a model and of a serial structure.
    ///
    /// Errors: [`Error::Model`] where the structure does not fit the model.
    pub fn new(model: &Model, structure: &Structure, device: Device) -> Result<Self> {
        let (spec, graph) = (model.spec.clone(), &structure.graph);
        let expected = graph.senders.len() * spec.n_edge_features();
        if graph.edge_features.len() != expected {
            return Err(Error::Model(format!(
                "{} edge features for {} edges: the model needs {} an edge, it is for {} directions",
                graph.edge_features.len(),
                graph.senders.len(),
                spec.n_edge_features(),
                spec.dim
            )));
        }
        let layout = Layout::new(&spec);
        let flat = Tensor::from_slice(&layout.flatten(model)?).to_device(device);
        let scale = |name: &str| -> Result<(Tensor, Tensor)> {
            let part = |which: &str| {
                let name = format!("norm.{name}.{which}");
                let tensor = model
                    .tensors
                    .get(&name)
                    .ok_or_else(|| Error::Model(format!("the model has no tensor `{name}`")))?;
                Ok::<Tensor, Error>(Tensor::from_slice(&tensor.data).to_device(device))
            };
            Ok((part("mean")?, part("std")?))
        };
        let graph = HostGraph::union(&[&HostGraph::new(structure, &spec)?], &spec, device);
        let edge = scale("edge")?;
        Ok(Inference {
            weights: layout.views(&flat, false),
            edges: (&graph.edges - edge.0) / edge.1,
            graph,
            node: scale("node")?,
            output: scale("output")?,
            spec,
            device,
        })
    }

    /// Lengths of the inputs and outputs of a step.
    pub fn lengths(&self) -> (usize, usize) {
        (
            self.graph.nodes as usize * self.spec.n_field_inputs(),
            self.graph.cells as usize * self.spec.n_outputs(),
        )
    }

    /// Physical inputs `[N x inputs]` to physical outputs `[C x outputs]`, changes not added.
    pub fn step(&self, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        if (inputs.len(), outputs.len()) != self.lengths() {
            let (n, m) = self.lengths();
            return Err(Error::Input(format!(
                "{} inputs and {} outputs, expected {n} and {m}",
                inputs.len(),
                outputs.len()
            )));
        }
        let result = tch::no_grad(|| {
            let fields = Tensor::from_slice(inputs).view([self.graph.nodes, -1]).to_device(self.device);
            let fields = (fields - &self.node.0) / &self.node.1;
            let network = Network::new(&self.spec.architecture, &self.weights);
            network.forward(&self.graph, &fields, &self.edges) * &self.output.1 + &self.output.0
        });
        let result = result.to_device(Device::Cpu).contiguous();
        result.f_copy_data(outputs, outputs.len()).map_err(|e| Error::Internal(e.to_string()))
    }
}
