//! Fields of cells to groups and back.

use super::merged::Merged;
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::vector::norm;

/// A neighbour of a group in the fit of its gradient.
#[derive(Clone, Copy, Debug)]
struct Neighbour {
    group: u32,
    /// What the difference to it adds to the gradient, 1/m.
    weight: [f64; 3],
}

/// A group beside another one, and from that one's centre to its own, m.
type Near = (u32, [f64; 3]);

/// Gradients of all groups by least squares.
#[derive(Clone, Debug, Default)]
struct Gradients {
    /// Neighbours of group g: `neighbours[row[g]..row[g + 1]]`.
    row: Vec<u32>,
    neighbours: Vec<Neighbour>,
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
    /// From the group's centre to the cell's, m.
    offset: Vec<[f64; 3]>,
    gradients: Gradients,
}

impl Transfer {
    pub(super) fn new(mesh: &Mesh, group: &[i32], merged: &Merged, rank: i32) -> Self {
        let own_groups: Vec<u32> = merged.groups_of(rank).map(|g| g as u32).collect();
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
            offset: group
                .iter()
                .zip(&mesh.cell_centres)
                .map(|(&g, c)| std::array::from_fn(|i| c[i] - merged.centres[g as usize][i]))
                .collect(),
            gradients: Gradients::new(merged),
        }
    }

    /// Volume averages of the cells' values and area averages of the boundary faces' at this rank's groups and merged
    /// faces, `[n x width]` each after the other, from `values` `[(n_cells + n_boundary) x width]`. Collective.
    ///
    /// A merged face all of whose faces have their cells' values (a zero gradient) gets its group's.
    pub fn restrict(&self, values: &[f32], width: usize, comm: &Comm) -> Vec<f32> {
        let (n, m) = (self.n_groups, self.n_faces);
        let (cells, boundary) = values.split_at(self.cells.len() * width);
        // Averages of groups, averages of faces, faces that differ from their cells.
        let mut sums = vec![0.0; (n + 2 * m) * width];
        let (groups, rest) = sums.split_at_mut(n * width);
        let (faces, differ) = rest.split_at_mut(m * width);
        for (&(g, share), row) in self.cells.iter().zip(cells.chunks_exact(width)) {
            let to = &mut groups[g as usize * width..][..width];
            to.iter_mut()
                .zip(row)
                .for_each(|(to, &x)| *to += share * f64::from(x));
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
        let mut out = Vec::with_capacity((self.own_groups.len() + self.own_faces.len()) * width);
        for &g in &self.own_groups {
            out.extend(groups[g as usize * width..][..width].iter().map(|&x| x as f32));
        }
        for &f in &self.own_faces {
            let owner = self.owner_group[f as usize] as usize;
            for i in 0..width {
                let at = f as usize * width + i;
                out.push(match differ[at] == 0.0 {
                    true => groups[owner * width + i] as f32,
                    false => faces[at] as f32,
                });
            }
        }
        out
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

    /// Values of this rank's cells `[n_cells x width]` from those of this rank's groups: linear within a group, with its
    /// mean. Collective.
    pub fn prolong(&self, own: &[f64], width: usize, comm: &Comm) -> Vec<f64> {
        let mut groups = vec![0.0; self.n_groups * width];
        for (&g, row) in self.own_groups.iter().zip(own.chunks_exact(width)) {
            groups[g as usize * width..][..width].copy_from_slice(row);
        }
        comm.sum_f64(&mut groups);
        let mut gradients = vec![[0.0; 3]; self.n_groups * width];
        for g in self.met.iter().map(|&g| g as usize) {
            for i in 0..width {
                let value = groups[g * width + i];
                let gradient = &mut gradients[g * width + i];
                for neighbour in self.gradients.of(g) {
                    let other = groups[neighbour.group as usize * width + i];
                    (0..3).for_each(|d| gradient[d] += neighbour.weight[d] * (other - value));
                }
            }
        }
        let mut out = Vec::with_capacity(self.cells.len() * width);
        for (&(g, _), x) in self.cells.iter().zip(&self.offset) {
            for i in 0..width {
                let at = g as usize * width + i;
                let d = gradients[at];
                out.push(groups[at] + d[0] * x[0] + d[1] * x[1] + d[2] * x[2]);
            }
        }
        out
    }
}

impl Gradients {
    fn new(merged: &Merged) -> Self {
        let n = merged.centres.len();
        let mut around: Vec<Vec<Near>> = vec![Vec::new(); n];
        for face in &merged.faces {
            let [a, b] = face.groups;
            around[a].push((b as u32, face.delta));
            around[b].push((a as u32, face.delta.map(|x| -x)));
        }
        let mut all = Gradients {
            row: vec![0],
            neighbours: Vec::new(),
        };
        for (group, near) in around.iter().enumerate() {
            let enough = near.len() > merged.directions.len();
            let near = if enough {
                near.clone()
            } else {
                wider(&around, group)
            };
            all.neighbours.extend(fit(&near, &merged.directions));
            all.row.push(all.neighbours.len() as u32);
        }
        all
    }

    fn of(&self, group: usize) -> &[Neighbour] {
        &self.neighbours[self.row[group] as usize..self.row[group + 1] as usize]
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

/// Weights of the least-squares gradient, by inverse squared distance, in the solved directions.
///
/// Of groups that interlock one may have its centre beside another's: what differs between the two says little of the gradient.
/// So a distance counts as half the root mean square of all at least.
fn fit(near: &[Near], directions: &[usize]) -> Vec<Neighbour> {
    let dim = directions.len();
    let mut matrix = [[0.0; 3]; 3];
    let square = |d: &[f64; 3]| directions.iter().map(|&i| d[i] * d[i]).sum::<f64>();
    let mean = near.iter().map(|(_, d)| square(d)).sum::<f64>() / near.len().max(1) as f64;
    let inverse_square = |d: &[f64; 3]| 1.0 / square(d).max(0.25 * mean);
    for (_, d) in near {
        let w = inverse_square(d);
        for (a, &i) in directions.iter().enumerate() {
            for (b, &j) in directions.iter().enumerate() {
                matrix[a][b] += w * d[i] * d[j];
            }
        }
    }
    // A group with few neighbours has no gradient across them: kept solvable, and small there.
    let trace: f64 = (0..dim).map(|a| matrix[a][a]).sum();
    for (a, row) in matrix.iter_mut().enumerate() {
        row[a] += if a < dim { 1e-6 * trace.max(1e-300) } else { 1.0 };
    }
    let inverse = inverted(matrix);
    near.iter()
        .map(|&(group, d)| {
            let w = inverse_square(&d);
            let mut weight = [0.0; 3];
            for (a, &i) in directions.iter().enumerate() {
                weight[i] = (0..dim).map(|b| inverse[a][b] * w * d[directions[b]]).sum();
            }
            Neighbour { group, weight }
        })
        .collect()
}

/// Inverse of a 3 x 3 matrix that is not singular.
fn inverted(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let minor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_neighbour_with_nearly_the_same_centre_does_not_decide_the_gradient() {
        let around = [
            [1.0, 0.0, 0.0],
            [-1.0, 0.1, 0.0],
            [0.1, 1.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        let near: Vec<Near> = (0..)
            .zip(around.into_iter().chain([[1e-5, -1e-5, 0.0]]))
            .collect();
        let weights = fit(&near, &[0, 1]);
        // Differences that are off by 1 in each neighbour
        let worst: f64 = weights.iter().map(|n| norm(n.weight)).sum();
        assert!(worst < 3.0, "{worst} 1/m");
        // Linear functions are exact all the same
        let gradient = weights.iter().zip(&near).fold([0.0; 2], |g, (n, (_, d))| {
            let difference = 2.0 * d[0] - 3.0 * d[1];
            [g[0] + n.weight[0] * difference, g[1] + n.weight[1] * difference]
        });
        assert!(
            (gradient[0] - 2.0).abs() < 1e-5 && (gradient[1] + 3.0).abs() < 1e-5,
            "{gradient:?}"
        );
    }
}
