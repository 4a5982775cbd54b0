//! A study: networks on data sets with several seeds, at equal updates or equal time, each trained and validated by this program in a process
//! of its own. What is done is kept; the same command goes on where it was stopped.

mod plan;
mod report;

pub use plan::{Data, Network, Plan, Test};
pub use report::Report;

use crate::digest::Digest;
use crate::generate::openfoam::absolute;
use crate::generate::process::Surroundings;
use m4gn_base::{Error, Result, files};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
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

/// Runs what is missing of a study in `folder`. `say` is told of each cell as it ends. Gives the cells and how many failed.
///
/// # Errors
/// [`Error::Interrupted`] when the user stops; [`Error::File`] where nothing can be written. A training or validation that fails is told and
/// counted.
pub fn run(
    plan: &Plan,
    folder: &Path,
    stop: &'static AtomicU8,
    say: &mut dyn FnMut(&str),
) -> Result<(Vec<Cell>, usize)> {
    let folder = absolute(folder)?;
    let program =
        std::env::current_exe().map_err(|e| Error::Input(format!("this program is not found: {e}")))?;
    let tools = Surroundings { stop, timeout: Duration::from_secs(u64::MAX / 4), environment: Vec::new() };
    let (cells, mut done, mut failed) = (plan.cells(), Vec::new(), 0);
    for (i, &(data, network, seed)) in cells.iter().enumerate() {
        let name = format!("{}/{} {}/{}/{seed}", i + 1, cells.len(), data.name, network.name);
        let place = folder.join(&data.name).join(&network.name).join(seed.to_string());
        let job =
            Job { plan, data, network, seed, place, program: program.display().to_string(), tools: &tools };
        match job.run() {
            Ok(cell) => {
                say(&format!("{name}: {}", cell.line()));
                done.push(cell);
            }
            Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
            Err(e) => {
                say(&format!("{name}: failed: {e}"));
                failed += 1;
            }
        }
    }
    Ok((done, failed))
}

/// One training and its validations.
struct Job<'a> {
    plan: &'a Plan,
    data: &'a Data,
    network: &'a Network,
    seed: u64,
    place: PathBuf,
    program: String,
    tools: &'a Surroundings,
}

impl Job<'_> {
    fn run(&self) -> Result<Cell> {
        fs::create_dir_all(&self.place)
            .map_err(|e| Error::file(&self.place, format!("cannot be made: {e}")))?;
        let at = |name: &str| self.place.join(name);
        let config = self.plan.config(self.data, self.network)?;
        let mut digest = Digest::default();
        digest.add("config", config.as_bytes());
        add_data(&mut digest, &self.data.train)?;
        let options = (&self.plan.backend, &self.plan.device, self.plan.threads, self.seed);
        digest.add("options", format!("{options:?}").as_bytes());
        // What was made from something else does not count.
        if fs::read_to_string(at("made-from")).ok().as_deref() != Some(&digest.text()) {
            for old in ["train.json", "model.safetensors", "model.checkpoint", "model.csv"] {
                let _ = fs::remove_file(at(old));
            }
            files::write_whole(&at("config.toml"), config.as_bytes())?;
            files::write_whole(&at("made-from"), digest.text().as_bytes())?;
        }
        if !at("train.json").is_file() {
            let mut train =
                words("train --config config.toml --out model.safetensors --json train.json --resume");
            train.extend(["--data".into(), path(&self.data.train)?, "--seed".into(), self.seed.to_string()]);
            for (option, value) in [("--backend", &self.plan.backend), ("--device", &self.plan.device)] {
                train.extend(value.iter().flat_map(|v| [option.to_string(), v.clone()]));
            }
            self.program(train, "log.train")?;
        }
        let own = [Test { name: "test".into(), data: self.data.train.clone(), split: "test".into() }];
        let tests = if self.data.test.is_empty() { &own[..] } else { &self.data.test };
        let counts = || std::iter::once(None).chain(self.network.segments.iter().map(|&n| Some(n)));
        let mut found = Vec::new();
        for (test, count) in tests.iter().flat_map(|t| counts().map(move |n| (t, n))) {
            let mut digest = digest;
            add_data(&mut digest, &test.data)?;
            digest.add("split", test.split.as_bytes());
            let more = count.map_or(String::new(), |n| format!("-{n}-segments"));
            let file = format!("{}{more}.json", test.name);
            let record = |text: String| serde_json::from_str::<Value>(&text).ok();
            let kept = fs::read_to_string(at(&file)).ok().and_then(record);
            let figures = match kept.filter(|v| v["made_from"] == Value::String(digest.text())) {
                Some(figures) => figures,
                None => self.validate(test, count, (&at(&file), &digest.text()))?,
            };
            found.push((test.name.clone(), count, figures));
        }
        Ok(Cell {
            data: self.data.name.clone(),
            network: self.network.name.clone(),
            seed: self.seed,
            training: read(&at("train.json"))?,
            tests: found,
        })
    }

    fn validate(&self, test: &Test, count: Option<usize>, (file, digest): (&Path, &str)) -> Result<Value> {
        let mut validate = words("validate --model model.safetensors --json validate.json --split");
        validate.extend([test.split.clone(), "--data".into(), path(&test.data)?]);
        validate.extend(count.into_iter().flat_map(|n| ["--segments".into(), n.to_string()]));
        let written = self.place.join("validate.json");
        let _ = fs::remove_file(&written);
        match self.program(validate, "log.validate") {
            // A rollout that is not finite is a result: its figures are written.
            Err(Error::File { .. }) if written.is_file() => {}
            done => done?,
        }
        let mut figures = read(&written)?;
        figures["made_from"] = digest.into();
        files::write_whole(file, format!("{figures:#}\n").as_bytes())?;
        Ok(figures)
    }

    /// Runs this program; its output is `log` in the cell's folder.
    fn program(&self, arguments: Vec<String>, log: &str) -> Result<()> {
        let threads = ["--threads".to_string(), self.plan.threads.to_string()];
        let command: Vec<String> =
            [self.program.clone()].into_iter().chain(arguments).chain(threads).collect();
        let done = self.tools.run(&self.place, &command);
        let name = self.program.rsplit('/').next().unwrap_or_default();
        let _ = fs::rename(self.place.join(format!("log.{name}")), self.place.join(log));
        done.map_err(|e| match e {
            Error::File { message, .. } => Error::file(self.place.join(log), message),
            e => e,
        })
    }
}

fn words(text: &str) -> Vec<String> {
    text.split(' ').map(String::from).collect()
}

fn path(path: &Path) -> Result<String> {
    let path = absolute(path)?;
    path.to_str().map(String::from).ok_or_else(|| Error::file(&path, "expected a name in UTF-8"))
}

/// Names, lengths and times of the files of a data set.
fn add_data(digest: &mut Digest, data: &Path) -> Result<()> {
    let missing = |e: std::io::Error| Error::file(data, format!("cannot be read: {e}"));
    let mut all = match data.is_dir() {
        true => fs::read_dir(data)
            .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>())
            .map_err(missing)?,
        false => vec![data.to_path_buf()],
    };
    all.retain(|p| p.extension().is_some_and(|e| e == "h5") || p == data);
    all.sort();
    for file in all {
        let about = fs::metadata(&file).map_err(missing)?;
        let changed = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        digest.add(&file.to_string_lossy(), format!("{} {changed:?}", about.len()).as_bytes());
    }
    Ok(())
}

fn read(file: &Path) -> Result<Value> {
    let text = fs::read_to_string(file).map_err(|e| Error::file(file, format!("cannot be read: {e}")))?;
    serde_json::from_str(&text)
        .map_err(|e| Error::file(file, format!("is not what 'm4gn' wrote: {e}; remove it")))
}
