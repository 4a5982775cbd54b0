//! Coarser graphs by bi-stride pooling (BSMS-GNN: Cao et al. 2023, section 3 and algorithm 1).
//!
//! A breadth-first search from the node nearest to the centre of each connected piece divides its nodes by the parity of their distance,
//! and the smaller half is the next graph's. Its edges join nodes that had an edge or a common neighbour (A squared), so that nothing falls
//! apart. A node passes an equal part of its weight to each neighbour; the latents of a kept node are the mean of its neighbours' by
//! these parts, the way back is the transpose, and the place of a kept node, which the features of edges are made of, is the same mean of
//! places. Places are sums of edges' vectors, so that they go through a cyclic.
//!
//! Every rank makes the levels of the undecomposed graph and takes its part: they do not depend on the number of ranks.

use super::graph::Graph;
use super::place::line;
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_mesh::vector::{Vector, dot, norm, sub};
use m4gn_parallel::{Comm, Halo, everywhere};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Range;

/// Weighted sums of rows: row i is the sum of `weight[k]` times row `from[k]` over `row[i]..row[i + 1]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Transfer {
    /// Terms of row i: `row[i]..row[i + 1]`.
    pub row: Vec<u32>,
    /// What is summed.
    pub from: Vec<i32>,
    /// Its factor.
    pub weight: Vec<f32>,
}

impl Transfer {
    /// Of the terms of each row.
    pub(super) fn new(rows: impl Iterator<Item = Vec<(i32, f64)>>) -> Self {
        let mut transfer = Transfer { row: vec![0], from: Vec::new(), weight: Vec::new() };
        for row in rows {
            transfer.from.extend(row.iter().map(|(from, _)| from));
            transfer.weight.extend(row.iter().map(|(_, weight)| *weight as f32));
            transfer.row.push(transfer.from.len() as u32);
        }
        transfer
    }

    /// The same with row `rows[i]` as row i, and what was row j of the sums' terms at `place[j]`; terms beyond stay.
    pub fn placed(&self, rows: &[u32], place: &[u32]) -> Self {
        let term = |k: usize| {
            let from = place.get(self.from[k] as usize).map_or(self.from[k], |&p| p as i32);
            (from, f64::from(self.weight[k]))
        };
        Self::new(rows.iter().map(|&i| self.terms(i as usize).map(term).collect()))
    }

    /// The transpose, of `rows` rows.
    pub fn transposed(&self, rows: usize) -> Self {
        let mut list = vec![Vec::new(); rows];
        for row in 0..self.row.len() - 1 {
            self.terms(row)
                .for_each(|k| list[self.from[k] as usize].push((row as i32, f64::from(self.weight[k]))));
        }
        Self::new(list.into_iter())
    }

    /// The terms of a row.
    pub fn terms(&self, row: usize) -> Range<usize> {
        self.row[row] as usize..self.row[row + 1] as usize
    }

    /// The sums `rows` of rows `x` of `columns` numbers, added to `out`.
    pub fn add(&self, rows: Range<usize>, columns: usize, x: &[f32], out: &mut [f32]) {
        for (row, out) in rows.zip(out.chunks_exact_mut(columns)) {
            for k in self.terms(row) {
                let (x, weight) = (&x[self.from[k] as usize * columns..][..columns], self.weight[k]);
                out.iter_mut().zip(x).for_each(|(out, x)| *out += weight * x);
            }
        }
    }
}

/// This rank's part of a coarser graph, and the way between it and the next finer one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Level {
    /// Its nodes, none of them a cell, with those of other ranks that an edge or the way up needs. Features are those of the finest graph's
    /// edges, over 2 to the number of the level: as large as those.
    pub graph: Graph,
    /// Owned rows from local rows of the finer graph.
    pub down: Transfer,
    /// Owned rows of the finer graph from local rows: the transpose.
    pub up: Transfer,
}

/// `n_levels` coarser graphs of `graph`, whose edges have a vector and its length, the finest first. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::Input`] for more nodes than can be numbered.
pub fn bi_stride(mesh: &Mesh, graph: &mut Graph, n_levels: usize, comm: &Comm) -> Result<Vec<Level>> {
    if n_levels == 0 {
        return Ok(Vec::new());
    }
    let mut total = [mesh.n_cells() as i64, graph.n_owned as i64];
    comm.sum_i64(&mut total);
    if total[1] > i64::from(i32::MAX) {
        return Err(Error::Input(format!("{} nodes: coarser graphs have at most {}", total[1], i32::MAX)));
    }
    let mut number = mesh.cell_global.clone();
    number.extend(mesh.boundary.iter().map(|b| total[0] + b.global));
    number.resize(graph.n_local, 0);
    graph.halo.exchange_i64(comm, &mut number, 1);
    let mut nodes: Vec<usize> = number.iter().map(|&n| n as usize).collect();
    let (mut whole, mut n_owned) = (Whole::gather(mesh, graph, &number, comm), graph.n_owned);
    let mut levels = Vec::with_capacity(n_levels);
    for l in 1..=n_levels {
        let pooled = whole.pool();
        let level = pooled.part(&nodes, n_owned, (mesh.dim(), 0.5f64.powi(l as i32)), comm)?;
        (whole, nodes, n_owned) = (pooled.coarse, level.1, level.0.graph.n_owned);
        levels.push(level.0);
    }
    Ok(levels)
}

/// An undecomposed graph.
struct Whole {
    /// The senders of a node, and their vectors from it.
    near: Vec<Vec<(usize, Vector)>>,
    /// Where the nodes are, and their numbers in the order of places, by which the search begins.
    place: Vec<(Vector, i64)>,
    /// What a node weighs as a part of a mean.
    weight: Vec<f64>,
    rank: Vec<i32>,
}

/// A coarser graph, and what of the finer one its nodes are.
struct Pooled {
    coarse: Whole,
    /// Nodes of the finer graph with their parts in the mean of each node.
    down: Vec<Vec<(usize, f64)>>,
    /// The transpose.
    up: Vec<Vec<(usize, f64)>>,
    /// Number of each node of the finer graph that is kept.
    number: Vec<Option<usize>>,
}

impl Whole {
    /// Of all ranks' parts, on all ranks; `number` numbers the local nodes. Collective.
    fn gather(mesh: &Mesh, graph: &Graph, number: &[i64], comm: &Comm) -> Self {
        let dim = mesh.dim();
        let ends = graph.senders.iter().zip(&graph.receivers);
        let ends: Vec<i64> = ends.flat_map(|(&s, &r)| [number[s as usize], number[r as usize]]).collect();
        let ends = everywhere(comm, &ends);
        let features = everywhere(comm, &graph.edge_features);
        let own: Vec<i64> =
            number[..graph.n_owned].iter().flat_map(|&n| [n, i64::from(comm.rank())]).collect();
        let own = everywhere(comm, &own);
        let places = mesh.cell_centres.iter().copied().chain(mesh.boundary.iter().map(|b| b.centre));
        let places = everywhere(comm, &places.flatten().collect::<Vec<f64>>());
        let n = own.len() / 2;
        let mut whole =
            Whole { near: vec![Vec::new(); n], place: Vec::new(), weight: vec![1.0; n], rank: vec![0; n] };
        let mut centre = vec![[0.0; 3]; n];
        for ([node, rank], place) in own.as_chunks::<2>().0.iter().zip(places.as_chunks::<3>().0) {
            centre[*node as usize] = *place;
            whole.rank[*node as usize] = *rank as i32;
        }
        for ([s, r], row) in ends.as_chunks::<2>().0.iter().zip(features.chunks_exact(dim + 1)) {
            let vector = std::array::from_fn(|i| if i < dim { f64::from(row[i]) } else { 0.0 });
            whole.near[*r as usize].push((*s as usize, vector));
        }
        let number = line(&centre, &(0..n as i64).collect::<Vec<_>>());
        whole.place = centre.into_iter().zip(number).collect();
        whole.near.iter_mut().for_each(|row| row.sort_by(|a, b| a.0.cmp(&b.0).then(order(a.1, b.1))));
        whole
    }

    /// The nodes that can be reached from `start`, whose distances are written where none is.
    fn search(&self, start: usize, distance: &mut [Option<u32>]) -> Vec<usize> {
        distance[start] = Some(0);
        let mut reached = vec![start];
        let mut at = 0;
        while let Some(&i) = reached.get(at) {
            at += 1;
            for &(j, _) in &self.near[i] {
                if distance[j].is_none() {
                    distance[j] = distance[i].map(|d| d + 1);
                    reached.push(j);
                }
            }
        }
        reached
    }

    /// The node of a piece next to its centre, among equals to rounding the first by its place.
    fn seed(&self, piece: &[usize]) -> usize {
        let mean: Vector = std::array::from_fn(|i| {
            piece.iter().map(|&n| self.place[n].0[i]).sum::<f64>() / piece.len() as f64
        });
        let distance = |n: usize| norm(sub(self.place[n].0, mean));
        let far = || piece.iter().map(|&n| distance(n));
        let (least, most) = (far().fold(f64::INFINITY, f64::min), far().fold(0.0, f64::max));
        let near = piece.iter().copied().filter(|&n| distance(n) <= least + 1e-9 * most);
        near.min_by_key(|&n| self.place[n].1).unwrap_or(piece[0])
    }

    /// Which nodes the next graph has.
    fn selected(&self) -> Vec<bool> {
        let n = self.near.len();
        let (mut seen, mut distance, mut kept) = (vec![None; n], vec![None; n], vec![false; n]);
        for start in 0..n {
            if seen[start].is_some() {
                continue;
            }
            let piece = self.search(start, &mut seen);
            self.search(self.seed(&piece), &mut distance);
            let is_even = |i: usize| distance[i].is_some_and(|d| d % 2 == 0);
            let even = piece.iter().filter(|&&i| is_even(i)).count();
            let keep_even = 2 * even <= piece.len() || even == piece.len();
            piece.iter().for_each(|&i| kept[i] = is_even(i) == keep_even);
        }
        kept
    }

    /// The next coarser graph.
    fn pool(&self) -> Pooled {
        let kept = self.selected();
        let old: Vec<usize> = (0..kept.len()).filter(|&i| kept[i]).collect();
        let mut number = vec![None; kept.len()];
        old.iter().enumerate().for_each(|(new, &i)| number[i] = Some(new));
        let part = |i: usize| self.weight[i] / self.near[i].len() as f64;
        let (mut down, mut weight, mut shift) = (Vec::new(), Vec::new(), Vec::new());
        for &i in &old {
            let near = &self.near[i];
            let sum: f64 = near.iter().map(|n| part(n.0)).sum();
            let mut moved = [0.0; 3];
            for &(j, vector) in near {
                (0..3).for_each(|c| moved[c] += part(j) / sum * vector[c]);
            }
            // A node without neighbours keeps what it has.
            down.push(match near.is_empty() {
                true => vec![(i, 1.0)],
                false => near.iter().map(|n| (n.0, part(n.0) / sum)).collect(),
            });
            weight.push(if near.is_empty() { self.weight[i] } else { sum });
            shift.push(moved);
        }
        let mut up = vec![Vec::new(); kept.len()];
        for (new, row) in down.iter().enumerate() {
            row.iter().for_each(|&(i, part): &(usize, f64)| up[i].push((new, part)));
        }
        let near = old.iter().enumerate().map(|(new, &i)| {
            // The shortest way to each, where several lead there: through a cyclic.
            let mut ways: BTreeMap<usize, Vector> = BTreeMap::new();
            let mut add = |j: usize, way: Vector| {
                if let Some(j) = number[j].filter(|&j| j != new) {
                    let known = ways.entry(j).or_insert(way);
                    if dot(way, way).total_cmp(&dot(*known, *known)).then(order(way, *known)).is_lt() {
                        *known = way;
                    }
                }
            };
            for &(m, first) in &self.near[i] {
                add(m, first);
                self.near[m].iter().for_each(|&(j, then)| add(j, sum(first, then)));
            }
            let moved = |(j, way): (usize, Vector)| (j, sub(sum(way, shift[j]), shift[new]));
            ways.into_iter().map(moved).collect()
        });
        let coarse = Whole {
            near: near.collect(),
            place: old.iter().map(|&i| self.place[i]).collect(),
            rank: old.iter().map(|&i| self.rank[i]).collect(),
            weight,
        };
        Pooled { coarse, down, up, number }
    }
}

impl Pooled {
    /// This rank's part, and the number of each of its local nodes: `nodes` has those of the finer graph, of which `n_owned` are owned.
    /// Collective.
    fn part(
        &self,
        nodes: &[usize],
        n_owned: usize,
        (dim, scale): (usize, f64),
        comm: &Comm,
    ) -> Result<(Level, Vec<usize>)> {
        let coarse = &self.coarse;
        let owned: Vec<usize> = nodes[..n_owned].iter().filter_map(|&i| self.number[i]).collect();
        let of_edges = owned.iter().flat_map(|&r| coarse.near[r].iter().map(|n| n.0));
        let of_way = nodes[..n_owned].iter().flat_map(|&i| self.up[i].iter().map(|n| n.0));
        let others = of_edges.chain(of_way).map(|i| (coarse.rank[i], i as i64));
        let ghosts: BTreeSet<(i32, i64)> = others.filter(|g| g.0 != comm.rank()).collect();
        let ghosts: Vec<(i32, i64)> = ghosts.into_iter().collect();
        let own: Vec<i64> = owned.iter().map(|&i| i as i64).collect();
        let halo = Halo::new(comm, &own, &ghosts, owned.len())?;
        let local: Vec<usize> = owned.iter().copied().chain(ghosts.iter().map(|g| g.1 as usize)).collect();
        let place = |list: &[usize]| -> HashMap<usize, i32> { list.iter().copied().zip(0..).collect() };
        let (fine, here) = (place(nodes), place(&local));
        let mut graph = Graph {
            n_owned: owned.len(),
            n_local: local.len(),
            node_types: vec![0; local.len()],
            row: vec![0],
            halo,
            ..Graph::default()
        };
        for (r, &i) in owned.iter().enumerate() {
            for (s, vector) in &coarse.near[i] {
                graph.senders.push(here[s]);
                graph.receivers.push(r as i32);
                graph.edge_features.extend(vector[..dim].iter().map(|x| (scale * x) as f32));
                graph.edge_features.push((scale * norm(*vector)) as f32);
            }
            graph.row.push(graph.senders.len() as u32);
        }
        let rows = |list: &[Vec<(usize, f64)>], rows: &[usize], place: &HashMap<usize, i32>| {
            let row = |i: &usize| list[*i].iter().map(|(j, part)| (place[j], *part)).collect();
            Transfer::new(rows.iter().map(row))
        };
        let down = rows(&self.down, &owned, &fine);
        let up = rows(&self.up, &nodes[..n_owned], &here);
        Ok((Level { graph, down, up }, local))
    }
}

fn sum(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn order(a: Vector, b: Vector) -> std::cmp::Ordering {
    let by = |i: usize| a[i].total_cmp(&b[i]);
    by(0).then(by(1)).then(by(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    fn levels(mesh: &Mesh, n: usize) -> Vec<Level> {
        let mut graph = Graph::new(mesh, &Comm::serial()).unwrap();
        bi_stride(mesh, &mut graph, n, &Comm::serial()).unwrap()
    }

    /// A row of five cells between two faces: distances 3 2 1 0 1 2 3, of which the even half is the smaller one.
    #[test]
    fn a_row_of_cells() {
        let mut mesh = sample::rectangle(5, 1, 5.0, 1.0);
        mesh.boundary.retain(|b| (b.centre[1] - 0.5).abs() < 1e-9);
        (0..).zip(&mut mesh.boundary).for_each(|(i, b)| b.global = i);
        let [one, two] = &levels(&mesh, 2)[..] else { panic!("two levels") };
        let g = &one.graph;
        assert_eq!((g.n_owned, &g.senders[..], &g.receivers[..]), (3, &[1, 0, 2, 1][..], &[0, 1, 1, 2][..]));
        // Cells at 0.5, 2.5 and 4.5 are at the means of their neighbours: the outer ones' weigh 1 of a face and 1/2 of a cell.
        assert_eq!((&one.down.row[..], &one.down.from[..3]), (&[0, 2, 4, 6][..], &[1, 5, 1][..]));
        let expected = [1.0 / 3.0, 2.0 / 3.0, 0.5, 0.5, 1.0 / 3.0, 2.0 / 3.0];
        assert!(one.down.weight.iter().zip(expected).all(|(a, b)| (a - b as f32).abs() < 1e-6), "{one:?}");
        // These means are the cells' own places, 2 apart, over 2.
        assert!((g.edge_features[0] - 1.0).abs() < 1e-6, "{g:?}");
        assert_eq!((two.graph.n_owned, two.graph.senders.len(), &two.down.from[..]), (1, 0, &[0, 2][..]));
        assert_eq!(two.up.row, [0, 1, 1, 2]);
    }

    #[test]
    fn levels_halve_and_hang_together_and_the_last_node_stays() {
        let all = levels(&sample::triangles(12, 7, 1.6, 0.41), 12);
        let mut before = 12 * 7 * 2 + 38usize;
        for level in &all {
            let graph = &level.graph;
            assert!(graph.n_owned <= before.div_ceil(2) && graph.n_owned > 0);
            let near = |i: usize| &graph.senders[graph.row[i] as usize..graph.row[i + 1] as usize];
            let (mut reached, mut at) = (vec![0], 0);
            while at < reached.len() {
                near(reached[at] as usize).iter().for_each(|s| {
                    if !reached.contains(s) {
                        reached.push(*s)
                    }
                });
                at += 1;
            }
            assert_eq!(reached.len(), graph.n_owned);
            for (j, row) in level.down.row.windows(2).enumerate() {
                let sum: f32 = level.down.weight[row[0] as usize..row[1] as usize].iter().sum();
                assert!((sum - 1.0).abs() < 1e-6, "node {j}: {sum}");
            }
            before = graph.n_owned;
        }
        let last = &all[11];
        assert_eq!(
            (last.graph.n_owned, &last.down.from[..], &last.down.weight[..]),
            (1, &[0][..], &[1.0][..])
        );
    }
}
