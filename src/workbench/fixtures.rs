//! What the tests of several tools begin with.

use crate::generate::process::Surroundings;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicU8;
use std::time::Duration;

/// Writes files of these names and texts below a folder.
pub fn write(folder: &Path, files: &[(&str, &str)]) {
    for (name, text) in files {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
}

/// A folder of its own with these files.
pub fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), files);
    dir
}

/// Conditions of programs that nobody stops.
pub fn tools() -> Surroundings {
    static GO: AtomicU8 = AtomicU8::new(0);
    Surroundings { stop: &GO, timeout: Duration::from_secs(600), asks: false, environment: Vec::new() }
}
