//! A stretch of a run, recomputed by its solver in a copy of the case.

use super::jumps::number_of;
use crate::generate::case::program;
use crate::generate::process::{Surroundings, excerpt};
use crate::user_case::{Copy, Start, copy_all, entry, log, times};
use m4gn_base::{Error, Result};
use std::path::{Path, PathBuf};

/// What has run.
pub(super) struct Run<'a> {
    /// Its folder.
    pub case: &'a Path,
    /// Its function object that has jumped.
    pub name: &'a str,
    /// Ranks whose folders its times are in; 0: they are the case's own.
    pub ranks: usize,
    /// Conditions of the solver.
    pub tools: &'a Surroundings,
}

impl Run<'_> {
    /// Names of the folders of all times, with their values in s, ascending.
    pub fn times(&self) -> Result<Vec<(String, f64)>> {
        times(&match self.ranks {
            0 => self.case.to_path_buf(),
            _ => self.case.join("processor0"),
        })
    }

    /// The solver goes from the first of these times (names of folders) to each of the others, without what m4gn adds to the case. The copy, below
    /// `beside`, has those times.
    pub fn recompute(&self, stretch: &[&(String, f64)], beside: &Path) -> Result<Copy> {
        let start = Start { time: &stretch[0].0, ranks: self.ranks };
        let copy = Copy::new(self.case, beside, Some(start), self.tools)?;
        self.restore_step(&copy, start.time)?;
        let mut from = stretch[0].clone();
        for to in &stretch[1..] {
            // OpenFOAM tries more digits than timePrecision from 18 on, and gives up where 17 make the same name
            let digits = from.0.trim_start_matches(['0', '.']).bytes().take_while(|c| *c != b'e');
            let precision = digits.filter(u8::is_ascii_digit).count().max(15);
            copy.control_dict(
                &format!(
                    "startFrom startTime;\nstartTime {};\ntimePrecision {precision};\nendTime {};\nwriteControl adjustableRunTime;\nwriteInterval {};",
                    from.0,
                    to.0,
                    to.1 - from.1
                ),
                "",
            )?;
            let solver = copy.solver();
            self.tools.run(&copy.folder, &solver).map_err(|e| match e {
                Error::Interrupted(e) => Error::Interrupted(e),
                e => {
                    let said = excerpt(&copy.folder.join(format!("log.{}", program(&solver))));
                    Error::Input(copy.in_words_of_the_case(&log::words(&said, &e)))
                }
            })?;
            let written = times(&copy.parts()[0])?;
            let values: Vec<f64> = written.iter().map(|t| t.1).collect();
            from = number_of(to.1, &values).map(|i| written[i].clone()).ok_or_else(|| {
                Error::Input(format!(
                    "{} came to {} s, not to {} s",
                    copy.application,
                    values.last().copied().unwrap_or(f64::NAN),
                    to.1
                ))
            })?;
        }
        Ok(copy)
    }

    /// A time within a jump is written with the surrogate's step; the solver goes on with its own.
    fn restore_step(&self, copy: &Copy, from: &str) -> Result<()> {
        for part in copy.parts() {
            let uniform = part.join(from).join("uniform");
            let kept = uniform.join("functionObjects/functionObjectProperties");
            // Compressed where the case's files are
            if !kept.is_file() && !kept.with_extension("gz").is_file() {
                continue;
            }
            let step = entry(&copy.folder, &kept, &format!("{}/solverDeltaT", self.name), self.tools)?;
            let step = step.filter(|s| s.parse::<f64>().is_ok_and(|s| s > 0.0));
            if let Some(step) = step {
                let file = uniform.join("time").display().to_string();
                let set = ["foamDictionary", "-entry", "deltaT", "-set", &step, &file];
                self.tools.run(&copy.folder, &set)?;
            }
        }
        Ok(())
    }
}

/// Puts the solver's times into a copy of the whole case, in place of the run's of the same number.
pub(super) fn replace(copy: &Copy, stretch: &[&(String, f64)], kept: &Path) -> Result<()> {
    for part in copy.parts() {
        let written = times(&part)?;
        let values: Vec<f64> = written.iter().map(|t| t.1).collect();
        let to: PathBuf = kept.join(part.strip_prefix(&copy.folder).unwrap_or(Path::new("")));
        for (name, t) in &stretch[1..] {
            let Some(i) = number_of(*t, &values) else { continue };
            let old = to.join(name);
            std::fs::remove_dir_all(&old).map_err(Error::cannot("replaced", &old))?;
            copy_all(&part.join(&written[i].0), &old)?;
        }
    }
    Ok(())
}
