//! A body's skin: which way its samples look, and the skin as an obstacle to itself.

use super::pushes::Constraints;
use crate::body::gap::{Gap, Samples};
use m4gn_mesh::body::Body;
use m4gn_mesh::surface::{Against, Foot, Surface};
use m4gn_mesh::vector::{Vector, cross, dot, norm, sub};

/// How far one part may have sunk into another and still be found, mean edges.
const LIMIT: f64 = 1.5;
/// Places nearer than this at rest are taken for two sides of the same material, mean edges: it is not pressed to less
/// than a quarter.
const APART: f64 = 4.0 * LIMIT;
/// Cosine of the normals of faces that look at each other, at most.
const FACING: f64 = -0.2;
/// Places this near to each other are kept apart, mean edges.
const REACH: f64 = 0.25;
/// Cosine to a face's normal from which on a place is behind the face and not beside it.
const BEHIND: f64 = 0.95;

/// Triangles of a body's skin: quadrilaterals are four around their middle.
#[derive(Clone, Debug)]
pub(super) struct Skin {
    faces: Vec<Vec<i32>>,
    /// Corners; those from the number of points on are middles of faces.
    triangles: Vec<[i32; 3]>,
    /// Faces around each sample.
    around: Vec<Vec<u32>>,
    /// Of each triangle.
    face: Vec<u32>,
    /// Triangles of each part.
    parts: Vec<Vec<u32>>,
    /// The part of each point.
    part: Vec<u32>,
    rest: Vec<Vector>,
    /// Normals at rest of the triangles, and outward at the samples.
    rest_normals: Vec<Vector>,
    rest_outward: Vec<Vector>,
    cell: f64,
}

impl Skin {
    pub(super) fn new(body: &Body, samples: &Samples, cell: f64) -> Self {
        let faces = body.elements.skin();
        let n = body.positions.len();
        let (mut triangles, mut face) = (Vec::new(), Vec::new());
        let mut of_point: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (k, f) in faces.iter().enumerate() {
            f.iter().for_each(|&p| of_point[p as usize].push(k as u32));
            match f[..] {
                [a, b, c] => triangles.push([a, b, c]),
                _ => triangles.extend((0..f.len()).map(|i| [f[i], f[(i + 1) % f.len()], (n + k) as i32])),
            }
            face.resize(triangles.len(), k as u32);
        }
        let all_at = |points: &[i32]| -> Vec<u32> {
            let mut first = of_point[points[0] as usize].clone();
            first.retain(|k| points.iter().all(|&p| of_point[p as usize].contains(k)));
            first
        };
        let part = body.elements.parts(n);
        let count = part.iter().max().map_or(0, |&last| last as usize + 1);
        let mut parts = vec![Vec::new(); count];
        for (t, corners) in triangles.iter().enumerate() {
            parts[part[corners[0] as usize] as usize].push(t as u32);
        }
        let mut skin = Skin {
            triangles,
            face,
            parts,
            part,
            around: (0..samples.len()).map(|s| all_at(samples.points_of(s))).collect(),
            rest: with_middles(&faces, &body.positions),
            faces,
            rest_normals: Vec::new(),
            rest_outward: Vec::new(),
            cell,
        };
        let surface = skin.at_rest();
        skin.rest_normals = (0..skin.triangles.len()).map(|t| surface.normal(t)).collect();
        skin.rest_outward = skin.normals(&body.positions);
        skin
    }

    /// The skin at rest as a surface.
    pub(super) fn at_rest(&self) -> Surface {
        Surface::open(&self.rest, &self.triangles)
    }

    /// Whether the body is of several parts, which share no point.
    pub(super) fn has_parts(&self) -> bool {
        self.parts.iter().filter(|triangles| !triangles.is_empty()).count() > 1
    }

    /// The skin at `place` as surfaces, each with its part and the numbers of its triangles: one of each part, or, where parts may
    /// touch themselves, one of all.
    fn surfaces(&self, place: &[Vector], itself: bool) -> Vec<(Option<u32>, Vec<u32>, Surface)> {
        let surface = |part: Option<u32>, numbers: Vec<u32>| {
            let corners: Vec<[i32; 3]> = numbers.iter().map(|&t| self.triangles[t as usize]).collect();
            (part, numbers, Surface::open(place, &corners))
        };
        let all = || (None, (0..self.triangles.len() as u32).collect());
        let parts = (0..).zip(&self.parts).map(|(part, numbers)| (Some(part), numbers.clone()));
        let groups: Vec<(Option<u32>, Vec<u32>)> = match itself {
            true => vec![all()],
            false => parts.collect(),
        };
        let groups = groups.into_iter().filter(|(_, numbers)| !numbers.is_empty());
        groups.map(|(part, numbers)| surface(part, numbers)).collect()
    }

    /// Constraints that keep the parts of the skin out of each other at `now`, and where `itself` each part out of itself, for a
    /// correction of which `done` is part of `now`. Returns the smallest gap.
    pub(super) fn constrain(
        &self,
        samples: &Samples,
        (now, done): (&[Vector], &[Vector]),
        (clearance, itself): (f64, bool),
        constraints: &mut Constraints,
    ) -> Option<Gap> {
        let place = with_middles(&self.faces, now);
        let shift = with_middles(&self.faces, done);
        let surfaces = self.surfaces(&place, itself);
        let mut worst: Option<Gap> = None;
        for s in 0..samples.len() {
            let points = samples.points_of(s);
            let x = samples.position(s, now);
            let at_rest = samples.position(s, &self.rest);
            let (out, out_at_rest) = (self.outward(s, &place), self.rest_outward[s]);
            let part = self.part[points[0] as usize];
            let against = Against { direction: out, cosine: FACING };
            let faces_me = |t: usize| {
                if self.part[self.triangles[t][0] as usize] != part {
                    return true;
                }
                // Of the same part: far from here at rest, or across a slit and not through the material
                let from = sub(at_rest, self.rest[self.triangles[t][0] as usize]);
                let across = self.rest_normals[t];
                norm(from) > APART * self.cell
                    || (dot(across, out_at_rest) < FACING && dot(from, across) > 0.0)
            };
            let limit = LIMIT * self.cell;
            let others = surfaces
                .iter()
                .filter(|(of, _, surface)| of.is_none_or(|of| of != part) && surface.beyond_box(x) < limit);
            let feet = others.filter_map(|(_, numbers, surface)| {
                let number = |t: usize| numbers[t] as usize;
                let foot = surface.foot_against(x, limit, against, |t| faces_me(number(t)))?;
                // Beside the edge of the face that it seems to be behind: in front of another one
                let beside = foot.distance < 0.0 && dot(foot.normal, surface.normal(foot.triangle)) < BEHIND;
                let triangle = number(foot.triangle);
                (!beside).then_some(Foot { triangle, ..foot })
            });
            let Some(foot) = feet.min_by(|a, b| a.distance.total_cmp(&b.distance)) else {
                continue;
            };
            if worst.is_none_or(|w| foot.distance < w.cells * self.cell) {
                worst = Some(Gap { cells: foot.distance / self.cell, at: x });
            }
            if foot.distance > REACH * self.cell {
                continue;
            }
            let share = 1.0 / points.len() as f64;
            let mut terms: Vec<(usize, f64)> = points.iter().map(|&p| (p as usize, share)).collect();
            let corners = self.triangles[foot.triangle].map(|p| p as usize);
            let weights = barycentric(foot.at, corners.map(|p| place[p]));
            let n = now.len();
            for (corner, w) in corners.into_iter().zip(weights) {
                if corner < n {
                    terms.push((corner, -w));
                } else {
                    let face = &self.faces[self.face[foot.triangle] as usize];
                    terms.extend(face.iter().map(|&p| (p as usize, -w / face.len() as f64)));
                }
            }
            let mine = samples.position(s, done);
            let other: Vector =
                std::array::from_fn(|i| (0..3).map(|k| weights[k] * shift[corners[k]][i]).sum());
            let least = clearance - foot.distance + dot(foot.normal, sub(mine, other));
            constraints.add(samples.len() + s, terms, foot.normal, least);
        }
        worst
    }

    /// The smallest gap between parts at `positions`, m; none where no two are near each other.
    pub(super) fn parts_gap(&self, samples: &Samples, positions: &[Vector]) -> Option<Gap> {
        let none = vec![[0.0; 3]; positions.len()];
        let constraints = &mut Constraints::default();
        self.constrain(samples, (positions, &none), (0.0, false), constraints)
    }

    /// Unit outward normals of all samples of a body at `now`.
    pub(super) fn normals(&self, now: &[Vector]) -> Vec<Vector> {
        let place = with_middles(&self.faces, now);
        (0..self.around.len()).map(|s| self.outward(s, &place)).collect()
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
        unit(sum)
    }
}

/// Points, then the middles of all faces.
fn with_middles(faces: &[Vec<i32>], points: &[Vector]) -> Vec<Vector> {
    let middle = |face: &Vec<i32>| -> Vector {
        std::array::from_fn(|i| face.iter().map(|&p| points[p as usize][i]).sum::<f64>() / face.len() as f64)
    };
    points.iter().copied().chain(faces.iter().map(middle)).collect()
}

fn unit(v: Vector) -> Vector {
    let length = norm(v);
    if length > 0.0 { v.map(|x| x / length) } else { v }
}

/// Weights of a triangle's corners that give a place in it; equal ones where it has no area.
fn barycentric(x: Vector, [a, b, c]: [Vector; 3]) -> [f64; 3] {
    let n = cross(sub(b, a), sub(c, a));
    let square = dot(n, n);
    if square == 0.0 {
        return [1.0 / 3.0; 3];
    }
    let v = dot(cross(sub(x, a), sub(c, a)), n) / square;
    let w = dot(cross(sub(b, a), sub(x, a)), n) / square;
    [1.0 - v - w, v, w]
}
