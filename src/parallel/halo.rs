//! Which owned values go to which rank, and where ghosts come from.

use super::{Comm, Element};
use crate::ffi::mpi::{Peer, Requests};
use m4gn_base::{Error, Result, refuse_any};
use std::collections::HashMap;

/// The exchange that fills ghost nodes: rows after the owned ones, ordered by (rank, global number). The default has none.
#[derive(Clone, Debug, Default)]
pub struct Halo {
    n_owned: usize,
    n_ghosts: usize,
    /// Owned rows to send, peer by peer.
    send_rows: Vec<i32>,
    peers: Vec<Peer>,
    buffer_f32: Vec<f32>,
    buffer_i64: Vec<i64>,
    requests: Requests,
}

impl Halo {
    /// Builds the exchange for `ghosts` = (rank, global cell), sorted and unique. Collective.
    ///
    /// `cell_global` numbers this rank's cells; ghosts follow the `n_owned` owned rows. A ghost that its rank
    /// does not own is a mesh error naming both.
    pub fn new(comm: &Comm, cell_global: &[i64], ghosts: &[(i32, i64)], n_owned: usize) -> Result<Self> {
        let size = comm.size() as usize;
        let mut wanted = vec![Vec::new(); size];
        let mut receive = vec![0..0; size];
        for (i, &(rank, global)) in ghosts.iter().enumerate() {
            let r = rank as usize;
            if wanted[r].is_empty() {
                receive[r] = i..i;
            }
            wanted[r].push(global);
            receive[r].end = i + 1;
        }
        let asked = comm.all_to_all(&wanted);
        let local: HashMap<i64, i32> = cell_global.iter().enumerate().map(|(i, &g)| (g, i as i32)).collect();
        let mut halo = Halo { n_owned, n_ghosts: ghosts.len(), ..Default::default() };
        let mut missing = None;
        for (rank, (asked, receive)) in asked.iter().zip(receive).enumerate() {
            let start = halo.send_rows.len();
            for &global in asked {
                match local.get(&global) {
                    Some(&row) => halo.send_rows.push(row),
                    None => missing = missing.or(Some((rank, global))),
                }
            }
            let send = start..halo.send_rows.len();
            if !send.is_empty() || !receive.is_empty() {
                halo.peers.push(Peer { rank: rank as i32, send, receive });
            }
        }
        comm.agree(refuse_any(missing, Error::Mesh, |(rank, global)| {
            let here = comm.rank();
            format!(
                "rank {rank} has a coupled face to cell {global} of rank {here}, which does not own that cell: check coupled_rank \
                 and coupled_global"
            )
        }))?;
        Ok(halo)
    }

    /// Owned rows that are sent, each once for every rank that needs it.
    pub fn n_sent(&self) -> usize {
        self.send_rows.len()
    }

    /// Ghost rows.
    pub fn n_ghosts(&self) -> usize {
        self.n_ghosts
    }

    /// Ranks that this one exchanges with.
    pub fn neighbours(&self) -> impl Iterator<Item = i32> + '_ {
        self.peers.iter().map(|p| p.rank)
    }

    /// Whether this rank sends anything to `rank`.
    pub fn sends_to(&self, rank: i32) -> bool {
        self.peers.iter().any(|p| p.rank == rank && !p.send.is_empty())
    }

    /// The same exchange where owned row i stands at `place[i]`; ghosts stay where they are.
    pub fn renumbered(&self, place: &[u32]) -> Self {
        let mut other = self.clone();
        for row in &mut other.send_rows {
            *row = place[*row as usize] as i32;
        }
        other
    }

    /// Fills the ghost rows of `values` `[n_local x width]` from their owners. Collective over neighbours.
    pub fn exchange_f32(&mut self, comm: &Comm, values: &mut [f32], width: usize) {
        let mut buffer = std::mem::take(&mut self.buffer_f32);
        self.exchange_during(comm, values, width, &mut buffer, |_, _| ());
        self.buffer_f32 = buffer;
    }

    /// Fills the ghost rows of `values` `[n_local x width]` from their owners. Collective over neighbours.
    pub fn exchange_i64(&mut self, comm: &Comm, values: &mut [i64], width: usize) {
        let mut buffer = std::mem::take(&mut self.buffer_i64);
        self.exchange_during(comm, values, width, &mut buffer, |_, _| ());
        self.buffer_i64 = buffer;
    }

    /// Fills the ghost rows of `values` `[n_local x width]` from their owners while `work` runs, which gets the owned
    /// rows and a function that it calls now and then to move the messages on. Collective over neighbours.
    pub fn exchange_during<T: Element>(
        &mut self,
        comm: &Comm,
        values: &mut [T],
        width: usize,
        buffer: &mut Vec<T>,
        work: impl FnOnce(&[T], &mut dyn FnMut()),
    ) {
        let (owned, ghosts) = values.split_at_mut(self.n_owned * width);
        let m = match comm {
            Comm::Mpi(m) if !self.peers.is_empty() => m,
            _ => return work(owned, &mut || ()),
        };
        super::guard::fault_point();
        debug_assert_eq!(ghosts.len(), self.n_ghosts * width);
        buffer.clear();
        for &row in &self.send_rows {
            let at = row as usize * width;
            buffer.extend_from_slice(&owned[at..at + width]);
        }
        let arrived = self.requests.exchange_during(
            m.owned(),
            &self.peers,
            buffer,
            ghosts,
            width,
            &mut || m.someone_left(),
            |progress| work(owned, progress),
        );
        if !arrived {
            // MPI may still read from it.
            std::mem::forget(std::mem::take(buffer));
            m.follow();
        }
    }
}
