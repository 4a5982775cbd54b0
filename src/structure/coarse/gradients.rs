//! How a change varies within each group: linearly, and next to a wall with a curvature as well.

use super::merged::Merged;
use m4gn_mesh::vector::{dot, norm};
use m4gn_mesh::{Mesh, NodeType};
use m4gn_parallel::Comm;
use std::collections::BTreeMap;

/// Unknowns of a fit: the gradient, and the curvature along the normal of a wall.
const UNKNOWNS: usize = 4;

/// How much more the value at a wall counts than that of a neighbouring group.
const WALL: f64 = 4.0;

/// Area vectors of a group's wall faces that sum up to less than this part of their sizes have no common normal: a group
/// that fills a narrow channel.
const COMMON_NORMAL: f64 = 0.3;

/// A neighbour of a group in the fit.
#[derive(Clone, Copy, Debug)]
struct Neighbour {
    group: u32,
    /// What the difference to it adds to the unknowns, 1/m and for the curvature 1/m^2.
    weight: [f64; UNKNOWNS],
}

/// A group beside another one, and from that one's centre to its own, m.
type Near = (u32, [f64; 3]);

/// A row of a fit: the value of each unknown's function there, and the row's weight.
type Row = ([f64; UNKNOWNS], f64);

/// The fit of a group next to a wall, at which the value is known.
#[derive(Clone, Debug)]
struct BesideWall {
    near: Vec<Neighbour>,
    /// What the difference to the wall's value adds to the unknowns.
    own: [f64; UNKNOWNS],
    normal: [f64; 3],
    /// Of the group's centre in front of the wall, m, along the outward normal; negative.
    depth: f64,
    /// Mean over the group of the depth's square, m^2.
    square: f64,
}

/// How values vary within all groups, by least squares over the neighbouring groups.
#[derive(Clone, Debug, Default)]
pub(super) struct Gradients {
    /// Neighbours of group g: `neighbours[row[g]..row[g + 1]]`.
    row: Vec<u32>,
    neighbours: Vec<Neighbour>,
    /// Groups that have faces of walls.
    walls: BTreeMap<u32, BesideWall>,
}

/// What is added to a group's value at a distance from its centre.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Variation {
    gradient: [f64; 3],
    curvature: f64,
    normal: [f64; 3],
    depth: f64,
    square: f64,
}

impl Variation {
    /// At `offset` from the group's centre, m. The mean over the group is zero.
    pub fn at(&self, offset: &[f64; 3]) -> f64 {
        let depth = self.depth + dot(self.normal, *offset);
        dot(self.gradient, *offset) + self.curvature * (depth * depth - self.square)
    }

    /// On the way to a curved one, from 0 (this one, which is linear) to 1.
    pub fn towards(self, curved: Self, share: f64) -> Self {
        let between = |i: usize| (1.0 - share) * self.gradient[i] + share * curved.gradient[i];
        Variation { gradient: std::array::from_fn(between), curvature: share * curved.curvature, ..curved }
    }
}

impl Gradients {
    /// Collective.
    pub fn new(mesh: &Mesh, group: &[i32], merged: &Merged, comm: &Comm) -> Self {
        let n = merged.centres.len();
        let mut around: Vec<Vec<Near>> = vec![Vec::new(); n];
        for face in &merged.faces {
            let [a, b] = face.groups;
            around[a].push((b as u32, face.delta));
            around[b].push((a as u32, face.delta.map(|x| -x)));
        }
        let mut all = Gradients { row: vec![0], ..Gradients::default() };
        let around: Vec<Vec<Near>> = (0..n)
            .map(|group| match around[group].len() > merged.directions.len() {
                true => around[group].clone(),
                false => wider(&around, group),
            })
            .collect();
        for near in &around {
            let rows: Vec<Row> = weights(near, &merged.directions)
                .zip(near)
                .map(|(weight, (_, d))| ([d[0], d[1], d[2], 0.0], weight))
                .collect();
            let fitted = fit(&rows, &merged.directions);
            all.neighbours
                .extend(near.iter().zip(fitted).map(|(&(group, _), weight)| Neighbour { group, weight }));
            all.row.push(all.neighbours.len() as u32);
        }
        let spread = Spread::new(mesh, group, merged, comm);
        let mut faces: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, face) in merged.boundary.iter().enumerate() {
            if face.kind == NodeType::Wall {
                faces.entry(face.group).or_default().push(i);
            }
        }
        for (group, faces) in faces {
            let beside = BesideWall::new(merged, &spread, (group, &around[group]), &faces);
            all.walls.extend(beside.map(|beside| (group as u32, beside)));
        }
        all
    }

    /// How values `[n_groups x width]` vary in a group, in one column; `wall`: what they are at its walls, where that counts.
    pub fn variation(
        &self,
        values: &[f64],
        (width, column): (usize, usize),
        group: usize,
        wall: Option<f64>,
    ) -> Variation {
        let value = values[group * width + column];
        let sum = |near: &[Neighbour], mut x: [f64; UNKNOWNS]| {
            for neighbour in near {
                let difference = values[neighbour.group as usize * width + column] - value;
                (0..UNKNOWNS).for_each(|i| x[i] += neighbour.weight[i] * difference);
            }
            x
        };
        match wall.zip(self.walls.get(&(group as u32))) {
            Some((at_wall, wall)) => {
                let [x, y, z, curvature] = sum(&wall.near, wall.own.map(|w| w * (at_wall - value)));
                Variation {
                    gradient: [x, y, z],
                    curvature,
                    normal: wall.normal,
                    depth: wall.depth,
                    square: wall.square,
                }
            }
            None => {
                let near = self.row[group] as usize..self.row[group + 1] as usize;
                let [x, y, z, _] = sum(&self.neighbours[near], [0.0; UNKNOWNS]);
                Variation { gradient: [x, y, z], ..Variation::default() }
            }
        }
    }
}

/// Second moments of all groups about their centres, per volume, m^2: xx, yy, zz, xy, yz, zx.
struct Spread(Vec<[f64; 6]>);

impl Spread {
    /// Collective.
    fn new(mesh: &Mesh, group: &[i32], merged: &Merged, comm: &Comm) -> Self {
        let mut sums = vec![0.0; 6 * merged.centres.len()];
        for ((&g, c), volume) in group.iter().zip(&mesh.cell_centres).zip(&mesh.cell_volumes) {
            let g = g as usize;
            let share = volume / merged.volumes[g];
            let d: [f64; 3] = std::array::from_fn(|i| c[i] - merged.centres[g][i]);
            for i in 0..3 {
                sums[6 * g + i] += share * d[i] * d[i];
                sums[6 * g + 3 + i] += share * d[i] * d[(i + 1) % 3];
            }
        }
        comm.sum_f64(&mut sums);
        Spread(sums.as_chunks::<6>().0.to_vec())
    }

    /// Mean over a group of the square of its distance along a unit vector from its centre, m^2.
    fn along(&self, group: usize, normal: [f64; 3]) -> f64 {
        let moments = &self.0[group];
        (0..3)
            .map(|i| normal[i] * (moments[i] * normal[i] + 2.0 * moments[3 + i] * normal[(i + 1) % 3]))
            .sum()
    }
}

impl BesideWall {
    /// None where the wall's faces have no common normal.
    fn new(
        merged: &Merged,
        spread: &Spread,
        (group, near): (usize, &[Near]),
        faces: &[usize],
    ) -> Option<Self> {
        let faces = || faces.iter().map(|&i| &merged.boundary[i]);
        let size: f64 = faces().map(|face| face.size).sum();
        let mean = |of: &dyn Fn(&super::merged::Boundary) -> [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| faces().map(|face| of(face)[i]).sum::<f64>() / size)
        };
        let area = mean(&|face| face.area);
        let towards =
            mean(&|face| std::array::from_fn(|i| face.size * (face.centre[i] - merged.centres[group][i])));
        let length = norm(area);
        if length < COMMON_NORMAL {
            return None;
        }
        let normal = area.map(|x| x / length);
        let depth = -dot(normal, towards);
        let squared = |depth: f64, group: usize| depth * depth + spread.along(group, normal);
        let square = squared(depth, group);
        // Mean of the change of the functions from this group to the next one, and to the wall.
        let mut rows: Vec<Row> = weights(near, &merged.directions)
            .zip(near)
            .map(|(weight, &(other, d))| {
                let curved = squared(depth + dot(normal, d), other as usize) - square;
                ([d[0], d[1], d[2], curved], weight)
            })
            .collect();
        let most = rows.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
        rows.push(([towards[0], towards[1], towards[2], -square], WALL * most));
        let mut directions = merged.directions.clone();
        directions.push(3);
        let fitted = fit(&rows, &directions);
        Some(BesideWall {
            near: near
                .iter()
                .zip(&fitted)
                .map(|(&(group, _), &weight)| Neighbour { group, weight })
                .collect(),
            own: fitted[near.len()],
            normal,
            depth,
            square,
        })
    }
}

/// A group's neighbours and theirs: a corner has too few of its own to tell the gradient in all directions.
fn wider(around: &[Vec<Near>], group: usize) -> Vec<Near> {
    let mut near = around[group].clone();
    for &(first, d) in &around[group] {
        for &(second, e) in &around[first as usize] {
            if second as usize != group && near.iter().all(|(g, _)| *g != second) {
                near.push((second, std::array::from_fn(|i| d[i] + e[i])));
            }
        }
    }
    near
}

/// Weight of each neighbour: the inverse square of its distance in the solved directions, 1/m^2.
///
/// Of groups that interlock one may have its centre beside another's: what differs between the two says little of the gradient.
/// So a distance counts as half the root mean square of all at least.
fn weights<'a>(near: &'a [Near], directions: &'a [usize]) -> impl Iterator<Item = f64> + 'a {
    let square = |d: &[f64; 3]| directions.iter().map(|&i| d[i] * d[i]).sum::<f64>();
    let mean = near.iter().map(|(_, d)| square(d)).sum::<f64>() / near.len().max(1) as f64;
    near.iter().map(move |(_, d)| 1.0 / square(d).max(0.25 * mean))
}

/// What the difference in each row adds to the unknowns, by weighted least squares; unknowns that are not solved for stay zero.
fn fit(rows: &[Row], solved: &[usize]) -> Vec<[f64; UNKNOWNS]> {
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    for (x, weight) in rows {
        for &i in solved {
            for &j in solved {
                matrix[i][j] += weight * x[i] * x[j];
            }
        }
    }
    // A group with few neighbours has no gradient across them: kept solvable, and small there.
    let trace = matrix[0][0] + matrix[1][1] + matrix[2][2];
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] += match (solved.contains(&i), i) {
            (false, _) => 1.0,
            (true, 3) => 1e-5 * row[i].max(1e-300),
            (true, _) => 1e-6 * trace.max(1e-300),
        };
    }
    let inverse = inverted(matrix);
    let column = |(x, weight): &Row| -> [f64; UNKNOWNS] {
        std::array::from_fn(|i| match solved.contains(&i) {
            true => solved.iter().map(|&j| inverse[i][j] * weight * x[j]).sum(),
            false => 0.0,
        })
    };
    rows.iter().map(column).collect()
}

/// Inverse of a symmetric, positive definite matrix, by Gauss and Jordan.
fn inverted(mut m: [[f64; UNKNOWNS]; UNKNOWNS]) -> [[f64; UNKNOWNS]; UNKNOWNS] {
    let mut inverse = [[0.0; UNKNOWNS]; UNKNOWNS];
    (0..UNKNOWNS).for_each(|i| inverse[i][i] = 1.0);
    for i in 0..UNKNOWNS {
        let pivot = m[i][i];
        for j in 0..UNKNOWNS {
            m[i][j] /= pivot;
            inverse[i][j] /= pivot;
        }
        for k in (0..UNKNOWNS).filter(|&k| k != i) {
            let factor = m[k][i];
            for j in 0..UNKNOWNS {
                m[k][j] -= factor * m[i][j];
                inverse[k][j] -= factor * inverse[i][j];
            }
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_neighbour_with_nearly_the_same_centre_does_not_decide_the_gradient() {
        let around = [[1.0, 0.0, 0.0], [-1.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, -1.0, 0.0]];
        let near: Vec<Near> = (0..).zip(around.into_iter().chain([[1e-5, -1e-5, 0.0]])).collect();
        let rows: Vec<Row> = weights(&near, &[0, 1])
            .zip(&near)
            .map(|(weight, (_, d))| ([d[0], d[1], d[2], 0.0], weight))
            .collect();
        let weights = fit(&rows, &[0, 1]);
        // Differences that are off by 1 in each neighbour
        let worst: f64 = weights.iter().map(|n| n[0].hypot(n[1])).sum();
        assert!(worst < 3.0, "{worst} 1/m");
        // Linear functions are exact all the same
        let gradient = weights.iter().zip(&near).fold([0.0; 2], |g, (n, (_, d))| {
            let difference = 2.0 * d[0] - 3.0 * d[1];
            [g[0] + n[0] * difference, g[1] + n[1] * difference]
        });
        assert!((gradient[0] - 2.0).abs() < 1e-5 && (gradient[1] + 3.0).abs() < 1e-5, "{gradient:?}");
    }
}
