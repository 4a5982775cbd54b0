//! The elements of finite-element libraries, recognised from a cell's faces as OpenFOAM's cell matchers do.

use super::mesh::Cell;

/// A cell with as many and such faces as a standard element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Three points, 2-D.
    Triangle,
    /// Four points, 2-D.
    Quadrilateral,
    /// Any other polygon.
    Polygon,
    /// Four triangles.
    Tetrahedron,
    /// One quadrilateral and four triangles.
    Pyramid,
    /// Two triangles and three quadrilaterals (OpenFOAM: prism).
    Wedge,
    /// Six quadrilaterals.
    Hexahedron,
    /// Any other cell.
    Polyhedron,
}

impl Shape {
    /// Lower-case name.
    pub fn name(self) -> &'static str {
        match self {
            Shape::Triangle => "triangle",
            Shape::Quadrilateral => "quadrilateral",
            Shape::Polygon => "polygon",
            Shape::Tetrahedron => "tetrahedron",
            Shape::Pyramid => "pyramid",
            Shape::Wedge => "wedge",
            Shape::Hexahedron => "hexahedron",
            Shape::Polyhedron => "polyhedron",
        }
    }
}

/// The shape of a cell, and its points as positions in the order of the reference element: a face whose normal
/// points into the cell, then the points opposite to it.
pub(super) fn recognise(cell: &Cell) -> (Shape, Vec<usize>) {
    let n = cell.points.len();
    let faces = |size: usize| cell.faces.iter().filter(|f| f.len() == size).count();
    if cell.faces.iter().all(|f| f.len() == 2) {
        let shape = match n {
            3 => Shape::Triangle,
            4 => Shape::Quadrilateral,
            _ => Shape::Polygon,
        };
        return (shape, (0..n).collect());
    }
    let (shape, base) = match (n, cell.faces.len(), faces(3), faces(4)) {
        (4, 4, 4, 0) => (Shape::Tetrahedron, 3),
        (5, 5, 4, 1) => (Shape::Pyramid, 4),
        (6, 5, 2, 3) => (Shape::Wedge, 3),
        (8, 6, 0, 6) => (Shape::Hexahedron, 4),
        _ => return (Shape::Polyhedron, Vec::new()),
    };
    let ordered = cell.faces.iter().find(|f| f.len() == base).and_then(|face| {
        let bottom: Vec<usize> = face.iter().rev().copied().collect();
        let mut order = bottom.clone();
        for &p in &bottom {
            let top = opposite(cell, &bottom, p)?;
            if !order.contains(&top) || matches!(shape, Shape::Wedge | Shape::Hexahedron) {
                order.push(top);
            }
        }
        let mut distinct = order.clone();
        distinct.sort_unstable();
        distinct.dedup();
        (order.len() == n && distinct.len() == n).then_some(order)
    });
    match ordered {
        Some(order) => (shape, order),
        None => (Shape::Polyhedron, Vec::new()),
    }
}

/// The point at the other end of the edge that leaves `p` and the bottom.
fn opposite(cell: &Cell, bottom: &[usize], p: usize) -> Option<usize> {
    cell.faces.iter().find_map(|face| {
        let at = face.iter().position(|&q| q == p)?;
        let next = face[(at + 1) % face.len()];
        (!bottom.contains(&next)).then_some(next)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::sample;

    #[test]
    fn shapes_are_recognised_and_turn_the_right_way() {
        for (kind, shape, n) in [
            (sample::Kind::Hexahedra, Shape::Hexahedron, 8),
            (sample::Kind::WedgesAlong, Shape::Wedge, 6),
            (sample::Kind::WedgesAcross, Shape::Wedge, 6),
            (sample::Kind::Tetrahedra, Shape::Tetrahedron, 4),
            (sample::Kind::Pyramids, Shape::Pyramid, 5),
        ] {
            let mesh = sample::block(kind, [2, 2, 2], [1.0, 1.0, 1.0]);
            for cell in mesh.polyhedra() {
                let (found, order) = recognise(&cell);
                assert_eq!((found, order.len()), (shape, n));
                // The first three edges from the first point are right-handed.
                let x: Vec<[f64; 3]> = order.iter().map(|&p| mesh.points[cell.points[p]]).collect();
                let (j, k) = match shape {
                    Shape::Hexahedron | Shape::Pyramid => (3, 4),
                    _ => (2, 3),
                };
                let e = [1, j, k].map(|i: usize| [0, 1, 2].map(|d| x[i][d] - x[0][d]));
                let det = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1])
                    - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0])
                    + e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
                assert!(det > 0.0, "{shape:?}: {x:?}");
            }
        }
        let mesh = sample::block(sample::Kind::Polyhedra, [2, 2, 2], [1.0, 1.0, 1.0]);
        assert!(mesh.polyhedra().iter().any(|c| recognise(c).0 == Shape::Polyhedron));
    }
}
