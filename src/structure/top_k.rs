//! The next coarser graph of a graph U-net (Gao and Ji 2019): of the nodes of the largest scores, joined where they are within two edges
//! of each other.
//!
//! The scores are learned, so that the graph changes with the state: backends make it anew in each step. A way from one node to another is
//! an edge and an edge, or an edge and none, in either order: the second power of the adjacency with its diagonal, as in PyTorch Geometric.

use super::graph::Graph;
use super::levels::Transfer;
use m4gn_parallel::{Comm, Halo};
use std::collections::BTreeMap;

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
    /// Half of the nodes, rounded up, of each part: of the whole graph, or of each of several that stand side by side. `part[i]` is that of
    /// node i, `scores[i]` its score; of equal ones the node with the lower number is kept.
    pub fn new((senders, receivers): (&[i32], &[i32]), part: &[u32], scores: &[f32]) -> Self {
        let n = scores.len();
        let mut near: Vec<Vec<(usize, Option<i32>)>> = (0..n).map(|i| vec![(i, None)]).collect();
        for (edge, (&s, &r)) in (0..).zip(senders.iter().zip(receivers)) {
            near[r as usize].push((s as usize, Some(edge)));
        }
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| part[a].cmp(&part[b]).then(scores[b].total_cmp(&scores[a])).then(a.cmp(&b)));
        let halves = order.chunk_by(|&a, &b| part[a] == part[b]).flat_map(|p| &p[..p.len().div_ceil(2)]);
        let mut kept: Vec<u32> = halves.map(|&i| i as u32).collect();
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
            n_cells: 0,
            n_owned: count,
            n_local: count,
            node_types: vec![0; count],
            row,
            senders,
            receivers,
            edge_features: Vec::new(),
            halo: Halo::new(&Comm::serial(), &[], &[], count).unwrap_or_default(),
        };
        Pooled { kept, graph, edges: Transfer::new(terms.into_iter()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of five nodes, x = 0 to 4, of which the ends and the middle have the largest scores; and a node apart.
    #[test]
    fn a_row_of_nodes() {
        let (senders, receivers) = ([1, 0, 2, 1, 3, 2, 4, 3], [0, 1, 1, 2, 2, 3, 3, 4]);
        let scores = [3.0, 0.0, 1.0, -1.0, 2.0, -9.0];
        let Pooled { kept, graph, edges } = Pooled::new((&senders, &receivers), &[0, 0, 0, 0, 0, 1], &scores);
        assert_eq!(kept, [0, 2, 4, 5]);
        assert_eq!((&graph.row[..], &graph.senders[..]), (&[0, 1, 3, 4, 4][..], &[1, 0, 2, 1][..]));
        assert_eq!((graph.n_owned, &graph.receivers[..]), (4, &[0, 1, 1, 2][..]));
        // x_s - x_r of the edges: 2 over 2 from the middle to the first, the other way round -1.
        let vectors: Vec<f32> = senders.iter().zip(&receivers).map(|(s, r)| (s - r) as f32).collect();
        let mut coarse = [0.0; 4];
        edges.add(0..4, 1, &vectors, &mut coarse);
        assert_eq!(coarse, [1.0, -1.0, 1.0, -1.0]);
        // Neighbours that are both kept: an edge and none, or none and an edge.
        let pair = Pooled::new((&senders, &receivers), &[0; 6], &[3.0, 2.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(
            (&pair.graph.senders[..], &pair.edges.weight[..2]),
            (&[1, 2, 0, 2, 0, 1][..], &[0.25, 0.25][..])
        );
    }
}
