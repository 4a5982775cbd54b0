//! Hybrid runs of many unseen cases against the full solver: what a model does on a whole family, not on one chosen case.
//!
//! For each draw of a family the plain solver runs once over the whole time span, and each [`Variant`] once: hybrids (the
//! function object m4gnSurrogate with other entries) and cheaper plain solvers. Each is compared with the full run by
//! [`crate::compare`]. [`run`] keeps what is finished, so that the same command goes on where it was stopped.

mod answer;
mod case;
mod html;
mod record;
mod score;
mod tables;
mod variant;

pub use html::report;
pub use record::{Cost, RunRecord};
pub use score::Score;
pub use tables::{case_table, failures, remarks, summary, summary_tables};
pub use variant::{FULL, Kind, Variant, variants};

use crate::foam_bridge;
use crate::generate::family::{Draw, Family, Hybrid};
use crate::generate::parameter::Settings;
use crate::generate::process::Surroundings;
use crate::generate::queue;
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, lock, plugin, refuse};
use m4gn_model::Model;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;

/// What to run and how.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The family; its `hybrid` is [`Plan::schedule`].
    pub family: Family,
    /// Time span and schedule.
    pub schedule: Hybrid,
    /// What the user sets, over what the schedule sets.
    pub settings: Settings,
    /// Model file, with its whole path; none: surrogates that need none.
    pub model: Option<PathBuf>,
    /// Seed of the draws.
    pub seed: u64,
    /// Number of draws.
    pub count: u64,
    /// What is run of each draw beside the full solver.
    pub variants: Vec<Variant>,
    /// Folder of the cases and results.
    pub folder: PathBuf,
    /// Draws at once.
    pub jobs: usize,
    /// Whether case folders stay.
    pub keep_cases: bool,
    /// Whether each run but the full one ends where it knows the family's figures, which are compared in place of the fields.
    pub answers: bool,
    /// Conditions of the tools.
    pub tools: Surroundings,
}

/// The results of one draw.
#[derive(Clone, Debug, Default, Serialize)]
pub struct DrawResult {
    /// Number of the draw.
    pub index: u64,
    /// Parameters and derived quantities.
    pub quantities: BTreeMap<String, f64>,
    /// What the cases are put in order by; the number of the draw where the family names nothing.
    pub order: f64,
    /// The full run.
    pub full: Option<RunRecord>,
    /// The variants that ended, by name.
    pub runs: BTreeMap<String, RunRecord>,
    /// What failed: name of the run and message.
    pub failed: Vec<(String, String)>,
}

/// Whether one of two times is a whole multiple of the other.
fn meet(a: f64, b: f64) -> bool {
    let ratio = a.max(b) / a.min(b);
    (ratio - ratio.round()).abs() <= 1e-3 * ratio
}

/// Runs everything that is not there yet; `say` is told of each run that ends. Results in the order of the draws.
///
/// # Errors
/// [`Error::Interrupted`] when the user stops. [`Error::Input`] for settings or a schedule that cannot be, or that the model's stride
/// does not meet. [`Error::File`]
/// when the folder cannot be used, or OpenFOAM's libraries cannot be loaded. Failed runs are in the results.
pub fn run(plan: &Plan, say: impl Fn(&str) + Sync) -> Result<Vec<DrawResult>> {
    let settings = plan.schedule.settings(&plan.settings);
    let draws: Vec<Draw> =
        (0..plan.count).map(|index| plan.family.draw(plan.seed, index, &settings)).collect::<Result<_>>()?;
    plan.family.check_outside(&plan.folder)?;
    let mut libraries = Digest::default();
    let own = plan.schedule.libraries.iter().map(String::as_str);
    let remedy =
        "./Allrun builds it; setup/solids4foam.sh what needs solids4foam (docs/how-to/build-solids4foam.md)";
    for name in ["libm4gn.so", "libm4gnFoam.so"].into_iter().chain(own) {
        libraries.add_file("file", &plugin::find(name, remedy)?)?;
    }
    let mut network = libraries;
    if let Some(model) = &plan.model {
        network.add_file("file", model)?;
        let (stride, interval) = (Model::read(model)?.spec.stride, plan.schedule.interval);
        refuse(!plan.answers && !meet(stride, interval), Error::Input, || {
            format!(
                "{} makes strides of {stride} s, and hybrid.interval of the family {} is {interval} s: expected one to be a whole \
                 multiple of the other, so that its runs store the times of the full one",
                model.display(),
                plan.family.name
            )
        })?;
    }
    let mut averages = Digest::default();
    if plan.answers {
        averages.add_file("file", &plugin::find("libm4gnAverages.so", remedy)?)?;
    }
    // Before there are threads, and before anything is run that could not be compared.
    foam_bridge::load()?;
    let _lock = lock::folder(&plan.folder)?;
    let comparing = Mutex::new(());
    let job = case::Job {
        plan,
        settings: &settings,
        libraries,
        network,
        averages,
        comparing: &comparing,
        say: &say,
    };
    let mut results: Vec<DrawResult> = Vec::new();
    let run = |i: usize| Some(job.run(i as u64, &draws[i]));
    queue::in_parallel((plan.jobs, draws.len()), &plan.tools, run, |_, result| {
        results.push(result);
    });
    refuse(plan.tools.stopped(), Error::Interrupted, || {
        format!("stopped by the user; the same command goes on with {}", plan.folder.display())
    })?;
    results.sort_by_key(|r| r.index);
    Ok(results)
}

#[cfg(test)]
mod tests {
    #[test]
    fn strides_meet_stored_times() {
        let meet = |stride: f64| super::meet(stride, 0.02);
        assert!(meet(0.02) && meet(0.08) && meet(0.005) && !meet(0.03) && !meet(0.012));
    }
}
