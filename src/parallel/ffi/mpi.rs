//! MPI calls that rsmpi has no safe form for: Fortran handles, freeing at the right time, halo exchange.

use mpi::Count;
use mpi::datatype::traits::Equivalence;
use mpi::ffi;
use mpi::raw::traits::{AsRaw, FromRaw};
use mpi::topology::SimpleCommunicator;
use std::mem::{ManuallyDrop, MaybeUninit};

/// Ranks of `MPI_COMM_WORLD`; none while MPI is down.
pub fn world_size() -> Option<i32> {
    if !mpi::environment::is_initialized() || mpi::environment::is_finalized() {
        return None;
    }
    let mut size = 0;
    // SAFETY: MPI is up, so MPI_COMM_WORLD is live.
    unsafe { ffi::MPI_Comm_size(ffi::RSMPI_COMM_WORLD, &mut size) };
    Some(size)
}

/// A duplicate of a communicator that is ours; freed on drop while MPI is up.
pub struct OwnedCommunicator {
    comm: ManuallyDrop<SimpleCommunicator>,
    abandoned: bool,
}

impl OwnedCommunicator {
    /// Duplicates the communicator with this Fortran handle (`MPI_Comm_c2f`). Collective.
    ///
    /// None if MPI is down or the handle names no communicator.
    pub fn from_fortran(handle: i32) -> Option<Self> {
        if !mpi::environment::is_initialized() || mpi::environment::is_finalized() {
            return None;
        }
        // SAFETY: MPI is up; f2c looks the handle up in a table and answers null for unknown ones.
        let raw = unsafe { ffi::RSMPI_Comm_f2c(handle) };
        // SAFETY: RSMPI_COMM_NULL is a constant set before main.
        if raw.0.is_null() || raw == unsafe { ffi::RSMPI_COMM_NULL } {
            return None;
        }
        let mut copy = MaybeUninit::uninit();
        // SAFETY: raw is a live communicator; on success MPI_Comm_dup writes copy.
        let code = unsafe { ffi::MPI_Comm_dup(raw, copy.as_mut_ptr()) };
        if code != 0 {
            return None;
        }
        // SAFETY: copy was written, is a user communicator and nobody else holds it.
        Some(Self::new(unsafe { SimpleCommunicator::from_raw(copy.assume_init()) }))
    }

    /// Takes over a communicator that rsmpi made.
    pub fn new(comm: SimpleCommunicator) -> Self {
        Self { comm: ManuallyDrop::new(comm), abandoned: false }
    }

    /// Leaves it unfreed when this is dropped: operations on it will never end.
    pub fn abandon(&mut self) {
        self.abandoned = true;
    }

    /// The communicator for rsmpi's calls.
    pub fn get(&self) -> &SimpleCommunicator {
        &self.comm
    }

    /// The Fortran handle (`MPI_Comm_c2f`).
    pub fn fortran(&self) -> i32 {
        // SAFETY: a live communicator.
        unsafe { ffi::RSMPI_Comm_c2f(self.raw()) }
    }

    /// The C handle, for PETSc and HDF5; valid while this object lives.
    pub fn raw(&self) -> ffi::MPI_Comm {
        self.comm.as_raw()
    }
}

impl Drop for OwnedCommunicator {
    fn drop(&mut self) {
        // A host may have finalised MPI before it lets go of us; then nothing is left to free.
        if !self.abandoned && !mpi::environment::is_finalized() {
            // SAFETY: dropped once, here.
            unsafe { ManuallyDrop::drop(&mut self.comm) };
        }
    }
}

/// What is exchanged with one neighbouring rank, in rows of the value array.
#[derive(Clone, Debug, PartialEq)]
pub struct Peer {
    /// The other rank.
    pub rank: i32,
    /// Rows of the packed send buffer for it.
    pub send: std::ops::Range<usize>,
    /// Ghost rows that come from it, counted from the first ghost.
    pub receive: std::ops::Range<usize>,
}

/// Requests in flight, kept between exchanges so that an exchange allocates nothing.
#[derive(Debug, Default)]
pub struct Requests(Vec<ffi::MPI_Request>);

// SAFETY: the handles are only meaningful within `exchange`, which holds `&mut self` and leaves the list empty.
unsafe impl Send for Requests {}
// SAFETY: as above; a shared reference gives no access to the handles.
unsafe impl Sync for Requests {}

impl Clone for Requests {
    fn clone(&self) -> Self {
        Self(Vec::with_capacity(self.0.capacity()))
    }
}

impl Requests {
    /// Sends packed rows to, and receives ghost rows from, every peer while `work` runs; returns when all have arrived.
    /// `work` gets a function that moves the messages on, since MPI may do so only when it is called.
    ///
    /// `send` is `[sum of send rows x width]`, `ghosts` is `[sum of receive rows x width]`. Collective over peers.
    ///
    /// While it waits it asks `given_up`; once that says so, what has not arrived is called off and the ghosts are
    /// undefined. False then: `send` may still be read from and must never be freed.
    #[allow(clippy::too_many_arguments)]
    #[must_use]
    pub fn exchange_during<T: Equivalence>(
        &mut self,
        comm: &OwnedCommunicator,
        peers: &[Peer],
        send: &[T],
        ghosts: &mut [T],
        width: usize,
        given_up: &mut dyn FnMut() -> bool,
        work: impl FnOnce(&mut dyn FnMut()),
    ) -> bool {
        const TAG: i32 = 4;
        let datatype = T::equivalent_datatype();
        let datatype = datatype.as_raw();
        self.0.clear();
        for peer in peers {
            let part = &mut ghosts[peer.receive.start * width..peer.receive.end * width];
            let mut request = MaybeUninit::uninit();
            // SAFETY: the slice outlives the wait below, nothing else touches it, and its type is T's.
            unsafe {
                ffi::MPI_Irecv(
                    part.as_mut_ptr().cast(),
                    part.len() as Count,
                    datatype,
                    peer.rank,
                    TAG,
                    comm.raw(),
                    request.as_mut_ptr(),
                );
                self.0.push(request.assume_init());
            }
        }
        for peer in peers {
            let part = &send[peer.send.start * width..peer.send.end * width];
            let mut request = MaybeUninit::uninit();
            // SAFETY: the slice outlives the wait below and is only read.
            unsafe {
                ffi::MPI_Isend(
                    part.as_ptr().cast(),
                    part.len() as Count,
                    datatype,
                    peer.rank,
                    TAG,
                    comm.raw(),
                    request.as_mut_ptr(),
                );
                self.0.push(request.assume_init());
            }
        }
        // Also where `work` panics: the slices must outlive the requests.
        let mut waiting = Waiting { requests: &mut self.0, n_receives: peers.len(), given_up };
        work(&mut || {
            waiting.test();
        });
        waiting.wait()
    }
}

/// Requests in flight, waited for when this goes.
struct Waiting<'a> {
    /// Receives, then sends.
    requests: &'a mut Vec<ffi::MPI_Request>,
    n_receives: usize,
    given_up: &'a mut dyn FnMut() -> bool,
}

impl Waiting<'_> {
    /// Lets MPI move the messages on; true when all have arrived.
    fn test(&mut self) -> bool {
        let mut done = 0;
        // SAFETY: live requests, or null ones once all are complete; statuses are ignored.
        unsafe {
            ffi::MPI_Testall(
                self.requests.len() as Count,
                self.requests.as_mut_ptr(),
                &mut done,
                ffi::RSMPI_STATUSES_IGNORE,
            );
        }
        done != 0
    }

    /// True when all have arrived, false when they were given up.
    fn wait(&mut self) -> bool {
        for turn in 1u32.. {
            if self.test() {
                break;
            }
            if turn % 16 == 0 && (self.given_up)() {
                self.call_off();
                return false;
            }
        }
        self.requests.clear();
        true
    }

    /// Calls receives off; afterwards nothing is written to their slices. Sends are left to MPI.
    fn call_off(&mut self) {
        for request in &mut self.requests[..self.n_receives] {
            // SAFETY: live requests or null ones, which are passed over; a receive that has been called off, or is under
            // way from a rank that still lives, completes.
            unsafe {
                if *request != ffi::RSMPI_REQUEST_NULL {
                    ffi::MPI_Cancel(request);
                    ffi::MPI_Wait(request, ffi::RSMPI_STATUS_IGNORE);
                }
            }
        }
        self.requests.clear();
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if self.requests.is_empty() || self.wait() {
            return;
        }
        // Two ranks failed in one exchange, and this one's send buffer goes with the stack.
        eprintln!("m4gn: two ranks failed in one exchange; ending the job");
        // SAFETY: MPI is up; it does not return.
        unsafe { ffi::MPI_Abort(ffi::RSMPI_COMM_WORLD, 1) };
    }
}
