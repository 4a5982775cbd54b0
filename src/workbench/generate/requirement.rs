//! What must hold of every case of a family.

use super::expression::{self, Variables};
use m4gn_base::{Error, Result};
use serde::Deserialize;

/// A condition on the quantities of a case, or on the libraries that it runs with.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Requirement {
    /// Condition.
    pub that: String,
    /// A library, with which the case can be where the condition does not hold.
    pub unless: Option<Library>,
    /// What is said where neither is so.
    pub otherwise: String,
}

/// A library in `LD_LIBRARY_PATH` that has something.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Library {
    /// Name of the file.
    pub library: String,
    /// What it contains: the name of a class.
    pub has: String,
}

impl Requirement {
    /// Whether the case can be.
    ///
    /// # Errors
    /// [`Error::Input`] for a condition that cannot be computed; [`Error::File`] for a library that cannot be read.
    pub fn holds(&self, variables: &Variables) -> Result<bool> {
        Ok(expression::holds(&self.that, variables)?
            || match &self.unless {
                Some(library) => library.found(std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default())?,
                None => false,
            })
    }
}

impl Library {
    /// Whether the first library of this name in these folders has it.
    fn found(&self, folders: std::ffi::OsString) -> Result<bool> {
        let place = std::env::split_paths(&folders).map(|f| f.join(&self.library)).find(|p| p.is_file());
        let Some(place) = place else { return Ok(false) };
        let bytes = std::fs::read(&place).map_err(Error::cannot("read", &place))?;
        Ok(bytes.windows(self.has.len().max(1)).any(|part| part == self.has.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_counts_where_the_condition_does_not_hold() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let library = Library { library: "libmodels.so".into(), has: "Newton".into() };
        let found =
            || library.found(std::env::join_paths(folders.iter().map(|f| f.path())).unwrap()).unwrap();
        assert!(!found());
        std::fs::write(folders[1].path().join("libmodels.so"), b"\0Newtons\0").unwrap();
        assert!(found());
        // The loader takes the first one
        std::fs::write(folders[0].path().join("libmodels.so"), b"\0Newto\0n").unwrap();
        assert!(!found());

        let variables = Variables::from([("algorithm".to_string(), 1.0)]);
        let requirement = |that: &str| Requirement {
            that: that.into(),
            unless: Some(Library { library: "libnone-such.so".into(), has: "x".into() }),
            otherwise: "no".into(),
        };
        assert!(requirement("algorithm == 1").holds(&variables).unwrap());
        assert!(!requirement("algorithm == 0").holds(&variables).unwrap());
        assert!(requirement("none == 0").holds(&variables).is_err());
    }
}
