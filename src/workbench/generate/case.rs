//! A case of a family, from nothing to a trajectory: files from templates, the family's commands, the check of what was
//! recorded.

use super::family::{Draw, FILE, Family, RESERVED};
use super::openfoam::lies_in;
use super::parameter::Value;
use super::process::Surroundings;
use super::queue::{Case, other_number};
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, files, listed, refuse};
use m4gn_data::{Split, Trajectory};
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Name of the recording inside the case.
const RECORDING: &str = "trajectory.h5";

/// What `system/controlDict` says of time.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// Step of the solver, s.
    pub delta_t: f64,
    /// End of the run, s.
    pub end: f64,
    /// Time between stored fields, s.
    pub write_interval: f64,
}

/// Everything that makes a case of a data set.
#[derive(Clone, Debug)]
pub struct FamilyCase {
    /// The family.
    pub family: Arc<Family>,
    /// Seed of the set.
    pub seed: u64,
    /// Number of the case in the set.
    pub index: u64,
    /// What was drawn.
    pub draw: Draw,
    /// What the trajectory is for.
    pub split: Split,
    /// Frames after the first one.
    pub frames: u32,
    /// Time between frames, s.
    pub interval: f64,
    /// Time of the first frame, s.
    pub spin_up: f64,
    /// The command, for provenance.
    pub command: String,
}

/// What there is to say about a trajectory that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Figures {
    /// Number of cells.
    pub cells: usize,
    /// Number of frames.
    pub frames: usize,
    /// Largest Courant number that the solver reported.
    pub courant: Option<f64>,
}

/// The files of a case, relative to its folder, and their contents.
pub(crate) type Files = Vec<(PathBuf, Vec<u8>)>;

impl Family {
    /// The files of a case but `system/functions`, which says what is recorded or replaced.
    ///
    /// # Errors
    /// [`Error::File`] when a file cannot be read, is none, or has a placeholder that the family does not know.
    pub(crate) fn files(&self, draw: &Draw, times: Times) -> Result<Files> {
        let value = |name: &str| match name {
            "deltaT" => Some(times.delta_t.to_string()),
            "endTime" => Some(times.end.to_string()),
            "writeInterval" => Some(times.write_interval.to_string()),
            _ => draw.variables.get(name).map(f64::to_string),
        };
        let read = |file: PathBuf| {
            let from = self.folder.join(&file);
            let bytes = files::read(&from).map_err(Error::cannot("read", &from))?;
            let bytes = match String::from_utf8(bytes) {
                Err(binary) => binary.into_bytes(),
                Ok(text) => match fill(&text, value) {
                    (text, None) => text.into_bytes(),
                    (_, Some(unknown)) => {
                        let known = listed(draw.variables.keys().map(String::as_str).chain(RESERVED));
                        let what = "stands for nothing: expected @NAME@ with one of";
                        return Err(Error::file(from, format!("@{unknown}@ {what} {known}")));
                    }
                },
            };
            Ok((file, bytes))
        };
        files(&self.folder)?.into_iter().map(read).collect()
    }

    /// Writes a case into a new folder; `functions` is the text of its `system/functions`.
    ///
    /// # Errors
    /// [`Error::File`] when a file cannot be written.
    pub(crate) fn write(&self, files: &Files, functions: &str, folder: &Path) -> Result<()> {
        for (file, bytes) in files {
            let to = folder.join(file);
            put(&to, bytes)?;
            stay_program(&self.folder.join(file), &to)?;
        }
        put(&folder.join("system/functions"), functions)
    }

    /// A digest of all that a case is made from: its files, and the commands that run in it, in their order.
    ///
    /// # Errors
    /// [`Error::Input`] for a condition that cannot be computed.
    pub(crate) fn digest(&self, draw: &Draw, files: &Files, functions: &str) -> Result<Digest> {
        let mut digest = Digest::default();
        for (file, bytes) in files {
            digest.add(&file.to_string_lossy(), bytes);
        }
        digest.add("system/functions", functions.as_bytes());
        for command in &self.prepare {
            if command.applies(draw)? {
                digest.add("prepare", command.words().join("\0").as_bytes());
            }
        }
        digest.add("solver", self.solver.join("\0").as_bytes());
        digest.add("m4gn", env!("CARGO_PKG_VERSION").as_bytes());
        Ok(digest)
    }

    /// Fails for a folder inside of the family's, which would become part of each case.
    ///
    /// # Errors
    /// [`Error::Input`] that names both.
    pub fn check_outside(&self, folder: &Path) -> Result<()> {
        refuse(lies_in(folder, &self.folder), Error::Input, || {
            format!(
                "{} lies inside of the family's folder {}, all files of which are copied into each case: choose another folder",
                folder.display(),
                self.folder.display()
            )
        })
    }

    /// Runs the commands that make the mesh and the first fields of this case.
    ///
    /// # Errors
    /// As [`Surroundings::run`]; [`Error::Input`] for a condition that cannot be computed.
    pub fn prepare(&self, draw: &Draw, folder: &Path, tools: &Surroundings) -> Result<()> {
        for command in &self.prepare {
            if command.applies(draw)? {
                tools.run(folder, command.words())?;
            }
        }
        Ok(())
    }
}

/// Entries of a provenance that say which draw of a family a recording is of.
fn origin(family: &Family, seed: u64, index: u64, draw: &Draw) -> Vec<(String, String)> {
    let mut entries = vec![
        ("family".into(), family.name.clone()),
        ("seed".into(), seed.to_string()),
        ("index".into(), index.to_string()),
    ];
    let values = draw.values.iter();
    entries.extend(values.map(|(name, value)| (name.clone(), value.to_string())));
    let derived = family.derived.iter().filter(|d| d.record);
    entries.extend(derived.map(|d| (d.name.clone(), draw.variables[&d.name].to_string())));
    entries
}

/// The dictionary `provenance` of m4gnRecorder.
fn provenance(entries: &[(String, String)]) -> String {
    let lines: String = entries.iter().map(|(key, value)| format!("        {key:<15} {value};\n")).collect();
    format!("    provenance\n    {{\n{lines}    }}\n")
}

impl FamilyCase {
    fn times(&self) -> Result<(Times, u32)> {
        let steps = self.family.steps(&self.draw, self.interval)?;
        let times = Times {
            delta_t: self.interval / f64::from(steps),
            end: self.spin_up + f64::from(self.frames) * self.interval,
            // Nothing but the recording is kept.
            write_interval: 1e6,
        };
        Ok((times, steps))
    }

    /// Entries of the function object m4gnRecorder, but the provenance.
    fn entries(&self, delta_t: f64, steps: u32) -> String {
        // Half a step off, so that rounding of the times does not matter
        let start = self.spin_up - 0.5 * delta_t;
        format!(
            "    type            m4gnRecorder;\n    libs            (m4gnFoam);\n    fields          ({});\n    \
             file            \"{RECORDING}\";\n    split           {};\n\n    timeStart       {start};\n    writeControl    \
             timeStep;\n    writeInterval   {steps};\n",
            self.family.recording.fields.join(" "),
            self.split.name(),
        )
    }

    /// The case's files, the text of its `system/functions`, and the digest of its inputs. (The split is none of them.)
    fn made_of(&self) -> Result<(Files, String, String)> {
        let (times, steps) = self.times()?;
        let files = self.family.files(&self.draw, times)?;
        let mut entries = self.entries(times.delta_t, steps);
        let split = format!("    split           {};\n", self.split.name());
        let inputs = self.family.digest(&self.draw, &files, &entries.replace(&split, ""))?.text();
        let mut origin = vec![("command".to_string(), format!("\"{}\"", self.command))];
        origin.extend(self::origin(&self.family, self.seed, self.index, &self.draw));
        origin.extend([
            ("frames".into(), self.frames.to_string()),
            ("frameInterval".into(), self.interval.to_string()),
            ("spinUp".into(), self.spin_up.to_string()),
            ("inputs".into(), inputs.clone()),
        ]);
        entries = format!("recorder\n{{\n{entries}\n{}}}\n", provenance(&origin));
        Ok((files, entries, inputs))
    }

    /// Writes the case into a new folder.
    fn write(&self, folder: &Path) -> Result<()> {
        let (files, functions, _) = self.made_of()?;
        self.family.write(&files, &functions, folder)
    }

    /// Whether a recorded trajectory is this case's: the first entry of its provenance that differs.
    fn difference(&self, provenance: &serde_json::Value) -> Result<Option<String>> {
        let found = &provenance["family"];
        if found != self.family.name.as_str() {
            return Ok(Some(format!("family {found} instead of \"{}\"", self.family.name)));
        }
        let mut numbers = vec![
            ("seed", self.seed as f64),
            ("index", self.index as f64),
            ("frames", f64::from(self.frames)),
            ("frameInterval", self.interval),
            ("spinUp", self.spin_up),
        ];
        for (name, value) in &self.draw.values {
            match value {
                Value::Number(v) => numbers.push((name, *v)),
                Value::Name(wanted) if provenance[name] != wanted.as_str() => {
                    return Ok(Some(format!("{name} {} instead of {wanted}", provenance[name])));
                }
                Value::Name(_) => {}
            }
        }
        if let Some(difference) = other_number(provenance, &numbers) {
            return Ok(Some(difference));
        }
        let (.., inputs) = self.made_of()?;
        Ok((provenance["inputs"] != inputs.as_str())
            .then(|| "family.toml, a file of the family or m4gn was another one".into()))
    }
}

impl Case for FamilyCase {
    type Figures = Figures;

    fn index(&self) -> u64 {
        self.index
    }

    fn run(&self, folder: &Path, tools: &Surroundings) -> Result<(PathBuf, Figures)> {
        self.write(folder)?;
        self.family.prepare(&self.draw, folder, tools)?;
        tools.run(folder, &self.family.solver)?;

        let solver = program(&self.family.solver);
        let (path, trajectory) = recorded(folder, self.frames, solver)?;
        let figures = Figures {
            cells: trajectory.mesh().n_cells(),
            frames: trajectory.times().len(),
            courant: largest_courant(&folder.join(format!("log.{solver}"))),
        };
        Ok((path, figures))
    }

    fn compare(&self, existing: &Path) -> Result<(Split, Option<String>)> {
        let trajectory = Trajectory::open(existing)?;
        Ok((trajectory.split(), self.difference(trajectory.provenance())?))
    }
}

/// Name of a command's program without its folder.
pub(crate) fn program(command: &[String]) -> &str {
    command[0].rsplit('/').next().unwrap_or(&command[0])
}

/// The template with each `@name@` replaced by its value, and the first name that has none.
pub(super) fn fill(template: &str, value: impl Fn(&str) -> Option<String>) -> (String, Option<String>) {
    let (mut text, mut unknown, mut rest) = (String::with_capacity(template.len()), None, template);
    while let Some(at) = rest.find('@') {
        let (before, from) = rest.split_at(at);
        text += before;
        let end = from[1..].find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        // An @ that begins no @name@ is an @.
        let name = end.filter(|&end| end > 0 && from[1 + end..].starts_with('@')).map(|end| &from[1..=end]);
        let Some(name) = name else {
            text.push('@');
            rest = &from[1..];
            continue;
        };
        match value(name) {
            Some(value) => text += &value,
            None => unknown = unknown.or(Some(name.to_string())),
        }
        rest = &from[name.len() + 2..];
    }
    (text + rest, unknown)
}

/// Files of a family's folder that belong to the case, relative to it.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let unreadable = |path: &Path, e: std::io::Error| Error::file(path, format!("cannot be read: {e}"));
    let (mut found, mut open) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(relative) = open.pop() {
        let path = folder.join(&relative);
        for entry in std::fs::read_dir(&path).map_err(|e| unreadable(&path, e))? {
            let entry = entry.map_err(|e| unreadable(&path, e))?;
            let (name, path) = (entry.file_name(), entry.path());
            let relative = relative.join(&name);
            let kind = path.metadata().map_err(|e| unreadable(&path, e))?;
            let link = entry.file_type().is_ok_and(|t| t.is_symlink());
            if kind.is_dir() && !link {
                open.push(relative);
            } else if !kind.is_file() {
                return Err(Error::file(
                    path,
                    "is no plain file: expected files and folders in the folder of a family, no pipes, devices or links to folders",
                ));
            } else if relative != Path::new(FILE) && name != "README.md" {
                found.push(relative);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Writes a file of a case, and makes its folder.
pub(crate) fn put(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    let folder = path.parent().unwrap_or(path);
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(Error::cannot("written", path))
}

/// What can be run in the family's folder can be run in the case.
fn stay_program(from: &Path, to: &Path) -> Result<()> {
    let mode = |path: &Path| path.metadata().map_or(0, |m| m.permissions().mode());
    let run = mode(from) & 0o111;
    if run == 0 {
        return Ok(());
    }
    std::fs::set_permissions(to, Permissions::from_mode(mode(to) | run))
        .map_err(Error::cannot("made a program", to))
}

/// The trajectory that `solver` left in the folder, which must have `frames` frames after its first.
fn recorded(folder: &Path, frames: u32, solver: &str) -> Result<(PathBuf, Trajectory)> {
    let path = folder.join(RECORDING);
    if !path.is_file() {
        return Err(Error::file(
            folder.join(format!("log.{solver}")),
            format!(
                "{solver} ended without a recording: the function object m4gnRecorder (libm4gnFoam.so) did not run; does \
                 the family's system/controlDict have 'functions {{ #include \"functions\" }}'?"
            ),
        ));
    }
    let trajectory = whole(&path, frames)?;
    Ok((path, trajectory))
}

/// A trajectory that has `frames` frames after its first.
///
/// # Errors
/// [`Error::File`] for another number of them, and as [`Trajectory::open`].
pub(super) fn whole(path: &Path, frames: u32) -> Result<Trajectory> {
    let trajectory = Trajectory::open(path)?;
    let (found, expected) = (trajectory.times().len(), frames as usize + 1);
    match found == expected {
        true => Ok(trajectory),
        false => Err(Error::file(path, format!("{found} frames were recorded, expected {expected}"))),
    }
}

/// Largest of the solver's "Courant Number mean: ... max: ..." lines.
fn largest_courant(log: &Path) -> Option<f64> {
    let text = files::read_text(log).ok()?;
    text.lines()
        .filter_map(|l| l.strip_prefix("Courant Number")?.rsplit("max:").next()?.trim().parse().ok())
        .max_by(f64::total_cmp)
}

#[cfg(test)]
#[path = "case_tests.rs"]
mod tests;
