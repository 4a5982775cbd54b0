//! The whole mesh of groups, the same on all ranks, and each rank's part of it.

use super::groups::{Links, all_rows};
use m4gn_mesh::vector::norm;
use m4gn_mesh::{BoundaryFace, CoupledFace, Mesh, NodeType};
use m4gn_parallel::Comm;
use std::collections::BTreeMap;

/// Two groups that touch, the lower one first.
#[derive(Clone, Debug)]
pub(super) struct Face {
    pub groups: [usize; 2],
    /// From the first group's centre to the second one's, through a cyclic patch where one joins them, m.
    pub delta: [f64; 3],
    /// Coefficient of the Laplacian, m.
    coeff: f64,
    /// Whether a cyclic patch joins them.
    cyclic: bool,
}

/// The faces of one patch and kind of a group, as one face.
#[derive(Clone, Debug)]
pub(super) struct Boundary {
    pub group: usize,
    pub patch: i32,
    pub kind: NodeType,
    pub centre: [f64; 3],
    /// Sum of the faces' areas, m^2.
    pub size: f64,
    pub area: [f64; 3],
    coeff: f64,
}

/// The whole mesh of groups.
#[derive(Clone, Debug)]
pub(super) struct Merged {
    pub directions: Vec<usize>,
    pub centres: Vec<[f64; 3]>,
    pub volumes: Vec<f64>,
    pub faces: Vec<Face>,
    pub boundary: Vec<Boundary>,
    /// Rank of each group's lowest cell.
    rank: Vec<i64>,
    patches: Vec<String>,
}

/// A translation that two sums of the same numbers share.
fn rounded(shift: [f64; 3]) -> [i64; 3] {
    // A cyclic patch's translation, in single precision (see Links): steps of 1e-4 of itself.
    let step = 1e-4 * norm(shift).max(f64::MIN_POSITIVE);
    match shift == [0.0; 3] {
        true => [0; 3],
        false => shift.map(|x| (x / step).round() as i64),
    }
}

impl Merged {
    /// Collective.
    pub fn new(mesh: &Mesh, links: &Links, group: &[i32], n: usize, comm: &Comm) -> Self {
        let mut sums = vec![0.0; 4 * n];
        for ((&g, centre), volume) in group.iter().zip(&mesh.cell_centres).zip(&mesh.cell_volumes) {
            let sums = &mut sums[4 * g as usize..][..4];
            sums[0] += volume;
            (0..3).for_each(|i| sums[i + 1] += volume * centre[i]);
        }
        comm.sum_f64(&mut sums);
        let rows = sums.as_chunks::<4>().0;
        let centres: Vec<[f64; 3]> = rows.iter().map(|s| [s[1] / s[0], s[2] / s[0], s[3] / s[0]]).collect();
        let mut lowest = vec![i64::MAX; n];
        for (&g, &cell) in group.iter().zip(&mesh.cell_global) {
            lowest[g as usize] = lowest[g as usize].min(cell);
        }
        let own = lowest.clone();
        comm.min_i64(&mut lowest);
        let mut rank: Vec<i64> = own
            .iter()
            .zip(&lowest)
            .map(|(own, lowest)| if own == lowest { i64::from(comm.rank()) } else { -1 })
            .collect();
        comm.max_i64(&mut rank);
        let faces = faces(mesh, links, group, &centres, comm);
        let boundary = boundary(mesh, group, &centres, comm);
        Merged {
            directions: mesh.directions.clone(),
            volumes: rows.iter().map(|s| s[0]).collect(),
            centres,
            faces,
            boundary,
            rank,
            patches: mesh.patches.clone(),
        }
    }

    /// Groups of a rank, ascending.
    pub fn groups_of(&self, rank: i32) -> impl Iterator<Item = usize> + '_ {
        (0..self.rank.len()).filter(move |&g| self.rank[g] == i64::from(rank))
    }

    /// A rank's part.
    pub fn part(&self, rank: i32) -> Mesh {
        let mut local = vec![-1i32; self.rank.len()];
        let mut mesh =
            Mesh { directions: self.directions.clone(), patches: self.patches.clone(), ..Mesh::default() };
        for g in self.groups_of(rank) {
            local[g] = mesh.cell_global.len() as i32;
            mesh.cell_global.push(g as i64);
            mesh.cell_centres.push(self.centres[g]);
            mesh.cell_volumes.push(self.volumes[g]);
        }
        for face in &self.faces {
            let [a, b] = face.groups;
            if local[a] >= 0 && local[b] >= 0 && !face.cyclic {
                mesh.face_owner.push(local[a]);
                mesh.face_neighbour.push(local[b]);
                mesh.face_coeff.push(face.coeff);
                continue;
            }
            for (here, there, delta) in [(a, b, face.delta), (b, a, face.delta.map(|x| -x))] {
                if local[here] >= 0 {
                    mesh.coupled.push(CoupledFace {
                        owner: local[here],
                        rank: self.rank[there] as i32,
                        global: there as i64,
                        delta,
                        coeff: face.coeff,
                    });
                }
            }
        }
        for (number, face) in self.boundary.iter().enumerate() {
            if local[face.group] >= 0 {
                mesh.boundary.push(BoundaryFace {
                    owner: local[face.group],
                    global: number as i64,
                    centre: face.centre,
                    area: face.area,
                    coeff: face.coeff,
                    kind: face.kind,
                    patch: face.patch,
                });
            }
        }
        mesh
    }
}

/// Two groups, the lower one first, and the translation of a cyclic patch between them.
type Pair = ([usize; 2], [i64; 3]);

/// The area where two groups touch (coefficient times distance), m^2, and the translation, m.
type Contact = (f64, [f64; 3]);

/// Faces between groups, merged.
fn faces(mesh: &Mesh, links: &Links, group: &[i32], centres: &[[f64; 3]], comm: &Comm) -> Vec<Face> {
    let behind = links.behind(mesh, group, comm);
    let mut sums: BTreeMap<Pair, Contact> = BTreeMap::new();
    let mut add = |a: i32, b: i32, area: f64, shift: [f64; 3]| {
        let (pair, shift) = match a < b {
            true => ([a as usize, b as usize], shift),
            false => ([b as usize, a as usize], shift.map(|x| if x == 0.0 { 0.0 } else { -x })),
        };
        if a != b {
            sums.entry((pair, rounded(shift))).or_insert((0.0, shift)).0 += area;
        }
    };
    for ((&a, &b), &coeff) in mesh.face_owner.iter().zip(&mesh.face_neighbour).zip(&mesh.face_coeff) {
        let (p, q) = (mesh.cell_centres[a as usize], mesh.cell_centres[b as usize]);
        let distance = norm([q[0] - p[0], q[1] - p[1], q[2] - p[2]]);
        add(group[a as usize], group[b as usize], coeff * distance, [0.0; 3]);
    }
    for (i, face) in mesh.coupled.iter().enumerate() {
        // Seen from both sides: the lower cell's counts.
        if mesh.cell_global[face.owner as usize] < links.cell[i] {
            let area = face.coeff * norm(face.delta);
            add(group[face.owner as usize], behind[i], area, links.shift[i]);
        }
    }
    let own: Vec<[f64; 6]> = sums
        .into_iter()
        .map(|((pair, _), (area, s))| [pair[0] as f64, pair[1] as f64, s[0], s[1], s[2], area])
        .collect();
    let mut all: BTreeMap<Pair, Contact> = BTreeMap::new();
    for row in all_rows(comm, &own) {
        let (pair, shift) = ([row[0] as usize, row[1] as usize], [row[2], row[3], row[4]]);
        all.entry((pair, rounded(shift))).or_insert((0.0, shift)).0 += row[5];
    }
    let merge = |((groups, _), (area, shift)): (Pair, Contact)| {
        let (a, b) = (centres[groups[0]], centres[groups[1]]);
        let delta: [f64; 3] = std::array::from_fn(|i| b[i] + shift[i] - a[i]);
        Face { groups, delta, coeff: area / norm(delta).max(f64::MIN_POSITIVE), cyclic: shift != [0.0; 3] }
    };
    all.into_iter().map(merge).collect()
}

/// Boundary faces of groups, merged by patch and kind.
fn boundary(mesh: &Mesh, group: &[i32], centres: &[[f64; 3]], comm: &Comm) -> Vec<Boundary> {
    let own: Vec<[f64; 11]> = mesh
        .boundary
        .iter()
        .map(|face| {
            let (size, c) = (norm(face.area), face.centre);
            let group = group[face.owner as usize];
            let away: [f64; 3] = std::array::from_fn(|i| c[i] - centres[group as usize][i]);
            // Never more than from the cell, which is nearer: the group's centre may lie in the face's plane.
            let coeff = (size / norm(away)).min(face.coeff);
            [
                f64::from(group),
                f64::from(face.patch),
                f64::from(face.kind as i32),
                size,
                size * c[0],
                size * c[1],
                size * c[2],
                face.area[0],
                face.area[1],
                face.area[2],
                coeff,
            ]
        })
        .collect();
    let mut sums: BTreeMap<[i64; 3], [f64; 8]> = BTreeMap::new();
    for row in all_rows(comm, &own) {
        let sums = sums.entry([row[0], row[1], row[2]].map(|x| x as i64)).or_default();
        sums.iter_mut().zip(&row[3..]).for_each(|(sum, x)| *sum += x);
    }
    let merge = |(key, s): ([i64; 3], [f64; 8])| {
        let group = key[0] as usize;
        let centre = [s[1] / s[0], s[2] / s[0], s[3] / s[0]];
        Boundary {
            group,
            patch: key[1] as i32,
            kind: NodeType::from_code(key[2] as i32).unwrap_or(NodeType::Wall),
            centre,
            size: s[0],
            area: [s[4], s[5], s[6]],
            coeff: s[7],
        }
    };
    sums.into_iter().map(merge).collect()
}

impl Merged {
    /// Number of each merged boundary face by group, patch and kind.
    pub fn numbers(&self) -> BTreeMap<(usize, i32, i32), usize> {
        let keys = self.boundary.iter().map(|b| (b.group, b.patch, b.kind as i32));
        keys.enumerate().map(|(number, key)| (key, number)).collect()
    }
}
