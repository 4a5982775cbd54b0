//! Fields of cells to groups and back.

use super::gradients::{Gradients, Variation};
use super::merged::Merged;
use m4gn_mesh::vector::norm;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_parallel::Comm;

/// Averages of a field's cells and boundary faces.
#[derive(Clone, Debug)]
pub struct Restricted {
    /// At this rank's groups, then at its merged faces, `[n x width]`.
    pub values: Vec<f32>,
    width: usize,
    /// Of all groups, then of all merged faces, then for each of these how many of its faces differ from their cells.
    all: Vec<f64>,
}

/// Restriction to groups and prolongation from them, of this rank's cells and boundary faces.
#[derive(Clone, Debug)]
pub struct Transfer {
    n_groups: usize,
    n_faces: usize,
    /// Groups and merged boundary faces of this rank.
    own_groups: Vec<u32>,
    own_faces: Vec<u32>,
    /// Group of each cell, and the cell's share of the group's volume.
    cells: Vec<(u32, f64)>,
    /// Groups of this rank's cells, ascending.
    met: Vec<u32>,
    /// Merged face of each boundary face, the face's share of its area, and the face's owner cell.
    faces: Vec<(u32, f64, u32)>,
    /// Group of each merged boundary face.
    owner_group: Vec<u32>,
    /// Merged faces of walls, and their areas, m^2.
    walls: Vec<(u32, f64)>,
    /// From the group's centre to the cell's, m.
    offset: Vec<[f64; 3]>,
    gradients: Gradients,
}

impl Transfer {
    /// Collective.
    pub(super) fn new(mesh: &Mesh, group: &[i32], merged: &Merged, comm: &Comm) -> Self {
        let own_groups: Vec<u32> = merged.groups_of(comm.rank()).map(|g| g as u32).collect();
        let owns = |g: usize| own_groups.binary_search(&(g as u32)).is_ok();
        let numbers = merged.numbers();
        let face = |f: &m4gn_mesh::BoundaryFace| {
            let number = numbers[&(group[f.owner as usize] as usize, f.patch, f.kind as i32)];
            let share = norm(f.area) / merged.boundary[number].size;
            (number as u32, share, f.owner as u32)
        };
        let mut met: Vec<u32> = group.iter().map(|&g| g as u32).collect();
        met.sort_unstable();
        met.dedup();
        Transfer {
            n_groups: merged.centres.len(),
            n_faces: merged.boundary.len(),
            own_faces: (0..merged.boundary.len())
                .filter(|&f| owns(merged.boundary[f].group))
                .map(|f| f as u32)
                .collect(),
            own_groups,
            met,
            cells: group
                .iter()
                .zip(&mesh.cell_volumes)
                .map(|(&g, volume)| (g as u32, volume / merged.volumes[g as usize]))
                .collect(),
            faces: mesh.boundary.iter().map(face).collect(),
            owner_group: merged.boundary.iter().map(|b| b.group as u32).collect(),
            walls: (0..)
                .zip(&merged.boundary)
                .filter(|(_, b)| b.kind == NodeType::Wall)
                .map(|(face, b)| (face, b.size))
                .collect(),
            offset: group
                .iter()
                .zip(&mesh.cell_centres)
                .map(|(&g, c)| std::array::from_fn(|i| c[i] - merged.centres[g as usize][i]))
                .collect(),
            gradients: Gradients::new(mesh, group, merged, comm),
        }
    }

    /// Volume averages of the cells' values and area averages of the boundary faces' at this rank's groups and merged
    /// faces, `[n x width]` each after the other, from `values` `[(n_cells + n_boundary) x width]`. Collective.
    ///
    /// A merged face all of whose faces have their cells' values (a zero gradient) gets its group's.
    pub fn restrict(&self, values: &[f32], width: usize, comm: &Comm) -> Restricted {
        let (n, m) = (self.n_groups, self.n_faces);
        let (cells, boundary) = values.split_at(self.cells.len() * width);
        // Averages of groups, averages of faces, faces that differ from their cells.
        let mut sums = vec![0.0; (n + 2 * m) * width];
        let (groups, rest) = sums.split_at_mut(n * width);
        let (faces, differ) = rest.split_at_mut(m * width);
        for (&(g, share), row) in self.cells.iter().zip(cells.chunks_exact(width)) {
            let to = &mut groups[g as usize * width..][..width];
            to.iter_mut().zip(row).for_each(|(to, &x)| *to += share * f64::from(x));
        }
        for (&(f, share, owner), row) in self.faces.iter().zip(boundary.chunks_exact(width)) {
            let at = f as usize * width;
            for (i, &x) in row.iter().enumerate() {
                faces[at + i] += share * f64::from(x);
                if x != cells[owner as usize * width + i] {
                    differ[at + i] += 1.0;
                }
            }
        }
        comm.sum_f64(&mut sums);
        let (groups, rest) = sums.split_at(n * width);
        let (faces, differ) = rest.split_at(m * width);
        let mut own = Vec::with_capacity((self.own_groups.len() + self.own_faces.len()) * width);
        for &g in &self.own_groups {
            own.extend(groups[g as usize * width..][..width].iter().map(|&x| x as f32));
        }
        for &f in &self.own_faces {
            let owner = self.owner_group[f as usize] as usize;
            for i in 0..width {
                let at = f as usize * width + i;
                own.push(match differ[at] == 0.0 {
                    true => groups[owner * width + i] as f32,
                    false => faces[at] as f32,
                });
            }
        }
        Restricted { values: own, width, all: sums }
    }

    /// How much a wall counts in each group, of all groups `[n_groups x width]`: 0 to 1, and 0 where a group has no wall with a value
    /// of its own. Collective.
    ///
    /// A change is zero at such a wall, which tells its course within the group, unless it happens in a layer thinner than the
    /// group. The field itself, `values` as they were restricted, shows which it is: the best share of both courses for it.
    pub fn at_walls(&self, values: &[f32], restricted: &Restricted, comm: &Comm) -> Vec<f64> {
        let (n, m, width) = (self.n_groups, self.n_faces, restricted.width);
        let (groups, rest) = restricted.all.split_at(n * width);
        let (faces, differ) = rest.split_at(m * width);
        // Mean value of each group's walls.
        let (mut sizes, mut walls) = (vec![0.0; n * width], vec![0.0; n * width]);
        for &(face, size) in &self.walls {
            let at = face as usize * width;
            let to = self.owner_group[face as usize] as usize * width;
            for i in (0..width).filter(|i| differ[at + i] > 0.0) {
                sizes[to + i] += size;
                walls[to + i] += size * faces[at + i];
            }
        }
        let held = |at: usize| sizes[at] > 0.0;
        let mut both = vec![[Variation::default(); 2]; n * width];
        for g in self.met.iter().map(|&g| g as usize) {
            for i in (0..width).filter(|i| held(g * width + i)) {
                let at = g * width + i;
                let wall = walls[at] / sizes[at];
                both[at] =
                    [None, Some(wall)].map(|wall| self.gradients.variation(groups, (width, i), g, wall));
            }
        }
        // Of what the wall adds, the part that the field has, and its square; and the field's own.
        let mut sums = vec![0.0; 3 * n * width];
        for ((&(g, share), offset), row) in
            self.cells.iter().zip(&self.offset).zip(values.chunks_exact(width))
        {
            for (i, &x) in row.iter().enumerate() {
                let at = g as usize * width + i;
                if held(at) {
                    let [free, wall] = both[at].map(|v| v.at(offset));
                    let rest = f64::from(x) - groups[at] - free;
                    sums[3 * at] += share * rest * (wall - free);
                    sums[3 * at + 1] += share * (wall - free).powi(2);
                    sums[3 * at + 2] += share * (f64::from(x) - groups[at]).powi(2);
                }
            }
        }
        comm.sum_f64(&mut sums);
        let share = |(at, [part, square, own]): (usize, &[f64; 3])| {
            if !held(at) {
                return 0.0;
            }
            // Where both courses are the same for the field, rounding must not choose between them.
            let wall = walls[at] / sizes[at];
            let least = 1e-6 * own + 1e-6 * (groups[at] - wall).powi(2) + 1e-10 * wall * wall;
            (part / (square + least.max(f64::MIN_POSITIVE))).clamp(0.0, 1.0)
        };
        sums.as_chunks::<3>().0.iter().enumerate().map(share).collect()
    }

    /// Volume averages of vectors of the cells at this rank's groups. Collective.
    pub(super) fn means(&self, cells: &[[f64; 3]], comm: &Comm) -> Vec<[f64; 3]> {
        let mut sums = vec![0.0; 3 * self.n_groups];
        for (&(g, share), x) in self.cells.iter().zip(cells) {
            (0..3).for_each(|i| sums[3 * g as usize + i] += share * x[i]);
        }
        comm.sum_f64(&mut sums);
        let means = sums.as_chunks::<3>().0;
        self.own_groups.iter().map(|&g| means[g as usize]).collect()
    }

    /// Changes of this rank's cells `[n_cells x width]` from those of this rank's groups: linear within a group, with its
    /// mean. Where `at_walls` (of all groups, as [`Self::at_walls`]) is 1 a change is zero at the group's walls, and curved along their
    /// normal. Collective.
    pub fn prolong(&self, own: &[f64], at_walls: &[f64], comm: &Comm) -> Vec<f64> {
        let width = at_walls.len() / self.n_groups;
        let mut groups = vec![0.0; self.n_groups * width];
        for (&g, row) in self.own_groups.iter().zip(own.chunks_exact(width)) {
            groups[g as usize * width..][..width].copy_from_slice(row);
        }
        comm.sum_f64(&mut groups);
        let mut variations = vec![Variation::default(); self.n_groups * width];
        for g in self.met.iter().map(|&g| g as usize) {
            for i in 0..width {
                let at = g * width + i;
                let variation = |wall| self.gradients.variation(&groups, (width, i), g, wall);
                variations[at] = match at_walls[at] > 0.0 {
                    true => variation(None).towards(variation(Some(0.0)), at_walls[at]),
                    false => variation(None),
                };
            }
        }
        let mut out = Vec::with_capacity(self.cells.len() * width);
        for (&(g, _), offset) in self.cells.iter().zip(&self.offset) {
            let at = g as usize * width..(g as usize + 1) * width;
            let (values, variations) = (&groups[at.clone()], &variations[at]);
            out.extend(values.iter().zip(variations).map(|(x, v)| x + v.at(offset)));
        }
        out
    }
}
