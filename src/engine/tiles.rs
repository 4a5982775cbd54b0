//! How a pass over nodes and their edges is cut: tiles that stay in cache, and one run of tiles for each thread.

use std::ops::Range;

/// Rows that a tile aims at: with width 64 its two activations take 64 KiB, well inside the second-level cache.
const ROWS: usize = 128;

/// Consecutive nodes with all their incoming edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Owned nodes.
    pub nodes: Range<usize>,
    /// Edges that they receive.
    pub edges: Range<usize>,
}

/// One thread's tiles and its buffers.
#[derive(Debug)]
pub struct Part {
    /// Consecutive tiles.
    pub tiles: Vec<Tile>,
    /// Nodes of all of them.
    pub nodes: Range<usize>,
    /// Edges of all of them.
    pub edges: Range<usize>,
    /// Activations: as many rows as the largest tile has, `width` wide.
    pub a: Vec<f32>,
    /// As `a`.
    pub b: Vec<f32>,
    /// Something per node of a tile.
    pub c: Vec<f32>,
}

/// Cuts the nodes whose edges are `row[i]..row[i + 1]` into tiles and deals these out to `n_threads` parts with
/// about equally many edges each; buffers are `width` wide.
pub fn cut(row: &[u32], n_threads: usize, width: usize) -> Vec<Part> {
    let n = row.len() - 1;
    let mut tiles: Vec<Tile> = Vec::new();
    let mut start = 0;
    while start < n {
        let mut end = start + 1;
        while end < n && end - start < ROWS && (row[end + 1] - row[start]) as usize <= ROWS {
            end += 1;
        }
        tiles.push(Tile {
            nodes: start..end,
            edges: row[start] as usize..row[end] as usize,
        });
        start = end;
    }
    let rows = tiles
        .iter()
        .map(|t| t.nodes.len().max(t.edges.len()))
        .max()
        .unwrap_or(0);
    let node_rows = tiles.iter().map(|t| t.nodes.len()).max().unwrap_or(0);
    let work = |t: &Tile| t.nodes.len() + t.edges.len();
    let total: usize = tiles.iter().map(work).sum();
    let mut parts = Vec::new();
    let mut rest = tiles.into_iter().peekable();
    let (mut done, mut nodes, mut edges) = (0, 0, 0);
    for p in 1..=n_threads.max(1) {
        let mut mine = Vec::new();
        while let Some(tile) = rest.next_if(|_| done < total * p / n_threads.max(1)) {
            done += work(&tile);
            mine.push(tile);
        }
        let end = mine.last().map_or((nodes, edges), |t| (t.nodes.end, t.edges.end));
        parts.push(Part {
            tiles: mine,
            nodes: nodes..end.0,
            edges: edges..end.1,
            a: vec![0.0; rows * width],
            b: vec![0.0; rows * width],
            c: vec![0.0; node_rows * width],
        });
        (nodes, edges) = end;
    }
    parts
}

/// Runs `work(part, its rows of x, its rows of y)` for every part, the first on this thread and the others on their
/// own. `x` has `x_width` values a node, `y` has `y_width` values an edge.
pub fn each_part(
    parts: &mut [Part],
    x: &mut [f32],
    x_width: usize,
    y: &mut [f32],
    y_width: usize,
    work: impl Fn(&mut Part, &mut [f32], &mut [f32]) + Sync,
) {
    if let [part] = parts {
        return work(part, x, y);
    }
    std::thread::scope(|scope| {
        let work = &work;
        let (mut x, mut y) = (x, y);
        let mut own = None;
        for part in parts {
            let x_part = x.split_off_mut(..part.nodes.len() * x_width).unwrap_or_default();
            let y_part = y.split_off_mut(..part.edges.len() * y_width).unwrap_or_default();
            match own {
                None => own = Some((part, x_part, y_part)),
                Some(_) => drop(scope.spawn(move || work(part, x_part, y_part))),
            }
        }
        if let Some((part, x_part, y_part)) = own {
            work(part, x_part, y_part);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_everything_once() {
        // 1000 nodes with 0 to 6 edges, and one with more than a tile holds.
        let mut row = vec![0u32];
        for i in 0..1000u32 {
            row.push(row[i as usize] + if i == 500 { 3000 } else { i % 7 });
        }
        for n_threads in [1, 2, 3, 7] {
            let mut parts = cut(&row, n_threads, 2);
            assert_eq!(parts.len(), n_threads);
            let mut next = 0;
            for part in &parts {
                assert_eq!(part.nodes.start, next);
                for tile in &part.tiles {
                    assert_eq!(tile.nodes.start, next);
                    assert_eq!(tile.edges, row[next] as usize..row[tile.nodes.end] as usize);
                    assert!(part.a.len() >= 2 * tile.nodes.len().max(tile.edges.len()));
                    next = tile.nodes.end;
                }
                assert_eq!(part.nodes.end, next);
            }
            assert_eq!(next, 1000);
            let (mut x, mut y) = (vec![0f32; 2000], vec![0f32; row[1000] as usize]);
            each_part(&mut parts, &mut x, 2, &mut y, 1, |part, x, y| {
                assert_eq!((x.len(), y.len()), (2 * part.nodes.len(), part.edges.len()));
                x.iter_mut().chain(y).for_each(|v| *v += 1.0);
            });
            assert!(x.iter().chain(&y).all(|&v| v == 1.0));
        }
        assert!(cut(&[0], 2, 4).iter().all(|p| p.tiles.is_empty()));
    }
}
