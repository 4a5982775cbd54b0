//! What a run on many ranks would exchange, without having the ranks.
//!
//! Cells are mapped to ranks as `method m4gn` of decomposePar does, whole segments at a time, where there are at
//! least as many segments as ranks, else by METIS. Of rank r, with n_r owned nodes (cells and their boundary faces)
//! and g_r ghosts (cells of other ranks across a face of its own), a step of a network of width d with L
//! message-passing layers receives
//!
//! ```text
//! halo        4 d L g_r bytes        one exchange a layer, fp32
//! all-reduce  8 K d bytes            sums over the segments, fp64; a ring sends 2 (P - 1)/P times as much
//! ```
//!
//! The first falls with the ranks (a rank's ghosts go with the surface of its part), the second does not. What a rank
//! computes and keeps follows from its nodes and edges ([`work`]). Where the network lives on groups of cells, the cells of
//! a plan are these groups.

use crate::bench::work::{self, Sizes, Storage};
use m4gn_engine::{KEEP_ENCODED, Precision};
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::modal::NoModes;
use m4gn_model::{MAX_SEGMENTS, ModelSpec, SegmentMethod, SegmentSpec};
use m4gn_report::{Table, number};
use m4gn_structure as segments;
use m4gn_structure::graph::Graph;
use m4gn_structure::ranks;
use serde_json::{Value, json};

/// Most ranks: METIS parts are cut like segments.
pub const MAX_RANKS: usize = MAX_SEGMENTS;

/// What a step exchanges, computes and keeps depends on.
#[derive(Clone, Debug)]
pub struct Network {
    /// Its shape; K is that of the segments that are mapped.
    pub spec: ModelSpec,
    /// Of the engine's products.
    pub precision: Precision,
}

impl Network {
    /// Latent width d.
    pub fn width(&self) -> usize {
        self.spec.architecture.width
    }

    /// Message-passing layers L, before and after the macro stage.
    pub fn layers(&self) -> usize {
        self.spec.architecture.layers()
    }

    /// Operations of a step, and bytes that the engine keeps.
    fn load(&self, sizes: Sizes) -> [f64; 2] {
        let storage = Storage::of(self.precision);
        let encoded = sizes.edges * self.width() * storage.edge <= KEEP_ENCODED;
        let step = work::step(&self.spec, sizes, storage, encoded);
        let kept = work::kept_bytes(&self.spec, sizes, storage, encoded);
        [step.iter().map(|w| w.flops).sum(), kept]
    }
}

/// The figures for one number of ranks. Pairs are mean and largest over the ranks.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Number of ranks P.
    pub ranks: usize,
    /// Whether whole segments were mapped; false: there are fewer segments than ranks.
    pub whole_segments: bool,
    /// Owned nodes.
    pub nodes: [f64; 2],
    /// Largest over mean of the owned nodes.
    pub imbalance: f64,
    /// Ghosts.
    pub ghosts: [f64; 2],
    /// Ranks exchanged with.
    pub neighbours: [f64; 2],
    /// Faces between cells of different ranks.
    pub cut_faces: usize,
    /// The same over all faces between cells.
    pub edge_cut_ratio: f64,
    /// Bytes that a rank receives a step in the halo exchanges.
    pub halo_bytes: [f64; 2],
    /// Bytes of the segment sums a step.
    pub all_reduce_bytes: f64,
    /// Multiplications and additions of a step, of the rank that has the most.
    pub flops: f64,
    /// Bytes that the engine keeps, on the rank that has the most.
    pub kept_bytes: f64,
}

/// Plans for each of `numbers` of ranks. `labels` is the segment of each cell of the undecomposed mesh, 0 to
/// `count` - 1.
///
/// # Errors
/// [`Error::Input`] for no rank, more ranks than cells, or more than [`MAX_RANKS`].
pub fn plans(
    mesh: &Mesh,
    graph: &mut Graph,
    labels: &[i32],
    count: usize,
    numbers: &[usize],
    network: &Network,
) -> Result<Vec<Plan>> {
    let most = mesh.n_cells().min(MAX_RANKS);
    if let Some(np) = numbers.iter().find(|&&np| np == 0 || np > most) {
        return Err(Error::Input(format!(
            "a plan for {np} ranks: expected 1 to {most} ({} cells, at most {MAX_RANKS} ranks)",
            mesh.n_cells()
        )));
    }
    let pairs = pairs(mesh);
    let segment_graph = segment_graph(mesh, &pairs, labels, count);
    numbers
        .iter()
        .map(|&np| {
            let whole_segments = count >= np;
            let rank_of_cell = match whole_segments {
                true => {
                    let (sizes, adjacency) = &segment_graph;
                    let of_segment = ranks::assign(sizes, adjacency, &vec![1.0; np])?;
                    labels.iter().map(|&l| of_segment[l as usize]).collect()
                }
                false => {
                    let spec = SegmentSpec {
                        method: SegmentMethod::Metis,
                        count: np,
                        connected: false,
                        ..SegmentSpec::default()
                    };
                    let mut parts =
                        segments::segment(mesh, graph, &spec, &NoModes, &Comm::serial(), None)?.node_segment;
                    parts.truncate(mesh.n_cells());
                    parts
                }
            };
            Ok(Plan { whole_segments, ..figures(mesh, &pairs, &rank_of_cell, np, count, network) })
        })
        .collect()
}

/// Cells on both sides of each internal and cyclic face, each face once.
fn pairs(mesh: &Mesh) -> Vec<[i32; 2]> {
    let internal = mesh.face_owner.iter().zip(&mesh.face_neighbour);
    // A cyclic face comes once from each side.
    let cyclic = mesh.coupled.iter().map(|c| [c.owner, c.global as i32]).filter(|[a, b]| a < b);
    internal.map(|(&a, &b)| [a, b]).chain(cyclic).collect()
}

/// Nodes of each segment, and directed faces between them `[K x K]`.
fn segment_graph(mesh: &Mesh, pairs: &[[i32; 2]], labels: &[i32], count: usize) -> (Vec<f64>, Vec<f64>) {
    let mut sizes = vec![0.0; count];
    labels.iter().for_each(|&l| sizes[l as usize] += 1.0);
    for b in &mesh.boundary {
        sizes[labels[b.owner as usize] as usize] += 1.0;
    }
    let mut adjacency = vec![0.0; count * count];
    for [a, b] in pairs {
        let (a, b) = (labels[*a as usize] as usize, labels[*b as usize] as usize);
        adjacency[a * count + b] += 1.0;
        adjacency[b * count + a] += 1.0;
    }
    (sizes, adjacency)
}

fn figures(
    mesh: &Mesh,
    pairs: &[[i32; 2]],
    rank_of_cell: &[i32],
    np: usize,
    count: usize,
    network: &Network,
) -> Plan {
    let mut sizes = vec![Sizes { nodes: 0, cells: 0, edges: 0, segments: count }; np];
    for &r in rank_of_cell {
        sizes[r as usize].nodes += 1;
        sizes[r as usize].cells += 1;
    }
    let rank = |cell: i32| rank_of_cell[cell as usize];
    // An edge lives with the node that it leads to.
    for b in &mesh.boundary {
        let sizes = &mut sizes[rank(b.owner) as usize];
        sizes.nodes += 1;
        sizes.edges += 2;
    }
    for cell in pairs.iter().flatten() {
        sizes[rank(*cell) as usize].edges += 1;
    }
    let cut: Vec<_> = pairs.iter().filter(|[a, b]| rank(*a) != rank(*b)).collect();
    // (rank, ghost), and from the owners (rank, other rank).
    let mut ghosts: Vec<(i32, i32)> =
        cut.iter().flat_map(|[a, b]| [(rank(*a), *b), (rank(*b), *a)]).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let mut neighbours: Vec<(i32, i32)> = ghosts.iter().map(|&(r, cell)| (r, rank(cell))).collect();
    neighbours.sort_unstable();
    neighbours.dedup();
    let tally = |list: &[(i32, i32)]| {
        let mut of = vec![0usize; np];
        list.iter().for_each(|&(r, _)| of[r as usize] += 1);
        mean_and_largest(&of)
    };
    let nodes: Vec<usize> = sizes.iter().map(|s| s.nodes).collect();
    let nodes = mean_and_largest(&nodes);
    let ghosts = tally(&ghosts);
    let a_ghost = (4 * network.width() * network.layers()) as f64;
    let loads = sizes.iter().map(|&s| network.load(s));
    let [flops, kept_bytes] = loads.fold([0f64; 2], |most, load| [0, 1].map(|i| most[i].max(load[i])));
    Plan {
        ranks: np,
        whole_segments: false,
        nodes,
        imbalance: nodes[1] / nodes[0],
        ghosts,
        neighbours: tally(&neighbours),
        cut_faces: cut.len(),
        edge_cut_ratio: cut.len() as f64 / pairs.len().max(1) as f64,
        halo_bytes: ghosts.map(|g| a_ghost * g),
        all_reduce_bytes: match np {
            1 => 0.0,
            _ => (8 * count * network.width()) as f64,
        },
        flops,
        kept_bytes,
    }
}

fn mean_and_largest(values: &[usize]) -> [f64; 2] {
    [
        values.iter().sum::<usize>() as f64 / values.len().max(1) as f64,
        values.iter().copied().max().unwrap_or(0) as f64,
    ]
}

/// One row a number of ranks; times of a rank that computes `gflops` (1e9 operations a second).
pub fn table(plans: &[Plan], gflops: f64) -> Table {
    let mut table = Table::new([
        "ranks",
        "mapped",
        "nodes mean",
        "largest",
        "imbalance",
        "ghosts mean",
        "largest",
        "neighbours",
        "edge cut",
        "halo KiB mean",
        "largest",
        "all-reduce KiB",
        "GFLOP",
        "ms",
        "MiB",
    ]);
    let kib = |bytes: f64| number(bytes / 1024.0, 3);
    for p in plans {
        table.row([
            p.ranks.to_string(),
            if p.whole_segments { "segments" } else { "cells" }.to_string(),
            format!("{:.1}", p.nodes[0]),
            format!("{:.0}", p.nodes[1]),
            format!("{:.3}", p.imbalance),
            format!("{:.1}", p.ghosts[0]),
            format!("{:.0}", p.ghosts[1]),
            format!("{:.0}", p.neighbours[1]),
            format!("{:.4}", p.edge_cut_ratio),
            kib(p.halo_bytes[0]),
            kib(p.halo_bytes[1]),
            kib(p.all_reduce_bytes),
            number(p.flops * 1e-9, 3),
            number(p.flops * 1e-6 / gflops, 3),
            number(p.kept_bytes / f64::from(1 << 20), 3),
        ]);
    }
    table
}

/// The same for programs.
pub fn json(plans: &[Plan]) -> Value {
    plans
        .iter()
        .map(|p| {
            json!({
                "ranks": p.ranks,
                "whole_segments": p.whole_segments,
                "nodes_mean": p.nodes[0],
                "nodes_max": p.nodes[1],
                "imbalance": p.imbalance,
                "ghosts_mean": p.ghosts[0],
                "ghosts_max": p.ghosts[1],
                "neighbours_mean": p.neighbours[0],
                "neighbours_max": p.neighbours[1],
                "cut_faces": p.cut_faces,
                "edge_cut_ratio": p.edge_cut_ratio,
                "halo_bytes_mean": p.halo_bytes[0],
                "halo_bytes_max": p.halo_bytes[1],
                "all_reduce_bytes": p.all_reduce_bytes,
                "flops_max": p.flops,
                "kept_bytes_max": p.kept_bytes,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Shape;
    use m4gn_samples::mesh as sample;

    fn network(dim: usize) -> Network {
        let shape = Shape { dim, layers: 3, width: 10, hidden_layers: 1, segments: None };
        Network { spec: shape.spec(), precision: Precision::Fp32 }
    }

    /// Eight cells in two rows of four, columns 0, 1 on one rank and 2, 3 on the other: two faces are cut, each
    /// rank has two ghosts, and 4 d L = 120 bytes a ghost.
    #[test]
    fn a_block_on_paper() {
        let mesh = sample::rectangle(4, 2, 4.0, 2.0);
        let mut graph = Graph::new(&mesh, &Comm::serial()).unwrap();
        let labels: Vec<i32> = mesh.cell_centres.iter().map(|x| i32::from(x[0] > 2.0)).collect();
        let plans = plans(&mesh, &mut graph, &labels, 2, &[1, 2], &network(2)).unwrap();
        let [one, two] = &plans[..] else { panic!() };
        assert_eq!(
            (one.cut_faces, one.ghosts, one.halo_bytes, one.all_reduce_bytes),
            (0, [0.0; 2], [0.0; 2], 0.0)
        );
        // 8 cells and 12 boundary faces.
        assert_eq!((one.nodes, one.imbalance), ([20.0, 20.0], 1.0));
        assert!(two.whole_segments);
        assert_eq!((two.nodes, two.ghosts, two.neighbours), ([10.0; 2], [2.0; 2], [1.0; 2]));
        assert_eq!((two.cut_faces, two.edge_cut_ratio), (2, 0.2));
        assert_eq!((two.halo_bytes, two.all_reduce_bytes), ([240.0; 2], 160.0));
        // Ten faces between cells: 20 edges, and two of each boundary face. Edges and nodes of the latents, 10 wide, in
        // single precision, and 8 bytes an edge and 20 a node of lists.
        assert_eq!(one.kept_bytes, 44.0 * (40.0 + 40.0 + 8.0) + 20.0 * (80.0 + 20.0));
        // A half has as many nodes, and its edges are those that lead to its cells.
        assert_eq!(two.kept_bytes, 0.5 * one.kept_bytes);
        assert!(two.flops > 0.4 * one.flops && two.flops < 0.6 * one.flops);
    }

    #[test]
    fn a_cell_a_rank() {
        // A chain: inner cells have two ghosts, the ends one.
        let mesh = sample::chain(5, 5.0);
        let mut graph = Graph::new(&mesh, &Comm::serial()).unwrap();
        let plans = plans(&mesh, &mut graph, &[0; 5], 1, &[5], &network(1)).unwrap();
        assert!(!plans[0].whole_segments);
        assert_eq!((plans[0].ghosts, plans[0].cut_faces), ([1.6, 2.0], 4));
        assert_eq!(json(&plans)[0]["neighbours_max"], 2.0);
        assert!(table(&plans, 100.0).to_string().contains("cells"));
    }

    #[test]
    fn impossible_numbers_are_refused() {
        let mesh = sample::chain(5, 5.0);
        let mut graph = Graph::new(&mesh, &Comm::serial()).unwrap();
        for np in [0, 6] {
            let error = plans(&mesh, &mut graph, &[0; 5], 1, &[np], &network(1)).unwrap_err();
            assert!(error.to_string().contains("expected 1 to 5"), "{error}");
        }
    }
}
