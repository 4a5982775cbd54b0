//! How good a predicted mesh is: the paper's metrics of appendix C.2, each 0 for the true mesh.
//!
//! `gf_h` (eq. 15, m) and `gf_c` (eq. 16, m^2) compare the two sets of points, not point by point. For the other two
//! the paper leaves choices; these are ours:
//!
//! * `mc`: eq. 17 gives every cell the ratio of the largest to the smallest of its neighbours' volumes. A neighbour
//!   shares a face; a cell is not its own neighbour; a cell without neighbours has the ratio 1. The
//!   paper reports values far below 1, so the figure is a difference from the true mesh: the mean over cells of
//!   |ratio predicted - ratio true|. `mc_predicted` is eq. 17 as printed: the mean ratio of the predicted mesh.
//! * `ar`: mean over cells of |aspect ratio predicted - aspect ratio true|, with the constant as printed,
//!   `sqrt(6) Lmax / V^(1/3)` (the paper prints it for tetrahedra; wedges, pyramids and hexahedra use it too), Lmax the longest edge.
//!
//! Sizes enter without their sign and at least 1e-9 of the true cell's, so that a cell that was turned inside out or
//! crushed gives a large figure and not an infinite one; [`Quality::inverted`] counts the cells turned inside out.

use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::elements::Elements;
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::vector::{Vector, norm, sub};

/// Differences of a predicted mesh from the true one.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Quality {
    /// Hausdorff distance of the points, m (eq. 15).
    pub gf_h: f64,
    /// Chamfer distance of the points, m^2 (eq. 16).
    pub gf_c: f64,
    /// Mesh continuity error (eq. 17).
    pub mc: f64,
    /// Mesh continuity of the predicted mesh alone (eq. 17 as printed), 1 where all cells are of one size.
    pub mc_predicted: f64,
    /// Aspect ratio error.
    pub ar: f64,
    /// Part of the cells that have a negative volume in the prediction, 0 to 1.
    pub inverted: f64,
}

impl Quality {
    /// Mean of each figure; all 0 for none.
    pub fn mean(all: &[Quality]) -> Quality {
        Quality::of(|figure| all.iter().map(figure).sum::<f64>() / all.len().max(1) as f64)
    }

    /// What is made of each figure.
    pub fn of(make: impl Fn(fn(&Quality) -> f64) -> f64) -> Quality {
        Quality {
            gf_h: make(|q| q.gf_h),
            gf_c: make(|q| q.gf_c),
            mc: make(|q| q.mc),
            mc_predicted: make(|q| q.mc_predicted),
            ar: make(|q| q.ar),
            inverted: make(|q| q.inverted),
        }
    }
}

/// Compares meshes of the same elements.
#[derive(Clone, Debug)]
pub struct Comparison<'a> {
    elements: &'a Elements,
    neighbours: Vec<Vec<usize>>,
}

impl<'a> Comparison<'a> {
    /// For meshes of these elements.
    pub fn new(elements: &'a Elements) -> Self {
        Comparison { elements, neighbours: elements.neighbours() }
    }

    /// Metrics of `predicted` points against `truth`, both `[N]` positions in m.
    ///
    /// # Errors
    /// [`Error::Input`] for different numbers of points, [`Error::Numerical`] for positions that are not finite.
    pub fn quality(&self, truth: &[Vector], predicted: &[Vector]) -> Result<Quality> {
        refuse(truth.len() != predicted.len(), Error::Input, || {
            format!("{} predicted points, expected {}", predicted.len(), truth.len())
        })?;
        for (name, points) in [("true", truth), ("predicted", predicted)] {
            if let Some(i) = points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
                return Err(Error::Numerical(format!("the {name} position of point {i} is not finite")));
            }
        }
        let (gf_h, gf_c) = geometric_fidelity(truth, predicted);
        let exact = self.elements.measures(truth);
        let found = self.elements.measures(predicted);
        let size = |measures: &[f64]| -> Vec<f64> {
            let pairs = measures.iter().zip(&exact);
            pairs.map(|(m, e)| m.abs().max(1e-9 * e.abs())).collect()
        };
        let (true_size, predicted_size) = (size(&exact), size(&found));
        let ratios = |size: &[f64]| self.neighbours.iter().map(|n| ratio(n, size)).collect::<Vec<f64>>();
        let (mc_true, mc_predicted) = (ratios(&true_size), ratios(&predicted_size));
        let mc = mc_predicted.iter().zip(&mc_true).map(|(p, t)| (p - t).abs());
        let ar = (0..self.elements.len()).map(|e| {
            let aspect = |positions, size: &[f64]| self.aspect_ratio(e, positions, size[e]);
            (aspect(predicted, &predicted_size) - aspect(truth, &true_size)).abs()
        });
        let inverted = found.iter().filter(|&&v| v < 0.0).count();
        let cells = self.elements.len().max(1) as f64;
        Ok(Quality {
            gf_h,
            gf_c,
            mc: mc.sum::<f64>() / cells,
            mc_predicted: mc_predicted.iter().sum::<f64>() / cells,
            ar: ar.sum::<f64>() / cells,
            inverted: inverted as f64 / cells,
        })
    }

    fn aspect_ratio(&self, e: usize, positions: &[Vector], size: f64) -> f64 {
        let kind = self.elements.kind[e];
        let corners = self.elements.corners(e, positions);
        let longest =
            kind.edges().into_iter().map(|[a, b]| norm(sub(corners[a], corners[b]))).fold(0.0, f64::max);
        6f64.sqrt() * longest / size.cbrt()
    }
}

/// Hausdorff and Chamfer distance of two sets of points (eq. 15 and 16).
pub fn geometric_fidelity(truth: &[Vector], predicted: &[Vector]) -> (f64, f64) {
    let directed = |from: &[Vector], to: &Nearest| {
        let squares = from.iter().map(|&x| to.distance_squared(x));
        squares.fold((0.0f64, 0.0), |(largest, sum), d| (largest.max(d), sum + d))
    };
    let (a, b) = (directed(truth, &Nearest::new(predicted)), directed(predicted, &Nearest::new(truth)));
    let hausdorff = a.0.max(b.0).sqrt();
    (hausdorff, a.1 / truth.len().max(1) as f64 + b.1 / predicted.len().max(1) as f64)
}

/// Largest over smallest size of the neighbours.
fn ratio(neighbours: &[usize], size: &[f64]) -> f64 {
    let (low, high) =
        neighbours.iter().map(|&n| size[n]).fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
    // Two cells crushed to nothing in the true mesh would be 0/0.
    if high > 0.0 { high / low } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::elements::ElementKind;

    fn compare(elements: &Elements, truth: &[Vector], predicted: &[Vector]) -> Quality {
        Comparison::new(elements).quality(truth, predicted).unwrap()
    }

    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0), "{found}, expected {expected}");
    }

    /// A row of `n` unit bricks along x as elements of a kind.
    fn row(kind: ElementKind, n: i32) -> (Elements, Vec<Vector>) {
        let positions = (0..=n)
            .flat_map(|x| [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(y, z)| [x, y, z].map(f64::from)))
            .collect();
        let mut points = Vec::new();
        for x in 0..n {
            // Corners as of a hexahedron: x = 0 quadrilateral, then the one at x = 1
            let c: Vec<i32> = (0..8).map(|i| 4 * x + i).collect();
            match kind {
                ElementKind::Hexahedron => points.extend(c),
                ElementKind::Wedge => points.extend([0, 1, 2, 4, 5, 6, 0, 2, 3, 4, 6, 7].map(|i| c[i])),
                _ => unreachable!(),
            }
        }
        (Elements::of_kind(kind, points), positions)
    }

    #[test]
    fn the_true_mesh_has_no_error() {
        for kind in [ElementKind::Hexahedron, ElementKind::Wedge] {
            let (elements, points) = row(kind, 3);
            let found = compare(&elements, &points, &points);
            let same = Quality { mc_predicted: found.mc_predicted, ..Quality::default() };
            assert_eq!((found, found.mc_predicted), (same, 1.0));
        }
    }

    #[test]
    fn shifted_points_have_the_shift_as_distance() {
        let (elements, points) = row(ElementKind::Hexahedron, 4);
        let shifted: Vec<_> = points.iter().map(|p| [p[0], p[1] + 0.25, p[2]]).collect();
        let q = compare(&elements, &points, &shifted);
        close(q.gf_h, 0.25);
        close(q.gf_c, 2.0 * 0.0625);
        close(q.mc, 0.0);
        close(q.ar, 0.0);
        // A shift by one cell along x: all but the end points coincide with other points
        let shifted: Vec<_> = points.iter().map(|p| [p[0] + 1.0, p[1], p[2]]).collect();
        let q = compare(&elements, &points, &shifted);
        close(q.gf_h, 1.0);
        close(q.gf_c, 2.0 * 4.0 / 20.0);
    }

    /// Three bricks; the last one becomes twice as long: neighbours of the middle one have sizes 1 and 2.
    #[test]
    fn continuity_of_bricks_on_paper() {
        let (elements, points) = row(ElementKind::Hexahedron, 3);
        let longer: Vec<_> =
            points.iter().map(|p| [if p[0] > 2.5 { 4.0 } else { p[0] }, p[1], p[2]]).collect();
        let q = compare(&elements, &points, &longer);
        close(q.mc, (0.0 + 1.0 + 0.0) / 3.0);
        close(q.mc_predicted, (1.0 + 2.0 + 1.0) / 3.0);
        // Aspect ratio of the long one: longest edge 2, volume 2
        close(q.ar, 6f64.sqrt() * (2.0 / 2f64.cbrt() - 1.0) / 3.0);
    }

    /// Wedges of the same row: the middle ones see their twin (their own size) and a wedge of a neighbouring brick.
    #[test]
    fn continuity_of_wedges_on_paper() {
        let (elements, points) = row(ElementKind::Wedge, 2);
        let longer: Vec<_> =
            points.iter().map(|p| [if p[0] > 1.5 { 3.0 } else { p[0] }, p[1], p[2]]).collect();
        let q = compare(&elements, &points, &longer);
        // Every wedge has its twin and one of the other brick as neighbours: sizes 1/2 and 1, ratio 2
        close(q.mc, 1.0);
        let of = |longest: f64, volume: f64| 6f64.sqrt() * longest / volume.cbrt();
        // Longest edge of a half unit brick is its diagonal sqrt(2), of the long one 2
        close(q.ar, (of(2.0, 1.0) - of(2f64.sqrt(), 0.5)).abs() / 2.0);
    }

    #[test]
    fn the_aspect_ratio_is_as_printed() {
        let tetrahedron = Elements::of_kind(ElementKind::Tetrahedron, vec![0, 1, 2, 3]);
        let c = Comparison::new(&tetrahedron);
        // The regular one with edges sqrt(2), volume 1/3
        let p = [[1., 1., 1.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
        close(tetrahedron.measures(&p)[0].abs(), 1.0 / 3.0);
        close(c.aspect_ratio(0, &p, 1.0 / 3.0), 12f64.sqrt() * 3f64.cbrt());
    }

    #[test]
    fn crushed_and_inverted_cells_stay_finite() {
        let (elements, points) = row(ElementKind::Hexahedron, 3);
        let flat = vec![[0.0; 3]; points.len()];
        let q = compare(&elements, &points, &flat);
        assert!(q.mc == 0.0 && q.ar.is_finite() && q.inverted == 0.0, "{q:?}");
        let mirrored: Vec<_> = points.iter().map(|p| [-p[0], p[1], p[2]]).collect();
        assert_eq!(compare(&elements, &points, &mirrored).inverted, 1.0);
        let c = Comparison::new(&elements);
        assert!(c.quality(&points, &points[1..]).is_err());
        let mut nan = points.clone();
        nan[3][1] = f64::NAN;
        assert!(c.quality(&points, &nan).unwrap_err().to_string().contains("point 3"));
    }
}
