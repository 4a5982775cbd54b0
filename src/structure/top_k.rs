//! The next coarser graph of a graph U-net (Gao and Ji 2019): of the nodes of the largest scores, joined where they are within two edges
//! of each other.
//!
//! The scores are learned, so that the graph changes with the state: backends make it anew in each step. A way from one node to another is
//! an edge and an edge, or an edge and none, in either order: the second power of the adjacency with its diagonal, as in PyTorch Geometric.

use super::graph::Graph;
use super::levels::Transfer;
use m4gn_parallel::{Comm, Halo};
use std::collections::BTreeMap;

/// Scores that differ by less than this, over the largest one, are equal: with nodes in another order a network's sums round otherwise.
const EQUAL: f32 = 1e-5;

/// The nodes that are kept, and their graph.
#[derive(Clone, Debug)]
pub struct Pooled {
    /// Nodes of the finer graph, ascending.
    pub kept: Vec<u32>,
    /// Of these nodes; its edges have no features.
    pub graph: Graph,
    /// Features of the edges from those of the finer graph's: half of the sum along a way, in the mean over all ways.
    pub edges: Transfer,
}

impl Pooled {
    /// Half of the nodes, rounded up, of each part: of the whole graph, or of each of several that stand side by side. `nodes[i]` are the
    /// part of node i and its number there in the order of places, `scores[i]` its score; of those that are equal to the least that is
    /// kept the first by their places are.
    pub fn new((senders, receivers): (&[i32], &[i32]), nodes: &[[u32; 2]], scores: &[f32]) -> Self {
        let n = scores.len();
        let mut near: Vec<Vec<(usize, Option<i32>)>> = (0..n).map(|i| vec![(i, None)]).collect();
        for (edge, (&s, &r)) in (0..).zip(senders.iter().zip(receivers)) {
            near[r as usize].push((s as usize, Some(edge)));
        }
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| nodes[a][0].cmp(&nodes[b][0]).then(scores[b].total_cmp(&scores[a])));
        let mut kept: Vec<u32> = Vec::with_capacity(n.div_ceil(2));
        for part in order.chunk_by_mut(|&a, &b| nodes[a][0] == nodes[b][0]) {
            let count = part.len().div_ceil(2);
            let near = EQUAL * part.iter().fold(0f32, |most, &i| most.max(scores[i].abs()));
            let least = scores[part[count - 1]];
            let above = part[..count].partition_point(|&i| scores[i] - least > near);
            let equal = part[count..].partition_point(|&i| least - scores[i] <= near);
            part[above..count + equal].sort_by_key(|&i| (nodes[i][1], i));
            kept.extend(part[..count].iter().map(|&i| i as u32));
        }
        kept.sort_unstable();
        let mut number = vec![None; n];
        (0..).zip(&kept).for_each(|(new, &i)| number[i as usize] = Some(new));

        let (mut row, mut senders, mut receivers, mut terms) =
            (vec![0u32], Vec::new(), Vec::new(), Vec::new());
        for (r, &node) in (0..).zip(&kept) {
            let mut ways: BTreeMap<i32, (f64, Vec<i32>)> = BTreeMap::new();
            for &(middle, first) in &near[node as usize] {
                for &(s, second) in &near[middle] {
                    let Some(s) = number[s].filter(|&s| s != r) else { continue };
                    let (count, edges) = ways.entry(s).or_default();
                    *count += 1.0;
                    edges.extend(first.into_iter().chain(second));
                }
            }
            for (s, (count, edges)) in ways {
                senders.push(s);
                receivers.push(r);
                terms.push(edges.into_iter().map(|e| (e, 0.5 / count)).collect());
            }
            row.push(senders.len() as u32);
        }
        let count = kept.len();
        let graph = Graph {
            n_owned: count,
            n_local: count,
            node_types: vec![0; count],
            row,
            senders,
            receivers,
            halo: Halo::new(&Comm::serial(), &[], &[], count).unwrap_or_default(),
            ..Graph::default()
        };
        Pooled { kept, graph, edges: Transfer::new(terms.into_iter()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes that stand as they are numbered.
    fn parts(part: [u32; 6]) -> [[u32; 2]; 6] {
        std::array::from_fn(|i| [part[i], i as u32])
    }

    /// Three nodes of six are kept: one has the largest score, four share the next one but for rounding, and those that come first by
    /// their places stay, wherever they are numbered.
    #[test]
    fn equal_scores_are_told_apart_by_places() {
        let kept =
            |place: [u32; 6], scores: [f32; 6]| Pooled::new((&[], &[]), &place.map(|p| [0, p]), &scores).kept;
        let scores = [1.0, 9.0, 1.0 + 1e-6, 1.0 - 1e-6, 0.5, 1.0];
        assert_eq!(kept([0, 1, 2, 3, 4, 5], scores), [0, 1, 2]);
        assert_eq!(kept([5, 4, 3, 2, 1, 0], scores), [1, 3, 5]);
        assert_eq!(kept([5, 4, 3, 2, 1, 0], [1.2, 9.0, 1.1, 0.9, 0.5, 1.0]), [0, 1, 2]);
        // A network that has come to numbers that are none is refused elsewhere.
        assert_eq!(kept([0, 1, 2, 3, 4, 5], [f32::NAN; 6]).len(), 3);
    }

    /// A row of five nodes, x = 0 to 4, of which the ends and the middle have the largest scores; and a node apart.
    #[test]
    fn a_row_of_nodes() {
        let (senders, receivers) = ([1, 0, 2, 1, 3, 2, 4, 3], [0, 1, 1, 2, 2, 3, 3, 4]);
        let scores = [3.0, 0.0, 1.0, -1.0, 2.0, -9.0];
        let Pooled { kept, graph, edges } =
            Pooled::new((&senders, &receivers), &parts([0, 0, 0, 0, 0, 1]), &scores);
        assert_eq!(kept, [0, 2, 4, 5]);
        assert_eq!((&graph.row[..], &graph.senders[..]), (&[0, 1, 3, 4, 4][..], &[1, 0, 2, 1][..]));
        assert_eq!((graph.n_owned, &graph.receivers[..]), (4, &[0, 1, 1, 2][..]));
        // x_s - x_r of the edges: 2 over 2 from the middle to the first, the other way round -1.
        let vectors: Vec<f32> = senders.iter().zip(&receivers).map(|(s, r)| (s - r) as f32).collect();
        let mut coarse = [0.0; 4];
        edges.add(0..4, 1, &vectors, &mut coarse);
        assert_eq!(coarse, [1.0, -1.0, 1.0, -1.0]);
        // Neighbours that are both kept: an edge and none, or none and an edge.
        let pair = Pooled::new((&senders, &receivers), &parts([0; 6]), &[3.0, 2.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(
            (&pair.graph.senders[..], &pair.edges.weight[..2]),
            (&[1, 2, 0, 2, 0, 1][..], &[0.25, 0.25][..])
        );
    }
}
