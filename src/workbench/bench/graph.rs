//! Graphs to measure on.

use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::{Mesh, NodeType, block};
use m4gn_model::ModelSpec;
use m4gn_parallel::{Comm, Halo};
use m4gn_structure::graph::Graph;
use m4gn_structure::{Segmentation, Sequence, Structure};
use rand::{RngExt, SeedableRng};

/// Points around a ring over the square root of all points: 24 for 1900.
const ASPECT: f64 = 0.55;

/// An O-mesh of triangles around a cylinder of radius 0.05 m, points as nodes and mesh edges as edges in both
/// directions: nearly six of them a node, as on the published point-based data sets. About `nodes` of them, all of
/// which the network predicts; 1900 gives 1896 nodes and 11,280 directed edges.
///
/// # Errors
/// [`Error::Input`] for fewer than 9 nodes or more edges than the graph can number.
pub fn o_mesh(nodes: usize, comm: &Comm) -> Result<Graph> {
    if !(9..=1 << 28).contains(&nodes) {
        return Err(Error::Input(format!("{nodes} nodes: expected 9 to {}", 1 << 28)));
    }
    let around = ((nodes as f64).sqrt() * ASPECT).round().max(3.0) as usize;
    let rings = (nodes as f64 / around as f64).round().max(2.0) as usize;
    let n = around * rings;
    let step = std::f64::consts::TAU / around as f64;
    let place = |r: usize, a: usize| {
        let (radius, angle) = (0.05 + 0.005 * r as f64, a as f64 * step);
        [radius * angle.cos(), radius * angle.sin()]
    };
    let mut graph = Graph {
        n_cells: n,
        n_owned: n,
        n_local: n,
        node_types: Vec::with_capacity(n),
        row: vec![0],
        senders: Vec::with_capacity(6 * n),
        receivers: Vec::with_capacity(6 * n),
        edge_features: Vec::with_capacity(18 * n),
        halo: Halo::new(comm, &(0..n as i64).collect::<Vec<_>>(), &[], n)?,
    };
    for i in 0..n {
        let (r, a) = (i / around, i % around);
        let (before, after) = ((a + around - 1) % around, (a + 1) % around);
        let kind = match r {
            0 => NodeType::Obstacle,
            _ if r + 1 < rings => NodeType::Fluid,
            _ if place(r, a)[0] < 0.0 => NodeType::Inlet,
            _ => NodeType::Outlet,
        };
        graph.node_types.push(kind as i32);
        let inner = r.checked_sub(1).map(|s| [(s, before), (s, a)]);
        let outer = (r + 1 < rings).then_some([(r + 1, a), (r + 1, after)]);
        let same = [(r, before), (r, after)];
        for (s, b) in inner.into_iter().flatten().chain(same).chain(outer.into_iter().flatten()) {
            let (from, to) = (place(s, b), place(r, a));
            let delta = [from[0] - to[0], from[1] - to[1]];
            graph.senders.push((s * around + b) as i32);
            graph.receivers.push(i as i32);
            graph.edge_features.extend(delta.map(|x| x as f32));
            graph.edge_features.push(delta[0].hypot(delta[1]) as f32);
        }
        graph.row.push(graph.senders.len() as u32);
    }
    Ok(graph)
}

/// A cube of hexahedra, as near to `cells` of them as a cube comes; its faces carry boundary nodes.
///
/// # Errors
/// [`Error::Input`] for a number whose graph cannot be numbered.
pub fn hexahedra(cells: usize) -> Result<Mesh> {
    if !(1..=1 << 27).contains(&cells) {
        return Err(Error::Input(format!("{cells} cells: expected 1 to {}", 1 << 27)));
    }
    let n = (cells as f64).cbrt().round().max(1.0) as usize;
    Ok(block::block([n; 3], [1.0; 3]))
}

/// [`o_mesh`] with runs of consecutive nodes as segments, as far as the model needs them.
///
/// # Errors
/// As [`o_mesh`]; [`Error::Input`] for more segments than nodes.
pub fn o_mesh_structure(spec: &ModelSpec, nodes: usize, comm: &Comm) -> Result<Structure> {
    let graph = o_mesh(nodes, comm)?;
    let segments = consecutive_segments(spec, graph.n_owned)?;
    let sequence = segments.as_ref().map(|s| Sequence::of_nodes(s, (0..graph.n_owned as i32).collect()));
    let steps = spec.architecture.needs().walk;
    let pairs: Vec<[i32; 2]> = graph.senders.iter().zip(&graph.receivers).map(|(s, r)| [*s, *r]).collect();
    let walk = m4gn_structure::walk_of_pairs(graph.n_owned, &pairs, steps);
    Ok(Structure { graph, segments, sequence, levels: Vec::new(), walk, place: Vec::new() })
}

/// Runs of consecutive nodes as segments, with random features: where no mesh is there to be cut. None for a model that
/// needs no segments.
fn consecutive_segments(spec: &ModelSpec, n: usize) -> Result<Option<Segmentation>> {
    if !spec.architecture.needs().segments {
        return Ok(None);
    }
    let k = spec.segments.count;
    refuse(k > n, Error::Input, || format!("{k} segments for {n} nodes: expected at most {n}"))?;
    let member = (0..n).map(|i| (i * k / n) as i32).collect();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut random = |n: usize| (0..n).map(|_| rng.random_range(-1.0f32..1.0)).collect();
    Ok(Some(Segmentation {
        position: random(k * spec.n_position_features()),
        offsets: random(n * spec.n_offset_features()),
        ..Segmentation::of_members(k, (0..=n as u32).collect(), member)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn a_mesh_of_the_size_of_the_published_ones() {
        let g = o_mesh(1900, &Comm::serial()).unwrap();
        // 24 x 79 points; 3 V - 2 x 24 edges in both directions.
        assert_eq!((g.n_owned, g.senders.len()), (1896, 2 * (3 * 1896 - 48)));
        let edges: HashSet<(i32, i32)> = g.senders.iter().copied().zip(g.receivers.iter().copied()).collect();
        assert_eq!(edges.len(), g.senders.len());
        assert!(edges.iter().all(|&(s, r)| s != r && edges.contains(&(r, s))));
        assert!(g.receivers.windows(2).all(|w| w[0] <= w[1]));
        assert_eq!(*g.row.last().unwrap() as usize, g.senders.len());
        for f in g.edge_features.chunks_exact(3) {
            assert!((f[0].hypot(f[1]) - f[2]).abs() < 1e-6 && f[2] > 0.0);
        }
        assert!(o_mesh(3, &Comm::serial()).is_err());
    }

    #[test]
    fn hexahedra_come_in_cubes() {
        let mesh = hexahedra(1000).unwrap();
        assert_eq!((mesh.n_cells(), mesh.boundary.len()), (1000, 600));
        assert_eq!(hexahedra(1100).unwrap().n_cells(), 1000);
        assert!(hexahedra(0).is_err());
    }
}
