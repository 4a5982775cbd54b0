//! Many cases at once: what is there is kept, what fails is reported and skipped.

use super::process::{Surroundings, clear};
use m4gn_base::{Error, Result, lock, refuse};
use m4gn_data::Split;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

/// A case of a data set, of whatever family.
pub trait Case: Sync {
    /// What there is to say about a trajectory that was made.
    type Figures: Send;

    /// Number of the case in the set.
    fn index(&self) -> u64;

    /// Makes the trajectory in the folder, which does not exist yet; where it is there, and its figures.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when the user stops; otherwise [`Error::File`].
    fn run(&self, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Self::Figures)>;

    /// The split of an existing trajectory, and in what it differs from this case.
    ///
    /// # Errors
    /// [`Error::File`] when it is damaged or no trajectory.
    fn compare(&self, existing: &Path) -> Result<(Split, Option<String>)>;
}

/// What to make and how.
#[derive(Clone, Debug)]
pub struct Queue<C> {
    /// Cases in order.
    pub cases: Vec<C>,
    /// Folder of the data set; cases run in its folder `cases`.
    pub folder: PathBuf,
    /// Whether the split was asked for; then an existing trajectory must have it.
    pub split: Option<Split>,
    /// Cases at once.
    pub jobs: usize,
    /// Whether case folders stay.
    pub keep_cases: bool,
    /// Conditions of the tools.
    pub tools: Surroundings,
}

/// A trajectory that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Made<F> {
    /// Its file.
    pub path: PathBuf,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// What its family says.
    #[serde(flatten)]
    pub figures: F,
}

/// What became of one case.
#[derive(Clone, Debug)]
pub enum Outcome<F> {
    /// It was made.
    Made(Made<F>),
    /// A whole trajectory of the same parameters was there.
    There,
    /// It failed.
    Failed(Error),
}

impl<C: Case> Queue<C> {
    /// Name of a case's trajectory.
    pub fn target(&self, case: &C) -> PathBuf {
        self.folder.join(format!("{:04}.h5", case.index()))
    }

    fn case_folder(&self, case: &C) -> PathBuf {
        self.folder.join("cases").join(format!("{:04}", case.index()))
    }

    /// Runs all cases; `report` is called as each ends, on the calling thread.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when the user stops. [`Error::File`] when the folder cannot be made, or holds a
    /// trajectory of the same name and other parameters, or another program works in it: nothing is run then. Failed
    /// cases are only reported.
    pub fn run(&self, mut report: impl FnMut(&C, &Outcome<C::Figures>)) -> Result<()> {
        let _lock = lock::folder(&self.folder)?;
        let cases = self.folder.join("cases");
        std::fs::create_dir_all(&cases).map_err(Error::cannot("made", &cases))?;
        let mut missing = Vec::new();
        for case in &self.cases {
            let target = self.target(case);
            if target.exists() {
                self.check_existing(case, &target)?;
                report(case, &Outcome::There);
            } else {
                missing.push(case);
            }
        }
        self.run_missing(&missing, &mut report);
        // Goes only when it is empty: failed and kept cases stay.
        let _ = std::fs::remove_dir(cases);
        refuse(self.tools.stopped(), Error::Interrupted, || {
            format!("stopped by the user; the same command goes on with {}", self.folder.display())
        })
    }

    fn run_missing(&self, missing: &[&C], report: &mut impl FnMut(&C, &Outcome<C::Figures>)) {
        let make = |i: usize| match self.make(missing[i]) {
            Ok(made) => Some(Outcome::Made(made)),
            Err(Error::Interrupted(_)) => None,
            Err(e) => Some(Outcome::Failed(e)),
        };
        in_parallel((self.jobs, missing.len()), &self.tools, make, |i, outcome| {
            report(missing[i], &outcome);
        });
    }

    /// Makes one trajectory. The case's folder is removed afterwards unless it is to be kept or the case failed.
    fn make(&self, case: &C) -> Result<Made<C::Figures>> {
        let (start, folder) = (Instant::now(), self.case_folder(case));
        clear(&folder)?;
        let result = case.run(&folder, &self.tools).and_then(|(recorded, figures)| {
            let target = self.target(case);
            let bytes = recorded.metadata().map_or(0, |m| m.len());
            std::fs::rename(&recorded, &target).map_err(Error::cannot("given its final name", &target))?;
            Ok(Made { path: target, bytes, seconds: start.elapsed().as_secs_f64(), figures })
        });
        let interrupted = matches!(result, Err(Error::Interrupted(_)));
        if interrupted || (result.is_ok() && !self.keep_cases) {
            let _ = clear(&folder);
        }
        result
    }

    fn check_existing(&self, case: &C, target: &Path) -> Result<()> {
        let (found, difference) = case.compare(target)?;
        let difference = difference.or_else(|| {
            let wanted = self.split?;
            (found != wanted).then(|| format!("split {} instead of {}", found.name(), wanted.name()))
        });
        match difference {
            None => Ok(()),
            Some(difference) => Err(Error::file(
                target,
                format!("was made with other settings ({difference}): choose another folder, or remove it"),
            )),
        }
    }
}

/// Does things 0 to `count` - 1, `jobs` at once, until the user stops; `each` is called on the calling thread as one ends, none where
/// it was stopped.
pub fn in_parallel<T: Send>(
    (jobs, count): (usize, usize),
    tools: &Surroundings,
    work: impl Fn(usize) -> Option<T> + Sync,
    mut each: impl FnMut(usize, T),
) {
    let next = AtomicUsize::new(0);
    let (sender, results) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, count.max(1)) {
            let (sender, next, work) = (sender.clone(), &next, &work);
            scope.spawn(move || {
                while !tools.stopped() {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count {
                        break;
                    }
                    let Some(result) = work(i) else { break };
                    if sender.send((i, result)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        results.into_iter().for_each(|(i, result)| each(i, result));
    });
}

/// The first number of a trajectory's provenance that is not the wanted one, but for rounding.
pub(super) fn other_number(provenance: &serde_json::Value, wanted: &[(&str, f64)]) -> Option<String> {
    let same = |found: &serde_json::Value, wanted: f64| {
        found.as_f64().is_some_and(|f| (f - wanted).abs() <= 1e-9 * wanted.abs())
    };
    wanted
        .iter()
        .find(|(key, wanted)| !same(&provenance[*key], *wanted))
        .map(|(key, wanted)| format!("{key} {} instead of {wanted}", provenance[*key]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_numbers_are_compared_by_their_own_size() {
        let provenance = serde_json::json!({"nu": 1e-10, "angle": 0.0, "speed": 1.0});
        assert_eq!(
            other_number(&provenance, &[("nu", 1e-10 * (1.0 + 1e-12)), ("angle", 0.0), ("speed", 1.0)]),
            None
        );
        let other = other_number(&provenance, &[("speed", 1.0), ("nu", 2e-10)]).unwrap();
        assert!(other.starts_with("nu "), "{other}");
    }
}
