//! Copies of the user's case: what is copied, what they differ in, and what a run is made from.

use super::settings::{Quantity, Settings, Statistic};
use super::table::{Row, Table};
use crate::generate::case::put;
use crate::generate::openfoam::scratch;
use crate::generate::process::Surroundings;
use crate::user_case::script::ORIGINAL;
use crate::user_case::{LEFT_OUT, copy_all, entry, function_objects, header, names, time, times};
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// The file of a case that has a run's parameters.
pub const PARAMETERS: &str = "system/simulationParameters";
/// Name of our m4gnAverages in a run.
pub const AVERAGES: &str = "m4gnCampaign";
/// Name of our m4gnSurrogate in a run.
const SURROGATE: &str = "m4gnCampaignSurrogate";
/// The user's `controlDict` in a copy.
const CONTROL: &str = "controlDict.case";
/// Ends the names of files in [`MadeFrom`].
const OF_CASE: &str = " of the case";
/// Deepest folder that is looked into.
const DEPTH: usize = 32;

/// Digests of all that a run was made from, by names that people understand.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct MadeFrom(pub BTreeMap<String, String>);

impl MadeFrom {
    /// In what the other one differs, for people; none: in nothing.
    pub fn differs(&self, other: &MadeFrom) -> Option<String> {
        let names = self.0.keys().chain(other.0.keys().filter(|k| !self.0.contains_key(*k)));
        let found: Vec<&str> =
            names.filter(|k| self.0.get(*k) != other.0.get(*k)).map(String::as_str).collect();
        match found.len() {
            0 => None,
            n @ 1..=4 => Some(found[..n].join(", ")),
            n => Some(format!("{} and {} more", found[..3].join(", "), n - 3)),
        }
    }

    /// What a run is made from beside the case's files, which are `self`; `plain`: cold, without surrogate, and to the end.
    pub fn of_run(&self, s: &Settings, table: &Table, row: &Row, plain: bool) -> MadeFrom {
        let mut parts = self.0.clone();
        let mut part = |name: &str, value: &dyn std::fmt::Debug| {
            let mut digest = Digest::default();
            digest.add("", format!("{value:?}").as_bytes());
            parts.insert(name.to_string(), digest.text());
        };
        part("prepare", &s.prepare);
        part("solver and ranks", &(&s.solver, s.ranks));
        part("quantities", &(&s.quantity, s.confidence));
        part("end_time", &s.end_time);
        // Whatever the order of the table's columns
        let values: BTreeMap<_, _> = table.parameters.iter().zip(&row.values).collect();
        part("the run's parameters", &values);
        if !plain {
            part("start and scale", &(s.start, &s.scale));
            part("surrogate", &(&s.surrogate, &s.surrogate_entries));
            part("stop and min_time", &(s.stop, s.min_time));
        }
        MadeFrom(parts)
    }
}

/// The user's case, as far as runs need to know it.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Its folder.
    pub folder: PathBuf,
    /// `startTime` of its `controlDict`, s.
    pub start: f64,
    /// `endTime`, s.
    pub end: f64,
    /// `application`.
    pub application: String,
    /// Names and types of its function objects.
    pub functions: Vec<(String, String)>,
}

impl Source {
    /// Reads what `controlDict` says with these parameters, in a copy of `system` in `scratch`, which is empty, beside links to the case's other
    /// files. Of the case that was read as `first` with others the times alone are read anew: each entry takes a program.
    ///
    /// # Errors
    /// [`Error::File`] for a folder that is no case, and an entry that is missing.
    pub fn read(
        folder: &Path,
        scratch: &Path,
        parameters: &str,
        first: Option<&Source>,
        tools: &Surroundings,
    ) -> Result<Self> {
        let control = folder.join("system/controlDict");
        if !control.is_file() {
            return Err(Error::file(
                folder,
                "has no system/controlDict: expected the folder of an OpenFOAM case",
            ));
        }
        copy_all(&folder.join("system"), &scratch.join("system"))?;
        // What controlDict includes of the others, which are read alone
        for name in names(folder)?.iter().filter(|name| *name != "system" && !is_left(name)) {
            let link = scratch.join(name);
            symlink(folder.join(name), &link).map_err(Error::cannot("made", &link))?;
        }
        put(&scratch.join(PARAMETERS), parameters)?;
        let copy = scratch.join("system/controlDict");
        let in_the_case = |e: Error| match e {
            Error::File { message, .. } => {
                let place = |path: &Path| path.display().to_string();
                Error::file(&control, message.replace(&place(scratch), &place(folder)))
            }
            e => e,
        };
        let wanted = |name: &str| {
            let found = entry(scratch, &copy, name, tools).map_err(in_the_case)?;
            found.ok_or_else(|| Error::file(&control, format!("has no entry {name}: expected one")))
        };
        let number = |name: &str| {
            let text = wanted(name)?;
            text.parse()
                .map_err(|_| Error::file(&control, format!("{name}: expected a number, found {text}")))
        };
        let (start, end) = (number("startTime")?, number("endTime")?);
        if let Some(first) = first {
            return Ok(Source { start, end, ..first.clone() });
        }
        let application = wanted("application")?;
        let functions = function_objects(scratch, &copy, tools).map_err(in_the_case)?;
        Ok(Source { folder: folder.to_path_buf(), start, end, application, functions })
    }

    /// Names in the case's folder that are copied: all but other times, and what runs have left.
    fn contents(&self) -> Result<Vec<String>> {
        let mut found = names(&self.folder)?;
        found.retain(|name| match time(name) {
            Some(t) => t == self.start,
            None => !is_left(name),
        });
        found.sort();
        Ok(found)
    }

    /// The case's files that are copied, by their paths in it.
    ///
    /// # Errors
    /// [`Error::File`] where a folder cannot be read.
    pub fn files(&self) -> Result<Vec<String>> {
        let mut files = Vec::new();
        for name in self.contents()? {
            self.below(&name, DEPTH, &mut files)?;
        }
        Ok(files)
    }

    fn below(&self, name: &str, depth: usize, files: &mut Vec<String>) -> Result<()> {
        let path = self.folder.join(name);
        let Ok(kind) = fs::metadata(&path) else { return Ok(()) };
        if kind.is_file() && name != PARAMETERS {
            files.push(name.to_string());
        } else if kind.is_dir() && depth > 0 {
            let mut inner = names(&path)?;
            inner.sort();
            inner.iter().try_for_each(|n| self.below(&format!("{name}/{n}"), depth - 1, files))?;
        }
        Ok(())
    }

    /// The digests of the case's files.
    ///
    /// # Errors
    /// [`Error::File`] where one cannot be read.
    pub fn digests(&self) -> Result<MadeFrom> {
        let mut parts = BTreeMap::new();
        for name in self.files()? {
            let mut digest = Digest::default();
            digest.add_file("", &self.folder.join(&name))?;
            parts.insert(format!("{name}{OF_CASE}"), digest.text());
        }
        Ok(MadeFrom(parts))
    }

    /// Copies the case to `copy`, which is not there yet, with a run's parameters.
    ///
    /// # Errors
    /// [`Error::File`] for what cannot be copied or written.
    pub fn copy(&self, copy: &Path, settings: &Settings, parameters: &str) -> Result<()> {
        for name in self.contents()? {
            copy_all(&self.folder.join(&name), &copy.join(&name))?;
        }
        let first = copy.join(self.start.to_string());
        // Commands, and scripts, that take them do so when the mesh has all patches that they name
        let of_script =
            |name: &String| files::read_text(copy.join(name)).is_ok_and(|text| takes_original(&text));
        let later =
            settings.prepare.iter().any(|c| c.iter().any(|word| word == ORIGINAL) || of_script(&c[0]));
        if !later && !first.exists() && copy.join(ORIGINAL).is_dir() {
            copy_all(&copy.join(ORIGINAL), &first)?;
        }
        put(&copy.join(PARAMETERS), parameters)
    }

    /// The case with the end and the function objects of a copy's `controlDict`, where the commands of `prepare` have left another one there.
    ///
    /// # Errors
    /// As [`Source::read`].
    pub fn prepared(self, copy: &Path, parameters: &str, tools: &Surroundings) -> Result<Self> {
        let control = |folder: &Path| files::read(folder.join("system/controlDict")).ok();
        if control(copy) == control(&self.folder) {
            return Ok(self);
        }
        let found = Source::read(copy, scratch()?.path(), parameters, None, tools)?;
        Ok(Source { end: found.end, functions: found.functions, ..self })
    }

    /// Puts the `controlDict` of a run in place of the case's, which it includes. The commands of `prepare` come before: they may run other solvers, or
    /// have one of several for the case.
    ///
    /// # Errors
    /// [`Error::File`] for what cannot be renamed or written.
    pub fn control(&self, copy: &Path, settings: &Settings, plain: bool) -> Result<()> {
        let (control, own) = (copy.join("system/controlDict"), copy.join("system").join(CONTROL));
        fs::rename(&control, &own).map_err(Error::cannot("renamed", &control))?;
        put(&control, self.control_dict(settings, plain))
    }

    /// Has a run store states: each after `stored.0` s, of which `stored.1` are kept, in binary, as sisters read all of them. `last`: the time at which
    /// it has ended, and from which it goes on by itself until they are there; none: while it is made.
    ///
    /// # Errors
    /// [`Error::File`] where its `controlDict` cannot be changed.
    pub fn store(&self, copy: &Path, stored: (f64, usize), last: Option<f64>) -> Result<()> {
        let path = copy.join("system/controlDict");
        let mut text = files::read_text(&path).map_err(Error::cannot("read", &path))?;
        text += &format!("writeInterval {};\npurgeWrite {};\nwriteFormat binary;\n", stored.0, stored.1);
        if let Some(last) = last {
            // One of them is the last state; half an interval more, and all are written
            let end = last + stored.0 * (stored.1 as f64 - 0.5);
            let off = [AVERAGES, SURROGATE].map(|name| format!("    {name} {{ enabled no; }}\n")).concat();
            text += &format!("startFrom latestTime;\nendTime {end};\nfunctions\n{{\n{off}}}\n");
        }
        put(&path, text)
    }

    /// The `controlDict` of a run: the user's, from its start time, with its last state alone, and our function objects behind the user's. No run is
    /// carried on, so these keep nothing for that.
    fn control_dict(&self, s: &Settings, plain: bool) -> String {
        let end = s.end_time.unwrap_or(self.end);
        let ours = self
            .functions
            .iter()
            .filter(|(_, kind)| ["m4gnSurrogate", "m4gnAverages"].contains(&kind.as_str()));
        let off: String = ours.map(|(name, _)| format!("    {name} {{ enabled no; }}\n")).collect();
        let surrogate = match &s.surrogate {
            Some(name) if !plain => format!(
                "    {SURROGATE}\n    {{\n        type m4gnSurrogate;\n        libs (m4gnFoam);\n        mode replace;\n        \
                 surrogates ({name});\n        dmd {{ keep no; }}\n        {}\n    }}\n",
                s.surrogate_entries
            ),
            _ => String::new(),
        };
        let stop = if s.stop && !plain { "yes" } else { "no" };
        let quantities: String = s.quantity.iter().map(entries).collect();
        // The user's first: entries that come later count
        format!(
            "{}#include \"{CONTROL}\"\nstartFrom startTime;\nstopAt endTime;\nendTime {end};\nwriteControl runTime;\nwriteInterval {};\n\
             purgeWrite 0;\nrunTimeModifiable no;\nfunctions\n{{\n{off}{surrogate}    {AVERAGES}\n    {{\n        type m4gnAverages;\n        \
             libs (m4gnAverages);\n        confidence {};\n        keep no;\n        stop {stop};\n        minTime {};\n        quantities\n        \
             {{\n{quantities}        }}\n    }}\n}}\n",
            header("controlDict"),
            end - self.start,
            s.confidence,
            s.min_time,
        )
    }
}

fn entries(q: &Quantity) -> String {
    let mut text =
        format!("            {} {{ functionObject {}; result {};", q.name, q.function_object, q.result);
    let mut more = |name: &str, value: Option<String>| {
        if let Some(value) = value {
            text += &format!(" {name} {value};");
        }
    };
    more("component", q.component.clone());
    more("statistic", (q.statistic == Statistic::Rms).then(|| "rms".into()));
    more("tolerance", q.tolerance.map(|v| v.to_string()));
    more("relative", q.relative.map(|v| v.to_string()));
    text + " }\n"
}

/// The text of [`PARAMETERS`].
pub fn parameters(table: &Table, row: &Row) -> String {
    let entries = table.parameters.iter().zip(&row.values).map(|(name, value)| format!("{name} {value};\n"));
    header("simulationParameters") + &entries.collect::<String>()
}

/// Whether a script puts the original first fields into the case itself, and not into folders of ranks.
pub(super) fn takes_original(script: &str) -> bool {
    let commands = script.lines().map(|line| line.split('#').next().unwrap_or_default());
    commands
        .filter(|c| !c.contains("processor"))
        .any(|c| ["restore0Dir", ORIGINAL].iter().any(|word| c.contains(word)))
}

/// Whether what has this name in a case's folder is left by runs.
fn is_left(name: &str) -> bool {
    name.starts_with("processor")
        || name.starts_with("log.")
        || name.starts_with('.')
        || LEFT_OUT.contains(&name)
}

/// Name and time of the folder of the last time in a run's case, if it is behind `start`.
pub fn last_time(case: &Path, start: f64) -> Result<Option<(String, f64)>> {
    Ok(times(case)?.pop().filter(|(_, t)| *t > start))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    /// A case of files whose text is their name.
    fn source(files: &[&str]) -> (tempfile::TempDir, Source) {
        let dir = fixtures::folder(&files.iter().map(|name| (*name, *name)).collect::<Vec<_>>());
        let folder = dir.path().to_path_buf();
        let functions = [("own", "m4gnAverages"), ("forces", "forceCoeffs")];
        let functions = functions.map(|(name, kind)| (name.into(), kind.into())).to_vec();
        (dir, Source { folder, end: 2.0, functions, ..Source::default() })
    }

    fn settings() -> Settings {
        toml::from_str(
            "case = \"c\"\nsolver = [\"icoFoam\"]\nmin_time = 0.5\nsurrogate = \"dmd\"\n[[quantity]]\nname = \"Cl\"\nfunction_object = \"f\"\n\
             result = \"Cl\"\nstatistic = \"rms\"\nrelative = 0.02\n",
        )
        .unwrap()
    }

    #[test]
    fn what_runs_left_is_not_of_the_case() {
        let files = [
            "0/U",
            "0.5/U",
            "constant/g",
            "log.icoFoam",
            "postProcessing/a",
            "processor0/0/U",
            "system/controlDict",
            PARAMETERS,
        ];
        let (_dir, source) = source(&files);
        assert_eq!(source.files().unwrap(), ["0/U", "constant/g", "system/controlDict"]);
    }

    #[test]
    fn an_edit_is_named() {
        let (_dir, source) = source(&["0/U", "constant/g"]);
        let table = Table {
            parameters: vec!["u".into(), "v".into()],
            rows: vec![Row { name: "a".into(), values: vec!["1".into(), "3".into()] }],
        };
        let of =
            |s: &Settings, t: &Table, plain: bool| source.digests().unwrap().of_run(s, t, &t.rows[0], plain);
        let mut s = settings();
        let (before, plain) = (of(&s, &table, false), of(&s, &table, true));
        assert_eq!(of(&s, &table, false).differs(&before), None);
        let mut other = table.clone();
        other.rows[0].values[0] = "2".into();
        assert_eq!(of(&s, &other, false).differs(&before).unwrap(), "the run's parameters");
        let mut turned = table.clone();
        turned.parameters.reverse();
        assert!(of(&s, &turned, false).differs(&before).is_some());
        turned.rows[0].values.reverse();
        assert_eq!(of(&s, &turned, false).differs(&before), None, "columns in another order");
        s.min_time = 0.7;
        assert_eq!(of(&s, &table, false).differs(&before).unwrap(), "stop and min_time");
        assert_eq!(of(&s, &table, true).differs(&plain), None, "a plain run is not ended by them");
        fs::write(source.folder.join("0/U"), "other").unwrap();
        fs::write(source.folder.join("0/p"), "new").unwrap();
        assert_eq!(
            of(&settings(), &table, false).differs(&before).unwrap(),
            "0/U of the case, 0/p of the case"
        );
    }

    #[test]
    fn first_fields_are_there_unless_a_command_takes_them() {
        let (_dir, source) = source(&["0.orig/U", "system/controlDict"]);
        let copies = tempfile::tempdir().unwrap();
        let mut s = settings();
        let script = |text: &str| fixtures::write(&source.folder, &[("Allrun.pre", text)]);
        let mut there = |command: &[&str]| {
            let copy = copies.path().join(command.join(" ").replace('/', ""));
            s.prepare.push(command.iter().map(|word| word.to_string()).collect());
            source.copy(&copy, &s, "").unwrap();
            s.prepare.clear();
            copy.join("0/U").exists()
        };
        assert!(there(&["blockMesh"]) && !there(&["cp", "-rT", ORIGINAL, "0"]));
        script("blockMesh # restore0Dir\nrestore0Dir -processor\n");
        assert!(there(&["./Allrun.pre", "1"]));
        script("createPatch -overwrite\nrestore0Dir\n");
        assert!(!there(&["./Allrun.pre", "2"]));
    }

    #[test]
    fn a_run_has_our_entries_behind_the_case_s() {
        let (dir, source) = source(&["system/controlDict"]);
        source.control(dir.path(), &settings(), false).unwrap();
        let read = |name: &str| fs::read_to_string(dir.path().join("system").join(name)).unwrap();
        assert_eq!(read(CONTROL), "system/controlDict");
        assert_eq!(read("controlDict"), source.control_dict(&settings(), false));
        let text = source.control_dict(&settings(), false);
        for expected in [
            "#include \"controlDict.case\"\nstartFrom startTime;",
            "endTime 2;\nwriteControl runTime;\nwriteInterval 2;",
            "own { enabled no; }",
            "surrogates (dmd);\n        dmd { keep no; }",
            "confidence 0.95;\n        keep no;",
            "stop yes;\n        minTime 0.5;",
            "Cl { functionObject f; result Cl; statistic rms; relative 0.02; }",
        ] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        let plain = source.control_dict(&settings(), true);
        assert!(plain.contains("stop no;") && !plain.contains("surrogates"), "{plain}");
    }

    #[test]
    fn a_run_goes_on_for_states() {
        let (dir, source) = source(&["system/controlDict"]);
        source.store(dir.path(), (0.25, 10), None).unwrap();
        let path = dir.path().join("system/controlDict");
        let text = || fs::read_to_string(&path).unwrap();
        assert_eq!(text(), "system/controlDictwriteInterval 0.25;\npurgeWrite 10;\nwriteFormat binary;\n");
        source.store(dir.path(), (0.25, 10), Some(2.0)).unwrap();
        assert!(text().contains("startFrom latestTime;\nendTime 4.375;\n"), "{}", text());
        assert!(text().ends_with("    m4gnCampaignSurrogate { enabled no; }\n}\n"), "{}", text());
    }
}
