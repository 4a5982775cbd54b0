//! The graph of bodies that deform and are touched (section 3.1): edges of the mesh, and world edges that change with
//! every step.
//!
//! World edges lead from the obstacle's points to the points of the skin within the radius. None leads back: the
//! obstacle's motion is prescribed, nothing acts on it. Its points are nodes of the first rank with points and ghosts of all others,
//! so that the exchange stays the same while world edges come and go.

mod edges;

pub use edges::{MeshEdge, N_FEATURES, has_feature};

use super::part::BodyPart;
use crate::{Boundary, Components};
pub(super) use edges::{by_ends, mesh_features};
use m4gn_base::{Error, Result};
use m4gn_mesh::NodeType;
use m4gn_mesh::surface::Surface;
use m4gn_mesh::vector::{Vector, sub};
use m4gn_model::ModelSpec;
use m4gn_parallel::{Comm, Halo};
use m4gn_structure::graph::Graph;

/// Bodies at points with an obstacle. Its nodes are its own points, on the first rank with points the obstacle's, and ghosts.
#[derive(Clone, Debug)]
pub struct Body {
    pub(super) components: Components,
    pub(super) boundary: Boundary,
    /// Within which the obstacle's points are joined to the skin's, m.
    pub(super) radius: f64,
    /// Own nodes: points, then, on the first rank with points, the obstacle's.
    pub(super) n_owned: usize,
    /// Own nodes and ghosts.
    pub(super) n_local: usize,
    /// Own points whose displacement is prescribed.
    pub(super) held: Vec<bool>,
    /// Sorted by receiver.
    pub(super) edges: Vec<MeshEdge>,
    /// Own points that can be touched.
    pub(super) skin: Vec<u32>,
    /// Positions at rest of the own points, m.
    pub(super) rest: Vec<Vector>,
    /// Positions of the obstacle where its displacement is 0, m.
    pub(super) obstacle: Vec<Vector>,
    /// Triangles of its surface.
    pub(super) triangles: Vec<[i32; 3]>,
    /// Local nodes of the obstacle's points.
    pub(super) obstacle_nodes: Vec<i32>,
}

impl Body {
    /// This rank's part of a body for the model that `spec` describes, and its graph at rest. Collective; all ranks fail together.
    ///
    /// # Errors
    /// As [`Graph::new`].
    pub fn new(part: &BodyPart, spec: &ModelSpec, comm: &Comm) -> Result<(Self, Graph)> {
        let contact = spec.contact.unwrap_or_default();
        let sizes = part.mesh.check(comm)?;
        let (n, q) = (part.mesh.n_cells(), part.obstacle.len());
        let is_first = comm.rank() == part.first;
        let here = if is_first { q } else { 0 };
        let n_owned = n + here;
        let number = |point: usize| sizes.cells + point as i64;
        let mut global = part.mesh.cell_global.clone();
        global.extend((0..here).map(number));
        let mut ghosts: Vec<(i32, i64)> = part.mesh.coupled.iter().map(|c| (c.rank, c.global)).collect();
        if !is_first {
            ghosts.extend((0..q).map(|p| (part.first, number(p))));
        }
        ghosts.sort_unstable();
        ghosts.dedup();
        let halo = Halo::new(comm, &global, &ghosts, n_owned)?;
        let ghost = |rank: i32, global: i64| {
            ghosts
                .binary_search(&(rank, global))
                .map(|i| (n_owned + i) as i32)
                .map_err(|_| Error::Internal(format!("point {global} of rank {rank} is no ghost")))
        };
        let obstacle_nodes = || -> Result<Vec<i32>> {
            let node = |p: usize| match is_first {
                true => Ok((n + p) as i32),
                false => ghost(part.first, number(p)),
            };
            (0..q).map(node).collect()
        };
        let obstacle_nodes = comm.agree(obstacle_nodes())?;

        let x = &part.mesh.cell_centres;
        let mut edges = Vec::new();
        let mut both = |a: i32, b: i32, rest: Vector| {
            for (sender, receiver, rest) in [(b, a, rest), (a, b, rest.map(|v| -v))] {
                edges.push(MeshEdge { sender, receiver, rest });
            }
        };
        for (&a, &b) in part.mesh.face_owner.iter().zip(&part.mesh.face_neighbour) {
            both(a, b, sub(x[b as usize], x[a as usize]));
        }
        for [a, b] in part.obstacle_edges.iter().filter(|_| is_first) {
            let rest = sub(part.obstacle[*b as usize], part.obstacle[*a as usize]);
            both(n as i32 + a, n as i32 + b, rest);
        }
        let across = |c: &m4gn_mesh::CoupledFace| {
            Ok(MeshEdge { sender: ghost(c.rank, c.global)?, receiver: c.owner, rest: c.delta })
        };
        let coupled: Result<Vec<_>> = part.mesh.coupled.iter().map(across).collect();
        edges.extend(comm.agree(coupled)?);
        edges.sort_by_key(|e| (e.receiver, e.sender));

        let n_local = n_owned + ghosts.len();
        let mut node_types = vec![NodeType::Body as i32; n_local];
        for (code, kind) in node_types.iter_mut().zip(&part.types) {
            if *kind == NodeType::Handle {
                *code = NodeType::Handle as i32;
            }
        }
        for &node in &obstacle_nodes {
            node_types[node as usize] = NodeType::Obstacle as i32;
        }
        let body = Body {
            components: Components::new(spec),
            boundary: Boundary::prescribed(n, here, &spec.fields, spec.dim),
            radius: contact.radius,
            n_owned,
            n_local,
            held: part.types.iter().map(|t| *t == NodeType::Handle).collect(),
            edges,
            skin: (0..n as u32).filter(|&p| part.skin[p as usize]).collect(),
            rest: x.clone(),
            obstacle: part.obstacle.clone(),
            triangles: part.triangles.clone(),
            obstacle_nodes,
        };
        let mut graph = Graph { n_cells: n, n_owned, n_local, node_types, halo, ..Graph::default() };
        body.edges_at(&vec![0.0; 3 * n_local], &mut graph);
        Ok((body, graph))
    }

    /// Own points.
    pub fn n_points(&self) -> usize {
        self.rest.len()
    }

    /// The obstacle's surface at a displacement of its points, m; none without an obstacle.
    pub(crate) fn surface(&self, displacement: &[[f32; 3]]) -> Option<Surface> {
        let at = |(x, u): (&Vector, &[f32; 3])| std::array::from_fn(|i| x[i] + f64::from(u[i]));
        let points: Vec<Vector> = self.obstacle.iter().zip(displacement).map(at).collect();
        (!points.is_empty()).then(|| Surface::open(&points, &self.triangles))
    }
}
