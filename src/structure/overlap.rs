//! Overlap of section 3.3.1, sizes, and the adjacency of eq. 10.

use super::Segmentation;
use crate::graph::Graph;
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_model::SegmentSpec;
use m4gn_parallel::Comm;

/// From the segment of each cell to the whole description. Collective.
pub(super) fn complete(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    comm: &Comm,
    cells: Vec<i32>,
) -> Result<Segmentation> {
    let count = spec.count;
    let mut node_segment = cells;
    for b in &mesh.boundary {
        node_segment.push(node_segment[b.owner as usize]);
    }

    // A set of K bits a node.
    let words = count.div_ceil(64);
    let mut sets = vec![0i64; graph.n_local * words];
    for (node, &segment) in node_segment.iter().enumerate() {
        sets[node * words + segment as usize / 64] |= 1i64 << (segment % 64);
    }
    graph.halo.exchange_i64(comm, &mut sets, words);
    for _ in 0..spec.overlap {
        let before = sets.clone();
        for (&sender, &receiver) in graph.senders.iter().zip(&graph.receivers) {
            for w in 0..words {
                sets[receiver as usize * words + w] |= before[sender as usize * words + w];
            }
        }
        graph.halo.exchange_i64(comm, &mut sets, words);
        if !comm.any(sets != before) {
            break;
        }
    }

    // Members of all local nodes, ghosts too: the adjacency needs both ends of an edge.
    let mut rows = vec![0u32];
    let mut members = Vec::with_capacity(graph.n_local);
    for node in 0..graph.n_local {
        for w in 0..words {
            let mut bits = sets[node * words + w] as u64;
            while bits != 0 {
                members.push((w * 64) as i32 + bits.trailing_zeros() as i32);
                bits &= bits - 1;
            }
        }
        rows.push(members.len() as u32);
    }
    let of = |node: i32| &members[rows[node as usize] as usize..rows[node as usize + 1] as usize];

    let mut sizes = vec![0i64; count];
    for &segment in &members[..rows[graph.n_owned] as usize] {
        sizes[segment as usize] += 1;
    }
    comm.sum_i64(&mut sizes);
    let mut adjacency = vec![0i64; count * count];
    for (&sender, &receiver) in graph.senders.iter().zip(&graph.receivers) {
        for &a in of(receiver) {
            for &b in of(sender) {
                adjacency[a as usize * count + b as usize] += 1;
            }
        }
    }
    comm.sum_i64(&mut adjacency);

    let owned = rows[graph.n_owned] as usize;
    rows.truncate(graph.n_owned + 1);
    members.truncate(owned);
    Ok(Segmentation {
        count,
        node_segment,
        member_row: rows,
        member: members,
        sizes: sizes.into_iter().map(|s| s as f64).collect(),
        adjacency: adjacency.into_iter().map(|a| a as f64).collect(),
        ..Segmentation::default()
    })
}
