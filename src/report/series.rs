//! Series of files for ParaView: NAME.pvd lists them, NAME_0000.vtu and so on lie beside it.

use super::vtu::pvd;
use super::write_file;
use m4gn_base::{Error, Result, files};
use std::path::{Path, PathBuf};

/// Begins a series of frames, of each its number and its time, s: writes the list to `path`, and gives the places of the frames' files. The files of an
/// earlier series are taken away before, those that its list names.
///
/// # Errors
/// [`Error::File`] for a file that has the name of one of the series, and is neither of it nor of the earlier one: who reads a series by its numbers
/// would read it too; and where the list cannot be written.
pub fn begin(path: &Path, frames: &[(usize, f64)]) -> Result<Vec<PathBuf>> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let names: Vec<String> = frames.iter().map(|(number, _)| format!("{stem}_{number:04}.vtu")).collect();
    let old = match path.exists() {
        true => files::read_text(path).map_err(Error::cannot("replaced", path))?,
        false => String::new(),
    };
    let listed = |name: &str| old.contains(&format!("file=\"{}\"", super::page::escape(name)));
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let failed = |e: std::io::Error| Error::file(folder, format!("cannot be listed: {e}"));
    let mut rest = Vec::new();
    for entry in folder.read_dir().map_err(failed)? {
        let name = entry.map_err(failed)?.file_name().to_string_lossy().into_owned();
        let number = name.strip_prefix(&format!("{stem}_")).and_then(|n| n.strip_suffix(".vtu"));
        let is_frame = number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
        if is_frame && listed(&name) {
            rest.push(folder.join(name));
        } else if is_frame && !names.contains(&name) {
            let what = format!(
                "would be read as one of the series {}, which does not list it: remove it, or choose another name",
                path.display()
            );
            return Err(Error::file(folder.join(name), what));
        }
    }
    for file in rest {
        std::fs::remove_file(&file).map_err(Error::cannot("removed", &file))?;
    }
    let list: Vec<_> = frames.iter().map(|f| f.1).zip(names.iter().cloned()).collect();
    write_file(path, pvd(&list).as_bytes())?;
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shorter_series_leaves_nothing_of_a_longer_one() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let write = |path: &Path, n: usize| -> Result<()> {
            let frames: Vec<_> = (0..n).map(|i| (i, 0.5 * i as f64)).collect();
            begin(path, &frames)?.iter().try_for_each(|file| write_file(file, b"x"))
        };
        // Whose names begin alike
        std::fs::write(at("w_a_0007.vtu"), "").unwrap();
        std::fs::write(at("w_0007.txt"), "").unwrap();
        write(&at("w.pvd"), 5).unwrap();
        write(&at("w.pvd"), 2).unwrap();
        let left =
            ["w_0000.vtu", "w_0001.vtu", "w_0002.vtu", "w_a_0007.vtu", "w_0007.txt"].map(|n| at(n).exists());
        assert_eq!(left, [true, true, false, true, true]);
        let list = std::fs::read_to_string(at("w.pvd")).unwrap();
        assert!(list.contains("timestep=\"0.5\" file=\"w_0001.vtu\"") && !list.contains("w_0002"), "{list}");
        // A file that no list of ours names is not ours.
        std::fs::write(at("w_0002.vtu"), "theirs").unwrap();
        let message = write(&at("w.pvd"), 2).unwrap_err().to_string();
        assert!(message.contains("w_0002.vtu: would be read as one of the series"), "{message}");
        assert_eq!(std::fs::read(at("w_0002.vtu")).unwrap(), b"theirs");
    }
}
