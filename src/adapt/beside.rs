//! A round on a thread of its own, while the run goes on.

use super::learner::{Knowledge, Learner};
use super::round::{Outcome, Split};
use super::window::Window;
use m4gn_learn::samples::Sample;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

/// A round that goes on. Dropped, it ends after the update that it is at.
#[derive(Debug)]
pub(super) struct Beside {
    /// The frames that it learns from; a run that is carried on begins the round again.
    pub sample: Arc<Sample>,
    pub window: Window,
    /// Model steps of a jump.
    pub strides: usize,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<(Result<Outcome>, Knowledge)>>,
}

impl Learner {
    /// A copy that learns from frames of its own.
    pub(super) fn with(&self, sample: Sample, window: Window) -> Self {
        Learner { sample: Arc::new(sample), window, stop: Arc::default(), ..self.clone() }
    }

    /// Begins a round on its frames, divided like this for jumps of so many model steps.
    ///
    /// # Errors
    /// [`Error::Internal`] where the system has no thread left, or others have the frames as well.
    pub(super) fn beside(mut self, strides: usize, split: Split) -> Result<Beside> {
        self.prepare()?;
        let (sample, window, stop) = (self.sample.clone(), self.window.clone(), self.stop.clone());
        let learn = move || {
            let result = self.round(&Comm::serial(), &split);
            (result, self.knowledge)
        };
        let thread = std::thread::Builder::new().name("m4gn adapt".into()).spawn(learn);
        let thread = thread.map_err(|e| Error::Internal(format!("adapt: no thread to learn on: {e}")))?;
        Ok(Beside { sample, window, strides, stop, thread: Some(thread) })
    }
}

impl Beside {
    /// Waits for its end. The outcome's time is that of the waiting.
    ///
    /// # Errors
    /// As the round; [`Error::Internal`] where it panicked.
    pub(super) fn end(mut self) -> Result<(Outcome, Knowledge)> {
        let began = Instant::now();
        let broke = || Error::Internal("adapt: the thread that learns beside the run broke".into());
        let thread = self.thread.take().ok_or_else(broke)?;
        let (result, knowledge) = thread.join().map_err(|_| broke())?;
        let mut outcome = result?;
        outcome.seconds = began.elapsed().as_secs_f64();
        outcome.note += &format!("; beside the run, which waited {:.1} s for it", outcome.seconds);
        Ok((outcome, knowledge))
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // What it says is of no use any more.
            let _ = thread.join();
        }
    }
}
