//! Finding a family: in a folder of the user's, or among those that come with m4gn.

use super::family::{FILE, Family};
use m4gn_base::{Error, Result, listed, plugin};
use std::path::{Path, PathBuf};

impl Family {
    /// The family of this name among those that come with m4gn, or in this folder of the user's.
    ///
    /// # Errors
    /// [`Error::Input`] that lists the families where there is none; otherwise as [`Family::load`].
    pub fn find(name: &Path) -> Result<Self> {
        if name.join(FILE).is_file() {
            return Family::load(name);
        }
        let folders = folders();
        if let Some(folder) = folders.iter().map(|f| f.join(name)).find(|f| f.join(FILE).is_file()) {
            return Family::load(&folder);
        }
        Err(Error::Input(format!(
            "'{}' is no family of cases: expected {}, or a folder with a file {FILE} (looked in {}; set M4GN_HOME to the \
             checkout if this program was moved)",
            name.display(),
            listed(names(&folders)),
            listed(folders.iter().map(|p| p.display()))
        )))
    }
}

/// Folders of the families that come with m4gn: beside those of the libraries.
fn folders() -> Vec<PathBuf> {
    let mut folders: Vec<_> =
        plugin::homes().into_iter().map(|home| home.join("openfoam/templates")).collect();
    folders.dedup();
    folders
}

/// Names of the families in these folders.
fn names(folders: &[PathBuf]) -> Vec<String> {
    let entries = folders.iter().filter_map(|f| std::fs::read_dir(f).ok()).flatten();
    let families = entries.flatten().filter(|e| e.path().join(FILE).is_file());
    let mut names: Vec<String> = families.filter_map(|e| e.file_name().into_string().ok()).collect();
    names.sort();
    names.dedup();
    names
}
