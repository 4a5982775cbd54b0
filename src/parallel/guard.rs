//! The way out of a collective call that one rank cannot finish.
//!
//! A rank that panics, or fails where the others do not know of it, would leave them in a collective operation for ever.
//! Here it tells them: each collective operation of [`Comm`] begins with a meeting (a barrier that does not block), and a
//! rank that waits there looks for such a message. Unless the sender had come to this very meeting, it then leaves the call
//! as well, so that all end it with the same class of status. A rank that waits inside a library (PETSc, HDF5) cannot look; after [`PATIENCE`] the job is ended.

use super::agree::{broken_elsewhere, inner};
use super::{Comm, MpiComm};
use m4gn_base::{Error, Result};
use mpi::point_to_point::Status;
use mpi::traits::{Communicator, CommunicatorCollectives, Destination, Source};
use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

/// How long a rank that leaves a call waits for the others to leave it too.
const PATIENCE: Duration = Duration::from_secs(10);

/// Most that counts of the time between two looks: where the machine stood still, so did the others.
const LOOK: Duration = Duration::from_millis(100);

/// Tag of the message of a rank that leaves; no other message on our duplicate has it.
const TAG: i32 = 6;

/// Longest message, which MPI sends without waiting for the receiver.
const LONGEST: usize = 900;

/// How a rank left a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// By its own error; what it holds is as before.
    Usable = 0,
    /// By a panic or an internal error.
    Broken = 1,
    /// Because another one had left.
    Followed = 2,
}

/// A rank that has left, and why.
#[derive(Clone, Debug)]
pub(super) struct Left {
    class: Class,
    /// Meetings that it had come to.
    meetings: i64,
    message: String,
}

/// Unwinds a rank from a meeting that will never be.
struct Followed;

static FAULT: AtomicI64 = AtomicI64::new(i64::MIN);

/// Makes the `after`-th collective operation of this process from now on (0: the next) panic. For tests.
#[doc(hidden)]
pub fn panic_after(after: u32) {
    FAULT.store(i64::from(after), Ordering::Relaxed);
}

/// Collective operations since [`panic_after`], which is ended. For tests.
#[doc(hidden)]
pub fn operations_since(after: u32) -> i64 {
    i64::from(after) - FAULT.swap(i64::MIN, Ordering::Relaxed)
}

/// A panic where a test asked for one.
pub(super) fn fault_point() {
    if FAULT.load(Ordering::Relaxed) != i64::MIN && FAULT.fetch_sub(1, Ordering::Relaxed) == 0 {
        FAULT.store(i64::MIN, Ordering::Relaxed);
        panic!("a fault that a test asked for");
    }
}

impl Comm {
    /// Runs the body of a collective call so that it ends on all ranks with the same class of result, whatever one of
    /// them meets: an error that the ranks did not agree on, a panic. Collective.
    ///
    /// # Errors
    /// The body's; [`Error::Internal`] on all ranks when one panicked, or failed while another was waiting for it: what
    /// was made on this communicator can then only be freed.
    pub fn guarded<T>(&self, body: impl FnOnce() -> Result<T>) -> Result<T> {
        let m = match self {
            Comm::Mpi(m) if m.size > 1 => m,
            _ => return body(),
        };
        if m.broken.get() {
            return Err(Error::Internal(
                "an earlier call broke on one of the ranks; what was made on its communicator can only be freed".into(),
            ));
        }
        m.agreed.set(false);
        // Unwind safety: after a panic the communicator is broken, and whatever holds it can only be freed.
        let ended = catch_unwind(AssertUnwindSafe(|| {
            let value = body()?;
            // A rank must not return while another is about to say that it cannot.
            self.agree(Ok(()))?;
            Ok(value)
        }));
        let (class, error) = match ended {
            Ok(Ok(value)) => return Ok(value),
            Ok(Err(e)) if m.agreed.get() => {
                m.broken.set(matches!(e, Error::Internal(_)));
                return Err(e);
            }
            Ok(Err(e)) if matches!(e, Error::Internal(_)) => (Class::Broken, Some(e)),
            Ok(Err(e)) => (Class::Usable, Some(e)),
            Err(panic) if panic.is::<Followed>() => (Class::Followed, None),
            Err(panic) => (Class::Broken, Some(Error::Internal(panic_text(&*panic).into()))),
        };
        Err(m.leave(class, error))
    }
}

/// The message of a panic.
pub fn panic_text(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(s), _) => s,
        (_, Some(s)) => s,
        _ => "panic without a message",
    }
}

impl MpiComm {
    /// Returns when all ranks have come here; unwinds when one has left instead.
    pub(super) fn meet(&self) {
        fault_point();
        self.agreed.set(false);
        if self.broken.get() {
            resume_unwind(Box::new(Followed));
        }
        let mut request = self.comm.get().immediate_barrier();
        self.meetings.set(self.meetings.get() + 1);
        // The common case needs no look at messages.
        for turn in 1u32.. {
            match request.test() {
                Ok(_) => return,
                Err(pending) => request = pending,
            }
            if turn % 16 == 0 && self.someone_stays_away() {
                // It never completes; its communicator is not used again.
                std::mem::forget(request);
                self.follow();
            }
        }
    }

    /// Leaves the call that another rank has left.
    pub(super) fn follow(&self) -> ! {
        self.broken.set(true);
        resume_unwind(Box::new(Followed))
    }

    /// Whether a rank has left that does not come to the meeting under way. One that came to it, and left later, has done its
    /// part of what follows: to leave here would keep others waiting in it, who do not look.
    fn someone_stays_away(&self) -> bool {
        self.listen();
        let left = self.left.borrow();
        left.iter().filter_map(VecDeque::front).any(|l| l.meetings < self.meetings.get())
    }

    /// Whether a message of a rank that left is here.
    pub(super) fn someone_left(&self) -> bool {
        self.listen();
        self.left.borrow().iter().any(|l| !l.is_empty())
    }

    fn listen(&self) {
        let any = self.comm.get().any_process();
        while let Some(status) = any.immediate_probe_with_tag(TAG) {
            self.take_message(&status);
        }
    }

    fn take_message(&self, status: &Status) {
        let rank = status.source_rank();
        let from = self.comm.get().process_at_rank(rank);
        let (message, _) = from.receive_vec_with_tag::<u8>(TAG);
        let class = match message.first() {
            Some(0) => Class::Usable,
            Some(1) => Class::Broken,
            _ => Class::Followed,
        };
        let (meetings, message) =
            message.get(1..).unwrap_or_default().split_first_chunk().unwrap_or((&[0; 8], &[]));
        let meetings = i64::from_le_bytes(*meetings);
        let message = String::from_utf8_lossy(message).into_owned();
        let mut left = self.left.borrow_mut();
        left.resize_with(self.size as usize, VecDeque::new);
        left[rank as usize].push_back(Left { class, meetings, message });
    }

    /// Tells the others, waits until all have left, and says what this rank returns.
    fn leave(&self, class: Class, own: Option<Error>) -> Error {
        let text = own.as_ref().map(inner).unwrap_or_default();
        let mut message = vec![class as u8];
        message.extend(self.meetings.get().to_le_bytes());
        message.extend(text.bytes().take(LONGEST));
        for rank in (0..self.size).filter(|&r| r != self.rank) {
            self.comm.get().process_at_rank(rank).send_with_tag(&message[..], TAG);
        }
        let (mut waited, mut looked) = (Duration::ZERO, Instant::now());
        let others = |left: &[VecDeque<Left>]| left.iter().filter(|l| !l.is_empty()).count() as i32;
        while others(&self.left.borrow()) < self.size - 1 {
            self.listen();
            let now = Instant::now();
            waited += (now - looked).min(LOOK);
            looked = now;
            if waited > PATIENCE {
                self.end_job(&text);
            }
            std::thread::yield_now();
        }
        let left: Vec<Option<Left>> = self.left.borrow_mut().iter_mut().map(VecDeque::pop_front).collect();
        let untouched = |c: Class| c == Class::Usable;
        let usable = untouched(class) && left.iter().flatten().all(|l| untouched(l.class));
        self.broken.set(!usable);
        // The cause: a rank that broke, or else one that failed alone.
        let cause = |wanted: Class| {
            let mut ranks = left.iter().enumerate();
            ranks.find_map(|(r, l)| l.as_ref().filter(|l| l.class == wanted).map(|l| (r as i32, l)))
        };
        match own {
            Some(e) if usable || matches!(e, Error::Internal(_)) => e,
            Some(e) => match cause(Class::Broken) {
                Some((rank, l)) => broken_elsewhere(rank, &l.message),
                None => Error::Internal(format!("only this rank found: {}", inner(&e))),
            },
            None => match cause(Class::Broken).or_else(|| cause(Class::Usable)) {
                Some((rank, l)) => broken_elsewhere(rank, &l.message),
                None => Error::Internal("another rank left the call".into()),
            },
        }
    }

    /// The others wait where they cannot be told.
    fn end_job(&self, text: &str) -> ! {
        eprintln!(
            "m4gn: rank {}: {text}\nm4gn: other ranks wait for this one and did not answer in {} s; ending the job",
            self.rank,
            PATIENCE.as_secs()
        );
        self.comm.get().abort(1)
    }
}
