//! Threads that wait beside the engine and share out a pass's tiles.
//!
//! A pass is a number of tasks; whoever is free takes the next one. Tasks write to places of their own, so that the
//! result does not depend on who did them. Between passes the threads spin for a moment, then sleep: a step's
//! passes follow each other closely, and a solver that works in between is not disturbed.

use super::kernels::{Isa, Tiles};
use std::cell::UnsafeCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;

/// Rounds of spinning before a thread sleeps: some tens of microseconds.
const SPINS: u32 = 4000;

/// A pass as the threads see it: what thread i does.
#[derive(Clone, Copy)]
struct Job(*const (dyn Fn(usize) + Sync));

#[derive(Default)]
struct Shared {
    /// Number of the pass. Written by the owner alone, after the job.
    pass: AtomicUsize,
    /// Threads still at work in this pass.
    busy: AtomicUsize,
    panicked: AtomicBool,
    stop: AtomicBool,
    job: UnsafeCell<Option<Job>>,
}

// SAFETY: the job is written by the owner while no thread is at work, and read after an acquire of `pass`, which is
// raised after it was written.
unsafe impl Sync for Shared {}
// SAFETY: as above; the pointer is used within a pass only.
unsafe impl Send for Shared {}

/// The threads of one engine. Its owner works too.
pub struct Pool {
    /// What the tasks' products are computed with.
    isa: Isa,
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

impl Pool {
    /// `n_threads` with the caller, for tasks that compute with `isa`; fewer where the system gives no more.
    pub fn new(n_threads: usize, isa: Isa) -> Self {
        let shared = Arc::new(Shared::default());
        let spawn = |i: usize| {
            let shared = shared.clone();
            let name = format!("m4gn-{i}");
            std::thread::Builder::new().name(name).spawn(move || work(&shared, i)).ok()
        };
        let workers = (1..n_threads.max(1)).map_while(spawn).collect();
        Pool { isa, shared, workers }
    }

    /// Threads, the caller's included.
    pub fn n_threads(&self) -> usize {
        self.workers.len() + 1
    }

    /// What the tasks' products are computed with.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Does `task(scratch, i)` for every i below `n`, each once, every thread with a scratch of its own; returns
    /// when all are done.
    ///
    /// `scratch` has one for each thread. `between` is called by the calling thread after each of its tasks.
    ///
    /// # Panics
    /// When a task does.
    pub fn run<S: Send>(
        &self,
        scratch: &mut [S],
        n: usize,
        task: impl Fn(&mut S, usize) + Sync,
        mut between: impl FnMut(),
    ) {
        assert!(scratch.len() >= self.n_threads(), "a scratch for each thread");
        if self.workers.is_empty() || n <= 1 {
            let _tiles = Tiles::new(self.isa);
            for i in 0..n {
                task(&mut scratch[0], i);
                between();
            }
            return;
        }
        let next = AtomicUsize::new(0);
        let scratch = Scratch(scratch.as_mut_ptr());
        let take = |thread: usize, between: &mut dyn FnMut()| {
            let _tiles = Tiles::new(self.isa);
            // SAFETY: thread numbers are different and below the length, so that nobody else has this one.
            let own = unsafe { scratch.of(thread) };
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= n {
                    break;
                }
                task(own, i);
                between();
            }
        };
        let job = |thread: usize| take(thread, &mut || ());
        self.start(&job);
        // The others use what stands on this stack, so that a panic has to wait for them.
        let own = catch_unwind(AssertUnwindSafe(|| take(0, &mut between)));
        self.finish();
        let others = self.shared.panicked.swap(false, Ordering::Relaxed);
        if let Err(panic) = own {
            std::panic::resume_unwind(panic);
        }
        assert!(!others, "a thread of the engine panicked");
    }

    fn start(&self, job: &(dyn Fn(usize) + Sync)) {
        // SAFETY: only the lifetime changes; run() waits for all threads before the job ends.
        let job = unsafe {
            std::mem::transmute::<*const (dyn Fn(usize) + Sync + '_), *const (dyn Fn(usize) + Sync + 'static)>(
                job,
            )
        };
        self.shared.busy.store(self.workers.len(), Ordering::Relaxed);
        // SAFETY: no thread is at work.
        unsafe { *self.shared.job.get() = Some(Job(job)) };
        self.shared.pass.fetch_add(1, Ordering::Release);
        self.workers.iter().for_each(|w| w.thread().unpark());
    }

    fn finish(&self) {
        let mut spins = 0;
        while self.shared.busy.load(Ordering::Acquire) > 0 {
            spins += 1;
            if spins < SPINS {
                std::hint::spin_loop();
            } else {
                std::thread::yield_now();
            }
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        for worker in self.workers.drain(..) {
            worker.thread().unpark();
            // A panic of a task was caught and reported.
            let _ = worker.join();
        }
    }
}

/// The scratches of a pass.
struct Scratch<S>(*mut S);

// SAFETY: each thread reaches its own element only.
unsafe impl<S: Send> Sync for Scratch<S> {}

impl<S> Scratch<S> {
    /// # Safety
    /// `i` is within, and nobody else has it.
    #[allow(clippy::mut_from_ref)]
    unsafe fn of(&self, i: usize) -> &mut S {
        // SAFETY: passed on to the caller.
        unsafe { &mut *self.0.add(i) }
    }
}

fn work(shared: &Shared, thread: usize) {
    let mut seen = 0;
    loop {
        let mut spins = 0;
        while shared.pass.load(Ordering::Acquire) == seen {
            if shared.stop.load(Ordering::Acquire) {
                return;
            }
            spins += 1;
            if spins < SPINS {
                std::hint::spin_loop();
            } else {
                std::thread::park();
            }
        }
        seen += 1;
        // SAFETY: the pass has begun, so the owner leaves the job alone until this thread has counted itself down.
        if let Some(job) = unsafe { *shared.job.get() } {
            // SAFETY: run() waits until busy is 0, which this thread has not counted down yet.
            let done = catch_unwind(AssertUnwindSafe(|| unsafe { (*job.0)(thread) }));
            if done.is_err() {
                shared.panicked.store(true, Ordering::Relaxed);
            }
        }
        shared.busy.fetch_sub(1, Ordering::Release);
    }
}

/// A slice that tasks write disjoint parts of.
pub struct Parts<'a, T> {
    start: *mut T,
    len: usize,
    owner: std::marker::PhantomData<&'a mut [T]>,
}

// SAFETY: it gives out disjoint parts only, as the callers of rows() promise.
unsafe impl<T: Send> Sync for Parts<'_, T> {}

impl<'a, T> Parts<'a, T> {
    /// Of a whole slice.
    pub fn new(slice: &'a mut [T]) -> Self {
        Parts { start: slice.as_mut_ptr(), len: slice.len(), owner: std::marker::PhantomData }
    }

    /// Rows `range` of `width` numbers.
    ///
    /// # Safety
    /// No other reference to these rows lives.
    ///
    /// # Panics
    /// Where the slice has not so many.
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn rows(&self, range: &std::ops::Range<usize>, width: usize) -> &'a mut [T] {
        assert!(
            range.start <= range.end && range.end * width <= self.len,
            "rows {range:?} of width {width} in {} numbers",
            self.len
        );
        // SAFETY: within the slice; that nobody else has them is the caller's promise.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(range.start * width), range.len() * width) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_is_done_once_in_every_pass() {
        for n_threads in [1, 2, 5] {
            let pool = Pool::new(n_threads, Isa::detect());
            assert_eq!(pool.n_threads(), n_threads);
            let mut counts = vec![0usize; n_threads];
            let mut done = vec![0u32; 100];
            let passes = if cfg!(miri) { 3 } else { 200 };
            for pass in 1..=passes {
                let parts = Parts::new(&mut done);
                let task = |count: &mut usize, i: usize| {
                    *count += 1;
                    // SAFETY: task i has row i.
                    unsafe { parts.rows(&(i..i + 1), 1)[0] += 1 };
                };
                pool.run(&mut counts, 100, task, || ());
                assert!(done.iter().all(|d| *d == pass));
            }
            assert_eq!(counts.iter().sum::<usize>(), 100 * passes as usize);
            pool.run(&mut counts, 0, |_, _| unreachable!(), || ());
        }
    }

    #[test]
    fn a_panic_reaches_the_caller_and_the_pool_goes_on() {
        let pool = Pool::new(3, Isa::detect());
        let mut scratch = [(); 3];
        for culprit in [0, 7, 49] {
            let task = |_: &mut (), i: usize| assert_ne!(i, culprit);
            let result = catch_unwind(AssertUnwindSafe(|| pool.run(&mut scratch, 50, task, || ())));
            assert!(result.is_err());
        }
        let all = |_: &mut (), i: usize| assert!(i > 50, "every task");
        let result = catch_unwind(AssertUnwindSafe(|| pool.run(&mut scratch, 50, all, || ())));
        assert!(result.is_err());
        pool.run(&mut scratch, 50, |_, _| (), || ());
    }
}
