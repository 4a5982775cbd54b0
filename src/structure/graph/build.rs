//! From a mesh to its graph.

use super::Graph;
use m4gn_base::Result;
use m4gn_mesh::vector::sub;
use m4gn_mesh::{Ghosts, Mesh, NodeType};
use m4gn_parallel::Comm;

/// An edge before sorting.
struct Edge {
    sender: i32,
    receiver: i32,
    /// Sender position minus receiver position, m.
    displacement: [f64; 3],
}

impl Graph {
    /// Builds this rank's part of the graph. Collective; all ranks fail together.
    ///
    /// The mesh is checked first ([`Mesh::check`]). A cell receives one edge from each face neighbour and one
    /// from each of its boundary faces; a boundary node receives one from its cell. Ghosts are ordered by
    /// (rank, global cell). A coupled face whose other side is on this rank (a translational cyclic) is a plain
    /// local edge.
    pub fn new(mesh: &Mesh, comm: &Comm) -> Result<Graph> {
        mesh.check(comm)?;
        let n_cells = mesh.n_cells();
        let n_owned = mesh.n_nodes();

        let ghosts = Ghosts::of(mesh, comm)?;
        let n_local = ghosts.n_local(mesh);
        let edges = edges(mesh, &ghosts);
        let mut row = vec![0u32; n_owned + 1];
        for e in &edges {
            row[e.receiver as usize + 1] += 1;
        }
        for i in 0..n_owned {
            row[i + 1] += row[i];
        }
        let width = mesh.dim() + 1;
        let mut next: Vec<u32> = row[..n_owned].to_vec();
        let mut senders = vec![0i32; edges.len()];
        let mut receivers = vec![0i32; edges.len()];
        let mut edge_features = vec![0f32; edges.len() * width];
        for e in &edges {
            let slot = &mut next[e.receiver as usize];
            let at = *slot as usize;
            *slot += 1;
            senders[at] = e.sender;
            receivers[at] = e.receiver;
            let features = &mut edge_features[at * width..(at + 1) * width];
            let mut square = 0.0;
            for (feature, &d) in features.iter_mut().zip(&mesh.directions) {
                *feature = e.displacement[d] as f32;
                square += e.displacement[d] * e.displacement[d];
            }
            features[width - 1] = square.sqrt() as f32;
        }

        let mut node_types = vec![NodeType::Fluid as i32; n_local];
        for (i, b) in mesh.boundary.iter().enumerate() {
            node_types[n_cells + i] = b.kind as i32;
        }
        Ok(Graph {
            n_cells,
            n_owned,
            n_local,
            node_types,
            row,
            senders,
            receivers,
            edge_features,
            halo: ghosts.halo,
        })
    }
}

fn edges(mesh: &Mesh, ghosts: &Ghosts) -> Vec<Edge> {
    let mut edges =
        Vec::with_capacity(2 * (mesh.face_owner.len() + mesh.boundary.len()) + mesh.coupled.len());
    for (&a, &b) in mesh.face_owner.iter().zip(&mesh.face_neighbour) {
        let (p, q) = (mesh.cell_centres[a as usize], mesh.cell_centres[b as usize]);
        edges.push(Edge { sender: b, receiver: a, displacement: sub(q, p) });
        edges.push(Edge { sender: a, receiver: b, displacement: sub(p, q) });
    }
    for (c, &node) in mesh.coupled.iter().zip(&ghosts.behind) {
        edges.push(Edge { sender: node, receiver: c.owner, displacement: c.delta });
    }
    for (i, b) in mesh.boundary.iter().enumerate() {
        let node = (mesh.n_cells() + i) as i32;
        let cell = mesh.cell_centres[b.owner as usize];
        edges.push(Edge { sender: node, receiver: b.owner, displacement: sub(b.centre, cell) });
        edges.push(Edge { sender: b.owner, receiver: node, displacement: sub(cell, b.centre) });
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    #[test]
    fn edges_of_a_small_rectangle() {
        // 2 x 1 quads of 0.5 x 1: one internal face, six boundary faces.
        let mesh = sample::rectangle(2, 1, 1.0, 1.0);
        let g = Graph::new(&mesh, &Comm::serial()).unwrap();
        assert_eq!((g.n_cells, g.n_owned, g.n_local), (2, 8, 8));
        assert_eq!(g.senders.len(), 2 + 12);
        assert_eq!(g.row.len(), 9);
        assert!(g.receivers.windows(2).all(|w| w[0] <= w[1]));
        let first = g.row[0] as usize;
        assert_eq!((g.senders[first], g.receivers[first]), (1, 0));
        assert_eq!(&g.edge_features[..3], &[0.5, 0.0, 0.5]);
        for node in 2..8 {
            assert_eq!(g.row[node + 1] - g.row[node], 1);
        }
        assert_eq!(&g.node_types[..2], &[0, 0]);
    }

    #[test]
    fn a_cyclic_on_one_rank_is_a_local_edge() {
        let mut mesh = sample::rectangle(4, 2, 1.0, 1.0);
        sample::make_cyclic(&mut mesh, 1.0);
        let g = Graph::new(&mesh, &Comm::serial()).unwrap();
        assert_eq!(g.n_local, g.n_owned);
        // Every cell has left, right, one vertical neighbour and one wall.
        for cell in 0..8 {
            assert_eq!(g.row[cell + 1] - g.row[cell], 4);
        }
        let left = (g.row[0]..g.row[1]).find(|&e| g.senders[e as usize] == 3).unwrap() as usize;
        assert!((g.edge_features[3 * left] + 0.25).abs() < 1e-6);
    }
}
