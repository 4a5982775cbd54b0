//! A body at points, and the obstacle, as graph and segments want them: this rank's part of both.

use m4gn_base::{Error, Result};
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::elements::Elements;
use m4gn_mesh::vector::{Vector, dot, sub};
use m4gn_mesh::{BoundaryFace, CoupledFace, Mesh, NodeType};

/// This rank's points of a body, and all of the obstacle.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyPart {
    /// The dual mesh: a point is a cell with a share of the volumes around it, an edge the face between two. The
    /// obstacle's points are the boundary, on rank `first` only.
    pub mesh: Mesh,
    /// What each own point is.
    pub types: Vec<NodeType>,
    /// Whether each own point is on the skin of the body and free to move: what an obstacle can touch.
    pub skin: Vec<bool>,
    /// Positions of the obstacle's points where its displacement is 0, m; on all ranks.
    pub obstacle: Vec<Vector>,
    /// Edges of the obstacle's surface, smaller point first, sorted; on all ranks.
    pub obstacle_edges: Vec<[i32; 2]>,
    /// Triangles of the obstacle's surface; on all ranks.
    pub triangles: Vec<[i32; 3]>,
    /// Own points, as numbers of the whole body.
    pub points: Vec<u32>,
    /// Rank of the obstacle's nodes: the first that has points of the body.
    pub first: i32,
}

impl BodyPart {
    /// The whole body on one rank.
    ///
    /// # Errors
    /// As [`BodyPart::of_rank`].
    pub fn whole(body: &Body, obstacle: Option<&Obstacle>) -> Result<Self> {
        Self::of_rank(body, obstacle, &vec![0; body.positions.len()], 0)
    }

    /// The points p with `ranks[p] == rank`.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a point without elements; [`Error::Input`] for ranks of other points.
    pub fn of_rank(body: &Body, obstacle: Option<&Obstacle>, ranks: &[i32], rank: i32) -> Result<Self> {
        let n = body.positions.len();
        if ranks.len() != n {
            return Err(Error::Input(format!("ranks of {} points for a body of {n} points", ranks.len())));
        }
        let first = ranks.iter().copied().min().unwrap_or(0);
        let volumes = dual_volumes(&body.elements, &body.positions)?;
        let skin = skin(body);
        let points: Vec<u32> = (0..n as u32).filter(|&p| ranks[p as usize] == rank).collect();
        let mut local = vec![-1i32; n];
        for (i, &p) in points.iter().enumerate() {
            local[p as usize] = i as i32;
        }
        let own = |values: &[f64]| points.iter().map(|&p| values[p as usize]).collect::<Vec<_>>();
        let mut mesh = Mesh {
            directions: vec![0, 1, 2],
            cell_global: points.iter().map(|&p| i64::from(p)).collect(),
            cell_centres: points.iter().map(|&p| body.positions[p as usize]).collect(),
            cell_volumes: own(&volumes),
            patches: vec!["obstacle".into()],
            ..Mesh::default()
        };
        for &[a, b] in &body.edges {
            let (a, b) = (a as usize, b as usize);
            let delta = sub(body.positions[b], body.positions[a]);
            // What a Laplacian on the edges would have: no face of the dual mesh has an area of its own here.
            let coeff = (volumes[a] + volumes[b]) / dot(delta, delta);
            if ranks[a] == rank && ranks[b] == rank {
                mesh.face_owner.push(local[a]);
                mesh.face_neighbour.push(local[b]);
                mesh.face_coeff.push(coeff);
                continue;
            }
            for (here, there, delta) in [(a, b, delta), (b, a, delta.map(|d| -d))] {
                if ranks[here] == rank {
                    mesh.coupled.push(CoupledFace {
                        owner: local[here],
                        rank: ranks[there],
                        global: there as i64,
                        delta,
                        coeff,
                    });
                }
            }
        }
        if let Some(obstacle) = obstacle.filter(|_| rank == first) {
            mesh.boundary = boundary(&obstacle.positions);
        }
        Ok(BodyPart {
            types: points.iter().map(|&p| body.types[p as usize]).collect(),
            skin: points.iter().map(|&p| skin[p as usize]).collect(),
            obstacle: obstacle.map_or(Vec::new(), |o| o.positions.clone()),
            triangles: obstacle.map_or(Vec::new(), |o| o.triangles.clone()),
            obstacle_edges: obstacle.map_or(Vec::new(), |o| edges(&o.triangles)),
            mesh,
            points,
            first,
        })
    }
}

/// Each element's volume in equal shares to its points, m^3.
fn dual_volumes(elements: &Elements, positions: &[Vector]) -> Result<Vec<f64>> {
    let mut volumes = vec![0.0; positions.len()];
    for (e, volume) in elements.measures(positions).into_iter().enumerate() {
        let points = elements.points_of(e);
        for &p in points {
            volumes[p as usize] += volume / points.len() as f64;
        }
    }
    match volumes.iter().position(|v| *v <= 0.0) {
        Some(p) => Err(Error::Mesh(format!(
            "point {p} of the body has {} m^3 of elements around it: expected each point in an element that is not \
             inverted",
            volumes[p]
        ))),
        None => Ok(volumes),
    }
}

fn skin(body: &Body) -> Vec<bool> {
    let mut skin = vec![false; body.positions.len()];
    for p in body.elements.skin().into_iter().flatten() {
        skin[p as usize] = body.types[p as usize] == NodeType::Body;
    }
    skin
}

fn edges(triangles: &[[i32; 3]]) -> Vec<[i32; 2]> {
    let sides = |t: &[i32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let mut edges: Vec<[i32; 2]> =
        triangles.iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// The obstacle's points as boundary faces, from which only distances are taken.
fn boundary(positions: &[Vector]) -> Vec<BoundaryFace> {
    let face = |(q, centre): (usize, &Vector)| BoundaryFace {
        owner: 0,
        global: q as i64,
        centre: *centre,
        area: [0.0; 3],
        coeff: 0.0,
        kind: NodeType::Obstacle,
        patch: 0,
    };
    positions.iter().enumerate().map(face).collect()
}
