//! The gap between a body's skin and a rigid obstacle, as the generator of the data measures it.

use m4gn_mesh::elements::Elements;
use m4gn_mesh::surface::Surface;
use m4gn_mesh::vector::{Vector, norm, sub};

/// Samples of a body's skin: its points, the middles of its edges, the centroids of its faces.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Point numbers whose mean is the sample.
    of: Vec<Vec<i32>>,
}

/// The worst sample of a frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Gap {
    /// Signed distance to the obstacle in cell sizes; negative: penetration.
    pub cells: f64,
    /// Where, m.
    pub at: Vector,
}

impl Samples {
    /// Samples of the skin of `elements`. Faces whose points are all fixed are left out: nothing can push them.
    pub fn new(elements: &Elements, is_fixed: impl Fn(i32) -> bool) -> Self {
        let mut faces = elements.skin();
        faces.retain(|f| !f.iter().all(|&p| is_fixed(p)));
        let mut of: Vec<Vec<i32>> = Vec::new();
        for face in &faces {
            for (i, &a) in face.iter().enumerate() {
                let b = face[(i + 1) % face.len()];
                of.push(vec![a]);
                of.push(vec![a.min(b), a.max(b)]);
            }
        }
        of.retain(|s| !s.iter().all(|&p| is_fixed(p)));
        of.sort_unstable();
        of.dedup();
        of.extend(faces);
        Samples { of }
    }

    /// The smallest gap between the body at `positions` (m) and an obstacle, in units of `cell_size`. None where there are no samples.
    pub fn worst(&self, positions: &[Vector], surface: &Surface, cell_size: f64) -> Option<Gap> {
        let mut worst: Option<(f64, Vector)> = None;
        for sample in &self.of {
            let x = mean(sample, positions);
            // Outside the box around the obstacle and farther from it than the worst: not looked at closer
            let least = surface.beyond_box(x);
            if worst.is_some_and(|(w, _)| least > 0.0 && least >= w) {
                continue;
            }
            let d = surface.distance(x);
            if worst.is_none_or(|(w, _)| d < w) {
                worst = Some((d, x));
            }
        }
        worst.map(|(d, at)| Gap { cells: d / cell_size, at })
    }
}

fn mean(points: &[i32], positions: &[Vector]) -> Vector {
    let mut x = [0.0; 3];
    for &p in points {
        for i in 0..3 {
            x[i] += positions[p as usize][i] / points.len() as f64;
        }
    }
    x
}

/// Mean rest length of the edges, m: the unit of gaps.
pub fn cell_size(positions: &[Vector], edges: &[[i32; 2]]) -> f64 {
    let length = |e: &[i32; 2]| norm(sub(positions[e[0] as usize], positions[e[1] as usize]));
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::elements::ElementKind;
    use m4gn_samples::mesh::brick;

    /// A unit brick and a box beside its side x = 1; all fixed at x = 0.
    fn worst(shift: f64) -> Gap {
        let body = Elements::of_kind(ElementKind::Hexahedron, (0..8).collect());
        let positions: Vec<Vector> = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]]
            .iter()
            .flat_map(|p| [[0.0, p[0], p[1]], [1.0, p[0], p[1]]])
            .collect();
        // Order of the brick: quadrilateral at x = 0, then at x = 1
        let positions: Vec<Vector> = [0, 2, 4, 6, 1, 3, 5, 7].iter().map(|&i| positions[i]).collect();
        let samples = Samples::new(&body, |p| p < 4);
        let (points, triangles) = brick([0.2; 3]);
        let obstacle: Vec<Vector> =
            points.iter().map(|p| [p[0] + 1.0 + shift, p[1] + 0.4, p[2] + 0.4]).collect();
        samples.worst(&positions, &Surface::new(&obstacle, &triangles).unwrap(), 0.5).unwrap()
    }

    #[test]
    fn the_middle_of_a_face_counts() {
        let gap = worst(0.3);
        assert!((gap.cells - 0.6).abs() < 1e-12, "{gap:?}");
        assert_eq!(gap.at, [1.0, 0.5, 0.5]);
        let gap = worst(-0.05);
        assert!((gap.cells + 0.1).abs() < 1e-12, "{gap:?}");
    }

    #[test]
    fn nothing_to_sample() {
        let body = Elements::of_kind(ElementKind::Hexahedron, (0..8).collect());
        let (points, triangles) = brick([1.0; 3]);
        let samples = Samples::new(&body, |_| true);
        assert_eq!(samples.worst(&points, &Surface::new(&points, &triangles).unwrap(), 1.0), None);
    }
}
