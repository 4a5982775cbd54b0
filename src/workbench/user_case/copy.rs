//! A copy of a case that its solver can run in. No path in it leads out of it, so that nothing that runs there can write into the user's files.

use super::script::{ORIGINAL, of_files, of_script};
use super::{
    BLOCK_MESH, LEFT_OUT, copy_all, entry, function_objects, has_mesh, has_regions, header, log, mentions,
    names, read_all, time, times,
};
use crate::generate::case::put;
use crate::generate::openfoam::absolute;
use crate::generate::process::{Surroundings, excerpt};
use m4gn_base::{Error, Result, files};
use std::fs;
use std::path::{Path, PathBuf};

/// A case whose solver can be run.
#[derive(Debug, Default)]
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

/// Where a run of the copy starts.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Name of its folder.
    pub time: &'a str,
    /// Ranks whose folders it is in; 0: it is the case's own.
    pub ranks: usize,
}

impl Copy {
    /// Copies a case into a folder that is not there yet, below `beside`. `start`: the time that it has beside its first one; none: that which
    /// the case's own run starts from, and the last one.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Input`] that say what is missing in the case, or cannot be read.
    pub fn new(case: &Path, beside: &Path, start: Option<Start>, tools: &Surroundings) -> Result<Self> {
        let original = absolute(case)?;
        let real = original.canonicalize().unwrap_or_else(|_| original.clone());
        let name = real.file_name().unwrap_or("case".as_ref());
        fs::create_dir_all(beside).map_err(Error::cannot("made", beside))?;
        let mut copy = Copy { folder: beside.join(name), original, ..Copy::default() };
        let system = copy.folder.join("system");
        copy_all(&copy.original.join("system"), &system)?;
        let mut named = Named::new(&copy, &real, beside)?;
        // What controlDict includes from elsewhere in the case, before it is read
        named.follow(vec![system])?;
        let Some(application) = copy.entry("application", tools)? else {
            return Err(Error::file(
                copy.control(),
                "has no entry application: expected the name of a solver, such as icoFoam",
            ));
        };
        copy.application = application;
        let taken = if let Some(Start { time, ranks }) = start {
            copy.ranks = ranks;
            copy.take(|name, t, [first, _]| name == time || t == first)?
        } else {
            let start = copy.entry("startTime", tools)?.and_then(|t| t.parse().ok()).unwrap_or(0.0);
            copy.ranks = ranks_of(&copy.original);
            copy.take(starts_or_ends(start))?
        };
        named.follow(taken)?;
        copy.find_own(tools)?;
        copy.complete(&mut named, tools)?;
        Ok(copy)
    }

    fn control(&self) -> PathBuf {
        self.original.join("system/controlDict")
    }

    /// Folders of the case's, or of its ranks', times.
    pub fn parts(&self) -> Vec<PathBuf> {
        match self.ranks {
            0 => vec![self.folder.clone()],
            n => (0..n).map(|i| self.folder.join(format!("processor{i}"))).collect(),
        }
    }

    /// The first by name of the regions of a case that has several; none: its mesh is that of no region.
    pub fn region(&self) -> Option<String> {
        if !has_regions(&self.folder) {
            return None;
        }
        let constant = self.parts()[0].join("constant");
        names(&constant).ok()?.into_iter().filter(|name| constant.join(name).join("polyMesh").is_dir()).min()
    }

    fn entry(&self, name: &str, tools: &Surroundings) -> Result<Option<String>> {
        entry(&self.folder, &self.control(), name, tools)
    }

    /// Copies what a run reads, its dictionaries, and those times, by name and the first and the last time, that it wants, but for what is copied already.
    /// Returns the copies.
    fn take(&self, wants: impl Fn(&str, f64, [f64; 2]) -> bool) -> Result<Vec<PathBuf>> {
        let mut copies = Vec::new();
        let processors = (0..self.ranks).map(|i| format!("processor{i}"));
        for part in std::iter::once(String::new()).chain(processors) {
            let (from, to) = (self.original.join(&part), self.folder.join(&part));
            let names = names(&from)?;
            let times = || names.iter().filter_map(|n| time(n));
            let ends = [times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max)];
            for name in &names {
                let wanted = match time(name) {
                    Some(t) => wants(name, t, ends),
                    None => name == "constant" || name.ends_with(".orig"),
                };
                let copy = to.join(name);
                if wanted && !copy.exists() {
                    copy_all(&from.join(name), &copy)?;
                    copies.push(copy);
                }
            }
        }
        Ok(copies)
    }

    /// Which of the user's function objects are m4gn's.
    fn find_own(&mut self, tools: &Surroundings) -> Result<()> {
        let all = function_objects(&self.folder, &self.control(), tools)?;
        self.own =
            all.into_iter().filter(|(_, kind)| kind.starts_with("m4gn")).map(|(name, _)| name).collect();
        if !self.own.is_empty() {
            self.notes.push(format!("the case's own {} is left out", self.own.join(", ")));
        }
        Ok(())
    }

    /// Makes what a run needs and the case does not have yet: the first fields of a tutorial, and a mesh, by the commands of its `Allrun.pre`
    /// and its `Allrun` before the solver, else by `blockMesh`. Files that the commands name come along.
    fn complete(&mut self, named: &mut Named, tools: &Surroundings) -> Result<()> {
        let at = |name: &str| self.folder.join(name);
        let made = self.ranks == 0 && !has_mesh(&self.folder);
        let (mut commands, mut others) = (Vec::new(), String::new());
        if made {
            // What a path may lead to lies in the copy.
            let stays = |c: &Vec<String>| !c.iter().any(|word| word.contains("..") || word.starts_with('/'));
            let read = |name: &str| files::read_text(self.original.join(name)).unwrap_or_default();
            // Each begins in the case's folder
            let script = ["Allrun.pre", "Allrun"].map(read).join("\ncd ${0%/*}\n");
            let original = at(ORIGINAL).is_dir() && !at("0").exists();
            let script = of_script(&script, &self.application, original);
            let (own, outside): (Vec<_>, Vec<_>) = script.prepare.into_iter().partition(stays);
            let lines: Vec<String> = own.iter().map(|c| c.join(" ")).collect();
            let copies = named.take(std::slice::from_ref(&lines.join("\n")))?;
            named.follow(copies)?;
            let left: Vec<String> =
                script.unknown.into_iter().chain(outside.iter().map(|c| c.join(" "))).collect();
            if !left.is_empty() {
                others = format!("; lines of its script that were left out: {}", left.join(" | "));
            }
            commands = own;
        }
        // A script takes them when the mesh has all patches that they name
        let later = commands.iter().flatten().any(|word| word == ORIGINAL);
        if self.ranks == 0 && !later && !at("0").exists() && at(ORIGINAL).is_dir() {
            copy_all(&at(ORIGINAL), &at("0"))?;
            self.notes.push("0.orig is taken for 0".into());
        }
        if !made {
            return Ok(());
        }
        if of_files(&commands) {
            if !BLOCK_MESH.iter().any(|f| at(f).is_file()) {
                let what = "it has no mesh, and no blockMeshDict: make its mesh first, as for a run (its Allrun, or Allrun.pre)";
                self.notes.push(what.to_string() + &others);
                return Ok(());
            }
            commands.push(vec!["blockMesh".into()]);
        }
        for command in &commands {
            if let Err(e) = tools.run(&self.folder, command) {
                let log = at(&format!("log.{}", command[0]));
                let said = self.in_words_of_the_case(&log::words(&excerpt(&log), &e));
                return Err(Error::file(
                    &self.original,
                    format!("{} makes no mesh of it: {said}{others}", command.join(" ")),
                ));
            }
        }
        let names: Vec<String> = commands.iter().map(|c| c.join(" ")).collect();
        self.notes.push(format!("made ready by {}{others}", names.join(", ")));
        Ok(())
    }

    /// Writes the `controlDict` of a run: the user's, with nothing written, these entries, and these function objects beside the user's.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be written.
    pub fn control_dict(&self, entries: &str, function_objects: &str) -> Result<()> {
        let off: String = self.own.iter().map(|name| format!("    {name} {{ enabled no; }}\n")).collect();
        let text = format!(
            "{}#include \"{}\"\nstopAt endTime;\n\
             writeControl timeStep;\nwriteInterval 1000000000;\npurgeWrite 0;\nrunTimeModifiable no;\n{entries}\nfunctions\n{{\n{off}    \
             {function_objects}\n}}\n",
            header("controlDict"),
            self.control().display()
        );
        put(&self.folder.join("system/controlDict"), text)
    }

    /// A text with the paths of the user's case.
    pub fn in_words_of_the_case(&self, text: &str) -> String {
        let folder = |path: &Path| path.display().to_string();
        text.replace(&folder(&self.folder), &folder(&self.original))
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

/// Files and folders of a case, and what lies beside it, that are copied where a copied file names them: from where, to where, and the name.
struct Named(Vec<(PathBuf, PathBuf, String)>);

impl Named {
    fn new(copy: &Copy, real: &Path, beside: &Path) -> Result<Self> {
        let parent = real.parent().unwrap_or(real);
        let own =
            |name: &str| time(name).is_none() && !name.starts_with("processor") && !LEFT_OUT.contains(&name);
        let mut all: Vec<(PathBuf, PathBuf, String)> = Vec::new();
        for name in names(&copy.original)?.into_iter().filter(|n| own(n)) {
            all.push((copy.original.join(&name), copy.folder.join(&name), name));
        }
        for name in names(parent).unwrap_or_default() {
            if Some(name.as_ref()) != real.file_name() {
                all.push((parent.join(&name), beside.join(&name), format!("../{name}")));
            }
        }
        Ok(Named(all))
    }

    /// Copies what the files below these paths name, and what those name. Each path is read once.
    fn follow(&mut self, mut paths: Vec<PathBuf>) -> Result<()> {
        while let Some(path) = paths.pop() {
            let mut texts = Vec::new();
            read_all(&path, &mut texts);
            paths.extend(self.take(&texts)?);
        }
        Ok(())
    }

    /// Copies what these texts name. Returns the copies.
    fn take(&mut self, texts: &[String]) -> Result<Vec<PathBuf>> {
        let is_named = |name: &str| texts.iter().any(|t| mentions(t, name));
        let (named, others): (Vec<_>, Vec<_>) = self.0.drain(..).partition(|(.., name)| is_named(name));
        self.0 = others;
        let mut copies = Vec::new();
        for (from, to, _) in named.into_iter().filter(|(_, to, _)| !to.exists()) {
            copy_all(&from, &to)?;
            copies.push(to);
        }
        Ok(copies)
    }
}

/// Ranks whose folders a case is run in; 0: its own. Where ranks have made the mesh, they alone have fields, and the own mesh is that which they began with.
fn ranks_of(case: &Path) -> usize {
    let rank = |i: usize| case.join(format!("processor{i}"));
    let has_fields = |folder: &Path| {
        let times = times(folder).unwrap_or_default();
        times.iter().any(|(name, _)| names(&folder.join(name)).is_ok_and(|fields| !fields.is_empty()))
    };
    match has_mesh(case) && (has_fields(case) || !has_fields(&rank(0))) {
        true => 0,
        false => (0..).take_while(|i| rank(*i).is_dir()).count(),
    }
}

/// The first and the last time, and one that a run starts from.
fn starts_or_ends(start: f64) -> impl Fn(&str, f64, [f64; 2]) -> bool {
    move |_, t, ends| ends.contains(&t) || (t - start).abs() <= 1e-9 * start.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use std::os::unix::fs::symlink;

    /// A case of the names and texts, and a copy of it that is not made yet.
    fn case(files: &[(&str, &str)]) -> (tempfile::TempDir, Copy) {
        let dir = tempfile::tempdir().unwrap();
        let original = dir.path().join("study/case");
        fixtures::write(&original, files);
        let folder = dir.path().join("beside/case");
        fs::create_dir_all(&folder).unwrap();
        (dir, Copy { folder, original, ..Copy::default() })
    }

    /// Copies the case and what its files name.
    fn take(copy: &Copy, beside: &Path) {
        let system = copy.folder.join("system");
        copy_all(&copy.original.join("system"), &system).unwrap();
        let mut copies = copy.take(starts_or_ends(0.0)).unwrap();
        copies.push(system);
        Named::new(copy, &copy.original, beside).unwrap().follow(copies).unwrap();
    }

    #[test]
    fn a_mesh_is_a_region_s_where_the_case_has_regions() {
        let (_dir, copy) = case(&[]);
        for mesh in ["solid/polyMesh", "air/polyMesh", "polyMesh"] {
            fs::create_dir_all(copy.folder.join("constant").join(mesh)).unwrap();
        }
        assert_eq!(copy.region(), None);
        fs::write(copy.folder.join("constant/regionProperties"), "").unwrap();
        assert_eq!(copy.region().unwrap(), "air");
    }

    /// Whether any path below leads out of it.
    fn leads_out(folder: &Path) -> bool {
        names(folder)
            .unwrap()
            .iter()
            .map(|n| folder.join(n))
            .any(|p| p.is_symlink() || p.is_dir() && leads_out(&p))
    }

    #[test]
    fn nothing_in_the_copy_is_the_user_s() {
        let long = " ".repeat(2 << 20);
        let (dir, copy) = case(&[
            ("log.icoFoam", &long),
            ("system/controlDict", &long),
            ("constant/polyMesh/faces", &long),
            ("0/U", "a"),
        ]);
        let (from, study) = (&copy.original, dir.path().join("study"));
        fixtures::write(&study, &[("mesh/points", "p")]);
        symlink("../../mesh", from.join("constant/linked")).unwrap();
        symlink("../../mesh/points", from.join("constant/points")).unwrap();
        symlink("..", from.join("constant/round")).unwrap();
        symlink("nowhere", from.join("constant/dangling")).unwrap();
        take(&copy, &dir.path().join("beside"));
        assert!(!leads_out(&copy.folder));
        let at = |name: &str| copy.folder.join(name);
        assert!(!at("log.icoFoam").exists() && !at("constant/dangling").exists());
        for name in
            ["constant/linked/points", "constant/points", "system/controlDict", "constant/polyMesh/faces"]
        {
            fs::write(at(name), "another").unwrap();
        }
        assert_eq!(fs::read_to_string(study.join("mesh/points")).unwrap(), "p");
        assert_eq!(fs::read_to_string(from.join("system/controlDict")).unwrap(), long);
        assert_eq!(fs::read_to_string(from.join("constant/polyMesh/faces")).unwrap(), long);
    }

    #[test]
    fn ranks_that_alone_have_fields_are_taken() {
        let (_dir, copy) = case(&[
            ("constant/polyMesh/faces", ""),
            ("0.orig/U", ""),
            ("processor0/constant/polyMesh/faces", ""),
        ]);
        fs::create_dir(copy.original.join("0")).unwrap();
        fs::create_dir(copy.original.join("processor1")).unwrap();
        let ranks = |more: &str| {
            fixtures::write(&copy.original, &[(more, "")]);
            ranks_of(&copy.original)
        };
        assert_eq!([ranks("log.blockMesh"), ranks("processor0/0/U"), ranks("0/U")], [0, 2, 0]);
        fs::remove_dir_all(copy.original.join("constant/polyMesh")).unwrap();
        assert_eq!(ranks_of(&copy.original), 2);
    }

    #[test]
    fn what_the_files_name_comes_along() {
        let (dir, copy) = case(&[
            ("system/controlDict", "#include \"../../shared\"\nfile \"$FOAM_CASE/inlet.csv\";"),
            ("inlet.csv", "1"),
            ("notes.csv", "2"),
            ("0/U", "a"),
            ("0.5/U", "b"),
            ("1/U", "c"),
        ]);
        let study = dir.path().join("study");
        let others = [("shared", "#include \"../deeper\""), ("deeper", "nu 1;"), ("other", "x")];
        fixtures::write(&study, &others);
        let beside = dir.path().join("beside");
        take(&copy, &beside);
        let there = |name: &str| beside.join(name).exists();
        assert!(there("shared") && there("deeper") && !there("other"));
        assert!(there("case/inlet.csv") && !there("case/notes.csv"));
        assert!(there("case/0/U") && !there("case/0.5/U") && there("case/1/U"));
    }
}
