//! How a pass over nodes and their edges is cut into tiles that stay in cache.

use super::kernels::{Buffer, Number, padded};
use super::profile::Clock;
use std::ops::Range;

/// Nodes of a tile: a whole number of the products' tiles of six rows.
const NODES: usize = 48;

/// Edges that go through the edge network at a time. With width 128 in bf16 the two activations and a panel of a
/// weight fit into a first-level cache of 48 KiB.
pub const EDGES: usize = 48;

/// Consecutive nodes with all their incoming edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Owned nodes.
    pub nodes: Range<usize>,
    /// Edges that they receive.
    pub edges: Range<usize>,
}

impl Tile {
    /// The edges, [`EDGES`] at a time.
    pub fn chunks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let end = self.edges.end;
        self.edges
            .clone()
            .step_by(EDGES)
            .map(move |start| start..(start + EDGES).min(end))
    }
}

/// Cuts the nodes whose edges are `row[i]..row[i + 1]`; no tile crosses `border`.
pub fn cut(row: &[u32], border: usize) -> Vec<Tile> {
    let n = row.len() - 1;
    let mut tiles = Vec::new();
    for part in [0..border.min(n), border.min(n)..n] {
        for start in part.clone().step_by(NODES) {
            let end = (start + NODES).min(part.end);
            tiles.push(Tile {
                nodes: start..end,
                edges: row[start] as usize..row[end] as usize,
            });
        }
    }
    tiles
}

/// Tiles of the rows 0 to n, for work on one row at a time.
pub fn blocks(n: usize) -> impl ExactSizeIterator<Item = Range<usize>> {
    (0..n.div_ceil(NODES)).map(move |i| block(i, n))
}

/// Rows of block i of n.
pub fn block(i: usize, n: usize) -> Range<usize> {
    i * NODES..((i + 1) * NODES).min(n)
}

/// One thread's buffers. Rows of `columns`, the padded width, unless said otherwise.
#[derive(Debug)]
pub struct Scratch<T> {
    /// What goes into a node network: latents and sums, rows of two widths.
    pub x: Buffer<T>,
    /// Activations.
    pub a: Buffer<T>,
    /// Activations.
    pub b: Buffer<T>,
    /// The last layer's output.
    pub c: Buffer<f32>,
    /// The receivers' part of the edge network, a row a node of the tile.
    pub receivers: Buffer<f32>,
    /// Sums over a node's edges.
    pub sums: Buffer<f32>,
    /// Raw features, and outputs, as wide as these are.
    pub raw: Buffer<f32>,
    /// This thread's.
    pub clock: Clock,
}

impl<T: Number> Scratch<T> {
    /// For latents of width `d` and up to `raw` features or outputs.
    pub fn new(d: usize, raw: usize, profile: bool) -> Self {
        let columns = padded(d);
        let rows = NODES.max(EDGES);
        Scratch {
            x: Buffer::new(rows * 2 * columns),
            a: Buffer::new(rows * columns),
            b: Buffer::new(rows * columns),
            c: Buffer::new(rows * columns),
            receivers: Buffer::new(NODES * columns),
            sums: Buffer::new(NODES * columns),
            raw: Buffer::new(rows * padded(raw)),
            clock: Clock::new(profile),
        }
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        [&self.x, &self.a, &self.b]
            .map(|x| x.bytes())
            .iter()
            .sum::<usize>()
            + [&self.c, &self.receivers, &self.sums, &self.raw]
                .map(|x| x.bytes())
                .iter()
                .sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_everything_once() {
        // 1000 nodes with 0 to 6 edges, and one with many.
        let mut row = vec![0u32];
        for i in 0..1000u32 {
            row.push(row[i as usize] + if i == 500 { 3000 } else { i % 7 });
        }
        for border in [0, 77, 1000] {
            let tiles = cut(&row, border);
            let (mut node, mut edge) = (0, 0);
            for tile in &tiles {
                assert_eq!(tile.nodes.start, node);
                assert!(tile.nodes.end <= border || tile.nodes.start >= border);
                assert_eq!(tile.edges, row[node] as usize..row[tile.nodes.end] as usize);
                for chunk in tile.chunks() {
                    assert_eq!(chunk.start, edge);
                    assert!(chunk.len() <= EDGES && !chunk.is_empty());
                    edge = chunk.end;
                }
                node = tile.nodes.end;
            }
            assert_eq!((node, edge), (1000, row[1000] as usize));
        }
        assert!(cut(&[0], 0).is_empty());
        assert_eq!(blocks(100).map(|b| b.len()).sum::<usize>(), 100);
    }
}
