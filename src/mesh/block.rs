//! Meshes that are put together face by face: a block of hexahedra, on which speed is measured.
//!
//! Coefficients are those of the finite-volume Laplacian, face area over distance of the centres.

use super::{BoundaryFace, Mesh, NodeType};

/// Patches of a block.
const PATCHES: [&str; 3] = ["inlet", "outlet", "walls"];

/// `n[0] x n[1] x n[2]` hexahedra on a block of size `l`; cell (i, j, k) is `i + n[0] * (j + n[1] * k)`. Inlet
/// at x = 0, outlet at the other end, walls elsewhere.
pub fn block(n: [usize; 3], l: [f64; 3]) -> Mesh {
    let h: Vec<f64> = (0..3).map(|d| l[d] / n[d] as f64).collect();
    let area = [h[1] * h[2], h[0] * h[2], h[0] * h[1]];
    let stride = [1, n[0], n[0] * n[1]];
    let count = n[0] * n[1] * n[2];
    let mut mesh = empty(vec![0, 1, 2]);
    for c in 0..count {
        let at = [c % n[0], c / n[0] % n[1], c / stride[2]];
        let centre = [0, 1, 2].map(|d| (at[d] as f64 + 0.5) * h[d]);
        mesh.cell_global.push(c as i64);
        mesh.cell_centres.push(centre);
        mesh.cell_volumes.push(h[0] * h[1] * h[2]);
        for d in 0..3 {
            if at[d] + 1 < n[d] {
                face(&mut mesh, c, c + stride[d], area[d] / h[d]);
            }
            for (end, sign) in [(0, -1.0), (n[d] - 1, 1.0)] {
                if at[d] == end {
                    let mut face_centre = centre;
                    face_centre[d] += sign * h[d] / 2.0;
                    let mut vector = [0.0; 3];
                    vector[d] = sign * area[d];
                    let patch = match (d, sign < 0.0) {
                        (0, true) => 0,
                        (0, false) => 1,
                        _ => 2,
                    };
                    boundary(&mut mesh, c, face_centre, vector, 2.0 * area[d] / h[d], patch);
                }
            }
        }
    }
    mesh
}

/// No cells yet, with the patches inlet, outlet and walls.
pub fn empty(directions: Vec<usize>) -> Mesh {
    Mesh { directions, patches: PATCHES.map(String::from).to_vec(), ..Default::default() }
}

/// Adds a face between two cells.
pub fn face(mesh: &mut Mesh, owner: usize, neighbour: usize, coeff: f64) {
    mesh.face_owner.push(owner as i32);
    mesh.face_neighbour.push(neighbour as i32);
    mesh.face_coeff.push(coeff);
}

/// Adds a boundary face of a patch, whose node type is that of its name.
pub fn boundary(mesh: &mut Mesh, owner: usize, centre: [f64; 3], area: [f64; 3], coeff: f64, patch: i32) {
    let kind = [NodeType::Inlet, NodeType::Outlet, NodeType::Wall][patch as usize];
    let global = mesh.boundary.len() as i64;
    mesh.boundary.push(BoundaryFace { owner: owner as i32, global, centre, area, coeff, kind, patch });
}
