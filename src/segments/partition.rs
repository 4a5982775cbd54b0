//! First partition: METIS on the root, in the canonical numbering.

use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::parallel::Comm;
use crate::{Error, Result};
use std::collections::VecDeque;
use std::sync::Mutex;

/// Seed of METIS's random choices: the partition is a function of the mesh alone.
const SEED: i32 = 1;

/// METIS draws from C's rand, which threads share: together they would spoil each other's sequence.
pub(super) static METIS_TURN: Mutex<()> = Mutex::new(());

/// The part (0 to count - 1, none empty) of each of this rank's cells. Collective.
pub(super) fn partition(mesh: &Mesh, graph: &mut Graph, count: usize, comm: &Comm) -> Result<Vec<i32>> {
    let pairs = global_pairs(mesh, graph, comm);
    let gathered = comm.gather(&pairs);
    let cells = comm.gather(&mesh.cell_global);
    let parts = match (gathered, cells) {
        (Some(pairs), Some(cells)) => {
            let n = cells.iter().map(Vec::len).sum();
            CellGraph::new(n, pairs.into_iter().flatten()).and_then(|g| g.partition(count))
        }
        _ => Ok(Vec::new()),
    };
    let mut parts = comm.agree(parts)?;
    comm.broadcast(&mut parts);
    Ok(mesh.cell_global.iter().map(|&g| parts[g as usize]).collect())
}

/// Global numbers (receiver, sender) of this rank's edges between cells, flattened.
fn global_pairs(mesh: &Mesh, graph: &mut Graph, comm: &Comm) -> Vec<i64> {
    let mut global = vec![-1i64; graph.n_local];
    global[..graph.n_cells].copy_from_slice(&mesh.cell_global);
    graph.halo.exchange_i64(comm, &mut global, 1);
    let mut pairs = Vec::with_capacity(2 * graph.senders.len());
    for (&sender, &receiver) in graph.senders.iter().zip(&graph.receivers) {
        let (r, s) = (global[receiver as usize], global[sender as usize]);
        if r >= 0 && s >= 0 && r != s {
            pairs.extend([r, s]);
        }
    }
    pairs
}

/// The undecomposed cell graph in compressed rows, neighbours ascending.
struct CellGraph {
    row: Vec<i32>,
    column: Vec<i32>,
}

impl CellGraph {
    fn new(n: usize, pairs: impl Iterator<Item = i64>) -> Result<Self> {
        if n > i32::MAX as usize / 2 {
            return Err(Error::Input(format!(
                "{n} cells: METIS counts to {}",
                i32::MAX / 2
            )));
        }
        let flat: Vec<i64> = pairs.collect();
        // Symmetric whatever the input: METIS relies on it.
        let mut edges: Vec<(i32, i32)> = flat
            .chunks_exact(2)
            .flat_map(|p| [(p[0] as i32, p[1] as i32), (p[1] as i32, p[0] as i32)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut row = vec![0i32; n + 1];
        for &(a, _) in &edges {
            row[a as usize + 1] += 1;
        }
        for i in 0..n {
            row[i + 1] += row[i];
        }
        Ok(CellGraph {
            row,
            column: edges.into_iter().map(|(_, b)| b).collect(),
        })
    }

    fn n(&self) -> usize {
        self.row.len() - 1
    }

    fn neighbours(&self, i: usize) -> &[i32] {
        &self.column[self.row[i] as usize..self.row[i + 1] as usize]
    }

    /// Cells in breadth-first order from `start` among those with `inside`.
    fn breadth_first(&self, start: usize, inside: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut seen = vec![false; self.n()];
        let mut order = Vec::new();
        let mut queue = VecDeque::from([start]);
        seen[start] = true;
        while let Some(i) = queue.pop_front() {
            order.push(i);
            for &j in self.neighbours(i) {
                let j = j as usize;
                if !seen[j] && inside(j) {
                    seen[j] = true;
                    queue.push_back(j);
                }
            }
        }
        order
    }

    fn partition(&self, count: usize) -> Result<Vec<i32>> {
        let n = self.n();
        if count == 1 {
            return Ok(vec![0; n]);
        }
        if count >= n {
            return Ok((0..n as i32).collect());
        }
        let mut parts = vec![0i32; n];
        let _turn = METIS_TURN.lock().unwrap_or_else(|e| e.into_inner());
        // METIS refuses contiguous parts of a graph that is not connected.
        let connected = self.breadth_first(0, |_| true).len() == n;
        metis::Graph::new(1, count as i32, &self.row, &self.column)
            .map_err(|e| Error::Internal(format!("METIS does not accept the cell graph: {e}")))?
            .set_option(metis::option::Seed(SEED))
            .set_option(metis::option::Contig(connected))
            .part_kway(&mut parts)
            .map_err(|e| {
                Error::Numerical(format!(
                    "METIS failed to cut {n} cells into {count} segments: {e}"
                ))
            })?;
        self.fill_empty(&mut parts, count);
        Ok(parts)
    }

    /// METIS may leave parts empty when they are to be tiny: the largest part gives its far half away.
    fn fill_empty(&self, parts: &mut [i32], count: usize) {
        let mut sizes = vec![0usize; count];
        for &p in parts.iter() {
            sizes[p as usize] += 1;
        }
        while let Some(empty) = sizes.iter().position(|&s| s == 0) {
            let largest = (0..count)
                .max_by_key(|&k| (sizes[k], std::cmp::Reverse(k)))
                .unwrap_or(0);
            let members: Vec<usize> = (0..parts.len())
                .filter(|&i| parts[i] as usize == largest)
                .collect();
            let reached = self.breadth_first(members[0], |j| parts[j] as usize == largest);
            // Pieces that the search does not reach come last: they leave first.
            let mut order = reached.clone();
            let mut near = vec![false; parts.len()];
            reached.iter().for_each(|&i| near[i] = true);
            order.extend(members.iter().filter(|&&i| !near[i]));
            let keep = order.len().div_ceil(2);
            for &i in &order[keep..] {
                parts[i] = empty as i32;
            }
            sizes[largest] = keep;
            sizes[empty] = order.len() - keep;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(n: i64) -> CellGraph {
        CellGraph::new(n as usize, (0..n - 1).flat_map(|i| [i, i + 1])).unwrap()
    }

    #[test]
    fn one_part_and_as_many_as_cells() {
        assert_eq!(path(4).partition(1).unwrap(), [0; 4]);
        assert_eq!(path(4).partition(4).unwrap(), [0, 1, 2, 3]);
    }

    #[test]
    fn two_blobs_joined_by_one_edge_are_told_apart() {
        let clique =
            |first: i64| (first..first + 6).flat_map(move |a| (a + 1..first + 6).flat_map(move |b| [a, b]));
        let g = CellGraph::new(12, clique(0).chain(clique(6)).chain([5, 6])).unwrap();
        let parts = g.partition(2).unwrap();
        assert!(parts[..6].iter().all(|&p| p == parts[0]));
        assert!(parts[6..].iter().all(|&p| p == parts[6]));
        assert_ne!(parts[0], parts[6]);
    }

    #[test]
    fn no_part_stays_empty() {
        let g = path(8);
        let mut parts = vec![0; 8];
        g.fill_empty(&mut parts, 4);
        let sizes = |k| parts.iter().filter(|&&p| p == k).count();
        assert_eq!([sizes(0), sizes(1), sizes(2), sizes(3)], [2, 2, 2, 2]);
        for count in 2..8 {
            let parts = g.partition(count).unwrap();
            assert!(
                (0..count as i32).all(|k| parts.contains(&k)),
                "{count}: {parts:?}"
            );
        }
    }
}
