//! HDF5 files that others made of the TFRecords: a group a trajectory, an array a feature, often with what does not change repeated in
//! each frame.

use super::array::{Array, Arrays};
use super::npz::MOST_OF_A_BYTE;
use super::points::STRUCTURE;
use hdf5::types::TypeDescriptor;
use m4gn_base::{Error, Result};
use std::path::Path;

/// The trajectories of a file. Groups are taken in the order of their numbers, or else of their names; a file without groups is one trajectory.
///
/// # Errors
/// [`Error::File`] for a file that is no HDF5, or does not hold all that it names.
pub fn read(path: &Path) -> Result<impl Iterator<Item = Result<Arrays>>> {
    let file = m4gn_data::open_other(path)?;
    let failed = |e: hdf5::Error| Error::file(path, format!("its groups cannot be listed: {e}"));
    let mut groups = file.groups().map_err(failed)?;
    if groups.is_empty() {
        groups.push(file.as_group().map_err(failed)?);
    }
    groups.sort_by_cached_key(|g| {
        let name = g.name();
        (name.trim_start_matches('/').parse::<u64>().unwrap_or(u64::MAX), name)
    });
    Ok(groups.into_iter().map(move |group| arrays(path, &group)))
}

/// The arrays of a group; of those that do not change the first frame.
fn arrays(path: &Path, group: &hdf5::Group) -> Result<Arrays> {
    let datasets =
        group.datasets().map_err(|e| Error::file(path, format!("{} cannot be listed: {e}", group.name())))?;
    let mut arrays = Arrays::new();
    for dataset in datasets {
        let place = dataset.name();
        let failed = |e: hdf5::Error| Error::file(path, format!("{place} cannot be read: {e}"));
        let kind = dataset.dtype().and_then(|t| t.to_descriptor()).map_err(failed)?;
        match kind {
            TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) | TypeDescriptor::Float(_) => {}
            TypeDescriptor::FixedAscii(_)
            | TypeDescriptor::FixedUnicode(_)
            | TypeDescriptor::VarLenAscii
            | TypeDescriptor::VarLenUnicode => continue,
            other => {
                let what = format!("{place} is of type {other}, expected whole or floating-point numbers");
                return Err(Error::file(path, what));
            }
        }
        let name = place.rsplit('/').next().unwrap_or_default().to_string();
        let mut shape = dataset.shape();
        // Compressed data may be a thousandth of what they become.
        let size = shape.iter().try_fold(8usize, |a, n| a.checked_mul(*n));
        let room = path.metadata().map_or(0, |m| m.len()).saturating_mul(MOST_OF_A_BYTE);
        if size.is_none_or(|size| size as u64 > room) {
            return Err(Error::file(
                path,
                format!("{place} has shape {shape:?}, more than the file can hold"),
            ));
        }
        let data = match shape[..] {
            [frames, n, c] if STRUCTURE.contains(&&name[..]) && frames > 0 => {
                shape = vec![n, c];
                let frame = |i: usize| {
                    let read = dataset.read_slice::<f64, _, ndarray::Ix2>((i, .., ..));
                    read.map(|a| a.into_raw_vec_and_offset().0).map_err(failed)
                };
                let first = frame(0)?;
                if frames > 1 && frame(frames - 1)? != first {
                    let what = format!(
                        "{place} of the last frame is another than that of frame 0: expected one that stays"
                    );
                    return Err(Error::file(path, what));
                }
                Ok(first)
            }
            _ => dataset.read_raw::<f64>(),
        };
        arrays.insert(name, Array { shape, data: data.map_err(failed)? });
    }
    Ok(arrays)
}
