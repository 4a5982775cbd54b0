//! One program at a time for what is written for long: a folder, or files. The lock is a file beside, or in the folder, that says who has it.

use crate::files::{Target, target};
use crate::{Error, Result};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The name of the lock of a folder, and the end of that of a file.
const NAME: &str = ".m4gn-lock";

/// A claim, which ends with its process at the latest.
#[derive(Debug)]
pub struct Lock {
    /// None on a file system without locks.
    file: Option<File>,
    path: PathBuf,
}

/// Claims a folder, which is made where there is none, with all that this program writes into it.
///
/// # Errors
/// [`Error::File`] where another program has it, which is named, or where it cannot be written to.
pub fn folder(folder: &Path) -> Result<Lock> {
    make(folder)?;
    claim(folder, folder.join(NAME))
}

/// Claims the place of a file that [`crate::files::write_whole`] is to put there; none for a device or a pipe, which need none.
///
/// # Errors
/// [`Error::File`] where another program has it, which is named, or where the file could not be put there.
pub fn file(path: &Path) -> Result<Option<Lock>> {
    crate::files::check_writable(path)?;
    match target(path) {
        Ok(Target::Plain(at, _)) => {
            let name = at.file_name().unwrap_or_default().to_string_lossy().into_owned();
            claim(path, at.with_file_name(format!(".{name}{NAME}"))).map(Some)
        }
        _ => Ok(None),
    }
}

/// Endings of files that commands write into folders that they read: results of an earlier command may be replaced.
const RESULTS: [&str; 7] = ["json", "html", "csv", "vtu", "pvd", "safetensors", "checkpoint"];

/// Claims the files that a command is to write as [`file`], each once. None of them may be what it reads, under whatever name: a file, or one
/// in a folder but for results of earlier commands.
///
/// # Errors
/// As [`file`]; [`Error::File`] naming an output that is an input.
pub fn outputs<'a>(
    paths: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<Vec<Lock>> {
    let inputs: Vec<&Path> = inputs.into_iter().collect();
    let apart = |path: &'a Path| match inputs.iter().find(|input| is_read(path, input)) {
        Some(input) => Err(Error::file(
            path,
            format!("it would replace what is read ({}): give another file", input.display()),
        )),
        None => file(path),
    };
    paths.into_iter().filter_map(|path| apart(path).transpose()).collect()
}

fn is_read(output: &Path, input: &Path) -> bool {
    let identity = |path: &Path| path.metadata().ok().filter(|m| !m.is_dir()).map(|m| (m.dev(), m.ino()));
    let Some(own) = identity(output).filter(|_| output.is_file()) else { return false };
    if identity(input) == Some(own) {
        return true;
    }
    let result = output.extension().is_some_and(|e| RESULTS.iter().any(|r| e == *r));
    let (Ok(output), Ok(input)) = (output.canonicalize(), input.canonicalize()) else { return false };
    input.is_dir() && output.starts_with(input) && !result
}

/// As [`folder`], but waits while another program has it; `waiting` is told what [`folder`] would say, every so often, and ends the wait with an error.
///
/// # Errors
/// As [`folder`] for all else; those of `waiting`.
pub fn folder_in_turn(folder: &Path, mut waiting: impl FnMut(&Error) -> Result<()>) -> Result<Lock> {
    make(folder)?;
    loop {
        match attempt(folder, folder.join(NAME))? {
            Ok(lock) => return Ok(lock),
            Err(held) => waiting(&held)?,
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
}

/// The program that has a folder, as it says of itself ([`folder`]); none: nobody has it. Nothing is claimed or made.
pub fn holder(folder: &Path) -> Option<String> {
    let file = File::open(folder.join(NAME)).ok()?;
    match flock(&file, FlockOperation::NonBlockingLockShared) {
        Err(Errno::WOULDBLOCK) => Some(read_holder(file)),
        _ => None,
    }
}

fn read_holder(file: File) -> String {
    let mut holder = String::new();
    let _ = file.take(4096).read_to_string(&mut holder);
    if holder.is_empty() { "another m4gn".into() } else { holder.trim_end().into() }
}

fn make(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(Error::cannot("made", folder))
}

fn claim(what: &Path, path: PathBuf) -> Result<Lock> {
    attempt(what, path)?
}

/// The lock, or what there is to say of who has it.
fn attempt(what: &Path, path: PathBuf) -> Result<Result<Lock>> {
    let failed = |e: std::io::Error| Error::file(what, format!("cannot be locked ({}): {e}", path.display()));
    loop {
        let mut options = OpenOptions::new();
        let mut opened = options.read(true).write(true).create(true).truncate(false).open(&path);
        if opened.as_ref().is_err_and(|e| e.kind() == ErrorKind::PermissionDenied) {
            // What another user's program has left.
            opened = File::open(&path);
        }
        let mut file = opened.map_err(failed)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                let why = format!(
                    "is being written by {}: wait until that has ended, or choose another place",
                    read_holder(file)
                );
                return Ok(Err(Error::file(what, why)));
            }
            // A file system without locks: one program at a time is then up to the user.
            Err(Errno::NOLCK | Errno::OPNOTSUPP | Errno::NOSYS) => return Ok(Ok(Lock { file: None, path })),
            Err(e) => return Err(failed(e.into())),
        }
        // Another one may have removed it between opening and locking.
        let own = file.metadata().map_err(failed)?;
        if path.metadata().is_ok_and(|m| (m.dev(), m.ino()) == (own.dev(), own.ino())) {
            // Only a help: a lock without it is one as well.
            let _ = file.set_len(0).and_then(|()| file.write_all(this_program().as_bytes()));
            return Ok(Ok(Lock { file: Some(file), path }));
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While it is still held: nobody else can have it then.
        let _ = std::fs::remove_file(&self.path);
        drop(self.file.take());
    }
}

/// What another program says of this one.
fn this_program() -> String {
    let words: Vec<String> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
    let command: String = words.join(" ").chars().take(300).collect();
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    format!("process {} on {} ({command})\n", std::process::id(), host.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn refused<T>(claimed: Result<T>) -> String {
        claimed.err().expect("two have it").to_string()
    }

    #[test]
    fn a_place_is_one_programs_and_says_whose() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let own = format!("process {} on ", std::process::id());
        let held = folder(&at("new/set")).unwrap();
        let message = refused(folder(&at("new/set")));
        assert!(message.contains("new/set: is being written by") && message.contains(&own), "{message}");
        assert!(holder(&at("new/set")).is_some_and(|who| who.starts_with(&own)));
        assert!(folder(&at("new")).is_ok(), "another folder");
        drop(held);
        assert_eq!([holder(&at("new/set")), holder(&at("none"))], [None, None]);
        assert!(!at("none").exists(), "who asks makes nothing");
        drop(folder(&at("new/set")).unwrap());
        let held = outputs([at("a.safetensors"), at("b.json")].iter().map(PathBuf::as_path), []).unwrap();
        assert!(held.len() == 2 && refused(file(&at("b.json"))).contains(&own));
        symlink("a.safetensors", at("link")).unwrap();
        assert!(refused(file(&at("link"))).contains("link: is being written by"));
        drop(held);
        assert!(file(Path::new("/dev/null")).unwrap().is_none());
        assert!(file(&at("none/a")).is_err());
        let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.len() == 2 && std::fs::read_dir(at("new/set")).unwrap().count() == 0, "{left:?}");
    }

    #[test]
    fn no_output_is_an_input_under_whatever_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir_all(at("data/deeper")).unwrap();
        for name in ["model", "data/a.h5", "data/deeper/b", "data/old.json"] {
            std::fs::write(at(name), name).unwrap();
        }
        symlink("model", at("link")).unwrap();
        std::fs::hard_link(at("model"), at("twin")).unwrap();
        let inputs = [at("model"), at("data")];
        let claimed = |names: &[&str]| {
            let paths: Vec<PathBuf> = names.iter().map(|name| at(name)).collect();
            outputs(paths.iter().map(PathBuf::as_path), inputs.iter().map(PathBuf::as_path))
                .map(|held| held.len())
        };
        for name in ["model", "link", "twin", "data/../model", "data/a.h5", "data/deeper/b"] {
            assert!(refused(claimed(&[name])).contains("would replace what is read"), "{name}");
        }
        assert_eq!(claimed(&["new", "data/old.json", "data/new.h5"]).unwrap(), 3);
        assert!(refused(claimed(&["new", "new"])).contains("is being written by"));
        assert_eq!(std::fs::read(at("model")).unwrap(), b"model");
    }

    /// A program that was killed leaves the file, and no lock.
    #[test]
    fn what_a_killed_program_left_is_taken() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(NAME), "process 1").unwrap();
        let held = folder(dir.path()).unwrap();
        assert!(!refused(folder(dir.path())).contains("process 1 "));
        drop(held);
    }

    #[test]
    fn who_waits_has_it_next() {
        let dir = tempfile::tempdir().unwrap();
        let held = folder(dir.path()).unwrap();
        let stopped = folder_in_turn(dir.path(), |_| Err(Error::Interrupted("stop".into())));
        assert!(matches!(stopped, Err(Error::Interrupted(_))));
        let (mut held, mut said) = (Some(held), String::new());
        let next = folder_in_turn(dir.path(), |who| {
            said = who.to_string();
            drop(held.take());
            Ok(())
        });
        assert!(said.contains("is being written by process ") && next.is_ok(), "{said}");
    }

    /// However many try, one at a time has it.
    #[test]
    fn one_of_many_has_it() {
        let dir = tempfile::tempdir().unwrap();
        let inside = std::sync::atomic::AtomicUsize::new(0);
        let order = std::sync::atomic::Ordering::SeqCst;
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        if let Ok(_held) = folder(dir.path()) {
                            assert_eq!(inside.fetch_add(1, order), 0);
                            inside.fetch_sub(1, order);
                        }
                    }
                });
            }
        });
    }
}
