//! A model on libtorch for one graph: the core crate's `backend torch`, and the reference of its tests.

use crate::network::{Network, Topology};
use crate::normaliser::Scales;
use crate::samples::HostGraph;
use crate::weights::Weights;
use m4gn_base::{Error, Result};
use m4gn_engine::backward::Layout;
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
    scales: Scales,
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
        let scales = Scales::new(&m4gn_engine::backward::Scales::of_model(model)?, device);
        let graph = HostGraph::union(&[&HostGraph::new(structure, &spec)?], &spec, device);
        Ok(Inference {
            weights: Weights::new(&layout, &flat, false),
            edges: (&*graph.edges - &scales.edge.0) / &scales.edge.1,
            graph,
            scales,
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

    /// Physical inputs `[N x inputs]` to physical outputs `[C x outputs]`, changes not added; both as long as [`Inference::lengths`] says.
    pub fn step(&self, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        let result = tch::no_grad(|| {
            let fields = Tensor::from_slice(inputs).view([self.graph.nodes, -1]).to_device(self.device);
            let fields = (fields - &self.scales.node.0) / &self.scales.node.1;
            let network = Network::new(&self.spec.architecture, &self.weights);
            let outputs = network.forward(&self.graph, &fields, &self.edges);
            outputs * &self.scales.output.1 + &self.scales.output.0
        });
        let result = result.to_device(Device::Cpu).contiguous();
        result.f_copy_data(outputs, outputs.len()).map_err(|e| Error::Internal(e.to_string()))
    }
}
