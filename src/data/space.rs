//! Room on the disk, asked for before HDF5 writes.

use m4gn_base::{Error, Result};
use std::path::Path;

/// Makes sure that `bytes` beyond `end` can be written, before HDF5 starts: a disk that fills up in the middle
/// of HDF5's tables leaves the library in a state that it does not recover from.
pub(super) fn reserve(file: &std::fs::File, path: &Path, end: u64, bytes: u64) -> Result<()> {
    use rustix::fs::{FallocateFlags, fallocate, fstatvfs};
    use rustix::io::Errno;
    match fallocate(file, FallocateFlags::empty(), end, bytes) {
        Ok(()) => Ok(()),
        Err(errno @ (Errno::NOSPC | Errno::DQUOT | Errno::FBIG)) => {
            let why = match errno {
                Errno::NOSPC => "the disk is full",
                Errno::DQUOT => "the disk quota is used up",
                _ => "the file size limit is reached (ulimit -f)",
            };
            let free = fstatvfs(file).map(|s| s.f_bavail.saturating_mul(s.f_frsize));
            let free = free.map_or(String::new(), |f| format!(", {} free there", size(f)));
            Err(Error::file(
                path,
                format!(
                    "{why}: {} more needed at {}{free}. Nothing of the recording is kept",
                    size(bytes),
                    size(end)
                ),
            ))
        }
        // A file system that cannot reserve (NFS before 4.2): compare with what is free.
        Err(_) => match fstatvfs(file) {
            Ok(s) if s.f_blocks > 0 && s.f_bavail.saturating_mul(s.f_frsize) < bytes => {
                let free = size(s.f_bavail.saturating_mul(s.f_frsize));
                let message = format!(
                    "the disk is full: {} needed, {free} free. Nothing of the recording is kept",
                    size(bytes)
                );
                Err(Error::file(path, message))
            }
            _ => Ok(()),
        },
    }
}

/// Bytes for people.
fn size(bytes: u64) -> String {
    if bytes >= 1 << 20 {
        format!("{:.1} MiB", bytes as f64 / 1048576.0)
    } else {
        format!("{} KiB", bytes.div_ceil(1024))
    }
}
