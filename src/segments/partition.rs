//! First partition: METIS on the root, in the canonical numbering.

use super::cell_graph::CellGraph;
use m4gn_mesh::{Error, Result};
use std::cmp::Reverse;
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
    let sizes: Vec<usize> = components.iter().map(Vec::len).collect();
    let mut parts = vec![0; n];
    let mut number = vec![0i32; n];
    let mut first = 0;
    for (cells, share) in components.iter().zip(shares(&sizes, count)) {
        for (i, &cell) in cells.iter().enumerate() {
            number[cell] = i as i32;
        }
        let pairs: Vec<[i32; 2]> = cells
            .iter()
            .flat_map(|&a| graph.neighbours(a).iter().map(move |&b| [a, b as usize]))
            .filter(|[a, b]| a < b)
            .map(|[a, b]| [number[a], number[b]])
            .collect();
        let own = cut(&CellGraph::new(cells.len(), &pairs), share, true)?;
        for (&cell, part) in cells.iter().zip(own) {
            parts[cell] = first + part;
        }
        first += share as i32;
    }
    Ok(parts)
}

/// How many of `count` parts each component gets: at least one, at most one a cell, else in proportion to the
/// sizes (d'Hondt's highest averages, of equals the first).
fn shares(sizes: &[usize], count: usize) -> Vec<usize> {
    let mut shares = vec![1; sizes.len()];
    for _ in sizes.len()..count {
        // size / (share + 1) compared as fractions.
        let next = (0..sizes.len()).filter(|&i| shares[i] < sizes[i]).reduce(|a, b| {
            if sizes[b] * (shares[a] + 1) > sizes[a] * (shares[b] + 1) {
                b
            } else {
                a
            }
        });
        if let Some(next) = next {
            shares[next] += 1;
        }
    }
    shares
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
        .map_err(|e| {
            Error::Numerical(format!(
                "METIS failed to cut {n} cells into {count} segments: {e}"
            ))
        })?;
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
        let members: Vec<usize> = (0..parts.len())
            .filter(|&i| parts[i] as usize == largest)
            .collect();
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
            assert!(
                (0..count as i32).all(|k| parts.contains(&k)),
                "{count}: {parts:?}"
            );
        }
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
        let error = partition(&g, 1, true).unwrap_err().to_string();
        assert!(error.contains("expected at least 2 segments"), "{error}");
        assert_eq!(partition(&g, 1, false).unwrap(), [0; 12]);
    }
}
