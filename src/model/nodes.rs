//! What a kind of domain makes of a network's inputs: another kind is another value of [`Nodes`].

use crate::{FieldSpec, ModelSpec, N_CONTACT_INPUTS, Precision};
use m4gn_mesh::NodeType;

/// The nodes of a model's domain.
pub(crate) struct Nodes {
    /// Type of the nodes whose fields are predicted.
    pub predicted: NodeType,
    /// What they are called.
    pub name: &'static str,
    /// Inputs beside the fields.
    pub n_inputs: usize,
    /// Vectors an edge has, each with its length, and flags.
    pub edge: [usize; 2],
    /// Whether edges carry the first field: the network sees it, and its change can be predicted, where it is no input.
    pub carried: bool,
    /// In what is computed where not in the precision of the training.
    pub precision: Option<Precision>,
}

/// Fields at the cells of a mesh that does not move.
const CELLS: Nodes = Nodes {
    predicted: NodeType::Fluid,
    name: "cells",
    n_inputs: 0,
    edge: [1, 0],
    carried: false,
    precision: None,
};

/// Bodies at points that an obstacle may touch.
const POINTS: Nodes = Nodes {
    predicted: NodeType::Body,
    name: "points",
    n_inputs: N_CONTACT_INPUTS,
    edge: [3, 1],
    carried: true,
    precision: Some(Precision::Fp32),
};

impl ModelSpec {
    /// What its nodes are.
    pub(crate) fn nodes(&self) -> Nodes {
        match self.contact {
            Some(_) => POINTS,
            None => CELLS,
        }
    }

    /// What `precision model` computes in where the processor is fast in it: that of the training. Of bodies fp32, since no phase
    /// hangs on it and ranks agree to rounding in it.
    pub fn precision_of_runs(&self) -> Precision {
        self.nodes().precision.unwrap_or(self.precision)
    }

    /// Features that change with time: of the fields that are inputs, then those of the obstacle where the model knows contact.
    pub fn n_field_inputs(&self) -> usize {
        let inputs = self.fields.iter().filter(|f| f.input);
        let fields: usize = inputs.map(|f| f.components(self.dim)).sum();
        fields + self.nodes().n_inputs
    }

    /// Edge features: displacement from receiver to sender in the solved directions, and its length. With contact that of an edge of
    /// the mesh at rest, what the deformation has added, that of a world edge at present, and 1 for a world edge (table 2 says the
    /// same in two vectors, at rest and at present).
    pub fn n_edge_features(&self) -> usize {
        let [vectors, flags] = self.nodes().edge;
        vectors * (self.dim + 1) + flags
    }

    /// Whether the network sees a field: as an input, or, of bodies, through the edges, which the displacement moves.
    pub fn reads(&self, field: &FieldSpec) -> bool {
        field.input || self.nodes().carried
    }
}
