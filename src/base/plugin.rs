//! The project's own libraries that are loaded when something needs them and not before: libtorch, PETSc and SLEPc,
//! OpenFOAM's libraries come with them.
//!
//! One search rule: the folder of the file that this code was loaded from (a solver's `libm4gn.so`, or the program),
//! `../../lib` of it, which is `lib` of the checkout that a program was built in, `../lib`, which is that of an installed program, and
//! `$M4GN_HOME/lib`, where that is absolute. Models, templates and tutorials are beside such a `lib`.
//!
//! Each library exports `PREFIX_abi_version()`, which must agree, and `PREFIX_last_error()`, the message of the calling
//! thread's last failure, valid until its next call. Statuses are those of `m4gn.h`. A library is never unloaded: exit
//! handlers of the libraries that it brings would return into nothing.
#![allow(unsafe_code)]

use crate::{Error, Result, listed, refuse};
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LOCAL, RTLD_NOW};
use std::cell::RefCell;
use std::ffi::{CStr, CString, OsString, c_char, c_void};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

/// Address space that must be left where it is limited, bytes: the libraries that come along (OpenBLAS with a buffer for each thread, MPI)
/// spin for ever or crash where they get none.
const ROOM: u64 = 1 << 30;

/// What is known of a library before it is loaded.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// File name, `libm4gn_torch.so`.
    pub file: &'static str,
    /// What the names of its functions begin with, `m4gn_torch`.
    pub prefix: &'static str,
    /// Version of the C interface that this code speaks.
    pub version: u32,
    /// What it needs and how it is built: the end of the message where it is not found or cannot be loaded.
    pub remedy: &'static str,
    /// Whether its symbols are for libraries that are loaded later.
    pub global: bool,
}

/// A loaded library.
#[derive(Debug)]
pub struct Plugin {
    library: ManuallyDrop<Library>,
    path: PathBuf,
    last_error: unsafe extern "C" fn() -> *const c_char,
}

/// Folders in which libraries are looked for, in this order; see [the search rule](self).
pub fn places() -> Vec<PathBuf> {
    let mut places = Vec::new();
    if let Some(folder) = own_file().and_then(|f| f.parent().map(PathBuf::from)) {
        let beside = ["../../lib", "../lib"].map(|lib| folder.join(lib));
        places.push(folder);
        places.extend(beside.into_iter().filter_map(|lib| lib.canonicalize().ok()));
    }
    places.extend(folder_variable("M4GN_HOME").map(|home| home.join("lib")));
    places.dedup();
    places
}

/// Folders that may hold models, templates and tutorials: those that the [`places`] are in.
pub fn homes() -> Vec<PathBuf> {
    places().iter().filter_map(|place| place.parent().map(PathBuf::from)).collect()
}

/// The folders of this name in the [`homes`], and the names of those in them that have a `file`.
pub fn shipped(folder: &str, file: &str) -> (Vec<PathBuf>, Vec<String>) {
    let mut folders: Vec<PathBuf> = homes().into_iter().map(|home| home.join(folder)).collect();
    folders.dedup();
    let entries = folders.iter().filter_map(|f| std::fs::read_dir(f).ok()).flatten().flatten();
    let with = entries.filter(|e| e.path().join(file).is_file());
    let mut names: Vec<String> = with.filter_map(|e| e.file_name().into_string().ok()).collect();
    names.sort();
    names.dedup();
    (folders, names)
}

/// The folder that an environment variable names, `M4GN_HOME` or `WM_PROJECT_DIR`. One that is empty is not set, and one that is not
/// absolute counts for nothing: what is loaded must not depend on the folder that a program is started in.
pub fn folder_variable(name: &str) -> Option<PathBuf> {
    absolute(std::env::var_os(name)?)
}

fn absolute(value: OsString) -> Option<PathBuf> {
    Some(PathBuf::from(value)).filter(|p| p.is_absolute())
}

/// The file of this name in one of the [`places`]; `remedy` says how it is made.
///
/// # Errors
/// [`Error::File`] naming the places, where it is in none of them.
pub fn find(file: &str, remedy: &str) -> Result<PathBuf> {
    let places = places();
    let found = places.iter().map(|p| p.join(file)).find(|p| p.is_file());
    found.ok_or_else(|| {
        let tried = listed(places.iter().map(|p| p.display()));
        let home = "Set M4GN_HOME to the checkout if this program was moved";
        Error::file(file, format!("not found in {tried}. {remedy}. {home}"))
    })
}

impl Description {
    /// The library's file.
    ///
    /// # Errors
    /// As [`find`].
    pub fn find(&self) -> Result<PathBuf> {
        find(self.file, self.remedy)
    }

    /// Finds the library, loads it, and checks its version.
    ///
    /// # Errors
    /// As [`Description::find`]; [`Error::File`] where it cannot be loaded or is of another version.
    pub fn load(&self) -> Result<Plugin> {
        self.load_from(self.find()?)
    }

    /// As [`Description::load`], from this file.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be loaded or is of another version.
    pub fn load_from(&self, path: PathBuf) -> Result<Plugin> {
        check_room(&path)?;
        let scope = if self.global { RTLD_GLOBAL } else { RTLD_LOCAL };
        // SAFETY: loading runs the initialisers of our own library, found where we install it, and of what it needs.
        let library = unsafe { Library::open(Some(&path), RTLD_NOW | scope) }
            .map_err(|e| Error::file(&path, format!("cannot be loaded ({e}). {}", self.remedy)))?;
        let library = ManuallyDrop::new(library);
        // SAFETY: the type of this function is the same in all versions of all interfaces.
        let version: unsafe extern "C" fn() -> u32 =
            unsafe { symbol(&library, &path, &format!("{}_abi_version", self.prefix))? };
        // SAFETY: as above.
        let (version, own) = (unsafe { version() }, self.version);
        let wrong = |what: String| Error::file(&path, what);
        refuse(version != own, wrong, || {
            format!(
                "version {version} of its interface, this program needs {own}: build both from one checkout with \
                 setup/build.sh"
            )
        })?;
        // SAFETY: as above.
        let last_error = unsafe { symbol(&library, &path, &format!("{}_last_error", self.prefix))? };
        Ok(Plugin { library, path, last_error })
    }
}

impl Plugin {
    /// The file that it came from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A function of the library.
    ///
    /// # Errors
    /// [`Error::File`] where there is none of this name.
    ///
    /// # Safety
    /// `T` must be the function's type in this version of the interface.
    pub unsafe fn function<T: Copy>(&self, name: &str) -> Result<T> {
        // SAFETY: passed on to the caller.
        unsafe { symbol(&self.library, &self.path, name) }
    }

    /// The message of this thread's last failure.
    pub fn message(&self) -> String {
        // SAFETY: the function returns null or a string that is valid until the next call on this thread.
        unsafe {
            let text = (self.last_error)();
            match text.is_null() {
                true => "no message".into(),
                false => CStr::from_ptr(text).to_string_lossy().into_owned(),
            }
        }
    }

    /// Turns a status into the error that the library kept for this thread.
    ///
    /// # Errors
    /// That error, of the class that the status says.
    pub fn check(&self, status: i32) -> Result<()> {
        match status {
            0 => Ok(()),
            _ => Err(Error::from_status(status, self.message())),
        }
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Keeps the message of this thread's last failure.
pub fn keep_error(message: &str) {
    let message = CString::new(message.replace('\0', "")).unwrap_or_default();
    // A thread that is being torn down keeps no message any more.
    let _ = LAST_ERROR.try_with(|m| *m.borrow_mut() = message);
}

/// The message kept, or an empty string: what `PREFIX_last_error()` returns. Each library has a copy of this code, and messages of its own.
pub fn last_error() -> *const c_char {
    LAST_ERROR.try_with(|m| m.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Whether a limit of the address space (`ulimit -v`) leaves room for a library and what it brings.
fn check_room(path: &Path) -> Result<()> {
    let read = |file: &str| std::fs::read_to_string(file).unwrap_or_default();
    let limit = limit_of(&read("/proc/self/limits"));
    let pages = read("/proc/self/statm").split(' ').next().and_then(|n| n.parse::<u64>().ok());
    // Pages of 4 kB, the least that there are.
    match (limit, pages.map(|n| 4096 * n)) {
        (Some(limit), Some(taken)) if limit.saturating_sub(taken) < ROOM => Err(Error::file(
            path,
            format!(
                "cannot be loaded: of the {} MB that this process may address (ulimit -v) {} MB are left, expected {} MB: raise \
                 the limit",
                limit >> 20,
                limit.saturating_sub(taken) >> 20,
                ROOM >> 20
            ),
        )),
        _ => Ok(()),
    }
}

/// The limit of the address space in the text of `/proc/self/limits`, bytes; none where there is none.
fn limit_of(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// # Safety
/// `T` must be the function's type.
unsafe fn symbol<T: Copy>(library: &Library, path: &Path, name: &str) -> Result<T> {
    // SAFETY: passed on to the caller.
    unsafe { library.get::<T>(name) }
        .map(|s| *s)
        .map_err(|e| Error::file(path, format!("has no function {name} ({e}): build it again")))
}

/// A text for a C interface.
///
/// # Errors
/// [`Error::Input`] for a text with a zero byte.
pub fn c_string(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error::Input(format!("{text:?} contains a zero byte")))
}

/// The file that this code was loaded from: `libm4gn.so` in a solver, the program elsewhere.
fn own_file() -> Option<PathBuf> {
    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here = own_file as *const c_void;
    // SAFETY: dladdr fills the struct when it returns non-zero; the name then points to a string of the loader.
    let name = unsafe {
        if libc::dladdr(here, info.as_mut_ptr()) == 0 {
            return None;
        }
        let info = info.assume_init();
        if info.dli_fname.is_null() {
            return None;
        }
        CStr::from_ptr(info.dli_fname)
    };
    let name = Path::new(name.to_str().ok()?);
    let is_library = name.extension().is_some_and(|e| e == "so");
    // Of a program the loader has only the word by which it was called.
    let file = if is_library { std::path::absolute(name).ok()? } else { std::env::current_exe().ok()? };
    Some(file.canonicalize().unwrap_or(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Description = Description {
        file: "libm4gn_none.so",
        prefix: "m4gn_none",
        version: 1,
        remedy: "Build it",
        global: false,
    };

    #[test]
    fn a_library_that_is_not_there_is_explained() {
        let own = std::env::current_exe().unwrap().canonicalize().unwrap();
        m4gn_samples::fails(NONE.load(), &[own.parent().unwrap().to_str().unwrap(), "Build it"]);
    }

    #[test]
    fn only_absolute_folders_are_searched() {
        assert_eq!(absolute("/a/b".into()), Some("/a/b".into()));
        for none in ["", ".", "a", "../a"] {
            assert_eq!(absolute(none.into()), None, "{none}");
        }
        assert!(places().iter().all(|p| p.is_absolute()));
    }

    #[test]
    fn a_limit_of_the_address_space_is_read() {
        let text = |soft: &str| {
            format!("Limit  Soft  Hard  Units\nMax address space         {soft}   unlimited   bytes\n")
        };
        assert_eq!(limit_of(&text("409600000")), Some(409_600_000));
        assert_eq!(limit_of(&text("unlimited")), None);
        assert_eq!(limit_of(""), None);
    }

    #[test]
    fn a_library_of_somebody_else_is_refused() {
        let other = NONE.load_from("libc.so.6".into());
        m4gn_samples::fails(other, &["has no function m4gn_none_abi_version"]);
        let own = std::env::current_exe().unwrap();
        assert!(NONE.load_from(own).is_err());
    }
}
