//! Sample bodies with an obstacle: a block of bricks held at one end, under an octahedron.

use crate::mesh::shuffled;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Material, Obstacle};
use m4gn_mesh::elements::{ElementKind, Elements};
use m4gn_mesh::vector::Vector;
use m4gn_model::{ContactSpec, ModelSpec};

/// A block `[0, l0] x [0, l1] x [0, l2]` of `n` hexahedra in each direction, E 1 MPa, nu 0.4, rho 1000 kg/m^3, held at
/// x = 0.
pub fn block(n: [usize; 3], l: Vector) -> Body {
    let at = |i: usize, j: usize, k: usize| (i + (n[0] + 1) * (j + (n[1] + 1) * k)) as i32;
    let mut positions = Vec::new();
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                positions.push([0, 1, 2].map(|d| [i, j, k][d] as f64 * l[d] / n[d] as f64));
            }
        }
    }
    let mut points = Vec::new();
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                for z in [k, k + 1] {
                    points.extend([at(i, j, z), at(i + 1, j, z), at(i + 1, j + 1, z), at(i, j + 1, z)]);
                }
            }
        }
    }
    let elements = Elements::of_kind(ElementKind::Hexahedron, points);
    let material = Material { young: 1e6, poisson: 0.4, density: 1000.0 };
    let kind = |x: &Vector| match x[0] == 0.0 {
        true => NodeType::Handle,
        false => NodeType::Body,
    };
    Body {
        types: positions.iter().map(kind).collect(),
        material: vec![material; elements.len()],
        edges: elements.edges(),
        elements,
        positions,
    }
}

/// The same body with points and elements in other orders; and of each of its points the number before.
pub fn renumbered(body: &Body, seed: u64) -> (Body, Vec<usize>) {
    let points = shuffled(body.positions.len(), seed);
    let order = shuffled(body.elements.len(), seed + 1);
    let mut new = vec![0i32; points.len()];
    (0..).zip(&points).for_each(|(to, &from)| new[from] = to);
    let of = |e: &usize| body.elements.points_of(*e).iter().map(|&p| new[p as usize]);
    let elements = Elements::of_kind(ElementKind::Hexahedron, order.iter().flat_map(of).collect());
    let renumbered = Body {
        positions: points.iter().map(|&p| body.positions[p]).collect(),
        types: points.iter().map(|&p| body.types[p]).collect(),
        material: order.iter().map(|&e| body.material[e]).collect(),
        edges: elements.edges(),
        elements,
    };
    (renumbered, points)
}

/// An octahedron around `centre` with corners at `radius` along the axes.
pub fn octahedron(centre: Vector, radius: f64) -> Obstacle {
    let mut positions = Vec::new();
    for axis in 0..3 {
        for side in [radius, -radius] {
            let mut x = centre;
            x[axis] += side;
            positions.push(x);
        }
    }
    // Corners +x -x +y -y +z -z are 0 to 5.
    let triangles =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    Obstacle { positions, triangles }
}

/// A small network for bodies whose points see the obstacle's within this radius, m.
pub fn spec(radius: f64) -> ModelSpec {
    ModelSpec { contact: Some(ContactSpec { radius }), ..m4gn_samples::model::bodies() }
}
