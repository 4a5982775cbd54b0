//! Domains whose edges come and go: world edges, edge features and node inputs for a displacement; edge features are differentiable
//! in it.

use crate::network::{Links, Topology, pick, sum_into};
use crate::rollout::State;
use m4gn_base::{Error, Result};
use m4gn_domain::Domain;
use tch::{Device, Kind, Tensor};

/// The graphs of a union with the world edges at a state instead of those they had; graphs that stay are as they were. `domains` are
/// the union's, in its order.
///
/// Errors: [`Error::Internal`] where a state cannot be read.
pub fn at_state(graph: Topology, domains: &[&dyn Domain], state: &State) -> Result<Topology> {
    let Some(is_world) = &graph.is_world else {
        return Ok(graph);
    };
    let (mut senders, mut receivers, mut rest) = (Vec::<i64>::new(), Vec::<i64>::new(), Vec::<f32>::new());
    let states = each_state(domains, &state.cells, &state.boundary)?;
    let (mut cell, mut face) = (0, 0);
    for (domain, state) in domains.iter().zip(states) {
        let n = domain.boundary().n_inner;
        let place = |node: i32| match (node as usize).checked_sub(n) {
            None => (cell + node as usize) as i64,
            Some(point) => graph.cells + (face + point) as i64,
        };
        for edge in domain.world_edges(&state) {
            senders.push(place(edge.sender));
            receivers.push(place(edge.receiver));
            rest.extend(edge.rest.map(|v| v as f32));
        }
        cell += n;
        face += domain.boundary().owners().count();
    }
    let device = graph.edges.device();
    // The mesh's edges stand first, those of coarser graphs last.
    let first: i64 = domains.iter().filter_map(|d| d.mesh_edges()).map(|edges| edges.len() as i64).sum();
    let count = senders.len() as i64;
    let append =
        |old: &Tensor, new: Tensor| Tensor::cat(&[old.narrow(0, 0, first), new.to_device(device)], 0);
    let insert = |old: &Tensor, new: Tensor| {
        let coarser: i64 = graph.levels.iter().map(|l| l.senders.size()[0]).sum();
        Tensor::cat(&[append(old, new), old.narrow(0, old.size()[0] - coarser, coarser)], 0)
    };
    let flags = Tensor::ones([count, 1], (Kind::Float, Device::Cpu));
    Ok(Topology {
        senders: append(&graph.senders, Tensor::from_slice(&senders)).into(),
        receivers: append(&graph.receivers, Tensor::from_slice(&receivers)).into(),
        edges: insert(&graph.edges, Tensor::from_slice(&rest).view([count, 3])).into(),
        is_world: Some(insert(is_world, flags).into()),
        ..graph
    })
}

/// The state of each of a union's domains, rows of all components, first of its cells.
fn each_state(domains: &[&dyn Domain], cells: &Tensor, boundary: &Tensor) -> Result<Vec<Vec<f32>>> {
    let (cells, boundary) = (host(cells)?, host(boundary)?);
    let (mut cells, mut boundary) = (&cells[..], &boundary[..]);
    let mut take = |domain: &&dyn Domain| {
        let width = domain.components().count;
        let (of_cells, other) = cells.split_at(width * domain.boundary().n_inner);
        let (of_boundary, rest) = boundary.split_at(width * domain.boundary().owners().count());
        (cells, boundary) = (other, rest);
        [of_cells, of_boundary].concat()
    };
    Ok(domains.iter().map(&mut take).collect())
}

/// Physical features of all edges at a state `[E x 13]`, as the domain has them, those of coarser graphs last; what the graph holds where
/// the nodes do not move.
pub fn edge_features(graph: &Topology, state: &State) -> Tensor {
    let Some(is_world) = graph.is_world.as_deref() else {
        return graph.edges.shallow_clone();
    };
    let mut u = Tensor::cat(&[&state.cells, &state.boundary], 0);
    let difference = |u: &Tensor, links: Links| pick(u, links.senders) - pick(u, links.receivers);
    let mut added = vec![difference(&u, graph.links())];
    for (level, scale) in graph.levels.iter().zip(std::iter::successors(Some(0.5), |s| Some(0.5 * s))) {
        u = sum_into(level.nodes, &(pick(&u, &level.finer) * &*level.share), &level.coarse);
        added.push(difference(&u, level.links()) * scale);
    }
    let added = Tensor::cat(&added, 0);
    let (rest, now) = (&*graph.edges, &*graph.edges + &added);
    let sum = |v: Tensor| v.sum_dim_intlist(Some(&[1i64][..]), true, Kind::Float);
    // Nodes of coarser graphs may be in one place, where the root has no derivative.
    let least = f64::from(f32::MIN_POSITIVE);
    let length = |v: &Tensor| sum(v.square()).clamp_min(least).sqrt();
    let longer = sum(&added * (&now + rest)) / (length(&now) + length(rest)).clamp_min(least);
    let of_mesh = Tensor::cat(&[rest, &length(rest), &added, &longer], 1) * (1.0 - is_world);
    let of_world = Tensor::cat(&[&now, &length(&now)], 1) * is_world;
    Tensor::cat(&[&of_mesh, &of_world, is_world], 1)
}

/// Physical node inputs between two states, as the domains have them; of them the displacement alone, where nodes read it, has a derivative.
///
/// Errors: [`Error::Internal`] where a state cannot be read.
pub fn node_inputs(domains: &[&dyn Domain], state: &State, next: &State) -> Result<Tensor> {
    let now = each_state(domains, &state.cells, &state.boundary)?;
    let after = each_state(domains, &state.cells, &next.boundary)?;
    let (mut of_cells, mut of_boundary, mut own) = (Vec::new(), Vec::new(), Vec::new());
    for (domain, (now, after)) in domains.iter().zip(now.iter().zip(&after)) {
        domain.inputs(now, after, &mut own);
        let nodes = now.len() / domain.components().count;
        let (cells, boundary) = own.split_at(own.len() / nodes * domain.boundary().n_inner);
        of_cells.extend_from_slice(cells);
        of_boundary.extend_from_slice(boundary);
    }
    of_cells.extend(of_boundary);
    let u = Tensor::cat(&[&state.cells, &state.boundary], 0);
    let inputs = Tensor::from_slice(&of_cells).view([u.size()[0], -1]).to_device(u.device());
    Ok(match domains.first().map_or(0, |d| d.components().inputs.len() as i64) {
        0 => inputs,
        read => Tensor::cat(&[u.narrow(1, 0, read), inputs.narrow(1, read, inputs.size()[1] - read)], 1),
    })
}

/// The numbers of a tensor, row by row.
///
/// Errors: [`Error::Internal`] where it cannot be read.
pub fn host(t: &Tensor) -> Result<Vec<f32>> {
    let flat = t.detach().to_device(Device::Cpu).contiguous().view([-1]);
    Vec::<f32>::try_from(flat).map_err(|e| Error::Internal(format!("a state cannot be read: {e}")))
}
