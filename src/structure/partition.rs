//! First partition: METIS on the root, of cells numbered by their places.

use super::cell_graph::CellGraph;
use m4gn_base::{Error, Result};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::sync::Mutex;

/// Seed of METIS's random choices: the partition is a function of the mesh alone.
const SEED: i32 = 1;

/// METIS draws from C's rand, which threads share: together they would spoil each other's sequence.
pub(super) static METIS_TURN: Mutex<()> = Mutex::new(());

/// The part (0 to count - 1, none empty) of each cell.
///
/// With `connected` a mesh whose cells do not all hang together is cut component by component, each into a number
/// of parts in proportion to its cells.
///
/// # Errors
/// [`Error::Input`] with `connected` and more components than parts; [`Error::Numerical`] if METIS fails.
pub(super) fn partition(graph: &CellGraph, count: usize, connected: bool) -> Result<Vec<i32>> {
    let n = graph.n();
    if count >= n {
        return Ok((0..n as i32).collect());
    }
    let components = graph.pieces(|_| 0);
    if components.len() == 1 || !connected {
        return cut(graph, count, components.len() == 1);
    }
    if components.len() > count {
        return Err(Error::Input(format!(
            "the mesh falls into {} components that no face joins, more than its {count} segments can be connected \
             in: expected at least {} segments, or connected off",
            components.len(),
            components.len()
        )));
    }
    within_each(graph, &components, count)
}

/// Parts of a block in [`partition_finely`].
const PARTS_OF_A_BLOCK: usize = 64;

/// As [`partition`] with connected parts, for parts of a few cells each: blocks first, then the parts of each block. At least
/// as many parts as the mesh falls into pieces.
///
/// METIS coarsens a graph to thirty nodes a part before it cuts it. Of parts of a few cells nothing is coarsened, and the whole
/// graph is bisected again and again.
pub(super) fn partition_finely(graph: &CellGraph, count: usize) -> Result<Vec<i32>> {
    let pieces = graph.pieces(|_| 0).len();
    let count = count.max(pieces);
    let blocks = count.div_ceil(PARTS_OF_A_BLOCK).max(pieces);
    if blocks == 1 {
        return partition(graph, count, true);
    }
    let block = partition(graph, blocks, true)?;
    let mut cells: Vec<Vec<usize>> = vec![Vec::new(); blocks];
    for (cell, &block) in block.iter().enumerate() {
        cells[block as usize].push(cell);
    }
    within_each(graph, &cells, count)
}

/// Cuts each of these sets of cells by itself, all of them into `count` parts.
fn within_each(graph: &CellGraph, sets: &[Vec<usize>], count: usize) -> Result<Vec<i32>> {
    let sizes: Vec<usize> = sets.iter().map(Vec::len).collect();
    let mut parts = vec![0; graph.n()];
    let (mut set_of, mut number) = (vec![0u32; graph.n()], vec![0i32; graph.n()]);
    for (set, cells) in sets.iter().enumerate() {
        for (i, &cell) in cells.iter().enumerate() {
            (set_of[cell], number[cell]) = (set as u32, i as i32);
        }
    }
    let mut first = 0;
    for (cells, share) in sets.iter().zip(shares(&sizes, count)) {
        let pairs: Vec<[i32; 2]> = cells
            .iter()
            .flat_map(|&a| graph.neighbours(a).iter().map(move |&b| [a, b as usize]))
            .filter(|&[a, b]| a < b && set_of[a] == set_of[b])
            .map(|[a, b]| [number[a], number[b]])
            .collect();
        let own = partition(&CellGraph::new(cells.len(), &pairs), share, true)?;
        for (&cell, part) in cells.iter().zip(own) {
            parts[cell] = first + part;
        }
        first += share as i32;
    }
    Ok(parts)
}

/// How many of `count` parts each set of cells gets: at least one, at most one a cell, else in proportion to the
/// sizes (d'Hondt's highest averages, of equals the first).
fn shares(sizes: &[usize], count: usize) -> Vec<usize> {
    let mut shares = vec![1; sizes.len()];
    let claim =
        |set: usize, share: usize| (share < sizes[set]).then_some(Claim { size: sizes[set], share, set });
    let mut claims: BinaryHeap<Claim> = (0..sizes.len()).filter_map(|set| claim(set, 1)).collect();
    for _ in sizes.len()..count {
        let Some(Claim { set, .. }) = claims.pop() else {
            break;
        };
        shares[set] += 1;
        claims.extend(claim(set, shares[set]));
    }
    shares
}

/// A set's claim to the next part: its size over the parts that it would then have.
#[derive(Debug, PartialEq, Eq)]
struct Claim {
    size: usize,
    share: usize,
    set: usize,
}

impl Ord for Claim {
    fn cmp(&self, other: &Self) -> Ordering {
        // size / (share + 1) compared as fractions
        let (own, others) = (self.size * (other.share + 1), other.size * (self.share + 1));
        own.cmp(&others).then(other.set.cmp(&self.set))
    }
}

impl PartialOrd for Claim {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// METIS's k-way partition, with no part empty; contiguous where METIS takes that option.
fn cut(graph: &CellGraph, count: usize, contiguous: bool) -> Result<Vec<i32>> {
    let n = graph.n();
    if count == 1 {
        return Ok(vec![0; n]);
    }
    if count >= n {
        return Ok((0..n as i32).collect());
    }
    let mut parts = vec![0i32; n];
    let _turn = METIS_TURN.lock().unwrap_or_else(|e| e.into_inner());
    // METIS refuses contiguous parts of a graph that is not connected.
    metis::Graph::new(1, count as i32, &graph.row, &graph.column)
        .map_err(|e| Error::Internal(format!("METIS does not accept the cell graph: {e}")))?
        .set_option(metis::option::Seed(SEED))
        .set_option(metis::option::Contig(contiguous))
        .part_kway(&mut parts)
        .map_err(|e| Error::Numerical(format!("METIS failed to cut {n} cells into {count} segments: {e}")))?;
    fill_empty(graph, &mut parts, count);
    Ok(parts)
}

/// METIS may leave parts empty when they are to be tiny: the largest part gives its far half away.
fn fill_empty(graph: &CellGraph, parts: &mut [i32], count: usize) {
    let mut sizes = vec![0usize; count];
    for &p in parts.iter() {
        sizes[p as usize] += 1;
    }
    while let Some(empty) = sizes.iter().position(|&s| s == 0) {
        let largest = (0..count).max_by_key(|&k| (sizes[k], Reverse(k))).unwrap_or(0);
        let members: Vec<usize> = (0..parts.len()).filter(|&i| parts[i] as usize == largest).collect();
        let reached = graph.breadth_first(members[0], |j| parts[j] as usize == largest);
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

#[cfg(test)]
mod tests {
    use super::super::cell_graph::tests::path;
    use super::*;

    #[test]
    fn one_part_and_as_many_as_cells() {
        assert_eq!(partition(&path(4), 1, true).unwrap(), [0; 4]);
        assert_eq!(partition(&path(4), 4, true).unwrap(), [0, 1, 2, 3]);
    }

    #[test]
    fn two_blobs_joined_by_one_edge_are_told_apart() {
        let clique =
            |first: i32| (first..first + 6).flat_map(move |a| (a + 1..first + 6).map(move |b| [a, b]));
        let pairs: Vec<[i32; 2]> = clique(0).chain(clique(6)).chain([[5, 6]]).collect();
        let parts = partition(&CellGraph::new(12, &pairs), 2, true).unwrap();
        assert!(parts[..6].iter().all(|&p| p == parts[0]));
        assert!(parts[6..].iter().all(|&p| p == parts[6]));
        assert_ne!(parts[0], parts[6]);
    }

    #[test]
    fn no_part_stays_empty() {
        let g = path(8);
        let mut parts = vec![0; 8];
        fill_empty(&g, &mut parts, 4);
        let sizes = |k| parts.iter().filter(|&&p| p == k).count();
        assert_eq!([sizes(0), sizes(1), sizes(2), sizes(3)], [2, 2, 2, 2]);
        for count in 2..8 {
            let parts = partition(&g, count, false).unwrap();
            assert!((0..count as i32).all(|k| parts.contains(&k)), "{count}: {parts:?}");
        }
    }

    /// A strip of 400 x 10 cells in 500 parts of eight: blocks of whole parts, all connected and none far from eight.
    #[test]
    fn parts_of_a_few_cells_are_cut_block_by_block() {
        let at = |i: i32, j: i32| 10 * i + j;
        let along = (0..399).flat_map(|i| (0..10).map(move |j| [at(i, j), at(i + 1, j)]));
        let across = (0..400).flat_map(|i| (0..9).map(move |j| [at(i, j), at(i, j + 1)]));
        let graph = CellGraph::new(4000, &along.chain(across).collect::<Vec<_>>());
        let parts = partition_finely(&graph, 500).unwrap();
        let mut sizes = vec![0; 500];
        parts.iter().for_each(|&p| sizes[p as usize] += 1);
        assert!(sizes.iter().all(|n| (4..=12).contains(n)), "{sizes:?}");
        assert_eq!(graph.pieces(|cell| parts[cell]).len(), 500);
    }

    #[test]
    fn components_share_the_parts_by_size() {
        assert_eq!(shares(&[10, 20, 10], 3), [1, 1, 1]);
        assert_eq!(shares(&[10, 20, 10], 4), [1, 2, 1]);
        assert_eq!(shares(&[2, 100], 10), [1, 9]);
        assert_eq!(shares(&[1, 3], 4), [1, 3]);
        // Two paths of 4 and 8 cells.
        let pairs: Vec<[i32; 2]> = (0..11).filter(|&i| i != 3).map(|i| [i, i + 1]).collect();
        let g = CellGraph::new(12, &pairs);
        let parts = partition(&g, 3, true).unwrap();
        assert_eq!(parts[..4], [0; 4]);
        assert!(parts[4..].iter().all(|&p| p == 1 || p == 2) && parts[4] != parts[11]);
        m4gn_samples::fails(partition(&g, 1, true), &["expected at least 2 segments"]);
        assert_eq!(partition(&g, 1, false).unwrap(), [0; 12]);
    }
}
