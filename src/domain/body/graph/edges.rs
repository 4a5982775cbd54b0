//! Edges of a state: those of the mesh, and world edges, which are found anew, with their features.

use super::Body;
use m4gn_mesh::vector::{Vector, sub};
use m4gn_mesh::within::Within;
use m4gn_structure::graph::Graph;

/// Features of an edge in three directions, each with its length: of an edge of the mesh its vector at rest and what the
/// deformation has added to that; of a world edge its vector at present; then whether it is a world edge.
///
/// The two vectors of table 2, at rest and at present, say the same. But a strain is a small difference of the two, which a network
/// reads badly from two inputs that are each normalised to their own size.
pub const N_FEATURES: usize = 13;

/// An edge that is there in all steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshEdge {
    /// Local node, may be a ghost.
    pub sender: i32,
    /// Owned node.
    pub receiver: i32,
    /// Sender's position minus receiver's at rest, m.
    pub rest: Vector,
}

impl Body {
    /// World edges at a displacement of all local nodes from rest `[n_local x 3]`, m, sorted by receiver.
    pub(in crate::body) fn world_edges_at(&self, displacement: &[f32]) -> Vec<MeshEdge> {
        let at = |x: Vector, node: usize| -> Vector {
            std::array::from_fn(|i| x[i] + f64::from(displacement[3 * node + i]))
        };
        let positions: Vec<Vector> =
            self.obstacle.iter().zip(&self.obstacle_nodes).map(|(x, &node)| at(*x, node as usize)).collect();
        let grid = Within::new(&positions, self.radius);
        let (mut near, mut edges) = (Vec::new(), Vec::new());
        for &p in &self.skin {
            let rest = self.rest[p as usize];
            near.clear();
            grid.query(at(rest, p as usize), &mut near);
            edges.extend(near.iter().map(|&q| MeshEdge {
                sender: self.obstacle_nodes[q as usize],
                receiver: p as i32,
                rest: sub(self.obstacle[q as usize], rest),
            }));
        }
        edges
    }

    /// The edges of a displacement of all local nodes, m.
    pub(crate) fn edges_at(&self, displacement: &[f32], graph: &mut Graph) {
        let world = self.world_edges_at(displacement);
        let Graph { row, senders, receivers, edge_features, n_owned, .. } = graph;
        row.clear();
        senders.clear();
        receivers.clear();
        edge_features.clear();
        row.push(0);
        let (mut mesh, mut world) = (self.edges.iter().peekable(), world.iter().peekable());
        for node in 0..*n_owned as i32 {
            let of_mesh = std::iter::from_fn(|| mesh.next_if(|e| e.receiver == node)).map(|e| (e, false));
            let of_world = std::iter::from_fn(|| world.next_if(|e| e.receiver == node)).map(|e| (e, true));
            for (edge, is_world) in of_mesh.chain(of_world) {
                senders.push(edge.sender);
                receivers.push(node);
                edge_features.extend(match is_world {
                    true => world_features(edge, displacement),
                    false => mesh_features(
                        edge.rest.map(|v| v as f32),
                        added(edge.sender, edge.receiver, displacement),
                    ),
                });
            }
            row.push(senders.len() as u32);
        }
    }
}

/// Displacement of an edge's sender beside its receiver's, m.
fn added(sender: i32, receiver: i32, displacement: &[f32]) -> Vector32 {
    let u = |node: i32, i: usize| displacement[3 * node as usize + i];
    std::array::from_fn(|i| u(sender, i) - u(receiver, i))
}

/// Features of an edge of the mesh: its vector at rest, and what has been added to it.
pub(in crate::body) fn mesh_features(rest: Vector32, added: Vector32) -> [f32; N_FEATURES] {
    let now: Vector32 = std::array::from_fn(|i| rest[i] + added[i]);
    let mut f = [0.0; N_FEATURES];
    f[..3].copy_from_slice(&rest);
    f[3] = length(rest);
    f[4..7].copy_from_slice(&added);
    // The difference of two lengths, without the loss of its digits.
    let twice: f32 = (0..3).map(|i| added[i] * (now[i] + rest[i])).sum();
    f[7] = twice / (length(now) + length(rest)).max(f32::MIN_POSITIVE);
    f
}

/// Features of a world edge for the displacement of all local nodes.
fn world_features(edge: &MeshEdge, displacement: &[f32]) -> [f32; N_FEATURES] {
    let added = added(edge.sender, edge.receiver, displacement);
    let now: Vector32 = std::array::from_fn(|i| edge.rest[i] as f32 + added[i]);
    let mut f = [0.0; N_FEATURES];
    f[8..11].copy_from_slice(&now);
    f[11] = length(now);
    f[12] = 1.0;
    f
}

/// Whether an edge with these features is of the kind that has this one; the others are 0.
pub fn has_feature(features: &[f32], number: usize) -> bool {
    match number {
        0..8 => features[N_FEATURES - 1] == 0.0,
        8..12 => features[N_FEATURES - 1] != 0.0,
        _ => true,
    }
}

/// Adds the derivatives by the features of a graph's edges, times `scale`, to those by the displacement of its nodes.
pub(in crate::body) fn by_ends(graph: &Graph, d_features: &[f32], scale: f32, d_displacement: &mut [f32]) {
    let rows = graph.edge_features.chunks_exact(N_FEATURES).zip(d_features.chunks_exact(N_FEATURES));
    for ((x, d), (&s, &r)) in rows.zip(graph.senders.iter().zip(&graph.receivers)) {
        for (i, by) in features_backward(x, d).into_iter().enumerate() {
            d_displacement[3 * s as usize + i] += scale * by;
            d_displacement[3 * r as usize + i] -= scale * by;
        }
    }
}

/// From the derivative by an edge's features to that by the sender's displacement; the derivative by the receiver's is the opposite.
fn features_backward(features: &[f32], d: &[f32]) -> Vector32 {
    let (now, first): (Vector32, usize) = match features[N_FEATURES - 1] != 0.0 {
        false => (std::array::from_fn(|i| features[i] + features[4 + i]), 4),
        true => (std::array::from_fn(|i| features[8 + i]), 8),
    };
    let length = length(now);
    let along = if length > 0.0 { d[first + 3] / length } else { 0.0 };
    std::array::from_fn(|i| d[first + i] + along * now[i])
}

type Vector32 = [f32; 3];

fn length(v: Vector32) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Domain;
    use crate::body::part::BodyPart;
    use m4gn_mesh::NodeType;
    use m4gn_parallel::Comm;
    use m4gn_samples::bodies as sample;
    use m4gn_structure::Structure;

    /// A cube of one brick, an octahedron whose lowest corner is 0.5 above a corner of its top.
    fn cube() -> (Body, Structure, usize) {
        let body = sample::block([1, 1, 1], [1.0; 3]);
        let obstacle = sample::octahedron([1.0, 1.0, 2.0], 0.5);
        let (body, graph) = seen_within(0.6, &BodyPart::whole(&body, Some(&obstacle)).unwrap());
        let mesh = body.edges.len();
        (body, Structure::of_graphs(graph, Vec::new()), mesh)
    }

    fn seen_within(radius: f64, part: &BodyPart) -> (Body, Graph) {
        Body::new(part, &sample::spec(radius), &Comm::serial()).unwrap()
    }

    #[test]
    fn world_edges_come_and_go() {
        let (contact, mut structure, mesh) = cube();
        let graph = &structure.graph;
        // 12 edges of the cube and 12 of the octahedron, both ways.
        assert_eq!(mesh, 48);
        let comm = Comm::serial();
        assert_eq!((graph.n_cells, graph.n_owned, graph.n_local), (8, 14, 14));
        // Point 7 is the corner (1, 1, 1); obstacle point 5, node 13, is 0.5 above it.
        assert_eq!(graph.senders.len(), mesh + 1);
        let e = graph.row[8] as usize - 1;
        assert_eq!((graph.senders[e], graph.receivers[e]), (13, 7));
        let row = &graph.edge_features[N_FEATURES * e..][..N_FEATURES];
        let mut expected = [0.0; N_FEATURES];
        expected[8..].copy_from_slice(&[0.0, 0.0, 0.5, 0.5, 1.0]);
        assert_eq!(row, expected);
        assert_eq!(graph.node_types[..2], [NodeType::Handle as i32, NodeType::Body as i32]);
        assert_eq!(graph.node_types[13], NodeType::Obstacle as i32);

        // The obstacle goes up by 0.2 and is out of reach; point 1 moves by (0.1, 0, 0).
        let mut u = vec![0.0; 3 * 14];
        (8..14).for_each(|node| u[3 * node + 2] = 0.2);
        u[3] = 0.1;
        contact.set_edges(&comm, &mut u, &mut structure).unwrap();
        let graph = &structure.graph;
        assert_eq!(graph.senders.len(), mesh);
        let from = |s: i32, r: i32| {
            let e = (0..mesh).find(|&e| (graph.senders[e], graph.receivers[e]) == (s, r));
            &graph.edge_features[N_FEATURES * e.unwrap()..][..N_FEATURES]
        };
        let mut expected = [0.0; N_FEATURES];
        expected[..8].copy_from_slice(&[1.0, 0.0, 0.0, 1.0, 0.1, 0.0, 0.0, 0.1]);
        assert!(from(1, 0).iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6));
        assert!(contact.set_edges(&comm, &mut u[3..], &mut structure).is_err());
        u[0] = f32::NAN;
        assert!(contact.set_edges(&comm, &mut u, &mut structure).unwrap_err().to_string().contains("node 0"));
    }

    #[test]
    fn held_points_are_not_touched() {
        let (contact, mut structure, mesh) = cube();
        // The obstacle above the held corner (0, 1, 1).
        let mut u = vec![0.0; 3 * 14];
        (8..14).for_each(|node| u[3 * node] = -1.0);
        contact.set_edges(&Comm::serial(), &mut u, &mut structure).unwrap();
        assert_eq!(structure.graph.senders.len(), mesh);
    }

    #[test]
    fn a_reflection_is_reflected() {
        let (contact, ..) = cube();
        let mirror = contact.mirrored();
        for (a, b) in contact.edges.iter().zip(&mirror.edges) {
            assert_eq!(a.rest, [b.rest[0], -b.rest[1], b.rest[2]]);
        }
        assert_eq!(mirror.world_edges_at(&[0.0; 42]).len(), 1);
    }
}
