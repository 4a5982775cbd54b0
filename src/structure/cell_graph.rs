//! The undecomposed graph of cells, on the root, numbered by their places: what METIS and the search for connected pieces see, so
//! that their answers depend neither on the ranks nor on the numbering of the mesh.

use super::place::line;
use crate::graph::Graph;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Mesh;
use m4gn_parallel::{Comm, Element};

/// Cells and the faces between them in compressed rows, neighbours ascending.
#[derive(Debug)]
pub(super) struct CellGraph {
    /// Neighbours of cell i: `column[row[i]..row[i + 1]]`.
    pub row: Vec<i32>,
    /// Neighbours.
    pub column: Vec<i32>,
}

impl CellGraph {
    /// The graph of `n` cells with an edge for each pair, in either direction or both.
    pub fn new(n: usize, pairs: &[[i32; 2]]) -> Self {
        let mut row = vec![0i32; n + 1];
        for &[a, b] in pairs {
            row[a as usize + 1] += 1;
            row[b as usize + 1] += 1;
        }
        for i in 0..n {
            row[i + 1] += row[i];
        }
        let mut next = row.clone();
        let mut column = vec![0i32; 2 * pairs.len()];
        for &[a, b] in pairs {
            for (from, to) in [(a, b), (b, a)] {
                let at = &mut next[from as usize];
                column[*at as usize] = to;
                *at += 1;
            }
        }
        // Two cells may share several faces: one edge.
        let (mut kept, mut first) = (0usize, 0usize);
        for i in 0..n {
            let end = row[i + 1] as usize;
            column[first..end].sort_unstable();
            for at in first..end {
                if at == first || column[at] != column[at - 1] {
                    column[kept] = column[at];
                    kept += 1;
                }
            }
            row[i + 1] = kept as i32;
            first = end;
        }
        column.truncate(kept);
        CellGraph { row, column }
    }

    /// Number of cells.
    pub fn n(&self) -> usize {
        self.row.len() - 1
    }

    /// Neighbours of a cell, ascending.
    pub fn neighbours(&self, i: usize) -> &[i32] {
        &self.column[self.row[i] as usize..self.row[i + 1] as usize]
    }

    /// Cells in breadth-first order from `start` among those with `inside`.
    pub fn breadth_first(&self, start: usize, inside: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut seen = vec![false; self.n()];
        self.flood(start, &mut seen, inside)
    }

    /// As [`CellGraph::breadth_first`], skipping cells that were seen and marking those that are now.
    fn flood(&self, start: usize, seen: &mut [bool], inside: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut order = vec![start];
        seen[start] = true;
        let mut at = 0;
        while at < order.len() {
            for &j in self.neighbours(order[at]) {
                let j = j as usize;
                if !seen[j] && inside(j) {
                    seen[j] = true;
                    order.push(j);
                }
            }
            at += 1;
        }
        order
    }

    /// Connected pieces of the cells with equal `label`, each in breadth-first order from its lowest cell, ascending
    /// by that cell.
    pub fn pieces(&self, label: impl Fn(usize) -> i32) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.n()];
        let mut pieces = Vec::new();
        for start in 0..self.n() {
            if !seen[start] {
                let own = label(start);
                pieces.push(self.flood(start, &mut seen, |j| label(j) == own));
            }
        }
        pieces
    }
}

/// The root's view of all cells: their graph, and which rank has which.
#[derive(Debug)]
pub(super) struct Root {
    /// The undecomposed graph.
    pub graph: CellGraph,
    /// Numbers by place of each rank's cells.
    cells: Vec<Vec<i64>>,
}

/// Cells of all ranks. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::Input`] for more cells, or neighbours of cells, than METIS counts.
pub(super) fn counted(mesh: &Mesh, comm: &Comm) -> Result<usize> {
    let cells = comm.total(mesh.n_cells());
    // Each face has a cell on either side.
    fits(cells, comm.total(2 * mesh.face_owner.len() + mesh.coupled.len()))?;
    Ok(cells as usize)
}

/// Whether METIS's 32-bit integers count a graph.
fn fits(cells: i64, neighbours: i64) -> Result<()> {
    let most = i64::from(i32::MAX);
    refuse(cells.max(neighbours) > most, Error::Input, || {
        format!(
            "{cells} cells with {neighbours} neighbours together: METIS counts to {most}, expected a mesh of fewer cells"
        )
    })
}

/// Numbers of this rank's cells in the order of the places of all ranks' cells. Collective.
pub(super) fn by_place(mesh: &Mesh, comm: &Comm) -> Vec<i64> {
    let cells = comm.gather(&mesh.cell_global);
    let centres = comm.gather(mesh.cell_centres.as_flattened());
    let send = cells.zip(centres).map(|(cells, centres)| {
        let number = line(centres.concat().as_chunks::<3>().0, &cells.concat());
        let mut rest = &number[..];
        let own = |cells: &Vec<i64>| rest.split_off(..cells.len()).unwrap_or_default().to_vec();
        cells.iter().map(own).collect()
    });
    from_root(send, comm)
}

/// What the root sends to this rank. Collective.
fn from_root<V: Element>(send: Option<Vec<Vec<V>>>, comm: &Comm) -> Vec<V> {
    let send = send.unwrap_or_else(|| vec![Vec::new(); comm.size() as usize]);
    comm.all_to_all(&send).into_iter().next().unwrap_or_default()
}

impl Root {
    /// Gathers the graph on the root, none elsewhere; and the numbers of this rank's cells there. Collective.
    ///
    /// # Errors
    /// As [`counted`].
    pub fn gather(mesh: &Mesh, graph: &mut Graph, comm: &Comm) -> Result<(Option<Self>, Vec<i64>)> {
        let total = counted(mesh, comm)?;
        let number = by_place(mesh, comm);
        let pairs = comm.gather(&numbered_pairs(&number, graph, comm));
        let root = pairs.zip(comm.gather(&number)).map(|(pairs, cells)| {
            let pairs = pairs.concat();
            Root { graph: CellGraph::new(total, pairs.as_chunks::<2>().0), cells }
        });
        Ok((root, number))
    }

    /// Labels of all cells, by place, from each rank's own; none but on the root. Collective.
    pub fn collect(root: Option<&Self>, labels: &[i32], comm: &Comm) -> Option<Vec<i32>> {
        let lists = comm.gather(labels)?;
        let root = root?;
        let mut all = vec![0; root.graph.n()];
        for (cells, labels) in root.cells.iter().zip(lists) {
            for (&cell, label) in cells.iter().zip(labels) {
                all[cell as usize] = label;
            }
        }
        Some(all)
    }

    /// Each rank's own part of the root's rows of `width` values. Collective.
    pub fn hand_out<V: Element>(root: Option<&Self>, values: &[V], width: usize, comm: &Comm) -> Vec<V> {
        let row = |&cell: &i64| values[cell as usize * width..][..width].iter().cloned();
        let of = |root: &Self| root.cells.iter().map(|cells| cells.iter().flat_map(row).collect()).collect();
        from_root(root.map(of), comm)
    }
}

/// The edges between cells of these numbers, each with the lower one first and on one rank, flattened. Collective.
fn numbered_pairs(cells: &[i64], graph: &mut Graph, comm: &Comm) -> Vec<i32> {
    let mut number = vec![-1i64; graph.n_local];
    number[..graph.n_cells].copy_from_slice(cells);
    graph.halo.exchange_i64(comm, &mut number, 1);
    let mut pairs = Vec::with_capacity(graph.senders.len());
    for (&sender, &receiver) in graph.senders.iter().zip(&graph.receivers) {
        let (r, s) = (number[receiver as usize], number[sender as usize]);
        // Both directions of an edge exist, each with its receiver's rank: one is enough.
        if r >= 0 && s > r {
            pairs.extend([r as i32, s as i32]);
        }
    }
    pairs
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn path(n: i32) -> CellGraph {
        let pairs: Vec<[i32; 2]> = (0..n - 1).map(|i| [i, i + 1]).collect();
        CellGraph::new(n as usize, &pairs)
    }

    #[test]
    fn rows_are_sorted_symmetric_and_without_repeats() {
        let g = CellGraph::new(4, &[[2, 1], [0, 2], [1, 2], [0, 2], [0, 1]]);
        assert_eq!(g.row, [0, 2, 4, 6, 6]);
        assert_eq!(g.column, [1, 2, 0, 2, 0, 1]);
    }

    /// 400 million hexahedra have six neighbours each.
    #[test]
    fn more_than_metis_counts_is_refused() {
        fits(300_000_000, 1_800_000_000).unwrap();
        m4gn_samples::fails(fits(400_000_000, 2_400_000_000), &["2400000000 neighbours", "2147483647"]);
        m4gn_samples::fails(fits(3_000_000_000, 0), &["3000000000 cells"]);
    }

    #[test]
    fn pieces_of_equal_labels() {
        let labels = [0, 0, 1, 0, 1, 1];
        assert_eq!(path(6).pieces(|i| labels[i]), [vec![0, 1], vec![2], vec![3], vec![4, 5]]);
        assert_eq!(path(3).breadth_first(1, |_| true), [1, 0, 2]);
    }
}
