//! Finding a family: in a folder of the user's, or among those that come with m4gn.

use super::family::{FILE, Family};
use m4gn_base::{Error, Result, listed, plugin};
use std::path::Path;

impl Family {
    /// The family of this name among those that come with m4gn, or in this folder of the user's.
    ///
    /// # Errors
    /// [`Error::Input`] that lists the families where there is none; otherwise as [`Family::load`].
    pub fn find(name: &Path) -> Result<Self> {
        if name.join(FILE).is_file() {
            return Family::load(name);
        }
        let (folders, names) = plugin::shipped("openfoam/templates", FILE);
        if let Some(folder) = folders.iter().map(|f| f.join(name)).find(|f| f.join(FILE).is_file()) {
            return Family::load(&folder);
        }
        Err(Error::Input(format!(
            "'{}' is no family of cases: expected {}, or a folder with a file {FILE} (looked in {}; set M4GN_HOME to the \
             checkout if this program was moved)",
            name.display(),
            listed(names),
            listed(folders.iter().map(|p| p.display()))
        )))
    }
}
