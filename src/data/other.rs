//! HDF5 files of other schemas.

use super::schema::h5_error;
use super::source::{Source, open_file};
use m4gn_base::Result;
use std::path::Path;

/// Opens an HDF5 file that is no trajectory of m4gn, all of which lies in the file itself. Nothing in it has to have a checksum.
///
/// # Errors
/// [`Error::File`](m4gn_base::Error::File) when it cannot be read, or leads to other files.
pub fn open_other(path: &Path) -> Result<hdf5::File> {
    let (file, source) = (open_file(path)?, Source::new(path)?);
    let root = file.group("/").map_err(h5_error(path, "no root group"))?;
    source.check_self_contained(&root, false)?;
    Ok(file)
}

/// Whether an HDF5 file says that it is a trajectory of m4gn, whole or not.
///
/// # Errors
/// [`Error::File`](m4gn_base::Error::File) when it cannot be read as HDF5.
pub fn is_trajectory(path: &Path) -> Result<bool> {
    Ok(open_file(path)?.attr("format").is_ok())
}
