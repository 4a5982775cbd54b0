//! Worker threads that share the pieces of a batch. What they compute does not depend on how many there are:
//! pieces are the same, and their results are put back in order.

use crate::learner::{Job, Learner, Outcome};
use m4gn_base::{Error, Result};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

type Answer = (usize, Result<Outcome>);

/// One thread: the caller's own. More: threads that wait for jobs.
pub struct Pool {
    own: Option<Learner>,
    jobs: Option<Sender<(usize, Job)>>,
    answers: Receiver<Answer>,
    threads: Vec<JoinHandle<()>>,
}

impl Pool {
    /// Starts `threads` workers; with one, jobs run in the caller's thread.
    pub fn new(learner: Learner, threads: usize) -> Result<Self> {
        let (answer, answers) = channel();
        if threads <= 1 {
            return Ok(Pool { own: Some(learner), jobs: None, answers, threads: Vec::new() });
        }
        let (jobs, queue) = channel::<(usize, Job)>();
        let queue = Arc::new(Mutex::new(queue));
        let mut handles = Vec::new();
        for number in 0..threads {
            let (learner, queue, answer) = (learner.share(), queue.clone(), answer.clone());
            let handle = std::thread::Builder::new()
                .name(format!("learner {number}"))
                .spawn(move || work(&learner, &queue, &answer))
                .map_err(|e| {
                    Error::Input(format!("cannot start {threads} threads: {e}; ask for fewer with --threads"))
                })?;
            handles.push(handle);
        }
        Ok(Pool { own: None, jobs: Some(jobs), answers, threads: handles })
    }

    /// Runs jobs and returns their outcomes in the jobs' order.
    pub fn run(&self, jobs: Vec<Job>) -> Result<Vec<Outcome>> {
        if let Some(learner) = &self.own {
            return jobs.into_iter().map(|job| guarded(learner, job)).collect();
        }
        let count = jobs.len();
        let gone = || Error::Internal("a training thread ended early".into());
        let queue = self.jobs.as_ref().ok_or_else(gone)?;
        for job in jobs.into_iter().enumerate() {
            queue.send(job).map_err(|_| gone())?;
        }
        let mut outcomes: Vec<Option<Outcome>> = (0..count).map(|_| None).collect();
        let mut failure = None;
        for _ in 0..count {
            let (index, outcome) = self.answers.recv().map_err(|_| gone())?;
            match outcome {
                Ok(outcome) => outcomes[index] = Some(outcome),
                Err(error) => failure = Some(error),
            }
        }
        match failure {
            Some(error) => Err(error),
            None => Ok(outcomes.into_iter().flatten().collect()),
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            // A worker guards its jobs, so there is no panic to report here.
            let _ = thread.join();
        }
    }
}

fn work(learner: &Learner, queue: &Mutex<Receiver<(usize, Job)>>, answer: &Sender<Answer>) {
    loop {
        let job = match queue.lock() {
            Ok(queue) => queue.recv(),
            Err(_) => return,
        };
        let Ok((index, job)) = job else { return };
        if answer.send((index, guarded(learner, job))).is_err() {
            return;
        }
    }
}

/// libtorch's errors arrive as panics of tch; they become messages.
fn guarded(learner: &Learner, job: Job) -> Result<Outcome> {
    catch_unwind(AssertUnwindSafe(|| learner.run(job)))
        .unwrap_or_else(|panic| Err(Error::Internal(panic_message(&*panic))))
}

/// The text of a panic.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text =
        panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    let text = text.unwrap_or("a panic without a message");
    // libtorch appends its own C++ stack.
    text.split("Exception raised from").next().unwrap_or(text).trim().to_string()
}
