//! Options in PETSc's database for the time of a solution.

use super::{c, check};
use m4gn_mesh::{Error, Result};
use std::ffi::{CStr, CString, c_char};

/// Prefix of our solvers' options.
pub(super) const PREFIX: &CStr = c"m4gn_";

/// Options that are in the database while this lives.
pub(super) struct Options {
    names: Vec<CString>,
    defaults: Vec<CString>,
    text: String,
}

impl Options {
    /// Puts them into the database.
    ///
    /// # Errors
    /// [`Error::Input`] for words that are no options under the prefix `m4gn_`.
    pub(super) fn new(text: &str) -> Result<Self> {
        let mut options = Options { names: Vec::new(), defaults: Vec::new(), text: text.into() };
        for (name, value) in parse(text)? {
            let c_string = |s: &str| {
                CString::new(s).map_err(|_| Error::Input(format!("PETSc option {s:?} has a zero byte")))
            };
            let (name, value) = (c_string(name)?, value.map(c_string).transpose()?);
            let value = value.as_ref().map_or(std::ptr::null(), |v| v.as_ptr() as *const c_char);
            // SAFETY: C strings that PETSc copies; a null value is none.
            check(unsafe { c::PetscOptionsSetValue(std::ptr::null_mut(), name.as_ptr(), value) })?;
            options.names.push(name);
        }
        Ok(options)
    }

    /// Puts those into the database that nobody else has set.
    pub(super) fn defaults(&mut self, defaults: &[(&CStr, &CStr)]) -> Result<()> {
        for &(name, value) in defaults {
            let null = std::ptr::null_mut();
            let mut given = c::PetscBool_PETSC_FALSE;
            // SAFETY: C strings that PETSc copies; one flag is written.
            unsafe {
                check(c::PetscOptionsHasName(null, std::ptr::null(), name.as_ptr(), &mut given))?;
                if given == c::PetscBool_PETSC_FALSE {
                    check(c::PetscOptionsSetValue(null, name.as_ptr(), value.as_ptr()))?;
                    self.defaults.push(name.to_owned());
                }
            }
        }
        Ok(())
    }

    /// After a solution: every option must have been looked at.
    ///
    /// # Errors
    /// [`Error::Input`] naming one that was not.
    pub(super) fn all_used(&self) -> Result<()> {
        for name in &self.names {
            let mut used = c::PetscBool_PETSC_FALSE;
            // SAFETY: a C string, past the hyphen, which this call does not want; one flag is written.
            check(unsafe { c::PetscOptionsUsed(std::ptr::null_mut(), name.as_ptr().add(1), &mut used) })?;
            if used == c::PetscBool_PETSC_FALSE {
                return Err(Error::Input(format!(
                    "PETSc option {} was not used: expected an option of the solver that ran; -m4gn_eps_view shows it, \
                     SLEPc's and PETSc's manuals have the names, here with the prefix m4gn_",
                    name.to_string_lossy()
                )));
            }
        }
        Ok(())
    }

    /// Says which options an error came with.
    pub(super) fn explain(&self, error: Error) -> Error {
        match error {
            Error::Numerical(m) if !self.names.is_empty() => {
                Error::Numerical(format!("{m}; with the PETSc options {}", self.text.trim()))
            }
            other => other,
        }
    }
}

impl Drop for Options {
    fn drop(&mut self) {
        for name in self.names.iter().chain(&self.defaults) {
            // SAFETY: a C string; clearing what is not there is allowed.
            unsafe { c::PetscOptionsClearValue(std::ptr::null_mut(), name.as_ptr()) };
        }
    }
}

/// Names with their values, if they have one.
fn parse(text: &str) -> Result<Vec<(&str, Option<&str>)>> {
    let mut options: Vec<(&str, Option<&str>)> = Vec::new();
    for word in text.split_whitespace() {
        let name = word.strip_prefix('-').is_some_and(|w| w.starts_with(|c: char| c.is_ascii_alphabetic()));
        match options.last_mut() {
            _ if name => {
                let known = word.strip_prefix("-m4gn_").is_some_and(|rest| !rest.is_empty());
                if !known {
                    return Err(Error::Input(format!(
                        "PETSc option {word}: expected a name that starts with -m4gn_, as -m4gn_eps_tol"
                    )));
                }
                options.push((word, None));
            }
            Some((_, value)) if value.is_none() => *value = Some(word),
            _ => {
                return Err(Error::Input(format!(
                    "PETSc options: expected '-m4gn_name value ...', found '{word}' where a name should stand"
                )));
            }
        }
    }
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_names_with_values() {
        let found = parse(" -m4gn_eps_view -m4gn_st_shift -1.5\n-m4gn_eps_tol 1e-9").unwrap();
        let expected =
            [("-m4gn_eps_view", None), ("-m4gn_st_shift", Some("-1.5")), ("-m4gn_eps_tol", Some("1e-9"))];
        assert_eq!(found, expected);
        assert!(parse("").unwrap().is_empty());
        for bad in ["-eps_tol 1", "1e-9", "-m4gn_a 1 2", "-m4gn_", "- 3"] {
            assert!(matches!(parse(bad), Err(Error::Input(_))), "{bad}");
        }
    }
}
