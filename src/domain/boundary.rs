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
    /// Whether it is where its owner is: the owner is a point of the boundary.
    at_owner: bool,
}

impl Face {
    /// Whether a field at a point of a wall or an obstacle changes with time, as frames show.
    fn slips(&self, field: &Columns) -> bool {
        self.at_owner && matches!(self.kind, NodeType::Wall | NodeType::Obstacle) && field.moves[self.patch]
    }
}

/// First component, number of components and kind of a field.
#[derive(Clone, Debug)]
struct Columns {
    first: usize,
    count: usize,
    vector: bool,
    /// Of each patch whether all of a scalar's values so far equal the owners'.
    same: Vec<bool>,
    /// Values of a vector at the faces in the first frame, and of each patch whether they are others in a later one.
    at_first: Vec<f32>,
    moves: Vec<bool>,
}

/// Which boundary values follow those of their cells; the others are prescribed.
///
/// Vectors (velocity, displacement) follow where the flow leaves, on symmetry planes and on free surfaces; at walls, inlets, obstacles and
/// handles they are prescribed. Scalars (pressure) follow on each patch whose recorded values equal the owner's in every frame, which is
/// how a zero gradient is recorded: frames are shown ([`Boundary::see`]) before [`Boundary::settle`] says so.
///
/// A node at the place of its boundary node is a point of the boundary. Its vectors are prescribed where those of the boundary node are,
/// and held ([`Boundary::is_held`]): at inlets and handles, and at walls and obstacles but on patches where frames show that they
/// change with time, as along a wall without friction: there it is predicted, and the boundary node follows.
#[derive(Clone, Debug)]
pub struct Boundary {
    /// Nodes before those of the boundary.
    pub n_inner: usize,
    width: usize,
    faces: Vec<Face>,
    fields: Vec<Columns>,
    /// Of each face and component.
    follows: Vec<bool>,
    /// Of each inner node and component whether it is prescribed; empty where none is.
    held: Vec<bool>,
}

impl Boundary {
    /// Of the boundary of a mesh and the fields of a model in `dim` directions. Before it is settled no value follows.
    pub fn new(mesh: &Mesh, fields: &[FieldSpec], dim: usize) -> Self {
        let face = |b: &m4gn_mesh::BoundaryFace| Face {
            owner: b.owner as u32,
            patch: b.patch.max(0) as usize,
            kind: b.kind,
            at_owner: mesh.cell_centres.get(b.owner as usize) == Some(&b.centre),
        };
        let faces: Vec<Face> = mesh.boundary.iter().map(face).collect();
        let patches = 1 + faces.iter().map(|f| f.patch).max().unwrap_or(0);
        let mut width = 0;
        let columns = |field: &FieldSpec| {
            let (first, count) = (width, field.components(dim));
            width += count;
            Columns {
                first,
                count,
                vector: field.vector,
                same: vec![true; patches],
                at_first: Vec::new(),
                moves: vec![false; patches],
            }
        };
        let fields = fields.iter().map(columns).collect();
        let follows = vec![false; faces.len() * width];
        let mut boundary =
            Boundary { n_inner: mesh.cell_global.len(), width, follows, held: Vec::new(), faces, fields };
        boundary.hold();
        boundary
    }

    /// Of so many values, all of them prescribed.
    pub fn prescribed(n_inner: usize, n: usize, fields: &[FieldSpec], dim: usize) -> Self {
        let face = Face { owner: 0, patch: 0, kind: NodeType::Obstacle, at_owner: false };
        let mut boundary = Boundary::new(&Mesh::default(), fields, dim);
        (boundary.n_inner, boundary.faces) = (n_inner, vec![face; n]);
        boundary.follows = vec![false; n * boundary.width];
        boundary
    }

    /// Looks at a frame: rows of all components, cells and then boundary.
    pub fn see(&mut self, frame: &[f32]) {
        for k in 0..self.fields.len() {
            let columns = self.fields[k].first..self.fields[k].first + self.fields[k].count;
            let mut rows = frame.chunks_exact(self.width).map(|row| &row[columns.clone()]);
            let cells = rows.by_ref().take(self.n_inner).flatten().copied().collect::<Vec<f32>>();
            let boundary: Vec<f32> = rows.flatten().copied().collect();
            self.see_field(k, &cells, &boundary);
        }
    }

    /// Looks at a frame of field `k` alone.
    pub fn see_field(&mut self, k: usize, cells: &[f32], boundary: &[f32]) {
        match self.fields[k].vector {
            true => self.see_vector(k, boundary),
            false => self.see_scalar(k, cells, boundary),
        }
    }

    fn see_vector(&mut self, k: usize, boundary: &[f32]) {
        let Columns { count, at_first, moves, .. } = &mut self.fields[k];
        if at_first.is_empty() {
            at_first.extend_from_slice(boundary);
        }
        let scale = boundary.iter().fold(0f32, |m, v| m.max(v.abs()));
        let rows = boundary.chunks_exact(*count).zip(at_first.chunks_exact(*count));
        for (face, (now, first)) in self.faces.iter().zip(rows) {
            moves[face.patch] |= now.iter().zip(first).any(|(a, b)| (a - b).abs() > SAME * scale);
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
                    true => {
                        matches!(face.kind, NodeType::Outlet | NodeType::Symmetry | NodeType::Free)
                            || face.slips(field)
                    }
                    false => field.same[face.patch],
                };
                row[field.first..][..field.count].fill(follows);
            }
        }
        self.hold();
    }

    /// Says what is held.
    fn hold(&mut self) {
        self.held.clear();
        for face in self.faces.iter().filter(|face| face.at_owner) {
            for field in self.fields.iter().filter(|field| field.vector) {
                let held = match face.kind {
                    NodeType::Inlet | NodeType::Handle => true,
                    NodeType::Wall | NodeType::Obstacle => !face.slips(field),
                    _ => false,
                };
                if held {
                    self.held.resize(self.n_inner * self.width, false);
                    self.held[face.owner as usize * self.width + field.first..][..field.count].fill(true);
                }
            }
        }
    }

    /// Whether a component of an inner node is prescribed: that of a point of the boundary.
    pub fn is_held(&self, node: usize, component: usize) -> bool {
        self.held.get(node * self.width + component).copied().unwrap_or(false)
    }

    /// The boundary faces at points whose component is held, with these points.
    pub fn held_points(&self, component: usize) -> impl Iterator<Item = (usize, usize)> {
        let faces = self.faces.iter().enumerate().filter(|(_, face)| face.at_owner);
        let points = faces.map(|(f, face)| (f, face.owner as usize));
        points.filter(move |&(_, point)| self.is_held(point, component))
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

    /// At points the velocity of inlets is held, and that of walls as long as no frame shows that it changes; a pressure and what is at an outlet
    /// are predicted.
    #[test]
    fn points_of_walls_and_inlets_are_held() {
        let mesh = sample::at_points(sample::rectangle(4, 3, 1.0, 1.0));
        let mut rule = Boundary::new(&mesh, &fields(), 2);
        let held = |rule: &Boundary| -> Vec<usize> {
            let of = |i: usize| (0..12).filter(|&point| rule.is_held(point, i)).collect::<Vec<_>>();
            assert_eq!((of(1), of(2)), (of(0), vec![]));
            of(0)
        };
        // Walls below and above, the inlet in the middle on the left.
        assert_eq!(held(&rule), [0, 1, 2, 3, 4, 8, 9, 10, 11]);
        let mut points: Vec<usize> = rule.held_points(0).map(|(_, point)| point).collect();
        points.sort_unstable();
        points.dedup();
        assert_eq!(points, held(&rule));
        let mut frame = vec![0.5f32; 3 * (12 + mesh.boundary.len())];
        rule.see(&frame);
        rule.see(&frame);
        rule.settle();
        assert_eq!(held(&rule).len(), 9);
        // Along the walls the flow slips from now on.
        for (i, _) in mesh.boundary.iter().enumerate().filter(|(_, b)| b.kind == NodeType::Wall) {
            frame[3 * (12 + i)] = 0.6;
        }
        rule.see(&frame);
        rule.settle();
        assert_eq!(held(&rule), [0, 4, 8]);
        for (face, follows) in mesh.boundary.iter().zip(rule.follows().chunks_exact(3)) {
            assert_eq!(follows[0], matches!(face.kind, NodeType::Outlet | NodeType::Wall), "{face:?}");
        }
        assert_eq!(Boundary::new(&sample::rectangle(4, 3, 1.0, 1.0), &fields(), 2).held, Vec::<bool>::new());
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
