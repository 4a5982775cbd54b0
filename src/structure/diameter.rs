//! The diameter of a graph: how many hops its farthest nodes are apart.

use super::cell_graph::CellGraph;

/// Hops between the nodes that are farthest apart, of `n` nodes and these edges, each in one direction or both. Found by breadth-first
/// searches, each from the farthest node of the one before, until none is farther: exact for trees, and rarely less than exact for
/// meshes, never more. Of a graph in several pieces that of the piece with node 0.
pub fn diameter(n: usize, edges: &[[i32; 2]]) -> usize {
    if n == 0 {
        return 0;
    }
    let graph = CellGraph::new(n, edges);
    let (mut start, mut found) = (0, 0);
    loop {
        let order = graph.breadth_first(start, |_| true);
        let mut hops = vec![usize::MAX; n];
        hops[start] = 0;
        for &node in &order[1..] {
            let nearest = graph.neighbours(node).iter().map(|&j| hops[j as usize]).min();
            hops[node] = nearest.map_or(0, |h| h.saturating_add(1));
        }
        let last = order[order.len() - 1];
        if hops[last] <= found {
            return found;
        }
        (start, found) = (last, hops[last]);
    }
}

#[cfg(test)]
mod tests {
    use super::diameter;

    #[test]
    fn of_a_path_a_star_a_ring_and_nothing() {
        // From the middle of a path the first search finds half of it.
        assert_eq!(diameter(5, &[[2, 0], [0, 1], [2, 3], [3, 4]]), 4);
        assert_eq!(diameter(4, &[[0, 1], [0, 2], [3, 0], [0, 3]]), 2);
        assert_eq!(diameter(6, &[[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0]]), 3);
        assert_eq!((diameter(0, &[]), diameter(1, &[]), diameter(3, &[[1, 2]])), (0, 0, 0));
    }

    #[test]
    fn of_a_grid() {
        let (nx, ny) = (7, 4);
        let at = |x: i32, y: i32| y * nx + x;
        let mut edges = Vec::new();
        for y in 0..ny {
            for x in 0..nx {
                edges.extend((x + 1 < nx).then(|| [at(x, y), at(x + 1, y)]));
                edges.extend((y + 1 < ny).then(|| [at(x, y), at(x, y + 1)]));
            }
        }
        assert_eq!(diameter(28, &edges), 9);
    }
}
