//! A training of a study and its validations.

use super::check::Checked;
use super::{Cell, Data, Network, Plan, Test};
use crate::generate::openfoam::absolute;
use crate::generate::process::Surroundings;
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, files};
use m4gn_model::Model;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A cell, as far as it is done.
pub(super) struct Job<'a> {
    plan: &'a Plan,
    data: &'a Data,
    network: &'a Network,
    seed: u64,
    place: PathBuf,
    /// Its configuration, and the number of its weights.
    config: &'a (String, u64),
    /// What it is made from: names and digests, a line each.
    made_from: String,
    /// What of that is another than that of what is there.
    differs: Option<String>,
    tests: Vec<Validation>,
}

/// A validation, its figures where they are there.
struct Validation {
    test: Test,
    count: Option<usize>,
    made_from: String,
    figures: Option<Value>,
}

impl<'a> Job<'a> {
    /// Looks at what is there.
    ///
    /// # Errors
    /// [`Error::File`] where its folder cannot be used, or the model of validations that are missing cannot be read.
    pub(super) fn new(
        plan: &'a Plan,
        (data, network, seed): (&'a Data, &'a Network, u64),
        folder: &Path,
        checked: &'a Checked,
    ) -> Result<Self> {
        let place = folder.join(&data.name).join(&network.name).join(seed.to_string());
        fs::create_dir_all(&place).map_err(Error::cannot("made", &place))?;
        let config = &checked.configs[&(data.name.clone(), network.name.clone())];
        let mut job = Job {
            made_from: made_from(plan, seed, &config.0, &checked.data[&data.train]),
            differs: None,
            tests: Vec::new(),
            plan,
            data,
            network,
            seed,
            place,
            config,
        };
        files::check_writable(&job.at("made-from"))?;
        let before = fs::read_to_string(job.at("made-from")).unwrap_or_default();
        let begun =
            ["made-from", "train.json", "model.checkpoint", "model.safetensors"].map(|f| job.at(f).exists());
        job.differs =
            (begun.contains(&true) && before != job.made_from).then(|| differing(&before, &job.made_from));
        let trained = job.differs.is_none() && job.at("train.json").is_file();
        for test in data.tests().iter() {
            for count in std::iter::once(None).chain(network.segments.iter().map(|&n| Some(n))) {
                let mut digest = Digest::default();
                let parts = [&job.made_from, &checked.data[&test.data], &test.split, &format!("{count:?}")];
                parts.iter().for_each(|part| digest.add("", part.as_bytes()));
                let mut validation =
                    Validation { test: test.clone(), count, made_from: digest.text(), figures: None };
                let kept = read(&job.at(&validation.file())).ok().filter(|_| trained);
                validation.figures = kept.filter(|v| v["made_from"] == validation.made_from[..]);
                job.tests.push(validation);
            }
        }
        if trained && job.tests.iter().any(|t| t.figures.is_none()) {
            let read = Model::read(job.at("model.safetensors")).map_err(|e| e.to_string());
            read.map_err(|e| {
                Error::file(job.at("train.json"), format!("is of a model that is no more: {e}; remove both"))
            })?;
        }
        Ok(job)
    }

    /// What is to be said before it is run.
    pub(super) fn notes(&self) -> Option<String> {
        let differs = self.differs.as_ref()?;
        let kept = self.earlier();
        Some(format!(
            "is trained anew, with another {differs}; what was there before is kept in {}",
            kept.display()
        ))
    }

    /// Disk that it will take, bytes.
    pub(super) fn bytes(&self) -> u64 {
        match self.differs.is_none() && self.at("train.json").is_file() {
            true => 0,
            // A model, and a checkpoint of weights, two moments, average and best ones, twice while it is replaced.
            false => self.config.1.saturating_mul(4 * (1 + 2 * 5)),
        }
    }

    /// Trains and validates what is missing.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when the user stops; what fails.
    pub(super) fn run(&self, tools: &Surroundings) -> Result<Cell> {
        if self.differs.is_some() {
            self.keep_earlier()?;
        }
        let at = |name: &str| self.at(name);
        if !at("train.json").is_file() {
            files::write_whole(&at("config.toml"), self.config.0.as_bytes())?;
            files::write_whole(&at("made-from"), self.made_from.as_bytes())?;
            let mut train =
                words("train --config config.toml --out model.safetensors --json train.json --resume");
            train.extend(["--data".into(), path(&self.data.train)?, "--seed".into(), self.seed.to_string()]);
            for (option, value) in [("--backend", &self.plan.backend), ("--device", &self.plan.device)] {
                train.extend(value.iter().flat_map(|v| [option.to_string(), v.clone()]));
            }
            self.program(tools, train, "log.train")?;
        }
        let tests = self.tests.iter().map(|validation| {
            let figures = match &validation.figures {
                Some(figures) => figures.clone(),
                None => self.validate(tools, validation)?,
            };
            Ok((validation.test.name.clone(), validation.count, figures))
        });
        Ok(Cell {
            data: self.data.name.clone(),
            network: self.network.name.clone(),
            seed: self.seed,
            tests: tests.collect::<Result<_>>()?,
            training: read(&at("train.json"))?,
        })
    }

    fn validate(&self, tools: &Surroundings, validation: &Validation) -> Result<Value> {
        let Validation { test, count, made_from, .. } = validation;
        let mut validate = words("validate --model model.safetensors --json validate.json --split");
        validate.extend([test.split.clone(), "--data".into(), path(&test.data)?]);
        validate.extend(count.iter().flat_map(|n| ["--segments".into(), n.to_string()]));
        let written = self.at("validate.json");
        let _ = fs::remove_file(&written);
        match self.program(tools, validate, "log.validate") {
            // A rollout that is not finite is a result: its figures are written.
            Err(Error::File { .. }) if written.is_file() => {}
            done => done?,
        }
        let mut figures = read(&written)?;
        figures["made_from"] = made_from[..].into();
        files::write_whole(&self.at(&validation.file()), format!("{figures:#}\n").as_bytes())?;
        Ok(figures)
    }

    /// Runs this program; its output is `log` in the cell's folder.
    fn program(&self, tools: &Surroundings, arguments: Vec<String>, log: &str) -> Result<()> {
        let program =
            std::env::current_exe().map_err(|e| Error::Input(format!("this program is not found: {e}")))?;
        let threads = ["--threads".to_string(), self.plan.threads.to_string()];
        let command: Vec<String> =
            [program.display().to_string()].into_iter().chain(arguments).chain(threads).collect();
        let done = tools.run(&self.place, &command);
        let name = program.file_name().unwrap_or_default().to_string_lossy();
        let _ = fs::rename(self.at(&format!("log.{name}")), self.at(log));
        done.map_err(|e| match e {
            Error::File { message, .. } => Error::file(self.at(log), message),
            e => e,
        })
    }

    fn at(&self, name: &str) -> PathBuf {
        self.place.join(name)
    }

    /// Where what is there is put, when it is to be made anew.
    fn earlier(&self) -> PathBuf {
        let names = (1..).map(|i| self.at(&format!("earlier-{i}")));
        names.into_iter().find(|place| !place.exists()).unwrap_or_default()
    }

    fn keep_earlier(&self) -> Result<()> {
        let earlier = self.earlier();
        let failed =
            |e: std::io::Error| Error::file(&earlier, format!("cannot be made of what is there: {e}"));
        fs::create_dir(&earlier).map_err(failed)?;
        for entry in self.place.read_dir().map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if entry.file_type().map_err(failed)?.is_file() {
                fs::rename(entry.path(), earlier.join(entry.file_name())).map_err(failed)?;
            }
        }
        Ok(())
    }
}

impl Validation {
    /// The file of its figures, which is none of the training's whatever the test is named.
    fn file(&self) -> String {
        let more = self.count.map_or(String::new(), |n| format!("-{n}-segments"));
        format!("test-{}{more}.json", self.test.name)
    }
}

/// What a training is made from.
fn made_from(plan: &Plan, seed: u64, config: &str, data: &str) -> String {
    let mut of_config = Digest::default();
    of_config.add("", config.as_bytes());
    let options = (&plan.backend, &plan.device, plan.threads, seed);
    format!("configuration {}\ndata set {data}\noptions {options:?}\n", of_config.text())
}

/// The names of the lines that are others.
fn differing(before: &str, now: &str) -> String {
    if before.lines().count() != now.lines().count() {
        return "version of m4gn".into();
    }
    let changed = now.lines().filter(|line| !before.lines().any(|old| old == *line));
    let names: Vec<&str> = changed.filter_map(|line| line.rsplit_once(' ').map(|(name, _)| name)).collect();
    let name = |name: &str| {
        if name.starts_with("options") { "backend, device, threads or seed".into() } else { name.to_string() }
    };
    names.into_iter().map(name).collect::<Vec<_>>().join(" and ")
}

fn words(text: &str) -> Vec<String> {
    text.split(' ').map(String::from).collect()
}

fn path(path: &Path) -> Result<String> {
    let path = absolute(path)?;
    path.to_str().map(String::from).ok_or_else(|| Error::file(&path, "expected a name in UTF-8"))
}

fn read(file: &Path) -> Result<Value> {
    let text = files::read_text(file).map_err(Error::cannot("read", file))?;
    serde_json::from_str(&text)
        .map_err(|e| Error::file(file, format!("is not what 'm4gn' wrote: {e}; remove it")))
}
