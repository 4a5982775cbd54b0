//! A study: networks on data sets with several seeds, at equal updates or equal time, each trained and validated by this program in a process
//! of its own. All that can be known before is checked before ([`check`]). What is done is kept; the same command goes on where it was stopped.

mod check;
mod figures;
mod job;
mod paired;
mod plan;
mod report;

pub use plan::{Data, Network, Plan, Test};
pub use report::Report;

use crate::generate::openfoam::absolute;
use crate::generate::process::Surroundings;
use job::Job;
use m4gn_base::{Error, Result};
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::AtomicU8;
use std::time::Duration;

/// What a network scored.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Data set, network, seed.
    pub data: String,
    /// The network.
    pub network: String,
    /// Seed of its training.
    pub seed: u64,
    /// Figures of the training.
    pub training: Value,
    /// Figures of 'm4gn validate' for each test, and with which number of segments where it is another than the training's.
    pub tests: Vec<(String, Option<usize>, Value)>,
}

/// A training or a validation that failed.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Failure {
    /// Data set, network, seed.
    pub data: String,
    /// The network.
    pub network: String,
    /// Seed of its training.
    pub seed: u64,
    /// Why.
    pub error: String,
}

/// Runs what is missing of a study in `folder`, and writes its report there. `say` is told of each training that cannot be or is made anew, before
/// the first one begins, and of each as it ends.
///
/// # Errors
/// As [`check::all`], before anything is trained; while another program works in the folder it waits. [`Error::Interrupted`] when the user stops: what is
/// trained then has saved its checkpoint. [`Error::File`] where the report cannot be written. A training or validation that fails is told, and is in
/// the report.
pub fn run(plan: &Plan, folder: &Path, stop: &'static AtomicU8, say: &mut dyn FnMut(&str)) -> Result<Report> {
    let folder = absolute(folder)?;
    let tools = Surroundings {
        stop,
        timeout: Duration::from_secs(u64::MAX / 4),
        asks: true,
        environment: Vec::new(),
    };
    // Then what the other one has done is there.
    let _lock = tools.take_turn(&folder, say)?;
    let checked = check::all(plan, &tools)?;
    let cells = plan.cells();
    let named = |i: usize| {
        let (data, network, seed) = cells[i];
        format!("{}/{} {}/{}/{seed}", i + 1, cells.len(), data.name, network.name)
    };
    let mut failures = Vec::new();
    let mut fail = |i: usize, e: Error, say: &mut dyn FnMut(&str)| {
        say(&format!("{}: failed: {e}", named(i)));
        let (data, network, seed) = cells[i];
        let (data, network) = (data.name.clone(), network.name.clone());
        failures.push(Failure { data, network, seed, error: e.to_string() });
    };
    let mut jobs: Vec<(usize, Job)> = Vec::new();
    for (i, &cell) in cells.iter().enumerate() {
        match Job::new(plan, cell, &folder, &checked) {
            Ok(job) => {
                job.notes().iter().for_each(|note| say(&format!("{}: {note}", named(i))));
                jobs.push((i, job));
            }
            Err(e) => fail(i, e, say),
        }
    }
    check::disk(&folder, jobs.iter().map(|(_, job)| job.bytes()))?;
    let mut done = Vec::new();
    for (i, job) in &jobs {
        match job.run(&tools) {
            Ok(cell) => {
                say(&format!("{}: {}", named(*i), cell.line()));
                done.push(cell);
            }
            Err(Error::Interrupted(e)) => {
                return Err(Error::Interrupted(format!(
                    "{e} at {}; the same command carries on from its last checkpoint",
                    named(*i)
                )));
            }
            Err(e) => fail(*i, e, say),
        }
    }
    let report = Report::new(plan, &done, &failures);
    report.write(&folder)?;
    Ok(report)
}
