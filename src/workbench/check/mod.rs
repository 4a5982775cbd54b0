//! Whether a case fits: its solver runs a few steps in a copy of it, with the function object m4gnSurrogate in mode check, which refuses and hands over
//! by the same code as in a run.

mod report;
mod verdict;

pub use report::{Patch, Report, Suggestion, WINDOW};

use crate::decisions::{self, Decision};
use crate::generate::case::{Times, program};
use crate::generate::family::{self, Family};
use crate::generate::openfoam::{absolute, environment, plain_path, scratch, surroundings};
use crate::generate::parameter::Settings;
use crate::generate::process::{Surroundings, excerpt};
use crate::user_case::{Copy, log};
use m4gn_base::{Error, Result, refuse};
use m4gn_parallel::Comm;
use m4gn_report::{figure, number};
use m4gn_train::{Request, delta, train_native};
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU8;
use std::time::{Duration, Instant};
use verdict::{End, Verdict};

/// Name of the function object that checks.
const NAME: &str = "m4gnCheck";

/// What it is called in texts for people.
const CALLED: &str = "surrogate";

/// Steps between the frames that a network is made from.
const STEPS: usize = 5;

/// Frames that it is made from.
const FRAMES: usize = 4;

/// A case.
#[derive(Clone, Debug)]
pub enum Case {
    /// A folder.
    Folder(PathBuf),
    /// The first draw of a family.
    Family(Box<Family>),
}

impl Case {
    /// A folder with `system/controlDict`, or a family of cases.
    ///
    /// # Errors
    /// [`Error::Input`] that says what was expected.
    pub fn find(name: &Path) -> Result<Self> {
        // A family's folder is a case as well, with gaps
        if name.join("system/controlDict").is_file() && !name.join(family::FILE).exists() {
            return Ok(Case::Folder(absolute(name)?));
        }
        let what = match (name.is_dir(), name.exists()) {
            (true, _) => "is a folder without system/controlDict",
            (_, true) => "is no folder",
            _ => "does not exist",
        };
        Family::find(name).map(|f| Case::Family(Box::new(f))).map_err(|e| {
            if name.join(family::FILE).exists() {
                return e;
            }
            Error::Input(format!(
                "{} {what}: expected the folder of an OpenFOAM case, or a family of cases ({e})",
                name.display()
            ))
        })
    }

    /// The folder that it is read from.
    pub fn folder(&self) -> &Path {
        match self {
            Case::Folder(folder) => folder,
            Case::Family(family) => &family.folder,
        }
    }
}

/// What to check.
#[derive(Debug)]
pub struct Plan {
    /// The case.
    pub case: Case,
    /// A model to check beside the dmd surrogate.
    pub model: Option<PathBuf>,
    /// A training configuration: a network of its shape is made from the case's own steps.
    pub config: Option<PathBuf>,
    /// Wall time of the solver for each surrogate, s.
    pub seconds: u64,
    /// The user's wish to stop.
    pub stop: &'static AtomicU8,
}

/// What came of one surrogate.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Finding {
    /// dmd, network.
    pub surrogate: String,
    /// Why it does not fit, or is not told to; none: it does.
    pub why: Option<String>,
    /// Whether its run was ended before it could be told.
    pub open: bool,
    /// What the function object did, and what m4gn warned of.
    pub notes: Vec<String>,
    /// How far it came.
    pub report: Report,
    /// What a stride takes with the window that is suggested, s: of the dmd surrogate that jumped.
    pub stride: Option<f64>,
}

impl Finding {
    /// Whether it fits, in words.
    pub fn verdict(&self) -> String {
        match &self.why {
            None => "fits".into(),
            Some(what) if self.open => format!("cannot be told yet: {what}"),
            Some(why) => format!("does not fit: {why}"),
        }
    }
}

/// What came of a case.
#[derive(Clone, Debug, Serialize)]
pub struct Checked {
    /// Its folder, or the family.
    pub case: String,
    /// Its solver.
    pub application: String,
    /// What had to be done before.
    pub notes: Vec<String>,
    /// Each surrogate.
    pub findings: Vec<Finding>,
}

/// Checks a case.
///
/// # Errors
/// What keeps the solver from being run at all: files that are missing, programs that are not there.
pub fn run(plan: &Plan) -> Result<Checked> {
    let folder = scratch()?;
    let room = &plain_path(folder.path())?;
    // Reading the mesh, a first step and making the surrogate come before the function object can end the run.
    let tools = surroundings(plan.stop, Duration::from_secs(20 * plan.seconds + 120))?;
    let case = match &plan.case {
        Case::Folder(case) => case.clone(),
        Case::Family(family) => {
            let folder = room.join("family");
            draw(family, &folder, &tools)?;
            folder
        }
    };
    let copy = Copy::new(&plain_path(&case)?, &room.join("beside"), None, &tools)?;
    let programs: Vec<&str> =
        copy.application.split('/').take(1).chain((copy.ranks > 0).then_some("mpirun")).collect();
    environment(&programs)?;

    let mut findings = vec![one(plan, &copy, "dmd", "", &tools)?];
    let model = match (&plan.model, &plan.config) {
        (Some(model), _) => Some(Ok(plain_path(model)?)),
        (None, Some(config)) => Some(random(&copy, config, &findings[0].report, room, &tools)),
        (None, None) => None,
    };
    match model {
        None => {}
        Some(Ok(model)) => {
            let entries = format!("model \"{}\"; precision auto;", model.display());
            findings.push(one(plan, &copy, "network", &entries, &tools)?);
        }
        Some(Err(Error::Interrupted(e))) => return Err(Error::Interrupted(e)),
        Some(Err(e)) => findings.push(Finding {
            surrogate: "network".into(),
            why: Some(format!("no network can be made of the configuration and this case: {e}")),
            ..Finding::default()
        }),
    }
    let case = match &plan.case {
        Case::Folder(case) => case.display().to_string(),
        Case::Family(family) => format!("family {}", family.name),
    };
    Ok(Checked { case, application: copy.application, notes: copy.notes, findings })
}

/// The first draw of a family as a case.
fn draw(family: &Family, folder: &Path, tools: &Surroundings) -> Result<()> {
    let settings = family.hybrid.as_ref().map(|h| h.settings(&Settings::new())).unwrap_or_default();
    let draw = family.draw(1, 0, &settings)?;
    environment(&family.programs(&draw)?)?;
    let recording = &family.recording;
    let (interval, end) = match &family.hybrid {
        Some(hybrid) => (hybrid.interval, hybrid.end),
        None => (recording.interval, recording.spin_up + f64::from(recording.frames) * recording.interval),
    };
    let delta_t = interval / f64::from(family.steps(&draw, interval)?);
    family.write(&family.files(&draw, Times { delta_t, end, write_interval: interval })?, "", folder)?;
    family.prepare(&draw, folder, tools)
}

/// Runs the solver with one surrogate.
fn one(plan: &Plan, copy: &Copy, surrogate: &str, entries: &str, tools: &Surroundings) -> Result<Finding> {
    let path = copy.folder.join("report.json");
    let _ = fs::remove_file(&path);
    let (tables, of_region) = match copy.region() {
        Some(region) => (format!("{region}/{NAME}"), format!("region {region};")),
        None => (NAME.to_string(), String::new()),
    };
    // Of the surrogate before
    let _ = fs::remove_dir_all(copy.folder.join("postProcessing").join(&tables));
    copy.control_dict(
        "",
        &format!(
            "{NAME} {{ type m4gnSurrogate; mode check; report \"{}\"; seconds {}; surrogates ({surrogate}); {entries} {of_region} libs (m4gnFoam); }}",
            path.display(),
            plan.seconds
        ),
    )?;
    let (solver, start) = (copy.solver(), Instant::now());
    let done = tools.run(&copy.folder, &solver);
    let late = done.is_err() && start.elapsed() > tools.timeout;
    if let Err(Error::Interrupted(e)) = done {
        return Err(Error::Interrupted(e));
    }
    let log = words(copy, &excerpt(&copy.folder.join(format!("log.{}", program(&solver)))));
    let text = fs::read_to_string(&path).unwrap_or_default();
    let report: Report = match text.is_empty() {
        true => Report::default(),
        false => serde_json::from_str(&text)
            .map_err(|e| Error::Internal(format!("report of mode check: {e}: {text}")))?,
    };
    let failed = done.err();
    let decisions = decisions::read(&copy.folder, &tables)?;
    let end = End { log: &log, failed: failed.as_ref(), late, seconds: plan.seconds, decisions: &decisions };
    let (why, open) = match Verdict::of(&report, &end, &copy.application) {
        Verdict::Fits => (None, false),
        Verdict::No(why) => (Some(why), false),
        Verdict::Open(what) => (Some(what), true),
    };
    let mut notes: Vec<String> =
        decisions::last(&decisions, "handed_back").map(jump_text).into_iter().collect();
    notes.extend(log::warnings(&log).into_iter().map(|w| format!("warning: {w}")));
    let stride = report.suggestion().and_then(|s| stride(&decisions, s.window));
    Ok(Finding { surrogate: surrogate.into(), why, open, notes, stride, report })
}

/// A text of a run in the copy, in the words of the case.
fn words(copy: &Copy, text: &str) -> String {
    copy.in_words_of_the_case(text).replace(NAME, CALLED)
}

/// What the jump was, for people.
fn jump_text(jump: &Decision) -> String {
    let told = jump["quantities"].as_object().into_iter().flatten();
    let told: String =
        told.map(|(name, v)| format!("; {name} {}", number(v.as_f64().unwrap_or(f64::NAN), 2))).collect();
    format!(
        "jumped {} steps to time {} in {} s{told}",
        jump["strides"],
        figure(jump["time"].as_f64(), 3),
        number(seconds(jump), 2)
    )
}

/// Wall time of a jump, s.
fn seconds(jump: &Decision) -> f64 {
    ["surrogate_seconds", "hand_over_seconds"].iter().filter_map(|name| jump[*name].as_f64()).sum()
}

/// What a stride of the dmd surrogate takes with this window, s: what the jump of one stride took, and what each further state adds. None:
/// there was none.
fn stride(decisions: &[Decision], window: usize) -> Option<f64> {
    let jump = decisions::last(decisions, "handed_back").filter(|jump| jump["strides"] == 1)?;
    let fit = decisions.iter().find(|d| d["event"] == "fit" && d["seconds_a_state"].is_number())?;
    let added = (window as f64 - fit["states"].as_f64()?) * fit["seconds_a_state"].as_f64()?;
    Some(seconds(jump) + added)
}

/// A network of the shape of a configuration, made from a few steps of the solver: its weights are random, its ranges the case's.
fn random(copy: &Copy, config: &Path, report: &Report, room: &Path, tools: &Surroundings) -> Result<PathBuf> {
    let mut table = delta::table(config)?;
    let wrong = || {
        Error::file(
            config,
            "has no table [model] with fields: expected a configuration of 'm4gn train' (docs/reference/training.md)",
        )
    };
    let model = table.get_mut("model").and_then(toml::Value::as_table_mut).ok_or_else(wrong)?;
    let fields = model.get("fields").and_then(toml::Value::as_array).ok_or_else(wrong)?;
    let names: Vec<String> =
        fields.iter().filter_map(|f| Some(f.get("name")?.as_str()?.to_string())).collect();
    refuse(report.delta_t <= 0.0, Error::Input, || "the solver came to no step (see dmd)")?;
    let stride = STEPS as f64 * report.delta_t;
    model.insert("stride".into(), stride.into());
    if let Some(training) = table.get_mut("training").and_then(toml::Value::as_table_mut) {
        for (key, value) in [("batch_size", 1), ("normaliser_steps", 1), ("normaliser_warmup", 1)] {
            training.insert(key.into(), toml::Value::from(value));
        }
        training.remove("unroll");
        training.remove("restarts");
    }
    let (data, own, out) = (room.join("data.h5"), room.join("config.toml"), room.join("random.safetensors"));
    fs::write(&own, table.to_string()).map_err(|e| Error::file(&own, e.to_string()))?;
    // Frames are equally far apart, also where the solver would change its step
    copy.control_dict(
        &format!(
            "adjustTimeStep no;\ndeltaT {};\nendTime {};",
            report.delta_t,
            report.start_time + (STEPS * FRAMES) as f64 * report.delta_t
        ),
        &format!(
            "{NAME} {{ type m4gnRecorder; fields ({}); file \"{}\"; overwrite yes; writeControl timeStep; writeInterval {STEPS}; libs (m4gnFoam); }}",
            names.join(" "),
            data.display()
        ),
    )?;
    let solver = copy.solver();
    tools.run(&copy.folder, &solver).map_err(|e| {
        let log = excerpt(&copy.folder.join(format!("log.{}", program(&solver))));
        match e {
            Error::Interrupted(_) => e,
            e => Error::Input(words(copy, &log::words(&log, &e)).replace("--timeout", "--seconds")),
        }
    })?;
    let request = Request {
        data,
        config: own,
        out: out.clone(),
        threads: Some(1),
        steps: Some(1),
        ..Request::default()
    };
    train_native(&request, tools.stop, &Comm::serial())?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_run_that_only_needs_more_time_is_not_said_not_to_fit() {
        let of = |why: Option<&str>, open| {
            Finding { why: why.map(String::from), open, ..Finding::default() }.verdict()
        };
        assert_eq!(of(None, false), "fits");
        assert_eq!(of(Some("give --seconds 45"), true), "cannot be told yet: give --seconds 45");
        assert_eq!(of(Some("no U"), false), "does not fit: no U");
    }

    #[test]
    fn each_state_of_a_window_has_its_share_of_a_stride() {
        let fit = json!({"time": 1.0, "event": "fit", "states": 14, "seconds_a_state": 5e-4});
        let jump = json!({"time": 2.0, "event": "handed_back", "strides": 1, "surrogate_seconds": 0.01,
            "hand_over_seconds": 0.008, "quantities": {"maxDivAfter": 2.6e-5}});
        let told = jump_text(&jump);
        assert!((stride(&[fit.clone(), jump], 40).unwrap() - 0.031).abs() < 1e-12);
        assert_eq!(stride(&[fit], 40), None);
        assert_eq!(told, "jumped 1 steps to time 2.00 in 0.018 s; maxDivAfter 2.6e-5");
    }
}
