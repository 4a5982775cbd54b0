//! Ranks: one communicator type for serial and MPI runs, and the halo exchange of the graph.
//!
//! A guest never moves the furniture: MPI is joined if it is up, and finalised only if we started it.

mod agree;
pub mod ffi;
mod guard;
mod halo;
mod lifetime;

pub use guard::{operations_since, panic_after, panic_text};
pub use halo::Halo;
pub use lifetime::{before_finalize, finalize, start};

use crate::ffi::mpi::OwnedCommunicator;
use m4gn_base::{Error, Result};
use mpi::collective::SystemOperation;
use mpi::datatype::traits::Equivalence;
use mpi::datatype::{Partition, PartitionMut};
use mpi::traits::{Communicator, CommunicatorCollectives, Destination, Root, Source};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

/// Fortran handle that means "this host runs without MPI" (`M4GN_NO_MPI` of the C ABI).
pub const NO_MPI: i32 = i32::MIN;

/// Messages longer than this many elements are sent in pieces, since MPI counts are 32-bit.
const PIECE: usize = 1 << 28;

/// Most elements that a rank sends to all ranks together, or receives from them, in one operation.
const TOGETHER: usize = 1 << 24;

/// Elements that can be sent: numbers of fixed size.
pub trait Element: Equivalence + Copy + Default {}
impl Element for u8 {}
impl Element for u16 {}
impl Element for i32 {}
impl Element for i64 {}
impl Element for f32 {}
impl Element for f64 {}

/// The ranks that work together on one mesh.
#[derive(Clone)]
pub enum Comm {
    /// One rank without MPI.
    Serial,
    /// Our own duplicate of a host's communicator.
    Mpi(Rc<MpiComm>),
}

/// A duplicated communicator with the scratch that in-place reductions need.
pub struct MpiComm {
    comm: OwnedCommunicator,
    rank: i32,
    size: i32,
    scratch_f64: RefCell<Vec<f64>>,
    scratch_f32: RefCell<Vec<f32>>,
    scratch_i64: RefCell<Vec<i64>>,
    /// How each rank left the call that this one is in, and calls after it: who has heard of all others may be at the next one.
    left: RefCell<Vec<VecDeque<guard::Left>>>,
    /// Whether the last collective operation was an agreement that something failed.
    agreed: Cell<bool>,
    /// Meetings that this rank has come to.
    meetings: Cell<i64>,
    /// Whether a rank left a call while another was waiting for it: no call can be made any more.
    broken: Cell<bool>,
}

impl std::fmt::Debug for Comm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Comm(rank {} of {})", self.rank(), self.size())
    }
}

impl Drop for MpiComm {
    fn drop(&mut self) {
        if self.broken.get() {
            // A meeting is still open on it.
            self.comm.abandon();
        }
    }
}

impl MpiComm {
    fn new(comm: OwnedCommunicator) -> Self {
        let (rank, size) = (comm.get().rank(), comm.get().size());
        MpiComm {
            comm,
            rank,
            size,
            scratch_f64: RefCell::default(),
            scratch_f32: RefCell::default(),
            scratch_i64: RefCell::default(),
            left: RefCell::default(),
            agreed: Cell::new(false),
            meetings: Cell::new(0),
            broken: Cell::new(false),
        }
    }

    /// The owned communicator, for PETSc and HDF5.
    pub fn owned(&self) -> &OwnedCommunicator {
        &self.comm
    }

    /// Sends `pieces[r]` to rank r, and appends what came from it to `received[r]`.
    fn exchange<T: Element>(&self, pieces: &[&[T]], received: &mut [Vec<T>]) {
        let comm = self.comm.get();
        let send_counts: Vec<i32> = pieces.iter().map(|piece| piece.len() as i32).collect();
        let mut receive_counts = vec![0i32; pieces.len()];
        comm.all_to_all_into(&send_counts[..], &mut receive_counts[..]);
        let mut packed: Vec<T> = pieces.concat();
        let mut arrived = vec![T::default(); receive_counts.iter().map(|&count| count as usize).sum()];
        // An empty list of bytes without room has the address 1, which is OpenMPI's MPI_IN_PLACE
        [&mut packed, &mut arrived]
            .into_iter()
            .filter(|list| list.is_empty())
            .for_each(|list| list.reserve(1));
        let outgoing = Partition::new(&packed[..], &send_counts[..], offsets(&send_counts));
        let mut incoming = PartitionMut::new(&mut arrived[..], &receive_counts[..], offsets(&receive_counts));
        comm.all_to_all_varcount_into(&outgoing, &mut incoming);
        let mut rest = &arrived[..];
        for (all, &count) in received.iter_mut().zip(&receive_counts) {
            let (part, tail) = rest.split_at(count as usize);
            all.extend_from_slice(part);
            rest = tail;
        }
    }

    fn reduce<T: Element>(&self, scratch: &RefCell<Vec<T>>, values: &mut [T], op: SystemOperation) {
        let mut scratch = scratch.borrow_mut();
        scratch.clear();
        scratch.extend_from_slice(values);
        self.meet();
        self.comm.get().all_reduce_into(&scratch[..], values, op);
    }
}

/// Reductions over all ranks, in place: name, type, scratch, MPI's operation.
macro_rules! reductions {
    ($($name:ident($kind:ty, $scratch:ident, $op:ident);)*) => {
        impl Comm {
            $(
                #[doc = concat!("Element-wise ", stringify!($op), " over all ranks, in place. Collective.")]
                pub fn $name(&self, values: &mut [$kind]) {
                    if let Comm::Mpi(m) = self {
                        m.reduce(&m.$scratch, values, SystemOperation::$op());
                    }
                }
            )*
        }
    };
}

reductions! {
    sum_f64(f64, scratch_f64, sum);
    sum_f32(f32, scratch_f32, sum);
    sum_i64(i64, scratch_i64, sum);
    max_i64(i64, scratch_i64, max);
    min_i64(i64, scratch_i64, min);
    max_f64(f64, scratch_f64, max);
}

impl Comm {
    /// One rank without MPI.
    pub fn serial() -> Self {
        Comm::Serial
    }

    /// Joins the host's communicator (`MPI_Comm_c2f`): duplicated here, freed with the last clone. Collective.
    ///
    /// [`NO_MPI`] gives a serial communicator. A handle that names no communicator, or MPI not being up, is an
    /// input error.
    pub fn from_fortran(handle: i32) -> Result<Self> {
        if handle == NO_MPI {
            return Ok(Comm::Serial);
        }
        let comm = OwnedCommunicator::from_fortran(handle).ok_or_else(|| {
            Error::Input(format!(
                "communicator handle {handle}: expected MPI_Comm_c2f of a live communicator while MPI is up, or \
                 M4GN_NO_MPI for a host without MPI"
            ))
        })?;
        Ok(Comm::Mpi(Rc::new(MpiComm::new(comm))))
    }

    /// What [`Comm::from_fortran`] takes: `MPI_Comm_c2f` of this communicator, or [`NO_MPI`].
    pub fn fortran(&self) -> i32 {
        match self {
            Comm::Serial => NO_MPI,
            Comm::Mpi(m) => m.comm.fortran(),
        }
    }

    /// All ranks of `MPI_COMM_WORLD` (a duplicate). Starts MPI if nobody has; then
    /// [`finalize`] ends it. Collective.
    pub fn world() -> Result<Self> {
        start()?;
        let world = mpi::topology::SimpleCommunicator::world();
        Ok(Comm::Mpi(Rc::new(MpiComm::new(OwnedCommunicator::new(world.duplicate())))))
    }

    /// This rank, 0 to size - 1.
    pub fn rank(&self) -> i32 {
        match self {
            Comm::Serial => 0,
            Comm::Mpi(m) => m.rank,
        }
    }

    /// Number of ranks.
    pub fn size(&self) -> i32 {
        match self {
            Comm::Serial => 1,
            Comm::Mpi(m) => m.size,
        }
    }

    /// Rank 0 speaks for all.
    pub fn is_root(&self) -> bool {
        self.rank() == 0
    }

    /// Returns when all ranks have arrived. Collective.
    pub fn barrier(&self) {
        if let Comm::Mpi(m) = self {
            m.meet();
        }
    }

    /// Sum of all ranks' counts. Collective.
    pub fn total(&self, own: usize) -> i64 {
        let mut sum = [own as i64];
        self.sum_i64(&mut sum);
        sum[0]
    }

    /// Whether it holds on some rank. Collective.
    pub fn any(&self, here: bool) -> bool {
        let mut any = [i64::from(here)];
        self.max_i64(&mut any);
        any[0] != 0
    }

    /// Sum of `v` over lower ranks; 0 on rank 0. Collective.
    pub fn exclusive_scan_i64(&self, v: i64) -> i64 {
        match self {
            Comm::Serial => 0,
            Comm::Mpi(m) => {
                let mut sum = 0i64;
                m.meet();
                m.comm.get().exclusive_scan_into(&v, &mut sum, SystemOperation::sum());
                // MPI leaves rank 0's result undefined.
                if m.rank == 0 { 0 } else { sum }
            }
        }
    }

    /// Sends `send[r]` to rank r; returns what came from each rank. `send` has one list a rank. Collective.
    pub fn all_to_all<T: Element>(&self, send: &[Vec<T>]) -> Vec<Vec<T>> {
        let Comm::Mpi(m) = self else {
            return send.to_vec();
        };
        let size = m.size as usize;
        let most = (TOGETHER / size).max(1);
        let mut rounds = [send.iter().map(|list| list.len().div_ceil(most)).max().unwrap_or(0) as i64];
        self.max_i64(&mut rounds);
        let mut received = vec![Vec::new(); size];
        for round in 0..rounds[0] as usize {
            let piece = |r: usize| send.get(r).and_then(|list| list.chunks(most).nth(round)).unwrap_or(&[]);
            m.exchange(&(0..size).map(piece).collect::<Vec<_>>(), &mut received);
        }
        received
    }

    /// Every rank's list on the root, none elsewhere. Collective.
    pub fn gather<T: Element>(&self, local: &[T]) -> Option<Vec<Vec<T>>> {
        const TAG: i32 = 5;
        let Comm::Mpi(m) = self else {
            return Some(vec![local.to_vec()]);
        };
        m.meet();
        let comm = m.comm.get();
        let length = local.len() as i64;
        if m.rank != 0 {
            comm.process_at_rank(0).gather_into(&length);
            for piece in local.chunks(PIECE) {
                comm.process_at_rank(0).send_with_tag(piece, TAG);
            }
            return None;
        }
        let mut lengths = vec![0i64; m.size as usize];
        comm.process_at_rank(0).gather_into_root(&length, &mut lengths[..]);
        let mut all = Vec::with_capacity(lengths.len());
        all.push(local.to_vec());
        for (rank, &length) in lengths.iter().enumerate().skip(1) {
            let mut part = vec![T::default(); length as usize];
            for piece in part.chunks_mut(PIECE) {
                comm.process_at_rank(rank as i32).receive_into_with_tag(piece, TAG);
            }
            all.push(part);
        }
        Some(all)
    }

    /// The root's list on every rank. Collective.
    pub fn broadcast<T: Element>(&self, data: &mut Vec<T>) {
        if let Comm::Mpi(m) = self {
            self.broadcast_from(m, 0, data);
        }
    }

    fn broadcast_from<T: Element>(&self, m: &MpiComm, root: i32, data: &mut Vec<T>) {
        m.meet();
        let root = m.comm.get().process_at_rank(root);
        let mut length = data.len() as i64;
        root.broadcast_into(&mut length);
        data.resize(length as usize, T::default());
        for piece in data.chunks_mut(PIECE) {
            root.broadcast_into(piece);
        }
    }
}

fn offsets(counts: &[i32]) -> Vec<i32> {
    let before = |sum: &mut i32, &count: &i32| Some(std::mem::replace(sum, sum.saturating_add(count)));
    counts.iter().scan(0, before).collect()
}

/// An input error unless these values, none below 0, are those of all other ranks. Collective.
pub fn same_on_all_ranks(comm: &Comm, values: &[(&str, i64)]) -> Result<()> {
    let mut extremes: Vec<i64> = values.iter().flat_map(|&(_, v)| [v, -v]).collect();
    comm.max_i64(&mut extremes);
    for (pair, (name, _)) in extremes.chunks_exact(2).zip(values) {
        if pair[0] != -pair[1] {
            return Err(Error::Input(format!("{name}: the ranks differ; expected the same on all")));
        }
    }
    Ok(())
}

/// All ranks' lists after each other, on all ranks. Collective.
pub fn everywhere<T: Element>(comm: &Comm, local: &[T]) -> Vec<T> {
    let mut all = comm.gather(local).map(|lists| lists.concat()).unwrap_or_default();
    comm.broadcast(&mut all);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn serial_collectives_are_identities() {
        let comm = Comm::from_fortran(NO_MPI).unwrap();
        assert_eq!((comm.rank(), comm.size(), comm.is_root()), (0, 1, true));
        let mut v = [1.0, 2.0];
        comm.sum_f64(&mut v);
        assert_eq!(v, [1.0, 2.0]);
        assert_eq!(comm.all_to_all(&[vec![3i64, 4]]), vec![vec![3, 4]]);
        assert_eq!(comm.gather(&[1i32]), Some(vec![vec![1]]));
        assert_eq!(comm.exclusive_scan_i64(7), 0);
        assert!(matches!(comm.agree::<()>(Err(Error::Input("x".into()))), Err(Error::Input(_))));
    }

    #[test]
    fn a_handle_without_mpi_is_refused() {
        if !mpi::environment::is_initialized() {
            assert!(matches!(Comm::from_fortran(0), Err(Error::Input(_))));
        }
    }
}
