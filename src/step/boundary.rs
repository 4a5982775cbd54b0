//! Boundary values after a step where no solver imposes them: validation and training roll out by the same rule.

use m4gn_mesh::{BoundaryFace, Mesh, NodeType};

/// How much a boundary value may differ from its cell's, relative to the field's largest value, to count as the
/// same: data sets hold fp32.
const SAME: f32 = 1e-5;

/// For each boundary face, whether it takes its owner cell's value; the others' values are prescribed.
///
/// Vectors (velocity, displacement) follow where the flow leaves, on symmetry planes and on free surfaces; at walls,
/// inlets, obstacles and handles they are prescribed. Scalars (pressure) follow on each patch whose recorded values equal the owner's in every frame, which
/// is how a zero gradient is recorded. `frames` are pairs of cell and boundary values `[n_cells]`, `[n_boundary]`.
pub fn copied_faces<'a>(
    mesh: &Mesh,
    vector: bool,
    frames: impl IntoIterator<Item = (&'a [f32], &'a [f32])>,
) -> Vec<bool> {
    let mut faces = CopiedFaces::new(mesh, vector);
    if faces.asks_for_values() {
        frames
            .into_iter()
            .for_each(|(cells, boundary)| faces.see(cells, boundary));
    }
    faces.found()
}

/// [`copied_faces`] of frames that are shown one after another.
#[derive(Debug)]
pub struct CopiedFaces<'a> {
    mesh: &'a Mesh,
    vector: bool,
    /// Of each patch, whether all values so far equal the owners'.
    same: Vec<bool>,
}

impl<'a> CopiedFaces<'a> {
    /// Before the first frame of a vector or a scalar.
    pub fn new(mesh: &'a Mesh, vector: bool) -> Self {
        let last = mesh.boundary.iter().map(|b| b.patch.max(0) as usize).max();
        CopiedFaces {
            mesh,
            vector,
            same: vec![true; 1 + last.unwrap_or(0)],
        }
    }

    /// Whether frames matter: the rule of vectors asks for no values.
    pub fn asks_for_values(&self) -> bool {
        !self.vector
    }

    /// Looks at a frame: values `[n_cells]`, `[n_boundary]`.
    pub fn see(&mut self, cells: &[f32], boundary: &[f32]) {
        let scale = cells.iter().fold(0f32, |m, v| m.max(v.abs()));
        for (face, value) in self.mesh.boundary.iter().zip(boundary) {
            if (value - cells[face.owner as usize]).abs() > SAME * scale {
                self.same[face.patch.max(0) as usize] = false;
            }
        }
    }

    /// For each boundary face, whether it takes its owner cell's value.
    pub fn found(&self) -> Vec<bool> {
        let follows = |b: &BoundaryFace| match self.vector {
            true => matches!(b.kind, NodeType::Outlet | NodeType::Symmetry | NodeType::Free),
            false => self.same[b.patch.max(0) as usize],
        };
        self.mesh.boundary.iter().map(follows).collect()
    }
}

/// Faces on which the network sees a vector's cell value in place of the face's own, with their owner cells.
///
/// The displacement of a free surface is its cell's plus what the traction makes of the strain: a solver knows it, a
/// rollout without one does not. With the cell's value, training, validation and a solver show the network the same.
pub fn faces_seen_as_their_cells(mesh: &Mesh) -> Vec<(usize, usize)> {
    mesh.boundary
        .iter()
        .enumerate()
        .filter(|(_, face)| face.kind == NodeType::Free)
        .map(|(i, face)| (i, face.owner as usize))
        .collect()
}

/// Fills `boundary [n_boundary x width]` for new cell values `cells [n_cells x width]`: the owner's where
/// `copied`, the value `prescribed` for the new time elsewhere.
pub fn impose_boundary<T: Copy>(
    mesh: &Mesh,
    width: usize,
    copied: &[bool],
    cells: &[T],
    prescribed: &[T],
    boundary: &mut [T],
) {
    let rows = boundary
        .chunks_exact_mut(width)
        .zip(prescribed.chunks_exact(width));
    for ((face, copied), (to, prescribed)) in mesh.boundary.iter().zip(copied).zip(rows) {
        let owner = face.owner as usize * width;
        to.copy_from_slice(if *copied {
            &cells[owner..owner + width]
        } else {
            prescribed
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::sample;

    #[test]
    fn outlets_follow_and_walls_are_prescribed() {
        let mesh = sample::rectangle(3, 2, 1.0, 1.0);
        let copied = copied_faces(&mesh, true, []);
        for (face, copied) in mesh.boundary.iter().zip(&copied) {
            assert_eq!(*copied, face.kind == NodeType::Outlet);
        }
        let cells: Vec<f64> = (0..12).map(f64::from).collect();
        let n = 2 * mesh.boundary.len();
        let (prescribed, mut boundary) = (vec![-1.0; n], vec![0.0; n]);
        impose_boundary(&mesh, 2, &copied, &cells, &prescribed, &mut boundary);
        for (i, face) in mesh.boundary.iter().enumerate() {
            let o = 2.0 * face.owner as f64;
            let expected = if copied[i] { [o, o + 1.0] } else { [-1.0, -1.0] };
            assert_eq!(boundary[2 * i..2 * i + 2], expected);
        }
    }

    #[test]
    fn free_faces_and_no_others_are_seen_as_their_cells() {
        let mut mesh = sample::rectangle(3, 2, 1.0, 1.0);
        assert_eq!(faces_seen_as_their_cells(&mesh), []);
        mesh.boundary[1].kind = NodeType::Free;
        mesh.boundary[4].kind = NodeType::Free;
        let owner = |i: usize| (i, mesh.boundary[i].owner as usize);
        assert_eq!(faces_seen_as_their_cells(&mesh), [owner(1), owner(4)]);
    }

    #[test]
    fn scalars_follow_where_the_data_show_a_zero_gradient() {
        let mesh = sample::rectangle(3, 2, 1.0, 1.0);
        let cells: Vec<f32> = (1..7).map(|i| i as f32).collect();
        let boundary: Vec<f32> = mesh
            .boundary
            .iter()
            .map(|b| {
                if b.kind == NodeType::Outlet {
                    0.0
                } else {
                    cells[b.owner as usize]
                }
            })
            .collect();
        let copied = copied_faces(&mesh, false, [(&cells[..], &boundary[..])]);
        for (face, copied) in mesh.boundary.iter().zip(&copied) {
            assert_eq!(*copied, face.kind != NodeType::Outlet);
        }
    }
}
