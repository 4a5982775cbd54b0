//! Random-walk structural encoding (Dwivedi et al., 2021) of a weighted graph of segments, and of the nodes of a mesh.

use super::cell_graph::{CellGraph, Root};
use super::graph::Graph;
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_parallel::Comm;

/// The encoding of a mesh's nodes, its cells and boundary faces `[n_owned x steps]`: the probability that a random walk from node to
/// neighbouring node is back where it started after 1 to `steps` steps. The root walks on the undecomposed graph, so that the answer
/// does not depend on the ranks. Collective; all ranks fail together.
///
/// # Errors
/// As [`Graph::new`].
pub fn node_walk(mesh: &Mesh, steps: usize, comm: &Comm) -> Result<Vec<f32>> {
    if steps == 0 {
        return Ok(Vec::new());
    }
    let mut graph = Graph::new(mesh, comm)?;
    let (root, _) = comm.agree(Root::gather(mesh, &mut graph, comm))?;
    let mut faces = vec![0; mesh.n_cells()];
    mesh.boundary.iter().for_each(|b| faces[b.owner as usize] += 1);
    let faces = Root::collect(root.as_ref(), &faces, comm).unwrap_or_default();
    let all = root.as_ref().map(|root| of_cells(&root.graph, &faces, steps)).unwrap_or_default();
    // Each cell has its own row, and that of its boundary faces.
    let own = Root::hand_out(root.as_ref(), &all, 2 * steps, comm);
    let row = |cell: usize, of_face: usize| own[(2 * cell + of_face) * steps..][..steps].iter().copied();
    let cells = (0..mesh.n_cells()).flat_map(|cell| row(cell, 0));
    Ok(cells.chain(mesh.boundary.iter().flat_map(|b| row(b.owner as usize, 1))).collect())
}

/// The same of `n` nodes with an edge for each pair `[n x steps]`.
pub fn walk_of_pairs(n: usize, pairs: &[[i32; 2]], steps: usize) -> Vec<f32> {
    if steps == 0 {
        return Vec::new();
    }
    let both = of_cells(&CellGraph::new(n, pairs), &vec![0; n], steps);
    both.chunks_exact(2 * steps).flat_map(|rows| rows[..steps].iter().copied()).collect()
}

/// Rows of the cells, each followed by that of any of its boundary faces `[n x 2 x steps]`; cell i has `faces[i]` of them, which have
/// no other neighbour.
///
/// With w steps taken the walker is at node j with probability u_j; since d_i (P^w)_ij = d_j (P^w)_ji with numbers d of neighbours,
/// (P^(v + w))_ii is the sum of d_i u_j(v) u_j(w) / d_j: half of the steps are enough.
fn of_cells(graph: &CellGraph, faces: &[i32], steps: usize) -> Vec<f32> {
    let n = graph.n();
    let degree = |i: usize| graph.neighbours(i).len() as f64 + f64::from(faces[i]);
    let mut out = Vec::with_capacity(2 * n * steps);
    // Of each cell the walker's probability to be there, and to be at one of its faces; now, and a step before.
    let [mut now, mut before] = [0, 1].map(|_| vec![[0.0f64; 2]; n]);
    // Cells near the start, nearest first.
    let (mut near, mut seen) = (Vec::new(), vec![false; n]);
    let mut back = Vec::with_capacity(steps + 1);
    for start in 0..n {
        near.clear();
        near.push(start);
        seen[start] = true;
        now[start] = [1.0, 0.0];
        back.clear();
        back.push(1.0);
        let d = degree(start);
        while back.len() <= steps && d > 0.0 {
            std::mem::swap(&mut now, &mut before);
            near.iter().for_each(|&i| now[i] = [0.0; 2]);
            for at in 0..near.len() {
                let i = near[at];
                let [here, outside] = before[i];
                let share = here / degree(i);
                now[i][0] += outside;
                now[i][1] += share * f64::from(faces[i]);
                if share == 0.0 {
                    continue;
                }
                for &j in graph.neighbours(i) {
                    let j = j as usize;
                    if !std::mem::replace(&mut seen[j], true) {
                        near.push(j);
                        (now[j], before[j]) = ([0.0; 2], [0.0; 2]);
                    }
                    now[j][0] += share;
                }
            }
            let met = |a: &[[f64; 2]], b: &[[f64; 2]]| -> f64 {
                let cell = |&i: &usize| {
                    let outside = if faces[i] > 0 { a[i][1] * b[i][1] / f64::from(faces[i]) } else { 0.0 };
                    a[i][0] * b[i][0] / degree(i) + outside
                };
                d * near.iter().map(cell).sum::<f64>()
            };
            back.push(met(&now, &before));
            back.push(met(&now, &now));
        }
        back.resize(steps + 1, 0.0);
        near.iter().for_each(|&i| {
            seen[i] = false;
            (now[i], before[i]) = ([0.0; 2], [0.0; 2]);
        });
        out.extend(back[1..].iter().map(|&p| p as f32));
        // From a face to its cell, back to the cell, and of all ways from there to this face.
        let of_face = |step: usize| if step == 0 || d == 0.0 { 0.0 } else { (back[step - 1] / d) as f32 };
        out.extend((0..steps).map(of_face));
    }
    out
}

/// Diagonals of P, P^2, ... P^steps, row-major `[n x steps]`, with P = D^-1 A and `a` `[n x n]`.
pub(super) fn rwse(n: usize, a: &[f64], steps: usize) -> Vec<f32> {
    let mut p = a.to_vec();
    for row in p.chunks_exact_mut(n.max(1)) {
        let degree: f64 = row.iter().sum();
        if degree > 0.0 {
            row.iter_mut().for_each(|x| *x /= degree);
        }
    }
    // A segment touches few others: products of whole rows would be n^3 work.
    let entries = |row: &[f64]| row.iter().copied().enumerate().filter(|e| e.1 != 0.0).collect();
    let near: Vec<Vec<(usize, f64)>> = p.chunks_exact(n.max(1)).map(entries).collect();
    let mut power = p;
    let mut next = vec![0.0; n * n];
    let mut out = vec![0f32; n * steps];
    for step in 0..steps {
        for i in 0..n {
            out[i * steps + step] = power[i * n + i] as f32;
        }
        if step + 1 == steps {
            break;
        }
        next.fill(0.0);
        let rows = next.chunks_exact_mut(n.max(1)).zip(power.chunks_exact(n.max(1)));
        for (row, weights) in rows {
            for (w, near) in weights.iter().zip(&near).filter(|(w, _)| **w != 0.0) {
                near.iter().for_each(|(j, y)| row[*j] += w * y);
            }
        }
        std::mem::swap(&mut power, &mut next);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    #[test]
    fn ring_returns_with_central_binomials() {
        // On a ring of n > t nodes a walk is back after t steps with probability C(t, t/2) / 2^t, t even.
        let n = 9;
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            a[i * n + (i + 1) % n] = 3.0;
            a[((i + 1) % n) * n + i] = 3.0;
        }
        let out = rwse(n, &a, 6);
        for row in out.chunks_exact(6) {
            for (x, y) in row.iter().zip([0.0, 0.5, 0.0, 6.0 / 16.0, 0.0, 20.0 / 64.0]) {
                assert!((x - y).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn nodes_of_a_mesh_walk_as_their_adjacency_says() {
        let mesh = sample::triangles(4, 3, 1.6, 0.41);
        let graph = Graph::new(&mesh, &Comm::serial()).unwrap();
        let n = graph.n_owned;
        let mut a = vec![0.0; n * n];
        for (&s, &r) in graph.senders.iter().zip(&graph.receivers) {
            a[s as usize * n + r as usize] = 1.0;
        }
        for steps in [1, 2, 7] {
            let found = node_walk(&mesh, steps, &Comm::serial()).unwrap();
            let expected = rwse(n, &a, steps);
            assert_eq!(found.len(), expected.len());
            for (x, y) in found.iter().zip(&expected) {
                assert!((x - y).abs() < 1e-6, "{x} {y} of {steps} steps");
            }
        }
        assert!(node_walk(&mesh, 0, &Comm::serial()).unwrap().is_empty());
        // Two nodes that only know each other, and one alone.
        assert_eq!(walk_of_pairs(3, &[[0, 1]], 3), [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_lone_segment_and_none() {
        assert_eq!(rwse(1, &[4.0], 3), [1.0, 1.0, 1.0]);
        assert_eq!(rwse(1, &[0.0], 2), [0.0, 0.0]);
        assert!(rwse(2, &[0.0; 4], 0).is_empty());
    }
}
