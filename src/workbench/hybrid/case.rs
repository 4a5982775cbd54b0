//! The runs of one draw: files, solver, cost, comparison, and the result that stays.

use super::compared::Compared;
use super::correctors::{Correctors, Worked};
use super::record::{Cost, RunRecord, kept, remove};
use super::variant::{FULL, Kind};
use super::{DrawResult, Event, Plan};
use crate::compare::{Options, records};
use crate::foam_case::FoamCase;
use crate::generate::case::{Times, origin, program, provenance};
use crate::generate::family::Draw;
use crate::generate::parameter::Settings;
use m4gn_mesh::files::write_whole;
use m4gn_mesh::{Error, Result};
use serde_json::json;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// What was found of a run that has ended.
struct Found {
    cost: Cost,
    correctors: Option<Correctors>,
    /// None of the full run.
    compared: Option<Compared>,
}

/// What all draws have in common.
pub(super) struct Job<'a> {
    pub plan: &'a Plan,
    pub settings: &'a Settings,
    pub model: String,
    pub comparing: &'a Mutex<()>,
    pub report: &'a (dyn Fn(Event) + Sync),
}

impl Job<'_> {
    /// Everything of draw `index` that is not there yet.
    pub fn run(&self, index: u64, draw: &Draw) -> DrawResult {
        let order = self.plan.schedule.order_by.as_ref();
        let mut result = DrawResult {
            index,
            quantities: draw.variables.clone(),
            order: order.map_or(index as f64, |name| draw.variables[name]),
            full: None,
            runs: Default::default(),
            failed: Vec::new(),
        };
        let folder = self.plan.folder.join(format!("{index:04}"));
        let mut missing = Vec::new();
        for variant in &self.plan.variants {
            match self
                .key(index, &variant.kind)
                .map(|key| (kept(&folder, &variant.name, &key), key))
            {
                Ok((Some(record), _)) => {
                    self.done(index, &variant.name, true);
                    result.runs.insert(variant.name.clone(), record);
                }
                Ok((None, key)) => missing.push((variant, key)),
                Err(e) => self.failed(&mut result, &variant.name, &e),
            }
        }
        let key = self.full_key(index);
        let (record, full) = (kept(&folder, FULL, &key), folder.join(FULL));
        // Its fields are there as long as this file is.
        let whole = full.join("system/controlDict").is_file();
        result.full = match record {
            Some(record) if whole || missing.is_empty() => {
                self.done(index, FULL, true);
                Some(record)
            }
            _ => self.make(&folder, index, FULL, draw, None, key, &mut result),
        };
        if result.full.is_none() {
            return result;
        }
        for (variant, key) in missing {
            if self.plan.tools.stopped() {
                return result;
            }
            let made = match self.draw_with(index, &variant.kind) {
                Ok(draw) => self.make(
                    &folder,
                    index,
                    &variant.name,
                    &draw,
                    Some(&variant.kind),
                    key,
                    &mut result,
                ),
                Err(e) => {
                    self.failed(&mut result, &variant.name, &e);
                    None
                }
            };
            if let Some(record) = made {
                result.runs.insert(variant.name.clone(), record);
            }
        }
        if result.failed.is_empty() && !self.plan.keep_cases {
            remove(&full);
        }
        result
    }

    fn done(&self, index: u64, name: &str, before: bool) {
        let name = name.to_string();
        (self.report)(Event::Done { index, name, before });
    }

    fn failed(&self, result: &mut DrawResult, name: &str, error: &Error) {
        let (index, message) = (result.index, error.to_string());
        result.failed.push((name.into(), message.clone()));
        let name = name.to_string();
        (self.report)(Event::Failed { index, name, message });
    }

    /// The draw of a variant, whose settings replace those of the full run.
    fn draw_with(&self, index: u64, kind: &Kind) -> Result<Draw> {
        let mut all = self.settings.clone();
        all.extend(kind.settings().clone());
        self.plan.family.draw(self.plan.seed, index, &all)
    }

    /// What the full run is made with.
    fn full_key(&self, index: u64) -> String {
        let s = &self.plan.schedule;
        let settings: Vec<String> = self
            .settings
            .iter()
            .map(|(name, setting)| format!("{name}={setting}"))
            .collect();
        json!({
            "m4gn": env!("CARGO_PKG_VERSION"), "family": self.plan.family.name, "seed": self.plan.seed, "index": index,
            "settings": settings, "start_up": s.start_up, "end": s.end, "interval": s.interval,
            "solver_time": s.solver_time, "patch": s.patch,
        })
        .to_string()
    }

    /// What a variant is made with.
    fn key(&self, index: u64, kind: &Kind) -> Result<String> {
        let own = match kind {
            Kind::Hybrid { entries, settings } => {
                let mut own = json!({
                    "model": self.model, "surrogate_steps": self.plan.schedule.surrogate_steps, "entries": entries,
                });
                if !settings.is_empty() {
                    own["quantities"] = json!(self.draw_with(index, kind)?.variables);
                }
                if let Some(folder) = &self.plan.stretches {
                    own["stretches"] = json!(folder);
                }
                own
            }
            Kind::Plain(_) => json!({ "quantities": self.draw_with(index, kind)?.variables }),
        };
        Ok(json!({ "full": self.full_key(index), "variant": own }).to_string())
    }

    /// Makes one run; a failure goes into the result. `kind` is none for the full run.
    #[allow(clippy::too_many_arguments)]
    fn make(
        &self,
        folder: &Path,
        index: u64,
        name: &str,
        draw: &Draw,
        kind: Option<&Kind>,
        made_with: String,
        result: &mut DrawResult,
    ) -> Option<RunRecord> {
        let case = folder.join(name);
        // A record stands for fields that are whole: that of a run before this one goes first.
        let _ = std::fs::remove_file(folder.join(format!("{name}.json")));
        let made = self.try_make(folder, index, name, draw, kind).and_then(|found| {
            let (score, comparison) = found.compared.map(|c| (c.score, c.whole)).unzip();
            let record = RunRecord {
                made_with,
                cost: found.cost,
                correctors: found.correctors,
                score,
                comparison,
            };
            let text = serde_json::to_vec(&record).map_err(|e| Error::Internal(e.to_string()))?;
            write_whole(&folder.join(format!("{name}.json")), &text)?;
            Ok(record)
        });
        match made {
            Ok(record) => {
                self.done(index, name, false);
                if kind.is_some() && !self.plan.keep_cases {
                    remove(&case);
                }
                Some(record)
            }
            Err(Error::Interrupted(_)) => None,
            Err(e) => {
                self.failed(result, name, &e);
                None
            }
        }
    }

    fn try_make(
        &self,
        folder: &Path,
        index: u64,
        name: &str,
        draw: &Draw,
        kind: Option<&Kind>,
    ) -> Result<Found> {
        let (plan, schedule) = (self.plan, &self.plan.schedule);
        let case = &folder.join(name);
        if case.exists() {
            std::fs::remove_dir_all(case)
                .map_err(|e| Error::file(case, format!("cannot be replaced: {e}")))?;
        }
        let steps = plan.family.steps(draw, schedule.interval)?;
        let times = Times {
            delta_t: schedule.interval / f64::from(steps),
            end: schedule.end,
            write_interval: schedule.interval,
        };
        let functions = match kind {
            Some(Kind::Hybrid { entries, .. }) => {
                self.surrogate(times.delta_t, entries) + &self.recorder(times.delta_t, index, name, draw)?
            }
            _ => String::new(),
        };
        plan.family.write(draw, times, &functions, case)?;
        plan.family.prepare(draw, case, &plan.tools)?;
        let start = Instant::now();
        plan.tools.run(case, &plan.family.solver)?;
        let wall = start.elapsed().as_secs_f64();
        let (solver, takeover) = (
            program(&plan.family.solver),
            schedule.start_up + schedule.solver_time,
        );
        let [before, after] = records::processor_seconds(case, solver, takeover).ok_or_else(|| {
            let log = case.join(format!("log.{solver}"));
            Error::file(
                log,
                "expected lines 'ExecutionTime = .. s' of an OpenFOAM solver, found none",
            )
        })?;
        let cost = Cost {
            wall,
            processor: before + after,
            after_takeover: after,
        };
        let _one = self.comparing.lock().unwrap_or_else(|e| e.into_inner());
        let mut found = Found {
            cost,
            correctors: None,
            compared: None,
        };
        match kind {
            None => found.correctors = Worked::of(case, solver)?.map(|full| full.alone()),
            Some(kind) => {
                let full = &folder.join(FULL);
                if let (Some(full), Some(own)) = (Worked::of(full, solver)?, Worked::of(case, solver)?) {
                    found.correctors = Some(own.beside(&full));
                }
                found.compared = Some(self.compare(folder, case, kind, takeover)?);
            }
        }
        Ok(found)
    }

    /// Compares a run with the full one.
    fn compare(&self, folder: &Path, case: &Path, kind: &Kind, takeover: f64) -> Result<Compared> {
        let (plan, schedule) = (self.plan, &self.plan.schedule);
        let log = case.join(format!("log.{}", program(&plan.family.solver)));
        let (mut a, mut b) = (FoamCase::open(&folder.join(FULL))?, FoamCase::open(case)?);
        let plain = matches!(kind, Kind::Plain(_));
        let mut options = Options {
            patch: schedule.patch.clone(),
            takeover: plain.then_some(takeover),
            interpolate: plain,
            ..Options::default()
        };
        let (stride, strides) = (schedule.interval, f64::from(schedule.surrogate_steps));
        let mut compared = Compared::new(&mut a, &mut b, &options, stride, strides)?;
        if matches!(kind, Kind::Hybrid { entries, .. } if controlled(entries))
            && compared.score.replaced.is_none()
        {
            // Error control let no jump go: the solver's own run is what came of it.
            options.takeover = Some(takeover);
            compared = Compared::new(&mut a, &mut b, &options, stride, strides)?;
            compared.score.replaced = Some(0.0);
        }
        if !plain && compared.score.replaced.is_none() {
            return Err(Error::file(
                case,
                format!(
                    "the surrogate replaced nothing up to {} s; {} says why",
                    schedule.end,
                    log.display()
                ),
            ));
        }
        if (compared.last - schedule.end).abs() > 0.5 * schedule.interval {
            return Err(Error::file(
                folder,
                format!(
                    "the last time that both runs have is {} s, expected {} s: remove the folder and run again",
                    compared.last, schedule.end
                ),
            ));
        }
        Ok(compared)
    }

    /// The function object's entries; those of the variant come last, so that they count.
    fn surrogate(&self, delta_t: f64, entries: &str) -> String {
        let s = &self.plan.schedule;
        // The function object allows for half a step of rounding.
        let start = s.start_up + s.solver_time;
        format!(
            "surrogate\n{{\n    type            m4gnSurrogate;\n    libs            (m4gnFoam);\n    mode            replace;\n    \
             model           \"{}\";\n    precision       auto;\n{}    timeStart       {start};\n    solverSteps     {};\n    \
             surrogateSteps  {};\n\n{entries}\n}}\n",
            self.plan.model.display(),
            self.plan.family.recording.location.entry(),
            (s.solver_time / delta_t).round().max(1.0),
            s.surrogate_steps
        )
    }

    /// The function object that records the solver's stretches between the jumps, if that is asked for.
    fn recorder(&self, delta_t: f64, index: u64, name: &str, draw: &Draw) -> Result<String> {
        let Some(stretches) = &self.plan.stretches else {
            return Ok(String::new());
        };
        let (family, seed) = (&self.plan.family, self.plan.seed);
        let recording = &family.recording;
        let steps = recording.interval / delta_t;
        if (steps - steps.round()).abs() > 1e-6 * steps || steps < 0.5 {
            return Err(Error::Input(format!(
                "the frames of family {} are {} s apart, which is {steps} of this run's time steps of {delta_t} s: expected a \
                 whole number",
                family.name, recording.interval
            )));
        }
        Ok(format!(
            "stretches\n{{\n    type            m4gnHarvest;\n    libs            (m4gnFoam);\n    fields          ({});\n{}    \
             hybrid          stretches;\n    file            \"{}/{seed}-{index:04}-{name}.h5\";\n    overwrite       yes;\n    \
             writeControl    timeStep;\n    writeInterval   {};\n\n{}}}\n",
            recording.fields.join(" "),
            recording.location.entry(),
            stretches.display(),
            steps.round(),
            provenance(&origin(family, seed, index, draw)),
        ))
    }
}

/// Whether a function object's entries have the dictionary `control`.
fn controlled(entries: &str) -> bool {
    let mut words = entries.split(|c: char| c.is_whitespace() || "{};".contains(c));
    words.any(|word| word == "control")
}
