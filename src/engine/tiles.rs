//! How a pass over nodes and their edges is cut into tiles that stay in cache.

use super::kernels::{Bf16, Buffer, Number, padded};
use super::order::Order;
use super::profile::Clock;
use std::ops::Range;

/// Consecutive nodes, as many as suit a kind of number, with all their incoming edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Owned nodes.
    pub nodes: Range<usize>,
    /// Edges that they receive.
    pub edges: Range<usize>,
}

impl Tile {
    /// The edges, so many at a time as suits this kind of number.
    pub fn chunks<T: Number>(&self) -> impl Iterator<Item = Range<usize>> + use<T> {
        let end = self.edges.end;
        self.edges.clone().step_by(T::ROWS).map(move |start| start..(start + T::ROWS).min(end))
    }
}

/// Cuts the nodes whose edges are `row[i]..row[i + 1]`; no tile crosses `border`.
pub fn cut<T: Number>(row: &[u32], border: usize) -> Vec<Tile> {
    let n = row.len() - 1;
    let mut tiles = Vec::new();
    for part in [0..border.min(n), border.min(n)..n] {
        for start in part.clone().step_by(T::ROWS) {
            let end = (start + T::ROWS).min(part.end);
            tiles.push(Tile { nodes: start..end, edges: row[start] as usize..row[end] as usize });
        }
    }
    tiles
}

/// Tiles of the rows 0 to n, for work on one row at a time.
pub fn blocks<T: Number>(n: usize) -> impl ExactSizeIterator<Item = Range<usize>> {
    (0..n.div_ceil(T::ROWS)).map(move |i| block::<T>(i, n))
}

/// Rows of block i of n.
pub fn block<T: Number>(i: usize, n: usize) -> Range<usize> {
    i * T::ROWS..((i + 1) * T::ROWS).min(n)
}

/// Where rows of so many columns stand.
pub fn numbers(rows: &Range<usize>, columns: usize) -> Range<usize> {
    rows.start * columns..rows.end * columns
}

/// From the row of a tile's node to that of the sum over its world edges, where that is another.
pub const WORLD: usize = Bf16::ROWS;

/// The sum that each edge of a graph adds to, as [`Order::receivers`] of it and [`WORLD`] more of world edges, of which the last of
/// the physical `features` says that they are some.
pub fn sums_of_kinds(order: &Order, features: &[f32], out: &mut Vec<i32>) {
    let k = features.len() / order.edge.len().max(1);
    let is_world = |&e: &u32| features[(e as usize + 1) * k - 1] > 0.5;
    out.clear();
    let pairs = order.receivers.iter().zip(&order.edge);
    out.extend(pairs.map(|(r, e)| r + if is_world(e) { WORLD as i32 } else { 0 }));
}

/// Edges cut into runs of one kind, the second of which is that of world edges, by their receivers and sums.
pub fn runs<'a>(
    edges: Range<usize>,
    receivers: &'a [i32],
    sums: &'a [i32],
) -> impl Iterator<Item = (Range<usize>, usize)> + 'a {
    let kind = |e: usize| usize::from(sums[e] != receivers[e]);
    let Range { mut start, end } = edges;
    std::iter::from_fn(move || {
        (start < end).then(|| {
            let own = kind(start);
            let run = start..(start..end).find(|&e| kind(e) != own).unwrap_or(end);
            start = run.end;
            (run, own)
        })
    })
}

/// One thread's buffers. Rows of `columns`, the padded width, unless said otherwise.
pub struct Scratch<T> {
    /// What goes into a node network: latents and sums, rows of as many widths.
    pub x: Buffer<T>,
    /// Activations.
    pub a: Buffer<T>,
    /// Activations.
    pub b: Buffer<T>,
    /// The last layer's output.
    pub c: Buffer<f32>,
    /// The receivers' part of the edge network, a row a node of the tile.
    pub receivers: Buffer<f32>,
    /// Sums over a node's edges, those of world edges from row [`WORLD`] on.
    pub sums: Buffer<f32>,
    /// Raw features, and outputs, as wide as these are.
    pub raw: Buffer<f32>,
    /// This thread's.
    pub clock: Clock,
}

impl<T: Number> Scratch<T> {
    /// For latents of width `d`, so many sums of edges and up to `raw` features or outputs.
    pub fn new(d: usize, kinds: usize, raw: usize, profile: bool) -> Self {
        let columns = padded(d);
        let rows = T::ROWS;
        Scratch {
            x: Buffer::new(rows * (1 + kinds) * columns),
            a: Buffer::new(rows * columns),
            b: Buffer::new(rows * columns),
            c: Buffer::new(rows * columns),
            receivers: Buffer::new(rows * columns),
            sums: Buffer::new((rows + (kinds - 1) * WORLD) * columns),
            raw: Buffer::new(rows * padded(raw)),
            clock: Clock::new(profile),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_everything_once() {
        cover::<f32>();
        cover::<Bf16>();
    }

    fn cover<T: Number>() {
        // 1000 nodes with 0 to 6 edges, and one with many.
        let mut row = vec![0u32];
        for i in 0..1000u32 {
            row.push(row[i as usize] + if i == 500 { 3000 } else { i % 7 });
        }
        for border in [0, 77, 1000] {
            let tiles = cut::<T>(&row, border);
            let (mut node, mut edge) = (0, 0);
            for tile in &tiles {
                assert_eq!(tile.nodes.start, node);
                assert!(tile.nodes.end <= border || tile.nodes.start >= border);
                assert_eq!(tile.edges, row[node] as usize..row[tile.nodes.end] as usize);
                for chunk in tile.chunks::<T>() {
                    assert_eq!(chunk.start, edge);
                    assert!(chunk.len() <= T::ROWS && !chunk.is_empty());
                    edge = chunk.end;
                }
                node = tile.nodes.end;
            }
            assert_eq!((node, edge), (1000, row[1000] as usize));
        }
        assert!(cut::<T>(&[0], 0).is_empty());
        assert_eq!(blocks::<T>(100).map(|b| b.len()).sum::<usize>(), 100);
    }
}
