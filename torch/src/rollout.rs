//! One model step on physical fields, and the states it runs through: what training unrolls and validation rolls out.

use crate::contact;
use crate::network::{Network, Topology};
use crate::normaliser::Scales;
use crate::shared::Shared;
use m4gn_base::Result;
use m4gn_domain::{Components, Domain};
use m4gn_model::{ModelSpec, Output};
use tch::{Device, Tensor};

/// Physical values of all fields at one time.
pub struct State {
    /// `[C x components]`.
    pub cells: Tensor,
    /// `[B x components]`.
    pub boundary: Tensor,
}

/// Boundary nodes of a union of graphs.
#[derive(Clone)]
pub struct Boundary {
    /// Owner cell of each boundary node, `[B]`.
    pub owners: Shared,
    /// 1 where the value is the owner's, 0 where it is prescribed, `[B x components]`.
    pub copies: Shared,
    /// 1 for values of points that are prescribed, `[C x components]`; none where all are predicted.
    pub held: Option<Shared>,
}

/// Index tensors and masks over components, made once.
pub struct Stepper {
    inputs: Option<Tensor>,
    /// `[outputs x components]`, 1 where an output is a component; none where they are the same list.
    spread: Option<Tensor>,
    outputs: Option<Tensor>,
    /// 1 for components whose change is predicted, `[components]`.
    delta: Tensor,
    /// The same, of outputs, `[outputs]`.
    delta_output: Tensor,
    /// 1 for components that are not predicted, `[components]`; none where all are.
    given: Option<Tensor>,
}

impl Stepper {
    /// For the fields of a model.
    pub fn new(spec: &ModelSpec, components: &Components, device: Device) -> Self {
        let all: Vec<usize> = (0..components.count).collect();
        let list = |part: &[usize]| {
            (part != all.as_slice()).then(|| {
                Tensor::from_slice(&part.iter().map(|&i| i as i64).collect::<Vec<_>>()).to_device(device)
            })
        };
        let mask = |wanted: Output, of: &[usize]| {
            let values: Vec<f32> = of
                .iter()
                .map(|&c| if spec.fields[components.field[c]].output == wanted { 1.0 } else { 0.0 })
                .collect();
            Tensor::from_slice(&values).to_device(device)
        };
        let same = components.outputs == all;
        let mut spread = vec![0f32; components.outputs.len() * components.count];
        for (row, &c) in components.outputs.iter().enumerate() {
            spread[row * components.count + c] = 1.0;
        }
        Stepper {
            inputs: list(&components.inputs),
            outputs: list(&components.outputs),
            spread: (!same)
                .then(|| Tensor::from_slice(&spread).view([-1, components.count as i64]).to_device(device)),
            delta: mask(Output::Delta, &all),
            delta_output: mask(Output::Delta, &components.outputs),
            given: (!same).then(|| mask(Output::None, &all)),
        }
    }

    /// Physical node inputs `[N x inputs]`. Where the domains move they come of both states.
    ///
    /// Errors: [`m4gn_base::Error::Internal`] where a state cannot be read.
    pub fn inputs(&self, domains: &[&dyn Domain], state: &State, next: &State) -> Result<Tensor> {
        if domains.iter().any(|d| d.moves()) {
            return contact::node_inputs(domains, state, next);
        }
        let all = Tensor::cat(&[&state.cells, &state.boundary], 0);
        Ok(match &self.inputs {
            Some(index) => all.index_select(1, index),
            None => all,
        })
    }

    /// Physical outputs that lead exactly to `next`, `[C x outputs]`: changes from the present state (with its
    /// noise), or values.
    pub fn target(&self, state: &State, next: &Tensor) -> Tensor {
        let pick = |t: &Tensor| match &self.outputs {
            Some(index) => t.index_select(1, index),
            None => t.shallow_clone(),
        };
        pick(next) - pick(&state.cells) * &self.delta_output
    }

    /// Normalised outputs of the network, `[C x outputs]`. `inputs` and `edges` are physical node inputs and edge features.
    pub fn predict(
        &self,
        network: &Network,
        graph: &Topology,
        (inputs, edges): (&Tensor, &Tensor),
        scales: &Scales,
    ) -> Tensor {
        let fields = (inputs - &scales.node.0) / &scales.node.1;
        let edges = (edges - &scales.edge.0) / &scales.edge.1;
        network.forward(graph, &fields, &edges)
    }

    /// The state one step later. `next` holds what is prescribed at the new time: fields that are not predicted
    /// and boundary values.
    pub fn advance(
        &self,
        scales: &Scales,
        boundary: &Boundary,
        state: &State,
        output: &Tensor,
        next: &State,
    ) -> State {
        let physical = output * &scales.output.1 + &scales.output.0;
        let physical = match &self.spread {
            Some(spread) => physical.matmul(spread),
            None => physical,
        };
        let mut cells = &state.cells * &self.delta + physical;
        let mut copies = boundary.copies.shallow_clone();
        if let Some(given) = &self.given {
            cells += &next.cells * given;
            copies = &copies * (1.0 - given);
        }
        if let Some(held) = &boundary.held {
            cells = &cells + (&next.cells - &cells) * &**held;
        }
        let boundary = Self::boundary_values(&cells, &boundary.owners, &copies, &next.boundary);
        State { cells, boundary }
    }

    /// The state without the levels of its pressures, as [`Domain::take_level_off`] has it, part by part of the union.
    pub fn without_levels(domains: &[&dyn Domain], state: State) -> State {
        if domains.iter().all(|d| d.levels().is_none()) {
            return state;
        }
        let (mut cells, mut boundary) = (Vec::new(), Vec::new());
        let (mut first_cell, mut first_face) = (0, 0);
        for domain in domains {
            let faces = domain.boundary().owners().count() as i64;
            let inner = domain.boundary().n_inner as i64;
            let of_cells = state.cells.narrow(0, first_cell, inner);
            let of_faces = state.boundary.narrow(0, first_face, faces);
            (first_cell, first_face) = (first_cell + inner, first_face + faces);
            let width = of_cells.size()[1];
            let mut shift = Tensor::zeros([1, width], (of_cells.kind(), of_cells.device()));
            for (column, level) in
                domain.levels().iter().flat_map(|(c, level)| c.iter().map(move |c| (*c, level)))
            {
                let at = |t: &Tensor| t.select(1, column as i64);
                let value = match (level.outlets(), level.volumes()) {
                    (_, Some(volumes)) => {
                        let whole = volumes.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                        let shares: Vec<f32> = volumes.iter().map(|v| (v / whole) as f32).collect();
                        (at(&of_cells) * Tensor::from_slice(&shares).to_device(of_cells.device()))
                            .sum(None::<tch::Kind>)
                    }
                    (outlets, None) => {
                        let outlets: Vec<i64> = outlets.iter().map(|&face| face as i64).collect();
                        let outlets = Tensor::from_slice(&outlets).to_device(of_faces.device());
                        let values = at(&of_faces).index_select(0, &outlets);
                        (values.max() + values.min()) * 0.5
                    }
                };
                let mut one = vec![0f32; width as usize];
                one[column] = 1.0;
                shift += Tensor::from_slice(&one).to_device(of_cells.device()) * value;
            }
            cells.push(of_cells - &shift);
            boundary.push(of_faces - &shift);
        }
        State { cells: Tensor::cat(&cells, 0), boundary: Tensor::cat(&boundary, 0) }
    }

    /// Boundary values for cell values: the owner's, or prescribed.
    pub fn boundary_values(cells: &Tensor, owners: &Tensor, copies: &Tensor, prescribed: &Tensor) -> Tensor {
        prescribed + (cells.index_select(0, owners) - prescribed) * copies
    }
}
