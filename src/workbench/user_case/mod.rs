//! A user's case: what its files say, asked of OpenFOAM's own programs, and a copy of it that its solver can run in.

mod copy;
pub(crate) mod log;
pub(crate) mod script;

pub(crate) use copy::{Copy, Start};

use crate::generate::process::{Surroundings, ends, excerpt};
use m4gn_base::{Error, Result, files};
use serde_json::Value;
use std::fs::{self, OpenOptions};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// What is not of use to a run.
pub(crate) const LEFT_OUT: [&str; 4] = ["postProcessing", "VTK", "logs", "dynamicCode"];

/// Where a case has the dictionary of blockMesh.
pub(crate) const BLOCK_MESH: [&str; 2] = ["system/blockMeshDict", "constant/polyMesh/blockMeshDict"];

/// Of longer files the begin and the end are searched for names of other files.
const SEARCHED: usize = 1 << 18;

/// What an OpenFOAM dictionary begins with.
pub(crate) fn header(object: &str) -> String {
    format!("FoamFile {{ version 2.0; format ascii; class dictionary; object {object}; }}\n")
}

/// An entry of a dictionary, as OpenFOAM reads it; none: it has none. The program works in `folder`.
pub(crate) fn entry(folder: &Path, file: &Path, name: &str, tools: &Surroundings) -> Result<Option<String>> {
    let done = tools.run(folder, &["foamDictionary", "-entry", name, "-value", &file.display().to_string()]);
    let log = excerpt(&folder.join("log.foamDictionary"));
    match done {
        Ok(()) => Ok(log.lines().rfind(|l| !l.trim().is_empty()).map(|l| l.trim().to_string())),
        Err(Error::Interrupted(e)) => Err(Error::Interrupted(e)),
        Err(_) if log.contains("Cannot find entry") => Ok(None),
        Err(e) => Err(Error::file(file, log::words(&log, &e))),
    }
}

/// Names and types of the function objects in a `controlDict`.
pub(crate) fn function_objects(
    folder: &Path,
    control: &Path,
    tools: &Surroundings,
) -> Result<Vec<(String, String)>> {
    if entry(folder, control, "functions", tools)?.is_none() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for name in keywords(folder, control, "functions", tools) {
        if let Some(kind) = entry(folder, control, &format!("functions/{name}/type"), tools)? {
            found.push((name, kind));
        }
    }
    Ok(found)
}

/// Names of the entries of a dictionary within a file; none where there is no such dictionary.
pub(crate) fn keywords(folder: &Path, file: &Path, name: &str, tools: &Surroundings) -> Vec<String> {
    let listed =
        tools.run(folder, &["foamDictionary", "-entry", name, "-keywords", &file.display().to_string()]);
    let names = excerpt(&folder.join("log.foamDictionary"));
    let names = names.lines().map(str::trim).filter(|n| listed.is_ok() && !n.is_empty());
    names.map(str::to_string).collect()
}

/// What the last check of the function object m4gnAverages of this name said in a run with this log, and the file that has it.
pub(crate) fn averages(case: &Path, name: &str, log: &Path) -> Result<(PathBuf, Value)> {
    let folder = case.join("postProcessing").join(name);
    let latest = times(&folder).unwrap_or_default().pop();
    let path = folder.join(latest.map_or(String::new(), |(n, _)| n)).join("averages.json");
    let text = files::read_text(&path).map_err(|e| {
        let log = log.display();
        let told =
            format!("cannot be read: {e}; expected figures of m4gnAverages; {log} says why there are none");
        Error::file(&path, told)
    })?;
    let all = serde_json::from_str(&text).map_err(|e| Error::file(&path, e.to_string()))?;
    Ok((path, all))
}

/// Whether a case has a mesh.
pub(crate) fn has_mesh(case: &Path) -> bool {
    let has = |folder: &Path| ["faces", "faces.gz"].iter().any(|f| folder.join("polyMesh").join(f).exists());
    let constant = case.join("constant");
    // Of several regions each has its own
    has(&constant) || fs::read_dir(&constant).into_iter().flatten().flatten().any(|e| has(&e.path()))
}

/// Whether a case is of several regions, each with a mesh and fields in folders of its own.
pub(crate) fn has_regions(case: &Path) -> bool {
    case.join("constant/regionProperties").is_file()
}

/// Names of all that a folder has.
pub(crate) fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).map_err(Error::cannot("read", folder))?;
    Ok(entries.flatten().filter_map(|e| e.file_name().into_string().ok()).collect())
}

/// The time that a folder is of; none: it is of none.
pub(crate) fn time(name: &str) -> Option<f64> {
    name.parse::<f64>().ok().filter(|t| t.is_finite())
}

/// Names of the folders of all times in a folder, with their values in s, ascending.
pub(crate) fn times(folder: &Path) -> Result<Vec<(String, f64)>> {
    let mut found: Vec<(String, f64)> =
        names(folder)?.into_iter().filter_map(|name| time(&name).map(|t| (name, t))).collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ok(found)
}

/// Whether a case's last times are in one folder of all ranks (collated), where the bridge does not look.
pub(crate) fn is_collated(case: &Path) -> bool {
    let last = |folder: &Path| times(folder).ok()?.pop().map(|t| t.1);
    let own = last(case);
    let of_all = |name: &String| name.starts_with("processors") && last(&case.join(name)) > own;
    !case.join("processor0").is_dir() && names(case).unwrap_or_default().iter().any(of_all)
}

/// Copies a file, or a folder with all that is in it, programs as programs. Links become what they lead to; those that lead nowhere or back to where
/// they are, pipes and devices are left out.
pub(crate) fn copy_all(from: &Path, to: &Path) -> Result<()> {
    copy_within(from, to, &mut Vec::new())
}

fn copy_within(from: &Path, to: &Path, open: &mut Vec<PathBuf>) -> Result<()> {
    let failed = |e: std::io::Error| {
        let hint = if to.starts_with(std::env::temp_dir()) { "; TMPDIR says where copies go" } else { "" };
        Error::file(from, format!("cannot be copied to {}: {e}{hint}", to.display()))
    };
    let Ok(kind) = fs::metadata(from) else { return Ok(()) };
    if kind.is_file() {
        let copied = || {
            to.parent().map_or(Ok(()), fs::create_dir_all)?;
            // Not as read-only as the original may be
            let mode = 0o666 | (kind.permissions().mode() & 0o111);
            let mut copy = OpenOptions::new().write(true).create(true).truncate(true).mode(mode).open(to)?;
            std::io::copy(&mut fs::File::open(from)?, &mut copy)
        };
        return copied().map(drop).map_err(failed);
    }
    let real = from.canonicalize().map_err(failed)?;
    if !kind.is_dir() || open.contains(&real) {
        return Ok(());
    }
    fs::create_dir_all(to).map_err(failed)?;
    open.push(real);
    for name in names(from)? {
        copy_within(&from.join(&name), &to.join(&name), open)?;
    }
    open.pop();
    Ok(())
}

/// Texts of all files here, of long ones the begin and the end.
fn read_all(path: &Path, texts: &mut Vec<String>) {
    if path.is_dir() {
        names(path).unwrap_or_default().iter().for_each(|name| read_all(&path.join(name), texts));
    } else {
        texts.push(ends(path, SEARCHED));
    }
}

/// Whether a text has this name as a whole part of a path.
pub(crate) fn mentions(text: &str, name: &str) -> bool {
    let inside = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    text.match_indices(name).any(|(at, _)| {
        let (before, after) = (text[..at].chars().next_back(), text[at + name.len()..].chars().next());
        !before.is_some_and(inside) && !after.is_some_and(inside)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_of_a_case_can_be_run_in_its_copy() {
        let dir = tempfile::tempdir().unwrap();
        let (from, to) = (dir.path().join("from"), dir.path().join("to"));
        fs::create_dir(&from).unwrap();
        for (name, mode, copied) in [("Allrun.pre", 0o555, 0o700), ("U", 0o444, 0o600)] {
            fs::write(from.join(name), name).unwrap();
            fs::set_permissions(from.join(name), fs::Permissions::from_mode(mode)).unwrap();
            copy_all(&from, &to).unwrap();
            let found = fs::metadata(to.join(name)).unwrap().permissions().mode();
            assert_eq!(found & 0o700, copied, "{name}");
        }
    }

    #[test]
    fn a_mesh_may_be_a_region_s_and_compressed() {
        let dir = tempfile::tempdir().unwrap();
        let mesh = dir.path().join("constant/air/polyMesh");
        fs::create_dir_all(&mesh).unwrap();
        assert!(!has_mesh(dir.path()));
        fs::write(mesh.join("faces.gz"), "").unwrap();
        assert!(has_mesh(dir.path()));
    }

    #[test]
    fn times_of_all_ranks_may_be_in_one_folder() {
        let dir = tempfile::tempdir().unwrap();
        for folder in ["0", "processors2/0", "processors2/0.5"] {
            fs::create_dir_all(dir.path().join(folder)).unwrap();
        }
        assert!(is_collated(dir.path()));
        fs::create_dir(dir.path().join("0.5")).unwrap();
        assert!(!is_collated(dir.path()), "they are reconstructed");
    }

    #[test]
    fn names_are_whole_parts_of_paths() {
        assert!(
            mentions("#include \"../shared\"", "../shared") && mentions("a ../../shared/b;", "../shared")
        );
        assert!(!mentions("../shared2", "../shared") && !mentions("\"shared\"", "../shared"));
        assert!(mentions("\"inlet.csv\"", "inlet.csv") && !mentions("my-inlet.csv", "inlet.csv"));
    }
}
