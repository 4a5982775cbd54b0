//! HDF5 files that others made of the TFRecords: a group a trajectory, an array a feature, often with what does not change repeated in
//! each frame.

use super::array::{Array, Arrays};
use super::npz::MOST_OF_A_BYTE;
use hdf5::types::TypeDescriptor;
use m4gn_base::{Error, Result};
use std::path::{Path, PathBuf};

/// Features that do not change, of which the first frame is read.
const FIXED: [&str; 5] = ["mesh_pos", "pos", "cells", "faces", "node_type"];

/// The trajectories of a file.
pub struct Copies {
    path: PathBuf,
    groups: std::vec::IntoIter<hdf5::Group>,
}

impl Copies {
    /// Opens the file. Groups are taken in the order of their numbers, or else of their names; a file without groups is one trajectory.
    ///
    /// # Errors
    /// [`Error::File`] for a file that is no HDF5, or does not hold all that it names.
    pub fn open(path: &Path) -> Result<Self> {
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
        Ok(Copies { path: path.into(), groups: groups.into_iter() })
    }

    /// The next trajectory; none at the end.
    ///
    /// # Errors
    /// [`Error::File`] naming the array.
    pub fn next_arrays(&mut self) -> Result<Option<Arrays>> {
        let Some(group) = self.groups.next() else { return Ok(None) };
        let datasets = group
            .datasets()
            .map_err(|e| Error::file(&self.path, format!("{} cannot be listed: {e}", group.name())))?;
        let mut arrays = Arrays::new();
        for dataset in datasets {
            let place = dataset.name();
            let failed = |e: hdf5::Error| Error::file(&self.path, format!("{place} cannot be read: {e}"));
            let kind = dataset.dtype().and_then(|t| t.to_descriptor()).map_err(failed)?;
            match kind {
                TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) | TypeDescriptor::Float(_) => {}
                TypeDescriptor::FixedAscii(_)
                | TypeDescriptor::FixedUnicode(_)
                | TypeDescriptor::VarLenAscii
                | TypeDescriptor::VarLenUnicode => continue,
                other => {
                    let what =
                        format!("{place} is of type {other}, expected whole or floating-point numbers");
                    return Err(Error::file(&self.path, what));
                }
            }
            let name = place.rsplit('/').next().unwrap_or_default().to_string();
            let mut shape = dataset.shape();
            // Compressed data may be a thousandth of what they become.
            let size = shape.iter().try_fold(8usize, |a, n| a.checked_mul(*n));
            let room = self.path.metadata().map_or(0, |m| m.len()).saturating_mul(MOST_OF_A_BYTE);
            if size.is_none_or(|size| size as u64 > room) {
                return Err(Error::file(
                    &self.path,
                    format!("{place} has shape {shape:?}, more than the file can hold"),
                ));
            }
            let data = match shape[..] {
                [frames, n, c] if FIXED.contains(&&name[..]) && frames > 0 => {
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
                        return Err(Error::file(&self.path, what));
                    }
                    Ok(first)
                }
                _ => dataset.read_raw::<f64>(),
            };
            arrays.insert(name, Array { shape, data: data.map_err(failed)? });
        }
        Ok(Some(arrays))
    }
}
