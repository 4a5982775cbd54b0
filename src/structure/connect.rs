//! Every segment made connected: pieces that do not hang together with the largest of their segment go to the
//! neighbour with which they share most faces. On the root, of cells numbered by their places.

use super::cell_graph::CellGraph;
use std::collections::VecDeque;

/// A cell that is between segments.
const FREE: i32 = -1;

/// Makes the segments 0 to `count` - 1 of `labels` (none empty) connected; returns how many cells changed theirs.
///
/// Of each segment the largest piece stays (of equals that with the lowest cell). The others join, from the
/// stayers outwards, the segment with the most faces to them, of equals the lowest. No segment becomes empty. A
/// component of the mesh in which nothing stays becomes one segment, for which the smallest segment of the
/// components that have several is given up. There must be no more components than segments.
pub(super) fn connect(graph: &CellGraph, labels: &mut [i32], count: usize) -> usize {
    let before = labels.to_vec();
    let pieces = graph.pieces(|i| before[i]);
    let mut largest: Vec<Option<usize>> = vec![None; count];
    for (p, cells) in pieces.iter().enumerate() {
        let kept = &mut largest[before[cells[0]] as usize];
        if kept.is_none_or(|k| pieces[k].len() < cells.len()) {
            *kept = Some(p);
        }
    }
    let mut piece_of = vec![0u32; labels.len()];
    let mut waiting = vec![false; pieces.len()];
    for (p, cells) in pieces.iter().enumerate() {
        if largest[before[cells[0]] as usize] != Some(p) {
            waiting[p] = true;
            cells.iter().for_each(|&i| {
                labels[i] = FREE;
                piece_of[i] = p as u32;
            });
        }
    }
    let mut queue: VecDeque<usize> =
        (0..pieces.len()).filter(|&p| waiting[p] && neighbour(graph, &pieces[p], labels).is_some()).collect();
    queue.iter().for_each(|&p| waiting[p] = false);
    while let Some(p) = queue.pop_front() {
        let Some(segment) = neighbour(graph, &pieces[p], labels) else {
            continue;
        };
        pieces[p].iter().for_each(|&i| labels[i] = segment);
        for &i in &pieces[p] {
            for &j in graph.neighbours(i) {
                let next = piece_of[j as usize] as usize;
                if labels[j as usize] == FREE && waiting[next] {
                    waiting[next] = false;
                    queue.push_back(next);
                }
            }
        }
    }
    if labels.contains(&FREE) {
        fill_components(graph, labels, count);
    }
    before.iter().zip(labels.iter()).filter(|(a, b)| a != b).count()
}

/// The segment with the most faces to the cells of a piece.
fn neighbour(graph: &CellGraph, piece: &[usize], labels: &[i32]) -> Option<i32> {
    let own = labels[piece[0]];
    let mut found: Vec<i32> = piece
        .iter()
        .flat_map(|&i| graph.neighbours(i))
        .map(|&j| labels[j as usize])
        .filter(|&l| l != FREE && l != own)
        .collect();
    found.sort_unstable();
    // max_by_key takes the last of equals: the lowest segment comes last.
    found.chunk_by(|a, b| a == b).rev().max_by_key(|run| run.len()).map(|run| run[0])
}

/// Gives each component that is free one segment, taken from the components that have several.
fn fill_components(graph: &CellGraph, labels: &mut [i32], count: usize) {
    let components = graph.pieces(|_| 0);
    for free in &components {
        if labels[free[0]] != FREE {
            continue;
        }
        let mut sizes = vec![0usize; count];
        let mut alone = vec![true; count];
        for cells in components.iter().filter(|c| labels[c[0]] != FREE) {
            let first = labels[cells[0]];
            let several = cells.iter().any(|&i| labels[i] != first);
            for &i in cells {
                sizes[labels[i] as usize] += 1;
                alone[labels[i] as usize] = !several;
            }
        }
        let Some(smallest) = (0..count).filter(|&k| !alone[k]).min_by_key(|&k| sizes[k]) else {
            return;
        };
        let members: Vec<usize> = (0..labels.len()).filter(|&i| labels[i] == smallest as i32).collect();
        if let Some(segment) = neighbour(graph, &members, labels) {
            members.iter().for_each(|&i| labels[i] = segment);
            free.iter().for_each(|&i| labels[i] = smallest as i32);
        }
    }
}

/// Whether every segment is connected.
#[cfg(test)]
pub(super) fn is_connected(graph: &CellGraph, labels: &[i32], count: usize) -> bool {
    graph.pieces(|i| labels[i]).len() == count
}

#[cfg(test)]
mod tests {
    use super::super::cell_graph::tests::path;
    use super::*;
    use proptest::prelude::*;

    fn connected(graph: &CellGraph, labels: &[i32], count: usize) -> (Vec<i32>, usize) {
        let mut labels = labels.to_vec();
        let moved = connect(graph, &mut labels, count);
        (labels, moved)
    }

    #[test]
    fn pieces_join_their_neighbours() {
        // The lone 1 within 0; the lone 0 has one face to each side and takes the lower.
        let (labels, moved) = connected(&path(8), &[0, 0, 1, 0, 0, 1, 1, 1], 2);
        assert_eq!((labels, moved), (vec![0, 0, 0, 0, 0, 1, 1, 1], 1));
        let (labels, moved) = connected(&path(7), &[0, 0, 2, 2, 0, 1, 1], 3);
        assert_eq!((labels, moved), (vec![0, 0, 2, 2, 1, 1, 1], 1));
        // Of equal pieces the first stays; what is connected stays as it is.
        let (labels, moved) = connected(&path(5), &[0, 1, 1, 1, 0], 2);
        assert_eq!((labels, moved), (vec![0, 1, 1, 1, 1], 1));
        assert_eq!(connected(&path(4), &[1, 1, 0, 0], 2), (vec![1, 1, 0, 0], 0));
    }

    #[test]
    fn most_faces_decide() {
        // 3 x 3 grid: the middle cell has one face to 0 and three to 1.
        let pairs: Vec<[i32; 2]> = (0..9)
            .flat_map(|i| {
                let right = (i % 3 < 2).then_some([i, i + 1]);
                let up = (i < 6).then_some([i, i + 3]);
                right.into_iter().chain(up)
            })
            .collect();
        let g = CellGraph::new(9, &pairs);
        let (labels, _) = connected(&g, &[2, 0, 0, 1, 2, 1, 1, 1, 1], 3);
        assert_eq!(labels, [2, 0, 0, 1, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn pieces_behind_pieces_are_reached() {
        // Behind the 1 at cell 3 lies a 0 that only touches pieces.
        let (labels, _) = connected(&path(8), &[0, 0, 0, 1, 0, 1, 1, 1], 2);
        assert_eq!(labels, [0, 0, 0, 0, 0, 1, 1, 1]);
        let (labels, _) = connected(&path(10), &[2, 2, 2, 0, 1, 0, 0, 1, 1, 1], 3);
        assert_eq!(labels, [2, 2, 2, 2, 0, 0, 0, 1, 1, 1]);
    }

    #[test]
    fn a_component_without_a_segment_gets_one() {
        // Two paths of 4 cells; all of the second is of segments that stay in the first.
        let pairs: Vec<[i32; 2]> = (0..7).filter(|&i| i != 3).map(|i| [i, i + 1]).collect();
        let g = CellGraph::new(8, &pairs);
        let (labels, _) = connected(&g, &[0, 0, 0, 1, 0, 0, 1, 1], 2);
        assert!(is_connected(&g, &labels, 2), "{labels:?}");
        let (labels, _) = connected(&g, &[0, 0, 0, 1, 0, 0, 0, 0], 2);
        assert_eq!(labels, [1, 1, 1, 1, 0, 0, 0, 0]);
        // Both largest pieces lie in the first path: 0 is given up there.
        let pairs = [[0, 1], [1, 2], [2, 3], [4, 5]];
        let (labels, moved) = connected(&CellGraph::new(6, &pairs), &[0, 0, 1, 1, 0, 0], 2);
        assert_eq!((labels, moved), (vec![1, 1, 1, 1, 0, 0], 2));
    }

    proptest! {
        #[test]
        fn any_graph_and_labels(
            n in 2usize..40, links in prop::collection::vec((0usize..40, 0usize..40), 0..80), wish in 1usize..12, seed in any::<u64>()
        ) {
            let pairs: Vec<[i32; 2]> = links
                .iter()
                .map(|&(a, b)| [(a % n) as i32, (b % n) as i32])
                .filter(|[a, b]| a != b)
                .collect();
            let g = CellGraph::new(n, &pairs);
            let components = g.pieces(|_| 0).len();
            let count = wish.max(components).min(n);
            // Every segment once, the rest by chance.
            let mut x = seed;
            let labels: Vec<i32> = (0..n)
                .map(|i| {
                    x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    if i < count { i as i32 } else { ((x >> 33) % count as u64) as i32 }
                })
                .collect();
            let (found, moved) = connected(&g, &labels, count);
            prop_assert!((0..count as i32).all(|k| found.contains(&k)));
            prop_assert!(is_connected(&g, &found, count), "{labels:?} {found:?}");
            prop_assert_eq!(connected(&g, &found, count), (found.clone(), 0));
            prop_assert_eq!(moved, labels.iter().zip(&found).filter(|(a, b)| a != b).count());
        }
    }
}
