//! Bodies at points: world edges, edge features and node inputs for a displacement; edge features are differentiable in it.

use crate::network::Topology;
use crate::rollout::State;
use m4gn_domain::Domain;
use m4gn_domain::body::Body;
use m4gn_mesh::{Error, Result};
use m4gn_model::N_CONTACT_INPUTS;
use tch::{Device, Kind, Tensor};

/// The graphs of a union with the world edges at a state instead of those they had: `bodies` are the union's, in its
/// order; none for graphs at cells, which stay as they are.
///
/// Errors: [`Error::Internal`] where a state cannot be read.
pub fn at_state(graph: Topology, bodies: &[&Body], state: &State) -> Result<Topology> {
    if bodies.is_empty() {
        return Ok(graph);
    }
    let (cells, boundary) = (host(&state.cells)?, host(&state.boundary)?);
    let (mut senders, mut receivers, mut rest) = (Vec::<i64>::new(), Vec::<i64>::new(), Vec::<f32>::new());
    let (mut cell, mut face) = (0, 0);
    for body in bodies {
        let (n, all) = (body.n_points(), body.n_owned());
        let mut displacement = cells[3 * cell..3 * (cell + n)].to_vec();
        displacement.extend_from_slice(&boundary[3 * face..3 * (face + all - n)]);
        let place = |node: i32| match (node as usize).checked_sub(n) {
            None => (cell + node as usize) as i64,
            Some(point) => graph.cells + (face + point) as i64,
        };
        for edge in body.world_edges(&displacement) {
            senders.push(place(edge.sender));
            receivers.push(place(edge.receiver));
            rest.extend(edge.rest.map(|v| v as f32));
        }
        cell += n;
        face += all - n;
    }
    let device = graph.edges.device();
    // The mesh's edges stand first.
    let first: i64 = bodies.iter().map(|b| b.mesh_edges().len() as i64).sum();
    let append =
        |old: &Tensor, new: Tensor| Tensor::cat(&[old.narrow(0, 0, first), new.to_device(device)], 0);
    let count = senders.len() as i64;
    let flags = Tensor::ones([count, 1], (Kind::Float, Device::Cpu));
    Ok(Topology {
        senders: append(&graph.senders, Tensor::from_slice(&senders)),
        receivers: append(&graph.receivers, Tensor::from_slice(&receivers)),
        edges: append(&graph.edges, Tensor::from_slice(&rest).view([count, 3])),
        is_world: graph.is_world.as_ref().map(|old| append(old, flags)),
        ..graph
    })
}

/// Physical features of all edges at a state `[E x 13]`, as [`Body`] has them; what the graph holds
/// where the nodes do not move.
pub fn edge_features(graph: &Topology, state: &State) -> Tensor {
    let Some(is_world) = &graph.is_world else {
        return graph.edges.shallow_clone();
    };
    let u = Tensor::cat(&[&state.cells, &state.boundary], 0);
    let added = u.index_select(0, &graph.senders) - u.index_select(0, &graph.receivers);
    let (rest, now) = (&graph.edges, &graph.edges + &added);
    let sum = |v: Tensor| v.sum_dim_intlist(Some(&[1i64][..]), true, Kind::Float);
    let length = |v: &Tensor| sum(v.square()).sqrt();
    let longer =
        sum(&added * (&now + rest)) / (length(&now) + length(rest)).clamp_min(f64::from(f32::MIN_POSITIVE));
    let of_mesh = Tensor::cat(&[rest, &length(rest), &added, &longer], 1) * (1.0 - is_world);
    let of_world = Tensor::cat(&[&now, &length(&now)], 1) * is_world;
    Tensor::cat(&[&of_mesh, &of_world, is_world], 1)
}

/// Physical node inputs of bodies between two states `[N x 8]`, as [`Body`] has them; no derivative goes through them.
///
/// Errors: [`Error::Internal`] where a state cannot be read.
pub fn node_inputs(bodies: &[&Body], state: &State, next: &State) -> Result<Tensor> {
    let (cells, boundary, after) = (host(&state.cells)?, host(&state.boundary)?, host(&next.boundary)?);
    let (mut of_points, mut of_obstacles, mut own) = (Vec::<f32>::new(), Vec::<f32>::new(), Vec::new());
    let (mut cell, mut face) = (0, 0);
    for body in bodies {
        let (n, all) = (body.n_points(), body.n_owned());
        let rows = 3 * face..3 * (face + all - n);
        let points = &cells[3 * cell..3 * (cell + n)];
        let state = |obstacle: &[f32]| [points, &obstacle[rows.clone()]].concat();
        body.inputs(&state(&boundary), &state(&after), &mut own);
        of_points.extend_from_slice(&own[..n * N_CONTACT_INPUTS]);
        of_obstacles.extend_from_slice(&own[n * N_CONTACT_INPUTS..]);
        cell += n;
        face += all - n;
    }
    of_points.extend(of_obstacles);
    let inputs = Tensor::from_slice(&of_points).view([-1, N_CONTACT_INPUTS as i64]);
    Ok(inputs.to_device(state.cells.device()))
}

/// The numbers of a tensor, row by row.
///
/// Errors: [`Error::Internal`] where it cannot be read.
pub fn host(t: &Tensor) -> Result<Vec<f32>> {
    let flat = t.detach().to_device(Device::Cpu).contiguous().view([-1]);
    Vec::<f32>::try_from(flat).map_err(|e| Error::Internal(format!("a state cannot be read: {e}")))
}
