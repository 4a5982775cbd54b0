//! The runs of one draw: files, solver, cost, comparison, and the result that stays.

use super::answer;
use super::record::{Cost, RunRecord, finished_record, remove};
use super::score::Score;
use super::variant::{FULL, Kind, NETWORK};
use super::{DrawResult, Plan};
use crate::compare::log::Log;
use crate::compare::{self, Options};
use crate::foam_case::FoamCase;
use crate::generate::case::{Files, Times, program};
use crate::generate::family::{Draw, Hybrid};
use crate::generate::parameter::Settings;
use crate::generate::process::clear;
use m4gn_base::digest::Digest;
use m4gn_base::files::write_whole;
use m4gn_base::{Error, Result};
use serde_json::Value;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// What all draws have in common.
pub(super) struct Job<'a> {
    pub plan: &'a Plan,
    pub settings: &'a Settings,
    /// Of the libraries that run surrogates.
    pub libraries: Digest,
    /// Of these and the model.
    pub network: Digest,
    /// Of the library that finds figures and ends runs, where there are some.
    pub averages: Digest,
    pub comparing: &'a Mutex<()>,
    pub say: &'a (dyn Fn(&str) + Sync),
}

/// A run before it is made.
struct Prepared<'a> {
    name: &'a str,
    /// None for the full run.
    kind: Option<&'a Kind>,
    draw: Draw,
    files: Files,
    functions: String,
    /// Digest of all that it is made from.
    key: String,
}

impl Job<'_> {
    /// Everything of draw `index` that is not there yet.
    pub fn run(&self, index: u64, draw: &Draw) -> DrawResult {
        let order = self.plan.schedule.order_by.as_ref();
        let mut result = DrawResult {
            index,
            quantities: draw.variables.clone(),
            order: order.map_or(index as f64, |name| draw.variables[name]),
            ..DrawResult::default()
        };
        let folder = self.plan.folder.join(format!("{index:04}"));
        let full = match self.prepare(index, FULL, None, None) {
            Ok(full) => full,
            Err(e) => {
                self.failed(&mut result, FULL, &e);
                return result;
            }
        };
        let mut missing = Vec::new();
        for variant in &self.plan.variants {
            match self.prepare(index, &variant.name, Some(&variant.kind), Some(&full)) {
                Ok(run) => match finished_record(&folder, run.name, &run.key) {
                    Some(record) => drop(result.runs.insert(run.name.into(), record)),
                    None => missing.push(run),
                },
                Err(e) => self.failed(&mut result, &variant.name, &e),
            }
        }
        let (record, case) = (finished_record(&folder, FULL, &full.key), folder.join(FULL));
        // Its fields are there as long as this file is.
        let whole = case.join("system/controlDict").is_file();
        result.full = match record {
            Some(record) if whole || missing.is_empty() => Some(record),
            _ => self.make(&folder, &full, &mut result),
        };
        if result.full.is_none() {
            return result;
        }
        for run in missing {
            if self.plan.tools.stopped() {
                return result;
            }
            if let Some(record) = self.make(&folder, &run, &mut result) {
                result.runs.insert(run.name.into(), record);
            }
        }
        if result.failed.is_empty() && !self.plan.keep_cases {
            remove(&case);
        }
        result
    }

    fn failed(&self, result: &mut DrawResult, name: &str, error: &Error) {
        (self.say)(&format!("{:04}  {name} failed: {error}", result.index));
        result.failed.push((name.into(), error.to_string()));
    }

    /// The files of a run, and what it is made from; a variant also from the full run that it is compared with.
    fn prepare<'a>(
        &self,
        index: u64,
        name: &'a str,
        kind: Option<&'a Kind>,
        full: Option<&Prepared>,
    ) -> Result<Prepared<'a>> {
        let (family, schedule) = (&self.plan.family, &self.plan.schedule);
        let mut settings = self.settings.clone();
        settings.extend(kind.map(|k| k.settings().clone()).unwrap_or_default());
        let draw = family.draw(self.plan.seed, index, &settings)?;
        let times = Times {
            delta_t: schedule.interval / f64::from(family.steps(&draw, schedule.interval)?),
            end: schedule.end,
            write_interval: schedule.interval,
        };
        let functions = match kind {
            Some(Kind::Hybrid { surrogates, entries, .. }) => {
                self.surrogate(times.delta_t, surrogates, entries)
            }
            _ => String::new(),
        };
        let answers = schedule.answers.as_ref().filter(|_| self.plan.answers);
        let functions =
            functions + &answers.map(|a| answer::entries(a, &draw, kind.is_some())).unwrap_or_default();
        let files = family.files(&draw, times)?;
        let mut digest = family.digest(&draw, &files, &functions)?;
        let s = schedule;
        let times = format!("{} {} {} {}", s.start_up, s.end, s.interval, s.solver_time);
        digest.add("schedule", times.as_bytes());
        digest.add("patch", s.patch.as_deref().unwrap_or_default().as_bytes());
        if loads_ours(&files) {
            digest.add("libraries", self.libraries.text().as_bytes());
        }
        if answers.is_some() {
            digest.add("averages", self.averages.text().as_bytes());
        }
        if let Some(full) = full {
            digest.add("surrogate steps", &s.surrogate_steps.to_le_bytes());
            digest.add("full", full.key.as_bytes());
        }
        if let Some(Kind::Hybrid { surrogates, .. }) = kind {
            let surrogate = if surrogates.contains(NETWORK) { self.network } else { self.libraries };
            digest.add("surrogate", surrogate.text().as_bytes());
        }
        Ok(Prepared { name, kind, draw, files, functions, key: digest.text() })
    }

    /// Makes one run; a failure goes into the result.
    fn make(&self, folder: &Path, run: &Prepared, result: &mut DrawResult) -> Option<RunRecord> {
        let (case, file) = (folder.join(run.name), folder.join(format!("{}.json", run.name)));
        // A record stands for fields that are whole: that of a run before this one goes first.
        let _ = std::fs::remove_file(&file);
        let made = self.try_make(folder, run).and_then(|record| {
            let text = serde_json::to_vec(&record).map_err(|e| Error::Internal(e.to_string()))?;
            write_whole(&file, &text)?;
            Ok(record)
        });
        match made {
            Ok(record) => {
                (self.say)(&format!("{:04}  {}{}", result.index, run.name, record.line()));
                if run.kind.is_some() && !self.plan.keep_cases {
                    remove(&case);
                }
                Some(record)
            }
            Err(Error::Interrupted(_)) => None,
            Err(e) => {
                self.failed(result, run.name, &e);
                None
            }
        }
    }

    fn try_make(&self, folder: &Path, run: &Prepared) -> Result<RunRecord> {
        let (plan, schedule) = (self.plan, &self.plan.schedule);
        let case = &folder.join(run.name);
        clear(case)?;
        plan.family.write(&run.files, &run.functions, case)?;
        plan.family.prepare(&run.draw, case, &plan.tools)?;
        let check_patch = |time| {
            let _one = self.one();
            let patch = schedule.patch.as_deref().filter(|_| run.kind.is_none());
            patch.map_or(Ok(()), |patch| compare::check_patch(&mut FoamCase::open(case)?, patch, time))
        };
        check_patch(0.0)?;
        let start = Instant::now();
        plan.tools.run(case, &plan.family.solver)?;
        let wall = start.elapsed().as_secs_f64();
        let (solver, takeover) = (program(&plan.family.solver), schedule.start_up + schedule.solver_time);
        let log = Log::read(case, solver).ok_or_else(|| {
            let log = case.join(format!("log.{solver}"));
            Error::file(log, "expected lines 'ExecutionTime = .. s' of an OpenFOAM solver, found none")
        })?;
        let mut record = RunRecord {
            made_with: run.key.clone(),
            cost: Cost {
                wall,
                processor: log.at(log.end()).processor,
                after_takeover: log.between(takeover, log.end()).processor,
            },
            ..RunRecord::default()
        };
        // A flow that begins at rest does not say before where it goes.
        check_patch(takeover)?;
        let _one = self.one();
        match run.kind {
            Some(_) if plan.answers => record.score = Some(answer::score(&folder.join(FULL), case, solver)?),
            Some(kind) => {
                let (score, comparison) = self.compare(folder, case, kind, takeover)?;
                (record.score, record.comparison) = (Some(score), Some(comparison));
            }
            None => {}
        }
        Ok(record)
    }

    /// OpenFOAM's libraries are not made for several threads.
    fn one(&self) -> std::sync::MutexGuard<'_, ()> {
        self.comparing.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Compares a run with the full one.
    fn compare(&self, folder: &Path, case: &Path, kind: &Kind, takeover: f64) -> Result<(Score, Value)> {
        let (plan, schedule) = (self.plan, &self.plan.schedule);
        let log = case.join(format!("log.{}", program(&plan.family.solver)));
        let (mut a, mut b) = (FoamCase::open(&folder.join(FULL))?, FoamCase::open(case)?);
        let plain = matches!(kind, Kind::Plain(_));
        let mut replaced = compare::surrogate::read(case)?.and_then(|s| s.replaced_fraction);
        if matches!(kind, Kind::Hybrid { surrogates, entries, .. } if *surrogates != NETWORK || controlled(entries))
        {
            // Where error control let no jump go, the solver's own run is what came of it.
            replaced = replaced.or(Some(0.0));
        }
        if !plain && replaced.is_none() {
            return Err(Error::file(
                case,
                format!(
                    "the surrogate replaced nothing up to {} s; {} says why",
                    schedule.end,
                    log.display()
                ),
            ));
        }
        let options = Options {
            patch: schedule.patch.clone(),
            takeover: (plain || replaced == Some(0.0)).then_some(takeover),
            interpolate: plain && !compare::is_solid(&mut a)?,
            ..Options::default()
        };
        let (stride, strides) = (schedule.interval, f64::from(schedule.surrogate_steps));
        let compared = compare::compare(&mut a, &mut b, &options, |_, _| {})?.0;
        let last = compared.times.last().copied().unwrap_or(f64::NAN);
        if !reaches(last, schedule) {
            return Err(Error::file(
                folder,
                format!(
                    "the last time that both runs have is {last} s, expected {} s: remove the folder and run again",
                    schedule.end
                ),
            ));
        }
        let full = Log::read(&folder.join(FULL), program(&plan.family.solver));
        let solver_pace =
            full.map(|log| log.between(compared.takeover, last).processor / (last - compared.takeover));
        let score = Score { replaced, solver_pace, ..Score::of(&compared, stride, strides) };
        Ok((score, compared.json()?))
    }

    /// The function object's entries; those of the variant come last, so that they count.
    fn surrogate(&self, delta_t: f64, surrogates: &str, entries: &str) -> String {
        let s = &self.plan.schedule;
        let mut own = String::new();
        if let Some(model) = self.plan.model.as_ref().filter(|_| surrogates.contains(NETWORK)) {
            own += &format!("    model           \"{}\";\n    precision       auto;\n", model.display());
        }
        own += &match surrogates == NETWORK {
            true => format!(
                "    solverSteps     {};\n    surrogateSteps  {};\n",
                (s.solver_time / delta_t).round().max(1.0),
                s.surrogate_steps
            ),
            // How far it goes a fit says itself.
            false => format!("    dmd             {{ snapshotInterval {}; }}\n", s.interval),
        };
        // The function object allows for half a step of rounding.
        let start = s.start_up + s.solver_time;
        format!(
            "surrogate\n{{\n    type            m4gnSurrogate;\n    libs            (m4gnFoam);\n    mode            replace;\n    \
             surrogates      ({surrogates});\n{own}    timeStart       {start};\n\n{entries}\n}}\n"
        )
    }
}

/// Whether a case's own files load our library, as for an accelerator of a plain solver, be it on or off.
fn loads_ours(files: &Files) -> bool {
    const OURS: &[u8] = b"m4gnFoam";
    files.iter().any(|(_, bytes)| bytes.windows(OURS.len()).any(|part| part == OURS))
}

/// Whether this is the last time that is stored up to the end, which need not be a multiple of the interval.
fn reaches(last: f64, schedule: &Hybrid) -> bool {
    schedule.end - last < 0.999 * schedule.interval
}

/// Whether a function object's entries have the dictionary `control`.
fn controlled(entries: &str) -> bool {
    let mut words = entries.split(|c: char| c.is_whitespace() || "{};".contains(c));
    words.any(|word| word == "control")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::family::Family;

    #[test]
    fn plain_runs_with_an_accelerator_are_made_from_the_library_that_has_it() {
        let loads = |name: &str| {
            let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates");
            let family = Family::load(&home.join(name)).unwrap();
            let draw = family.draw(1, 0, &Settings::new()).unwrap();
            loads_ours(&family.files(&draw, Times { delta_t: 1.0, end: 1.0, write_interval: 1.0 }).unwrap())
        };
        assert_eq!(["vibrating-rubber", "pressed-rubber", "cylinder-flow"].map(loads), [true, true, false]);
    }

    #[test]
    fn a_run_may_end_between_stored_times() {
        let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates/cylinder-flow");
        let schedule = Family::load(&home).unwrap().hybrid.unwrap();
        let reaches =
            |end: f64, last: f64| reaches(last, &Hybrid { end, interval: 0.05, ..schedule.clone() });
        assert!(reaches(1.2, 1.2) && reaches(1.23, 1.2) && reaches(1.249, 1.200_001));
        assert!(!reaches(1.2, 1.15) && !reaches(1.23, 1.15));
    }
}
