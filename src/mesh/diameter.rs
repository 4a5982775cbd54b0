//! The diameter of a graph: how many hops its farthest nodes are apart.

/// Hops between the nodes that are farthest apart, of `n` nodes and these edges, each in one direction or both. Found by breadth-first
/// searches, each from the farthest node of the one before, until none is farther: exact for trees, and rarely less than exact for
/// meshes, never more. Of a graph in several pieces that of the piece with node 0.
pub fn diameter(n: usize, edges: &[[i32; 2]]) -> usize {
    let mut row = vec![0usize; n + 1];
    for &[a, b] in edges {
        row[a as usize + 1] += 1;
        row[b as usize + 1] += 1;
    }
    for i in 0..n {
        row[i + 1] += row[i];
    }
    let (mut next, mut column) = (row.clone(), vec![0usize; 2 * edges.len()]);
    for &[a, b] in edges {
        for (from, to) in [(a as usize, b as usize), (b as usize, a as usize)] {
            column[next[from]] = to;
            next[from] += 1;
        }
    }
    let (mut start, mut found) = (0, 0);
    let mut hops = vec![usize::MAX; n];
    while start < n {
        hops.fill(usize::MAX);
        hops[start] = 0;
        let mut queue = Vec::from([start]);
        let mut at = 0;
        while at < queue.len() {
            let node = queue[at];
            at += 1;
            for &to in &column[row[node]..row[node + 1]] {
                if hops[to] == usize::MAX {
                    hops[to] = hops[node] + 1;
                    queue.push(to);
                }
            }
        }
        let last = queue[queue.len() - 1];
        if start != 0 && hops[last] <= found {
            break;
        }
        (start, found) = (last, hops[last]);
        if found == 0 {
            break;
        }
    }
    found
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
