//! Boundary values after a step where no solver imposes them: rollouts in a run, in a training and in a validation go by this one rule.

use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::FieldSpec;

/// How much a boundary value may differ from its cell's, relative to the field's largest value, to count as the
/// same: data sets hold fp32.
const SAME: f32 = 1e-5;

/// Fills the boundary values of a field, rows of `width`: a face's owner's in `cells` where it follows, and the value `prescribed` for the
/// new time elsewhere.
pub fn impose<T: Copy>(
    width: usize,
    faces: impl Iterator<Item = (usize, bool)>,
    cells: &[T],
    prescribed: &[T],
    boundary: &mut [T],
) {
    let rows = boundary.chunks_exact_mut(width).zip(prescribed.chunks_exact(width));
    for ((owner, follows), (to, prescribed)) in faces.zip(rows) {
        to.copy_from_slice(match follows {
            true => &cells[owner * width..][..width],
            false => prescribed,
        });
    }
}

/// A boundary face, or a point of an obstacle.
#[derive(Clone, Debug)]
struct Face {
    owner: u32,
    patch: usize,
    kind: NodeType,
}

/// First component, number of components and kind of a field, and of each patch whether all of a scalar's values so far equal the owners'.
#[derive(Clone, Debug)]
struct Columns {
    first: usize,
    count: usize,
    vector: bool,
    same: Vec<bool>,
}

/// Which boundary values follow those of their cells; the others are prescribed.
///
/// Vectors (velocity, displacement) follow where the flow leaves, on symmetry planes and on free surfaces; at walls, inlets, obstacles and
/// handles they are prescribed. Scalars (pressure) follow on each patch whose recorded values equal the owner's in every frame, which is
/// how a zero gradient is recorded: frames are shown ([`Boundary::see`]) before [`Boundary::settle`] says so.
#[derive(Clone, Debug)]
pub struct Boundary {
    /// Nodes before those of the boundary.
    pub n_inner: usize,
    width: usize,
    faces: Vec<Face>,
    fields: Vec<Columns>,
    /// Of each face and component.
    follows: Vec<bool>,
}

impl Boundary {
    /// Of the boundary of a mesh and the fields of a model in `dim` directions. Before it is settled no value follows.
    pub fn new(mesh: &Mesh, fields: &[FieldSpec], dim: usize) -> Self {
        let face = |b: &m4gn_mesh::BoundaryFace| Face {
            owner: b.owner as u32,
            patch: b.patch.max(0) as usize,
            kind: b.kind,
        };
        let faces: Vec<Face> = mesh.boundary.iter().map(face).collect();
        let patches = 1 + faces.iter().map(|f| f.patch).max().unwrap_or(0);
        let mut width = 0;
        let columns = |field: &FieldSpec| {
            let (first, count) = (width, field.components(dim));
            width += count;
            Columns { first, count, vector: field.vector, same: vec![true; patches] }
        };
        let fields = fields.iter().map(columns).collect();
        Boundary {
            n_inner: mesh.cell_global.len(),
            width,
            follows: vec![false; faces.len() * width],
            faces,
            fields,
        }
    }

    /// Of so many values, all of them prescribed.
    pub fn prescribed(n_inner: usize, n: usize, fields: &[FieldSpec], dim: usize) -> Self {
        let face = Face { owner: 0, patch: 0, kind: NodeType::Obstacle };
        let mut boundary = Boundary::new(&Mesh::default(), fields, dim);
        (boundary.n_inner, boundary.faces) = (n_inner, vec![face; n]);
        boundary.follows = vec![false; n * boundary.width];
        boundary
    }

    /// Looks at a frame: rows of all components, cells and then boundary.
    pub fn see(&mut self, frame: &[f32]) {
        let scalars: Vec<usize> = (0..self.fields.len()).filter(|&k| !self.fields[k].vector).collect();
        for k in scalars {
            let first = self.fields[k].first;
            let mut column = frame.chunks_exact(self.width).map(|row| row[first]);
            let cells: Vec<f32> = column.by_ref().take(self.n_inner).collect();
            let boundary: Vec<f32> = column.collect();
            self.see_scalar(k, &cells, &boundary);
        }
    }

    /// Looks at a frame of field `k` alone, where that is a scalar.
    pub fn see_field(&mut self, k: usize, cells: &[f32], boundary: &[f32]) {
        if !self.fields[k].vector {
            self.see_scalar(k, cells, boundary);
        }
    }

    fn see_scalar(&mut self, k: usize, cells: &[f32], boundary: &[f32]) {
        let scale = cells.iter().fold(0f32, |m, v| m.max(v.abs()));
        for (face, value) in self.faces.iter().zip(boundary) {
            if (value - cells[face.owner as usize]).abs() > SAME * scale {
                self.fields[k].same[face.patch] = false;
            }
        }
    }

    /// Lets follow what does so by the frames that were seen.
    pub fn settle(&mut self) {
        for (face, row) in self.faces.iter().zip(self.follows.chunks_exact_mut(self.width)) {
            for field in &self.fields {
                let follows = match field.vector {
                    true => matches!(face.kind, NodeType::Outlet | NodeType::Symmetry | NodeType::Free),
                    false => field.same[face.patch],
                };
                row[field.first..][..field.count].fill(follows);
            }
        }
    }

    /// Owner cell of each face.
    pub fn owners(&self) -> impl Iterator<Item = usize> {
        self.faces.iter().map(|face| face.owner as usize)
    }

    /// Whether a value follows, of each face and component.
    pub fn follows(&self) -> &[bool] {
        &self.follows
    }

    /// [`impose`] of field `k`.
    pub fn impose<T: Copy>(&self, k: usize, width: usize, cells: &[T], prescribed: &[T], boundary: &mut [T]) {
        let rows = self.follows.chunks_exact(self.width.max(1));
        let faces = self.owners().zip(rows.map(|row| row[self.fields[k].first]));
        impose(width, faces, cells, prescribed, boundary);
    }

    /// Gives boundary values in a state, which are the prescribed ones, their owners' where they follow, in the components that `counts`.
    pub fn follow(&self, state: &mut [f32], counts: impl Fn(usize) -> bool) {
        self.pairs(counts, |to, from| state[to] = state[from]);
    }

    /// Adds the derivative by boundary values that follow to that by their owners'.
    pub fn follow_backward(&self, d_state: &mut [f32], counts: impl Fn(usize) -> bool) {
        self.pairs(counts, |to, from| d_state[from] += d_state[to]);
    }

    /// Places in a state of each value that follows, and of its owner's.
    fn pairs(&self, counts: impl Fn(usize) -> bool, mut with: impl FnMut(usize, usize)) {
        let width = self.width;
        for (f, (face, row)) in self.faces.iter().zip(self.follows.chunks_exact(width.max(1))).enumerate() {
            for i in (0..width).filter(|&i| row[i] && counts(i)) {
                with((self.n_inner + f) * width + i, face.owner as usize * width + i);
            }
        }
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

/// Makes of a frame (rows of all components, cells and then boundary) what networks see: the faces of [`faces_seen_as_their_cells`] have
/// the cells' vectors, and what is positive is on its scale ([`FieldSpec::seen`]).
pub fn as_seen(
    as_cells: &[(usize, usize)],
    fields: &[FieldSpec],
    dim: usize,
    cells: usize,
    frame: &mut [f32],
) {
    let width: usize = fields.iter().map(|f| f.components(dim)).sum();
    let mut first = 0;
    for field in fields {
        let n = field.components(dim);
        for &(face, cell) in as_cells.iter().filter(|_| field.vector) {
            let at = |node: usize| node * width + first;
            frame.copy_within(at(cell)..at(cell) + n, at(cells + face));
        }
        if field.floor.is_some() {
            frame.chunks_exact_mut(width).for_each(|row| row[first] = field.seen(row[first].into()) as f32);
        }
        first += n;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_model::ModelSpec;
    use m4gn_samples::mesh as sample;

    /// U (vector) and p (scalar).
    fn fields() -> Vec<FieldSpec> {
        m4gn_samples::model::spec().fields
    }

    #[test]
    fn outlets_follow_and_walls_are_prescribed() {
        let mesh = sample::rectangle(3, 2, 1.0, 1.0);
        let mut rule = Boundary::new(&mesh, &fields()[..1], 2);
        rule.settle();
        let outlet = |i: usize| mesh.boundary[i].kind == NodeType::Outlet;
        let cells: Vec<f64> = (0..12).map(f64::from).collect();
        let n = 2 * mesh.boundary.len();
        let (prescribed, mut boundary) = (vec![-1.0; n], vec![0.0; n]);
        rule.impose(0, 2, &cells, &prescribed, &mut boundary);
        let mut state: Vec<f32> = (0..12).map(|i| i as f32).chain(vec![-1.0; n]).collect();
        rule.follow(&mut state, |i| i == 1);
        for (i, face) in mesh.boundary.iter().enumerate() {
            let o = 2.0 * face.owner as f64;
            let expected = if outlet(i) { [o, o + 1.0] } else { [-1.0, -1.0] };
            assert_eq!(boundary[2 * i..2 * i + 2], expected);
            assert_eq!(state[12 + 2 * i..][..2], [-1.0, expected[1] as f32]);
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
    fn positive_fields_are_seen_on_their_scale() {
        let mut fields = fields();
        fields[1].floor = Some(0.5);
        let mut frame = vec![3.0, 4.0, 2.0, 5.0, 6.0, 0.0];
        as_seen(&[(0, 0)], &fields, 2, 1, &mut frame);
        assert_eq!(frame, [3.0, 4.0, 2f32.ln(), 3.0, 4.0, 0.5f32.ln()]);
        let spec = ModelSpec { fields, ..m4gn_samples::model::spec() };
        let components = crate::Components::new(&spec);
        let off = components.mean_square(&[2], &frame[..3], &frame[3..], 0..1);
        assert!((off - 1.5f64.powi(2)).abs() < 1e-6);
    }

    #[test]
    fn scalars_follow_where_the_data_show_a_zero_gradient() {
        let mesh = sample::rectangle(3, 2, 1.0, 1.0);
        let cells: Vec<f32> = (1..7).map(|i| i as f32).collect();
        let at = |b: &m4gn_mesh::BoundaryFace| match b.kind {
            NodeType::Outlet => 0.0,
            _ => cells[b.owner as usize],
        };
        let boundary: Vec<f32> = mesh.boundary.iter().map(at).collect();
        let mut rule = Boundary::new(&mesh, &fields(), 2);
        let rows = cells.iter().chain(&boundary);
        rule.see(&rows.flat_map(|p| [0.5, 0.5, *p]).collect::<Vec<f32>>());
        rule.settle();
        let mut alone = Boundary::new(&mesh, &fields()[1..], 2);
        alone.see_field(0, &cells, &boundary);
        alone.settle();
        for (i, face) in mesh.boundary.iter().enumerate() {
            let expected = face.kind != NodeType::Outlet;
            assert_eq!((rule.follows()[3 * i + 2], alone.follows()[i]), (expected, expected));
        }
    }
}
