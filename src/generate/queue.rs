//! Many cases at once: what is there is kept, what fails is reported and skipped.

use super::case::{Made, make};
use super::cylinder::CaseFiles;
use super::process::Surroundings;
use crate::dataset::{Split, Trajectory};
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// What to make and how.
#[derive(Clone, Debug)]
pub struct Queue {
    /// Cases in order.
    pub cases: Vec<CaseFiles>,
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

/// What became of one case.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// It was made.
    Made(Made),
    /// A whole trajectory of the same parameters was there.
    There(PathBuf),
    /// It failed.
    Failed(Error),
}

impl Queue {
    /// Name of a case's trajectory.
    pub fn target(&self, case: &CaseFiles) -> PathBuf {
        self.folder.join(format!("{:04}.h5", case.index))
    }

    fn case_folder(&self, case: &CaseFiles) -> PathBuf {
        self.folder.join("cases").join(format!("{:04}", case.index))
    }

    /// Runs all cases; `report` is called as each ends, on the calling thread.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when the user stops. [`Error::File`] when the folder cannot be made, or holds a
    /// trajectory of the same name and other parameters: nothing is run then. Failed cases are only reported.
    pub fn run(&self, mut report: impl FnMut(&CaseFiles, &Outcome)) -> Result<()> {
        std::fs::create_dir_all(self.folder.join("cases"))
            .map_err(|e| Error::file(&self.folder, format!("cannot be made: {e}")))?;
        let mut missing = Vec::new();
        for case in &self.cases {
            let target = self.target(case);
            if target.exists() {
                self.check_existing(case, &target)?;
                report(case, &Outcome::There(target));
            } else {
                missing.push(case);
            }
        }
        self.run_missing(&missing, &mut report);
        // Goes only when it is empty: failed and kept cases stay.
        let _ = std::fs::remove_dir(self.folder.join("cases"));
        if self.tools.stopped() {
            return Err(Error::Interrupted(format!(
                "stopped by the user; the same command goes on with {}",
                self.folder.display()
            )));
        }
        Ok(())
    }

    fn run_missing(&self, missing: &[&CaseFiles], report: &mut impl FnMut(&CaseFiles, &Outcome)) {
        let next = AtomicUsize::new(0);
        let (sender, outcomes) = mpsc::channel();
        std::thread::scope(|scope| {
            for _ in 0..self.jobs.clamp(1, missing.len().max(1)) {
                let (sender, next) = (sender.clone(), &next);
                scope.spawn(move || {
                    while !self.tools.stopped() {
                        let Some(case) = missing.get(next.fetch_add(1, Ordering::Relaxed)) else {
                            break;
                        };
                        let (folder, target) = (self.case_folder(case), self.target(case));
                        let outcome = match make(case, &folder, &target, self.keep_cases, &self.tools) {
                            Ok(made) => Outcome::Made(made),
                            Err(Error::Interrupted(_)) => break,
                            Err(e) => Outcome::Failed(e),
                        };
                        if sender.send((*case, outcome)).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (case, outcome) in outcomes {
                report(case, &outcome);
            }
        });
    }

    fn check_existing(&self, case: &CaseFiles, target: &Path) -> Result<()> {
        let trajectory = Trajectory::open(target)?;
        let difference = case.difference(trajectory.provenance()).or_else(|| {
            let (found, wanted) = (trajectory.split(), self.split?);
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
