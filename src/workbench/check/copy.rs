//! A copy of a case that its solver can run in: what is small is copied, what is large is linked, and the user's folder stays as it is.

use crate::generate::openfoam::absolute;
use crate::generate::process::Surroundings;
use m4gn_base::{Error, Result};
use std::fs;
use std::path::{Path, PathBuf};

/// Files above are linked: meshes and fields. No program that runs here writes to one.
const LARGE: u64 = 1 << 20;

/// Name of the function object that checks.
const NAME: &str = "m4gnCheck";

/// What is not of use to a run.
const LEFT_OUT: [&str; 4] = ["postProcessing", "VTK", "logs", "dynamicCode"];

/// A case whose solver can be run.
#[derive(Debug)]
pub struct Copy {
    /// Its folder.
    pub folder: PathBuf,
    /// `application` of its `controlDict`.
    pub application: String,
    /// Ranks that it is decomposed for; 0: it is not.
    pub ranks: usize,
    /// What had to be done to it.
    pub notes: Vec<String>,
    original: PathBuf,
    /// The user's own function objects of m4gn, which would jump as well.
    own: Vec<String>,
}

impl Copy {
    /// Copies a case into a folder that is not there yet, below `beside`.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Input`] that say what is missing in the case, or cannot be read.
    pub fn new(case: &Path, beside: &Path, tools: &Surroundings) -> Result<Self> {
        let original = absolute(case)?;
        let real = original.canonicalize().unwrap_or_else(|_| original.clone());
        let name = real.file_name().unwrap_or("case".as_ref());
        link_siblings(&real, beside)?;
        let mut copy = Copy {
            folder: beside.join(name),
            application: String::new(),
            ranks: 0,
            notes: Vec::new(),
            original,
            own: Vec::new(),
        };
        copy_folder(&copy.original.join("system"), &copy.folder.join("system"))?;
        let Some(application) = copy.entry("application", tools)? else {
            return Err(Error::file(
                copy.control(),
                "has no entry application: expected the name of a solver, such as icoFoam",
            ));
        };
        copy.application = application;
        let start = copy.entry("startTime", tools)?.and_then(|t| t.parse().ok()).unwrap_or(0.0);
        let processors = (0..).take_while(|i| copy.original.join(format!("processor{i}")).is_dir()).count();
        if processors > 0 && !has_mesh(&copy.original) {
            copy.ranks = processors;
        }
        copy.take(start)?;
        copy.find_own(tools)?;
        copy.complete(tools)?;
        Ok(copy)
    }

    fn control(&self) -> PathBuf {
        self.original.join("system/controlDict")
    }

    /// An entry of `controlDict`, as OpenFOAM reads it; none: it has none.
    fn entry(&self, name: &str, tools: &Surroundings) -> Result<Option<String>> {
        let control = self.control().display().to_string();
        let done = tools.run(&self.folder, &["foamDictionary", "-entry", name, "-value", &control]);
        let log = fs::read_to_string(self.folder.join("log.foamDictionary")).unwrap_or_default();
        match done {
            Ok(()) => Ok(log.lines().rfind(|l| !l.trim().is_empty()).map(|l| l.trim().to_string())),
            Err(Error::Interrupted(e)) => Err(Error::Interrupted(e)),
            Err(_) if log.contains("Cannot find entry") => Ok(None),
            Err(e) => Err(Error::file(self.control(), super::words(&log, &e))),
        }
    }

    /// Everything but times that no run starts from.
    fn take(&self, start: f64) -> Result<()> {
        let time = |name: &str| name.parse::<f64>().ok().filter(|t| t.is_finite());
        let names = names(&self.original)?;
        let times = || names.iter().filter_map(|n| time(n));
        let (first, last) =
            (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        for name in &names {
            let path = self.original.join(name);
            let wanted = match time(name) {
                Some(t) => t == first || t == last || (t - start).abs() <= 1e-9 * start.abs(),
                None if name.starts_with("processor") => self.ranks > 0,
                None => !LEFT_OUT.contains(&name.as_str()) && name != "system",
            };
            if wanted && path.is_dir() {
                copy_folder(&path, &self.folder.join(name))?;
            } else if wanted && path.is_file() {
                copy_file(&path, &self.folder.join(name))?;
            }
        }
        Ok(())
    }

    /// Which of the user's function objects are m4gn's.
    fn find_own(&mut self, tools: &Surroundings) -> Result<()> {
        if self.entry("functions", tools)?.is_none() {
            return Ok(());
        }
        let control = self.control().display().to_string();
        let listed =
            tools.run(&self.folder, &["foamDictionary", "-entry", "functions", "-keywords", &control]);
        let names = fs::read_to_string(self.folder.join("log.foamDictionary")).unwrap_or_default();
        for name in names.lines().map(str::trim).filter(|n| listed.is_ok() && !n.is_empty()) {
            let kind = self.entry(&format!("functions/{name}/type"), tools)?;
            if kind.is_some_and(|k| k.starts_with("m4gn")) {
                self.own.push(name.to_string());
            }
        }
        if !self.own.is_empty() {
            self.notes.push(format!("the case's own {} is left out", self.own.join(", ")));
        }
        Ok(())
    }

    /// Makes what a run needs and the case does not have yet: the first fields of a tutorial, and a mesh that blockMesh makes.
    fn complete(&mut self, tools: &Surroundings) -> Result<()> {
        let at = |name: &str| self.folder.join(name);
        if !at("0").exists() && at("0.orig").is_dir() && self.ranks == 0 {
            fs::rename(at("0.orig"), at("0")).map_err(|e| Error::file(at("0"), e.to_string()))?;
            self.notes.push("0.orig is taken for 0".into());
        }
        if self.ranks > 0 || has_mesh(&self.folder) {
            return Ok(());
        }
        if !["system/blockMeshDict", "constant/polyMesh/blockMeshDict"].iter().any(|f| at(f).is_file()) {
            self.notes.push("it has no mesh, and no blockMeshDict: make its mesh first, as for a run (its Allrun, or Allrun.pre)".into());
            return Ok(());
        }
        if let Err(e) = tools.run(&self.folder, &["blockMesh"]) {
            let log = fs::read_to_string(at("log.blockMesh")).unwrap_or_default();
            let log = self.in_words_of_the_case(&log);
            return Err(Error::file(
                &self.original,
                format!("blockMesh makes no mesh of it: {}", super::words(&log, &e)),
            ));
        }
        self.notes.push("the mesh is blockMesh's".into());
        Ok(())
    }

    /// Writes the `controlDict` of a run: the user's, with nothing written, these entries, and this function object beside the user's.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be written.
    pub fn control_dict(&self, entries: &str, function_object: &str) -> Result<()> {
        let off: String = self.own.iter().map(|name| format!("    {name} {{ enabled no; }}\n")).collect();
        let text = format!(
            "FoamFile {{ version 2.0; format ascii; class dictionary; object controlDict; }}\n#include \"{}\"\nstopAt endTime;\n\
             writeControl timeStep;\nwriteInterval 1000000000;\npurgeWrite 0;\nrunTimeModifiable no;\n{entries}\nfunctions\n{{\n{off}    \
             {NAME} {{ {function_object} libs (m4gnFoam); }}\n}}\n",
            self.control().display()
        );
        let path = self.folder.join("system/controlDict");
        fs::write(&path, text).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    }

    /// A log with the paths of the user's case, and without advice about the function object that it does not have.
    pub fn in_words_of_the_case(&self, log: &str) -> String {
        let folder = |path: &Path| path.display().to_string();
        let advice = |line: &str| line.contains(NAME) && !line.contains("while loading");
        let lines = log.lines().filter(|l| !advice(l)).map(|l| format!("{l}\n"));
        lines.collect::<String>().replace(&folder(&self.folder), &folder(&self.original))
    }

    /// The solver's command.
    pub fn solver(&self) -> Vec<String> {
        let mut words = Vec::new();
        if self.ranks > 0 {
            words.extend(["mpirun".into(), "-np".into(), self.ranks.to_string()]);
        }
        words.push(self.application.clone());
        words.extend((self.ranks > 0).then(|| "-parallel".to_string()));
        words
    }
}

/// Whether a case has a mesh.
fn has_mesh(case: &Path) -> bool {
    ["faces", "faces.gz"].iter().any(|f| case.join("constant/polyMesh").join(f).exists())
        // Of several regions each has its own
        || fs::read_dir(case.join("constant")).into_iter().flatten().flatten().any(|e| e.path().join("polyMesh/faces").exists())
}

fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).map_err(|e| Error::file(folder, format!("cannot be read: {e}")))?;
    Ok(entries.flatten().filter_map(|e| e.file_name().into_string().ok()).collect())
}

/// What lies beside the case is found from the copy as well: its files may include it.
fn link_siblings(case: &Path, beside: &Path) -> Result<()> {
    fs::create_dir_all(beside).map_err(|e| Error::file(beside, format!("cannot be made: {e}")))?;
    let Some(parent) = case.parent() else { return Ok(()) };
    for name in names(parent).unwrap_or_default() {
        if Some(name.as_ref()) != case.file_name() {
            let _ = std::os::unix::fs::symlink(parent.join(&name), beside.join(&name));
        }
    }
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).map_err(|e| Error::file(to, format!("cannot be made: {e}")))?;
    for name in names(from)? {
        let (from, to) = (from.join(&name), to.join(&name));
        if from.is_dir() && !from.is_symlink() {
            copy_folder(&from, &to)?;
        } else {
            copy_file(&from, &to)?;
        }
    }
    Ok(())
}

fn copy_file(from: &Path, to: &Path) -> Result<()> {
    let done = match fs::metadata(from) {
        Ok(kind) if kind.is_file() && kind.len() <= LARGE => {
            fs::read(from).and_then(|bytes| fs::write(to, bytes))
        }
        Ok(kind) if kind.is_file() || kind.is_dir() => std::os::unix::fs::symlink(from, to),
        // Pipes, devices, links that lead nowhere
        _ => Ok(()),
    };
    done.map_err(|e| Error::file(from, format!("cannot be copied: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_small_is_copied_and_what_is_large_is_linked() {
        let dir = tempfile::tempdir().unwrap();
        let (case, beside) = (dir.path().join("study/case"), dir.path().join("copy"));
        fs::create_dir_all(case.join("constant/polyMesh")).unwrap();
        fs::write(case.join("../shared"), "nu 1;").unwrap();
        fs::write(case.join("constant/small"), "a").unwrap();
        fs::write(case.join("constant/polyMesh/faces"), vec![b' '; LARGE as usize + 1]).unwrap();
        std::os::unix::fs::symlink("nowhere", case.join("constant/dangling")).unwrap();
        assert!(has_mesh(&case) && !has_mesh(&beside));
        link_siblings(&case, &beside).unwrap();
        copy_folder(&case, &beside.join("case")).unwrap();
        let at = |name: &str| beside.join("case").join(name);
        assert!(!at("constant/small").is_symlink() && at("constant/polyMesh/faces").is_symlink());
        assert!(!at("constant/dangling").is_symlink());
        assert_eq!(fs::read_to_string(at("../shared")).unwrap(), "nu 1;");
        // The copy's files are its own.
        fs::write(at("constant/small"), "b").unwrap();
        assert_eq!(fs::read_to_string(case.join("constant/small")).unwrap(), "a");
    }
}
