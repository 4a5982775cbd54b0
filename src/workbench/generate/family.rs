//! A family of OpenFOAM cases as a folder of data: `family.toml` beside the case's files.
//!
//! The files are a case in which `@name@` stands for a parameter or a derived quantity, and for `@endTime@`, `@deltaT@` and
//! `@writeInterval@`; its `controlDict` includes `system/functions`, which the command writes. docs/reference/families.md describes
//! every key.

use super::case::fill;
use super::command::Command;
use super::expression::{self, Variables};
use super::parameter::{
    self, Parameter, Setting, Settings, Value, check_decimals, is_word, rounded, shortened,
};
use super::requirement::Requirement;
use m4gn_base::{Error, Result, files, listed, refuse};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// What a folder must hold to be a family.
pub const FILE: &str = "family.toml";

/// Names that templates may use beside those of the family.
pub(super) const RESERVED: [&str; 3] = ["deltaT", "endTime", "writeInterval"];

/// What the provenance of a recording says beside the quantities of its family.
const PROVENANCE: [&str; 15] = [
    "command",
    "family",
    "seed",
    "index",
    "inputs",
    "frames",
    "frameInterval",
    "spinUp",
    "application",
    "case",
    "openfoam",
    "m4gn",
    "ranks",
    "solid",
    "interval",
];

/// A family.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Family {
    /// Name of the folder.
    #[serde(skip)]
    pub name: String,
    /// The folder.
    #[serde(skip)]
    pub folder: PathBuf,
    /// What is computed, in a line.
    pub about: String,
    /// More of it.
    #[serde(default)]
    pub details: String,
    /// What is said of a case beside its number, with `@name@`.
    #[serde(default)]
    pub label: String,
    /// Decimals that draws are rounded to.
    #[serde(default = "six")]
    pub decimals: i32,
    /// Commands that make the mesh and the first fields, in their order.
    #[serde(default)]
    pub prepare: Vec<Command>,
    /// The solver.
    pub solver: Vec<String>,
    /// Steps of the solver in `interval` seconds.
    pub steps: String,
    /// What is recorded.
    pub recording: Recording,
    /// Parameters in the order of their draw.
    #[serde(default, rename = "parameter")]
    pub parameters: Vec<Parameter>,
    /// Quantities that follow from the parameters and from the ones before.
    #[serde(default, rename = "derived")]
    pub derived: Vec<Derived>,
    /// What must hold of every case.
    #[serde(default, rename = "require")]
    pub requirements: Vec<Requirement>,
    /// What `m4gn hybrid` runs.
    pub hybrid: Option<Hybrid>,
}

fn six() -> i32 {
    6
}

/// What a trajectory holds unless the user says otherwise.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Fields, as the function object m4gnRecorder names them.
    pub fields: Vec<String>,
    /// Frames after the first one.
    pub frames: u32,
    /// Time between frames, s.
    pub interval: f64,
    /// Time of the first frame, s.
    pub spin_up: f64,
}

/// A quantity that follows from the parameters.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Derived {
    /// Name.
    pub name: String,
    /// What it is.
    #[serde(default)]
    pub about: String,
    /// Expression.
    pub value: String,
    /// Decimals that it is rounded to.
    pub decimals: Option<i32>,
    /// Whether it is kept with the data.
    #[serde(default)]
    pub record: bool,
}

/// Hybrid runs: the solver alone, then by turns with the surrogate.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hybrid {
    /// The solver is alone before, s.
    pub start_up: f64,
    /// End of the runs, s.
    pub end: f64,
    /// Time between stored times, s.
    pub interval: f64,
    /// Time that the solver does before each jump, s.
    pub solver_time: f64,
    /// Strides of the model in a jump.
    pub surrogate_steps: u32,
    /// Patch whose forces are compared.
    pub patch: Option<String>,
    /// Quantity by which the cases are put in order.
    pub order_by: Option<String>,
    /// Settings of all runs.
    #[serde(default)]
    pub set: Settings,
    /// Settings of the runs with the surrogate, beside these.
    #[serde(default)]
    pub hybrid_set: Settings,
    /// Files in `lib`, beside `libm4gnFoam.so`, that the runs load.
    #[serde(default)]
    pub libraries: Vec<String>,
    /// Cheaper plain solvers, to compare at equal cost.
    #[serde(default)]
    pub plain: Vec<Plain>,
    /// Figures that users of such runs ask for.
    pub answers: Option<Answers>,
}

/// Figures of a run, and how well they are to be known.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answers {
    /// Function objects that publish them; `@name@` is a quantity of the family.
    pub functions: String,
    /// `quantities` of m4gnAverages.
    pub quantities: String,
    /// `minTime` of m4gnAverages, s.
    pub min_time: f64,
    /// End of the runs that do not know before, and of the full one, s.
    pub end: f64,
}

/// A plain solver with other settings.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plain {
    /// Name.
    pub name: String,
    /// Its settings.
    pub set: Settings,
}

/// One case: the value of every parameter, and what follows.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// Parameters in their order.
    pub values: Vec<(String, Value)>,
    /// Numbers of parameters and derived quantities.
    pub variables: Variables,
}

impl Family {
    /// Reads `folder/family.toml` and checks all that can be checked before a case is drawn.
    ///
    /// # Errors
    /// [`Error::File`] naming the file and what is wrong in it.
    pub fn load(folder: &Path) -> Result<Self> {
        let file = folder.join(FILE);
        let folder = folder.canonicalize().map_err(Error::cannot("read", &file))?;
        let text = files::read_text(&file).map_err(Error::cannot("read", &file))?;
        let mut family: Family =
            toml::from_str(&text).map_err(|e| Error::file(&file, e.to_string().trim().to_string()))?;
        family.name = folder.file_name().and_then(|n| n.to_str()).unwrap_or_default().into();
        family.folder = folder;
        family.check().map_err(|e| Error::file(&file, e.to_string()))?;
        Ok(family)
    }

    fn check(&self) -> Result<()> {
        let fault = |what: String| Err(Error::Input(what));
        if !is_word(&self.name) {
            return fault(format!(
                "the folder is named '{}': expected at most 64 letters, digits, - and _",
                shortened(&self.name)
            ));
        }
        check_decimals(self.decimals)?;
        for derived in &self.derived {
            derived.decimals.map_or(Ok(()), check_decimals)?;
        }
        self.parameters.iter().try_for_each(Parameter::check)?;
        let parameters = self.parameters.iter().map(|p| p.name.as_str());
        let names: Vec<&str> = parameters.chain(self.derived.iter().map(|d| d.name.as_str())).collect();
        for (i, name) in names.iter().enumerate() {
            let taken = RESERVED.contains(name) || PROVENANCE.contains(name) || expression::is_reserved(name);
            if !is_word(name) || taken || names[..i].contains(name) {
                return fault(format!(
                    "'{}' cannot be the name of a quantity, or is one already",
                    shortened(name)
                ));
            }
        }
        let mut commands = self.prepare.iter().map(Command::words).chain([&self.solver[..]]);
        if let Some(empty) = commands.find(|c| c.first().is_none_or(String::is_empty)) {
            return fault(format!(
                "a command is '{}': expected a program and its arguments",
                empty.join(" ")
            ));
        }
        let r = &self.recording;
        times(r.interval, r.spin_up)?;
        let plain = |f: &&String| f.chars().any(|c| c.is_whitespace() || "\"'{};$#/".contains(c));
        if let Some(field) = r.fields.iter().find(|f| f.is_empty() || plain(f)) {
            return fault(format!("recording: '{field}' is no name of a field"));
        }
        let unknown = |text: &str| fill(text, |name| names.contains(&name).then(String::new)).1;
        let functions =
            self.hybrid.iter().flat_map(|h| &h.answers).map(|a| ("hybrid.answers: functions", &a.functions));
        for (what, text) in [("label", &self.label)].into_iter().chain(functions) {
            if let Some(name) = unknown(text) {
                return fault(format!(
                    "{what}: @{name}@ stands for no quantity: expected one of {}",
                    listed(&names)
                ));
            }
        }
        let Some(hybrid) = &self.hybrid else { return Ok(()) };
        hybrid.check()?;
        self.check_settings(&hybrid.set)?;
        self.check_settings(&hybrid.hybrid_set)?;
        for plain in &hybrid.plain {
            if !is_word(&plain.name) {
                return fault(format!("hybrid: '{}' is no name of a variant", plain.name));
            }
            self.check_settings(&plain.set)?;
        }
        match &hybrid.order_by {
            Some(name) if !names.contains(&name.as_str()) => {
                fault(format!("hybrid: there is no quantity '{name}' to order by"))
            }
            _ => Ok(()),
        }
    }

    /// Whether the parameters exist and can be set to this.
    ///
    /// # Errors
    /// [`Error::Input`] that lists the parameters, or what the parameter can be set to.
    pub fn check_settings(&self, settings: &Settings) -> Result<()> {
        settings.iter().try_for_each(|(name, setting)| {
            let known = self.parameters.iter().find(|p| &p.name == name);
            match known {
                Some(p) => p.check_setting(setting),
                None => {
                    let names = listed(self.parameters.iter().map(|p| &p.name));
                    Err(Error::Input(format!(
                        "family {} has no parameter '{name}': it has {names}",
                        self.name
                    )))
                }
            }
        })
    }

    /// Case `index` of the set `seed` with these settings: the same whatever else is drawn.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that [`Family::check_settings`] refuses, an expression or a condition that cannot be
    /// computed, or a requirement that does not hold.
    pub fn draw(&self, seed: u64, index: u64, settings: &Settings) -> Result<Draw> {
        self.check_settings(settings)?;
        let values = parameter::draw(&self.parameters, settings, seed, index, self.decimals)?;
        let mut variables = Variables::new();
        for (p, value) in self.parameters.iter().zip(&values) {
            variables.insert(p.name.clone(), p.number(value));
        }
        for derived in &self.derived {
            let mut value = expression::number(&derived.value, &variables)?;
            if let Some(decimals) = derived.decimals {
                value = rounded(value, decimals);
            }
            if !value.is_finite() {
                return Err(Error::Input(format!(
                    "quantity '{}' of case {index} is {value} once it is rounded: expected a finite number",
                    derived.name
                )));
            }
            variables.insert(derived.name.clone(), value);
        }
        for requirement in &self.requirements {
            if !requirement.holds(&variables)? {
                let drawn = self.parameters.iter().zip(&values).map(|(p, v)| format!("{} {v}", p.name));
                return Err(Error::Input(format!(
                    "case {index} of family {} cannot be: {} ({})",
                    self.name,
                    requirement.otherwise,
                    listed(drawn)
                )));
            }
        }
        let names = self.parameters.iter().map(|p| p.name.clone());
        let draw = Draw { values: names.zip(values).collect(), variables };
        // A condition that cannot be computed is told before the first case runs
        self.prepare.iter().try_for_each(|c| c.applies(&draw).map(|_| ()))?;
        Ok(draw)
    }

    /// Steps of the solver in `interval` seconds.
    ///
    /// # Errors
    /// [`Error::Input`] where the expression gives none.
    pub fn steps(&self, draw: &Draw, interval: f64) -> Result<u32> {
        let mut variables = draw.variables.clone();
        variables.insert("interval".into(), interval);
        let steps = (expression::number(&self.steps, &variables)? - 1e-6).ceil().max(1.0);
        match steps <= 1e7 {
            true => Ok(steps as u32),
            false => Err(Error::Input(format!(
                "family {}: {steps} steps of the solver in {interval} s: expected at most 1e7",
                self.name
            ))),
        }
    }

    /// The programs that a case's commands begin with, each once.
    ///
    /// # Errors
    /// As [`Command::applies`].
    pub fn programs(&self, draw: &Draw) -> Result<Vec<&str>> {
        let mut programs = Vec::new();
        for command in &self.prepare {
            if command.applies(draw)? {
                programs.push(command.words()[0].as_str());
            }
        }
        programs.push(self.solver[0].as_str());
        let mut seen = std::collections::BTreeSet::new();
        programs.retain(|p| seen.insert(*p));
        Ok(programs)
    }

    /// Parameters, one a line, for people.
    pub fn parameter_help(&self) -> String {
        let width = self.parameters.iter().map(|p| p.name.len()).max().unwrap_or(0);
        let line = |p: &Parameter| {
            let usual = match (&p.range, &p.value) {
                (Some([low, high]), _) => format!("{low}:{high}"),
                (_, Some(value)) => value.to_string(),
                _ => String::new(),
            };
            let choices = listed(p.choices.keys());
            let choices = if choices.is_empty() { choices } else { format!(": {choices}") };
            format!("  {:<width$}  {}{choices} [{usual}]\n", p.name, p.about)
        };
        self.parameters.iter().map(line).collect()
    }
}

impl Hybrid {
    /// Settings of all runs: the family's, and over them the user's.
    pub fn settings(&self, own: &Settings) -> Settings {
        let mut all = self.set.clone();
        all.extend(own.clone());
        all
    }

    /// Whether the times are in order.
    ///
    /// # Errors
    /// [`Error::Input`] where not.
    pub fn check(&self) -> Result<()> {
        let ordered = 0.0 < self.start_up
            && self.start_up + self.solver_time < self.end
            && self.end.is_finite()
            && self.interval.is_finite();
        let positive = self.interval > 0.0 && self.solver_time > 0.0 && self.surrogate_steps > 0;
        refuse(!(ordered && positive), Error::Input, || {
            format!(
                "hybrid runs: start_up {} s, solver_time {} s, end {} s, interval {} s, surrogate_steps {}: expected all \
                 above 0, and start_up + solver_time before the end",
                self.start_up, self.solver_time, self.end, self.interval, self.surrogate_steps
            )
        })
    }
}

impl Draw {
    /// The text with each `@name@` of the family replaced.
    pub fn text(&self, template: &str) -> String {
        fill(template, |name| self.variables.get(name).map(f64::to_string)).0
    }
}

/// Whether frames every `interval` seconds from `spin_up` on can be recorded.
///
/// # Errors
/// [`Error::Input`] where not.
pub fn times(interval: f64, spin_up: f64) -> Result<()> {
    match interval >= 1e-6 && spin_up >= 0.999_999 * interval && spin_up.is_finite() {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "frames every {interval} s from {spin_up} s on: expected an interval of at least 1e-6 s, and a spin-up of at \
             least one interval"
        ))),
    }
}

/// The settings as options of a command, for provenance.
pub fn settings_text(settings: &Settings) -> String {
    let one = |(name, setting): (&String, &Setting)| format!(" --set {name}={setting}");
    settings.iter().map(one).collect()
}
