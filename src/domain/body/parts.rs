//! The gap between the parts of a body, which share no point.

use super::gap::{Gap, Samples, cell_size};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::Body;
use m4gn_mesh::surface::{Against, Surface};
use m4gn_mesh::vector::{Vector, cross, dot, norm, sub};

/// How far one part may have sunk into another and still be found, mean edges.
const LIMIT: f64 = 1.5;
/// Cosine of the normals of faces that look at each other, at most.
const FACING: f64 = -0.2;
/// Cosine to a face's normal below which a place is not straight behind the face: the nearest place of the face lies on an edge.
const STRAIGHT: f64 = 1.0 - 1e-6;

/// The skin of a body, triangulated: quadrilaterals are four triangles around their middle.
pub(super) struct Skin {
    faces: Vec<Vec<i32>>,
    /// Corners; those from the number of points on are middles of faces.
    triangles: Vec<[i32; 3]>,
}

impl Skin {
    pub(super) fn new(body: &Body) -> Self {
        let (faces, n) = (body.elements.skin(), body.positions.len());
        let mut triangles = Vec::new();
        for (k, f) in faces.iter().enumerate() {
            match f[..] {
                [a, b, c] => triangles.push([a, b, c]),
                _ => triangles.extend((0..f.len()).map(|i| [f[i], f[(i + 1) % f.len()], (n + k) as i32])),
            }
        }
        Skin { faces, triangles }
    }

    /// As a surface at these places of the body's points.
    pub(super) fn surface(&self, positions: &[Vector]) -> Surface {
        Surface::open(&with_middles(&self.faces, positions), &self.triangles)
    }
}

/// The samples of a body's skin.
pub(super) fn samples(body: &Body) -> Samples {
    Samples::new(&body.elements, |p| body.types[p as usize] != NodeType::Body)
}

/// The smallest gap between the parts of a body.
#[derive(Clone, Debug)]
pub struct BetweenParts {
    samples: Samples,
    faces: Vec<Vec<i32>>,
    /// Faces around each sample.
    around: Vec<Vec<u32>>,
    /// Triangles of each part's skin; corners from the number of points on are middles of faces.
    triangles: Vec<Vec<[i32; 3]>>,
    /// The part of each point.
    part: Vec<u32>,
    cell: f64,
}

impl BetweenParts {
    /// For a body of several parts; none of a body in one.
    pub fn new(body: &Body) -> Option<Self> {
        let n = body.positions.len();
        let part = body.elements.parts(n);
        let count = part.iter().max().map_or(0, |&last| last as usize + 1);
        let Skin { faces, triangles: all } = Skin::new(body);
        let mut triangles = vec![Vec::new(); count];
        all.iter().for_each(|&t| triangles[part[t[0] as usize] as usize].push(t));
        triangles.retain(|t: &Vec<_>| !t.is_empty());
        if triangles.len() < 2 {
            return None;
        }
        let mut of_point: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (k, face) in faces.iter().enumerate() {
            face.iter().for_each(|&p| of_point[p as usize].push(k as u32));
        }
        let all_at = |points: &[i32]| -> Vec<u32> {
            let mut first = of_point[points[0] as usize].clone();
            first.retain(|k| points.iter().all(|&p| of_point[p as usize].contains(k)));
            first
        };
        let samples = samples(body);
        Some(BetweenParts {
            around: (0..samples.len()).map(|s| all_at(samples.points_of(s))).collect(),
            samples,
            faces,
            triangles,
            part,
            cell: cell_size(&body.positions, &body.edges),
        })
    }

    /// The smallest gap at `positions`, m; none where no two parts are near each other (1.5 mean edges).
    pub fn gap(&self, positions: &[Vector]) -> Option<Gap> {
        let place = with_middles(&self.faces, positions);
        let limit = LIMIT * self.cell;
        let surface = |triangles: &Vec<[i32; 3]>| {
            (self.part[triangles[0][0] as usize], Surface::open(&place, triangles))
        };
        let surfaces: Vec<(u32, Surface)> = self.triangles.iter().map(surface).collect();
        let mut worst: Option<Gap> = None;
        for s in 0..self.samples.len() {
            let x = self.samples.position(s, positions);
            let part = self.part[self.samples.points_of(s)[0] as usize];
            let against = Against { direction: self.outward(s, &place), cosine: FACING };
            let others = surfaces.iter().filter(|(of, surface)| *of != part && surface.beyond_box(x) < limit);
            let distances = others.filter_map(|(_, surface)| {
                let foot = surface.foot_against(x, limit, against)?;
                // Nearest to an edge whose other face is left out, the normal of both does not tell the side: it may be in front of that one
                let straight = dot(foot.normal, surface.normal(foot.triangle)) >= STRAIGHT;
                let beside = foot.distance < 0.0 && !straight && surface.distance(x) >= 0.0;
                (!beside).then_some(foot.distance)
            });
            if let Some(distance) = distances.min_by(f64::total_cmp)
                && worst.is_none_or(|w| distance < w.cells * self.cell)
            {
                worst = Some(Gap { cells: distance / self.cell, at: x });
            }
        }
        worst
    }

    /// Unit outward normal of the faces around a sample.
    fn outward(&self, sample: usize, x: &[Vector]) -> Vector {
        let mut sum = [0.0; 3];
        for &k in &self.around[sample] {
            let face = &self.faces[k as usize];
            let middle = x[x.len() - self.faces.len() + k as usize];
            for (i, &a) in face.iter().enumerate() {
                let b = face[(i + 1) % face.len()];
                let n = cross(sub(x[a as usize], middle), sub(x[b as usize], middle));
                (0..3).for_each(|i| sum[i] += n[i]);
            }
        }
        let length = norm(sum);
        if length > 0.0 { sum.map(|v| v / length) } else { sum }
    }
}

/// Points, then the middles of all faces.
fn with_middles(faces: &[Vec<i32>], points: &[Vector]) -> Vec<Vector> {
    let middle = |face: &Vec<i32>| -> Vector {
        std::array::from_fn(|i| face.iter().map(|&p| points[p as usize][i]).sum::<f64>() / face.len() as f64)
    };
    points.iter().copied().chain(faces.iter().map(middle)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::bodies as sample;

    /// The upper of two blocks sinks into the lower one.
    #[test]
    fn the_gap_between_two_blocks() {
        let body = sample::stack([5, 5, 4], [5.0, 5.0, 4.0], 0.2);
        let between = BetweenParts::new(&body).unwrap();
        let n = body.positions.len() / 2;
        let mut sunk = body.positions.clone();
        for x in &mut sunk[n..] {
            (0..3).for_each(|i| x[i] += [0.13, 0.08, -0.6][i]);
        }
        for (positions, expected) in [(&body.positions, 0.2), (&sunk, -0.4)] {
            let gap = between.gap(positions).unwrap().cells;
            assert!((gap - expected).abs() < 0.02, "{gap}, expected {expected}");
        }
        assert!(BetweenParts::new(&sample::block([2, 2, 2], [2.0; 3])).is_none());
    }
}
