//! Whole files: a reader sees the old one or the new one, never half of it. What is no plain file is written through, and not read.

use crate::{Error, Result};
use std::fs::{self, Metadata, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Where a path leads.
pub(crate) enum Target {
    /// A plain file, or none yet: replaced as a whole, at the end of symbolic links.
    Plain(PathBuf, Option<Metadata>),
    /// What this process prints to.
    StandardOutput,
    /// A device, a pipe, a socket.
    Stream,
}

/// Writes `bytes` as the whole content of `path`.
///
/// A plain file is written beside its name first and renamed when it is whole; its permissions stay. A symbolic link
/// stays too, and its target is replaced. A device or a pipe is written to, and so is the standard output of this process
/// under any name it has (`/dev/stdout`): what was printed before is kept.
///
/// # Errors
/// [`Error::File`]; a plain file is then as it was.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    write(path, bytes).map_err(|e| failed(path, e))
}

/// Whether [`write_whole`] could put a file there, so that a long job can say so before it begins.
///
/// # Errors
/// [`Error::File`] where it could not.
pub fn check_writable(path: &Path) -> Result<()> {
    let check = || match target(path)? {
        Target::Plain(at, _) => tempfile::NamedTempFile::new_in(folder(&at)).map(drop),
        Target::StandardOutput => Ok(()),
        // A pipe without a reader would block here.
        Target::Stream if fs::metadata(path)?.file_type().is_fifo() => Ok(()),
        Target::Stream => OpenOptions::new().write(true).open(path).map(drop),
    };
    check().map_err(|e| failed(path, e))
}

/// The bytes of a plain file. A pipe without a writer would be waited for, and a device may never end: they are refused.
///
/// # Errors
/// What was found in place of a plain file, or why it cannot be read.
pub fn read(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    check_plain(path.as_ref()).and_then(|()| fs::read(path))
}

/// As [`read`], of a text in UTF-8.
///
/// # Errors
/// As [`read`].
pub fn read_text(path: impl AsRef<Path>) -> io::Result<String> {
    check_plain(path.as_ref()).and_then(|()| fs::read_to_string(path))
}

/// Whether what is there is a plain file, at the end of symbolic links.
///
/// # Errors
/// What else it is, or that there is nothing.
pub fn check_plain(path: &Path) -> io::Result<()> {
    let kind = fs::metadata(path)?;
    if kind.is_file() {
        return Ok(());
    }
    let found = if kind.is_dir() { "a folder" } else { "a pipe or a device" };
    Err(io::Error::other(format!("expected a plain file, found {found}")))
}

fn failed(path: &Path, e: io::Error) -> Error {
    Error::file(path, format!("cannot be written: {e}"))
}

fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    match target(path)? {
        Target::Plain(at, before) => replace(&at, before, bytes),
        Target::StandardOutput => {
            let mut out = io::stdout().lock();
            out.write_all(bytes)?;
            out.flush()
        }
        Target::Stream => OpenOptions::new().write(true).open(path)?.write_all(bytes),
    }
}

pub(crate) fn target(path: &Path) -> io::Result<Target> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(io::Error::other("it is a folder")),
        Ok(found) if is_standard_output(&found) => Ok(Target::StandardOutput),
        Ok(found) if found.is_file() => Ok(Target::Plain(fs::canonicalize(path)?, Some(found))),
        Ok(_) => Ok(Target::Stream),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Target::Plain(end_of_links(path)?, None)),
        Err(e) => Err(e),
    }
}

fn is_standard_output(found: &Metadata) -> bool {
    fs::metadata("/proc/self/fd/1").is_ok_and(|out| (out.dev(), out.ino()) == (found.dev(), found.ino()))
}

/// Where links that lead to no file yet end.
fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    let mut at = path.to_path_buf();
    for _ in 0..40 {
        match fs::read_link(&at) {
            Ok(to) => at = folder(&at).join(to),
            Err(_) => return Ok(at),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

fn replace(path: &Path, before: Option<Metadata>, bytes: &[u8]) -> io::Result<()> {
    // The process's mask takes from these.
    let new = fs::Permissions::from_mode(0o666);
    let mut builder = tempfile::Builder::new();
    let mut temporary = builder.prefix(".m4gn-").permissions(new).tempfile_in(folder(path))?;
    temporary.write_all(bytes)?;
    if let Some(before) = before {
        temporary.as_file().set_permissions(before.permissions())?;
    }
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|e| e.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;
    use std::io::Read;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_file_is_replaced_whole_and_keeps_its_permissions() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_whole(&path, b"one").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is left beside it");
        let nowhere = dir.path().join("none/a.json");
        fails(write_whole(&nowhere, b"x"), &["cannot be written"]);
        assert!(check_writable(&nowhere).is_err());
        fails(write_whole(dir.path(), b"x"), &["it is a folder"]);
    }

    #[test]
    fn devices_and_pipes_stay_what_they_are() {
        let before = fs::metadata("/dev/null").unwrap().rdev();
        check_writable(Path::new("/dev/null")).unwrap();
        write_whole(Path::new("/dev/null"), b"x").unwrap();
        assert_eq!(fs::metadata("/dev/null").unwrap().rdev(), before);
        fails(write_whole(Path::new("/dev/full"), b"x"), &["No space left"]);

        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        check_writable(&pipe).unwrap();
        // Nobody writes there
        for (path, what) in
            [(&pipe, "a pipe"), (&PathBuf::from("/dev/zero"), "a device"), (&dir.path().into(), "a folder")]
        {
            let refused = [read(path).unwrap_err(), read_text(path).unwrap_err()];
            assert!(refused.iter().all(|e| e.to_string().contains(what)), "{refused:?}");
        }
        let reader = {
            let pipe = pipe.clone();
            std::thread::spawn(move || {
                let mut text = String::new();
                fs::File::open(pipe).unwrap().read_to_string(&mut text).unwrap();
                text
            })
        };
        write_whole(&pipe, b"through").unwrap();
        assert_eq!(reader.join().unwrap(), "through");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    }

    #[test]
    fn links_stay_and_their_targets_are_written() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("elsewhere")).unwrap();
        let (link, file) = (dir.path().join("link"), dir.path().join("elsewhere/file"));
        symlink("elsewhere/file", &link).unwrap();
        for content in [b"one", b"two"] {
            write_whole(&link, content).unwrap();
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
            assert_eq!(fs::read(&file).unwrap(), content);
        }
        let null = dir.path().join("null");
        symlink("/dev/null", &null).unwrap();
        write_whole(&null, b"x").unwrap();
        assert!(fs::symlink_metadata(&null).unwrap().is_symlink());
        symlink(dir.path().join("round"), dir.path().join("round")).unwrap();
        assert!(write_whole(&dir.path().join("round"), b"x").is_err());
    }
}
