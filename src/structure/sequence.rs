//! The nodes of each segment in an order, for networks that read one after another (EAGLE: Janny et al. 2023).
//!
//! The order is that of places: by the third direction, then the second, then the first. It depends neither on the numbering of the
//! nodes nor on the ranks, and neighbours in it are near each other along the flow; numbers of clusters' nodes, which the authors take
//! as they come, would depend on both. All nodes of a segment are read by one rank, the lowest that has any of them.

use super::Segmentation;
use super::place::line;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::vector::Vector;
use m4gn_parallel::{Comm, Halo, everywhere};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// The segments that this rank reads.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sequence {
    /// Nodes of segment s: `node[row[s]..row[s + 1]]`; none of a segment that another rank reads.
    pub row: Vec<u32>,
    /// Owned nodes, and from `n_owned` on those that the halo brings.
    pub node: Vec<i32>,
    /// Brings the nodes of other ranks; no part of what is written of a sequence.
    #[serde(skip)]
    pub halo: Halo,
}

impl Sequence {
    /// Of the nodes of a segmentation, which are at `places`. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Internal`] for places of other nodes.
    pub fn new(segments: &Segmentation, places: &[Vector], comm: &Comm) -> Result<Self> {
        let (n_owned, k) = (places.len(), segments.count);
        comm.agree(refuse(segments.member_row.len() != n_owned + 1, Error::Internal, || {
            format!("segments of other nodes than {n_owned}")
        }))?;
        let first = comm.exclusive_scan_i64(n_owned as i64) as usize;
        // Of nodes at one place, which a point and its boundary face are, the first here.
        let all = everywhere(comm, &places.concat());
        let all = all.as_chunks::<3>().0;
        let number = line(all, &(0..all.len() as i64).collect::<Vec<_>>());
        let number = &number[first..first + n_owned];
        let of = |node: usize| {
            let row = segments.member_row[node] as usize..segments.member_row[node + 1] as usize;
            segments.member[row].iter().map(|&s| s as usize)
        };
        let (rank, size) = (i64::from(comm.rank()), comm.size() as usize);
        let mut reader = vec![size as i64 - 1; k];
        (0..n_owned).flat_map(of).for_each(|s| reader[s] = reader[s].min(rank));
        comm.min_i64(&mut reader);
        let mut members = vec![Vec::new(); size];
        for (node, &number) in number.iter().enumerate() {
            of(node).for_each(|s| members[reader[s] as usize].extend([s as i64, number]));
        }
        let (mut found, mut ghosts) = (Vec::new(), Vec::new());
        for (from, list) in (0..).zip(comm.all_to_all(&members)) {
            let pairs = list.as_chunks::<2>().0;
            found.extend_from_slice(pairs);
            if from != comm.rank() {
                ghosts.extend(pairs.iter().map(|[_, number]| (from, *number)));
            }
        }
        found.sort_unstable();
        ghosts.sort_unstable();
        ghosts.dedup();
        let halo = Halo::new(comm, number, &ghosts, n_owned)?;
        let known = number.iter().chain(ghosts.iter().map(|(_, number)| number));
        let local: HashMap<i64, i32> = known.copied().zip(0..).collect();
        let mut row = vec![0u32; k + 1];
        found.iter().for_each(|[s, _]| row[*s as usize + 1] += 1);
        (0..k).for_each(|s| row[s + 1] += row[s]);
        Ok(Sequence { row, node: found.iter().map(|[_, number]| local[number]).collect(), halo })
    }

    /// On one rank, of segments whose nodes stand after one another in `node`.
    pub fn of_nodes(segments: &Segmentation, node: Vec<i32>) -> Self {
        let mut row = vec![0];
        row.extend(segments.sizes.iter().scan(0, |sum, n| {
            *sum += *n as u32;
            Some(*sum)
        }));
        Sequence { row, node, halo: Halo::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_of_a_segment_stand_by_their_places() {
        // Six nodes, two of which are in both segments; the third and the fifth have one y but for rounding.
        let places = [[3.0, 0.0], [1.0, 2.0], [2.0, 1.0], [0.0, 5.0], [2.0 + 1e-12, 0.5], [9.0, 0.0]];
        let places = places.map(|[y, x]| [x, y, 0.0]);
        let members = (vec![0, 1, 3, 5, 6, 7, 8], vec![0, 0, 1, 0, 1, 1, 0, 1]);
        let segments = Segmentation::of_members(2, members.0, members.1);
        let found = Sequence::new(&segments, &places, &Comm::serial()).unwrap();
        assert_eq!((&found.row[..], &found.node[..]), (&[0, 4, 8][..], &[1, 4, 2, 0, 3, 1, 2, 5][..]));
        assert_eq!(Sequence::of_nodes(&segments, found.node.clone()).row, found.row);
        assert!(Sequence::new(&segments, &places[1..], &Comm::serial()).is_err());
    }
}
