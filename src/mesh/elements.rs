//! Linear elements in three dimensions: faces, edges, sizes.

use crate::joined::Joined;
use crate::vector::{Vector, cross, dot, sub};
use m4gn_base::{Error, Result};
use std::collections::BTreeMap;

/// A linear element; the codes are VTK's.
///
/// Points are ordered as usual in finite elements (and as OpenFOAM's cell models): the fourth point of a tetrahedron lies on the side to which the normal of the first three points; so do a
/// pyramid's tip, a wedge's second triangle and a hexahedron's second quadrilateral, point above point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(i32)]
pub enum ElementKind {
    /// 4 points.
    Tetrahedron = 10,
    /// 8 points.
    Hexahedron = 12,
    /// 6 points.
    Wedge = 13,
    /// 5 points.
    Pyramid = 14,
}

m4gn_base::names! {
    ElementKind: Tetrahedron "tetrahedra", Hexahedron "hexahedra", Wedge "wedges", Pyramid "pyramids"
}

impl ElementKind {
    /// The kind of a code.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a code that is none.
    pub fn from_code(code: i32) -> Result<Self> {
        Self::ALL.into_iter().find(|k| *k as i32 == code).ok_or_else(|| {
            let known = Self::ALL.map(|k| format!("{} ({})", k as i32, k.name()));
            Error::Mesh(format!("element code {code}, expected one of {}", known.join(", ")))
        })
    }

    /// Number of points.
    pub fn n_points(self) -> usize {
        match self {
            ElementKind::Tetrahedron => 4,
            ElementKind::Pyramid => 5,
            ElementKind::Wedge => 6,
            ElementKind::Hexahedron => 8,
        }
    }

    /// What it shares with a neighbour: faces, normals outward.
    pub fn sides(self) -> &'static [&'static [usize]] {
        match self {
            ElementKind::Tetrahedron => &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[2, 0, 3]],
            ElementKind::Pyramid => &[&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]],
            ElementKind::Wedge => &[&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]],
            ElementKind::Hexahedron => {
                &[&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]]
            }
        }
    }

    /// Each edge once, as positions among the element's points.
    pub fn edges(self) -> Vec<[usize; 2]> {
        let mut edges: Vec<[usize; 2]> = self
            .sides()
            .iter()
            .flat_map(|side| {
                let n = side.len();
                (0..n).map(move |i| {
                    let (a, b) = (side[i], side[(i + 1) % n]);
                    [a.min(b), a.max(b)]
                })
            })
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Volume of the element at `points`, m^3; negative when turned inside out.
    ///
    /// Quadrilateral faces are bilinear.
    pub fn measure(self, points: &[Vector]) -> f64 {
        // Divergence theorem over triangles around the middle of each face, from the element's own middle.
        let middle = mean(points.iter().copied(), points.len());
        let mut volume = 0.0;
        for side in self.sides() {
            let centre = mean(side.iter().map(|&i| points[i]), side.len());
            for i in 0..side.len() {
                let (a, b) = (points[side[i]], points[side[(i + 1) % side.len()]]);
                volume += dot(sub(centre, middle), cross(sub(a, middle), sub(b, middle))) / 6.0;
            }
        }
        volume
    }
}

fn mean(points: impl Iterator<Item = Vector>, count: usize) -> Vector {
    let sum = points.fold([0.0; 3], |s, p| [s[0] + p[0], s[1] + p[1], s[2] + p[2]]);
    sum.map(|s| s / count as f64)
}

/// Elements of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Elements {
    /// Kind of each.
    pub kind: Vec<ElementKind>,
    /// Points of element e: `points[start[e]..start[e + 1]]`; one more than there are elements.
    pub start: Vec<usize>,
    /// Point numbers.
    pub points: Vec<i32>,
}

impl Elements {
    /// Elements of one kind, from rows of its number of points.
    pub fn of_kind(kind: ElementKind, points: Vec<i32>) -> Self {
        let n = kind.n_points();
        let count = points.len() / n;
        Elements { kind: vec![kind; count], start: (0..=count).map(|i| i * n).collect(), points }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.kind.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.kind.is_empty()
    }

    /// Point numbers of element `e`.
    pub fn points_of(&self, e: usize) -> &[i32] {
        &self.points[self.start[e]..self.start[e + 1]]
    }

    /// Positions of the points of element `e`.
    pub fn corners(&self, e: usize, positions: &[Vector]) -> Vec<Vector> {
        self.points_of(e).iter().map(|&p| positions[p as usize]).collect()
    }

    /// Volumes of all elements, see [`ElementKind::measure`].
    pub fn measures(&self, positions: &[Vector]) -> Vec<f64> {
        (0..self.len()).map(|e| self.kind[e].measure(&self.corners(e, positions))).collect()
    }

    /// Sides of all elements: the elements at each (one or two where the mesh is sound) and its points, outward from
    /// the first. Sorted by points.
    fn sides(&self) -> BTreeMap<Vec<i32>, (Vec<usize>, Vec<i32>)> {
        let mut sides: BTreeMap<Vec<i32>, (Vec<usize>, Vec<i32>)> = BTreeMap::new();
        for e in 0..self.len() {
            let points = self.points_of(e);
            for side in self.kind[e].sides() {
                let face: Vec<i32> = side.iter().map(|&i| points[i]).collect();
                let mut key = face.clone();
                key.sort_unstable();
                sides.entry(key).or_insert_with(|| (Vec::new(), face)).0.push(e);
            }
        }
        sides
    }

    /// Elements that share a face with each element.
    pub fn neighbours(&self) -> Vec<Vec<usize>> {
        let mut neighbours = vec![Vec::new(); self.len()];
        for (elements, _) in self.sides().into_values() {
            for &a in &elements {
                neighbours[a].extend(elements.iter().filter(|&&b| b != a));
            }
        }
        neighbours
    }

    /// Faces of one element only, as point numbers, normals outward.
    pub fn skin(&self) -> Vec<Vec<i32>> {
        let outer = self.sides().into_values().filter(|(e, _)| e.len() == 1);
        outer.map(|(_, face)| face).collect()
    }

    /// Each edge of the mesh once, smaller point first, sorted.
    pub fn edges(&self) -> Vec<[i32; 2]> {
        let mut edges = Vec::new();
        for e in 0..self.len() {
            let points = self.points_of(e);
            edges.extend(self.kind[e].edges().into_iter().map(|[a, b]| {
                let (a, b) = (points[a], points[b]);
                [a.min(b), a.max(b)]
            }));
        }
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Number of the part that each of the points `0..n` belongs to: parts share no point with one another.
    pub fn parts(&self, n: usize) -> Vec<u32> {
        let mut joined = Joined::new(n);
        for e in 0..self.len() {
            for pair in self.points_of(e).windows(2) {
                joined.join(pair[0] as usize, pair[1] as usize);
            }
        }
        let mut number = vec![u32::MAX; n];
        let mut count = 0;
        let mut of = |p: usize| {
            let r = joined.root(p);
            if number[r] == u32::MAX {
                number[r] = count;
                count += 1;
            }
            number[r]
        };
        (0..n).map(&mut of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The element of unit size in its usual place.
    fn unit(kind: ElementKind) -> Vec<Vector> {
        let square = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]];
        let at = |z: f64, n: usize| square[..n].iter().map(move |p| [p[0], p[1], z]);
        let triangle = |z: f64| [[0., 0., z], [1., 0., z], [0., 1., z]].into_iter();
        match kind {
            ElementKind::Tetrahedron => triangle(0.).chain([[0., 0., 1.]]).collect(),
            ElementKind::Hexahedron => at(0., 4).chain(at(1., 4)).collect(),
            ElementKind::Wedge => triangle(0.).chain(triangle(1.)).collect(),
            ElementKind::Pyramid => at(0., 4).chain([[0.5, 0.5, 1.]]).collect(),
        }
    }

    #[test]
    fn sizes_of_unit_elements() {
        let sizes = [1.0 / 6.0, 1.0, 0.5, 1.0 / 3.0];
        for (kind, size) in ElementKind::ALL.into_iter().zip(sizes) {
            let points = unit(kind);
            assert_eq!(points.len(), kind.n_points());
            assert!((kind.measure(&points) - size).abs() < 1e-15, "{kind:?}");
            let mirrored: Vec<_> = points.iter().map(|p| [-p[0], p[1], p[2]]).collect();
            assert!((kind.measure(&mirrored) + size).abs() < 1e-15, "{kind:?}");
            assert_eq!(ElementKind::from_code(kind as i32).unwrap(), kind);
        }
        assert!(ElementKind::from_code(4).unwrap_err().to_string().contains("13 (wedges)"));
    }

    /// A hexahedron whose top is twisted by bilinear faces: the volume is the integral of its Jacobian.
    #[test]
    fn bilinear_faces_are_exact() {
        let mut p = unit(ElementKind::Hexahedron);
        p[6] = [1., 1., 3.];
        // z = t (1 + 2 r s): integral over r, s of 1 + 2 r s is 1.5
        assert!((ElementKind::Hexahedron.measure(&p) - 1.5).abs() < 1e-14);
    }

    #[test]
    fn edges_and_euler() {
        let edges = [6, 12, 9, 8];
        for (kind, count) in ElementKind::ALL.into_iter().zip(edges) {
            assert_eq!(kind.edges().len(), count, "{kind:?}");
            assert_eq!(kind.n_points() + kind.sides().len() - count, 2, "{kind:?}");
        }
    }

    #[test]
    fn two_wedges_make_a_brick() {
        // Bottom 0 1 2 3, top 4 5 6 7, cut from 0 to 2
        let wedges = Elements::of_kind(ElementKind::Wedge, vec![0, 1, 2, 4, 5, 6, 0, 2, 3, 4, 6, 7]);
        assert_eq!(wedges.neighbours(), [vec![1], vec![0]]);
        assert_eq!(wedges.skin().len(), 8);
        assert_eq!(wedges.edges().len(), 14);
        let positions = unit(ElementKind::Hexahedron);
        assert!(wedges.measures(&positions).iter().all(|v| (v - 0.5).abs() < 1e-15));
        // Outward normals: the skin's volume is the brick's
        let mut volume = 0.0;
        for face in wedges.skin() {
            let p: Vec<_> = face.iter().map(|&i| positions[i as usize]).collect();
            for i in 1..p.len() - 1 {
                volume += dot(p[0], cross(p[i], p[i + 1])) / 6.0;
            }
        }
        assert!((volume - 1.0).abs() < 1e-14);
    }
}
