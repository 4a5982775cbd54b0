//! Ragged and compressed arrays of a file, and single frames of it; the same distrust as in `source`.

use super::schema::h5_error;
use super::source::Source;
use crate::{Error, Result};
use ndarray::{Ix1, Ix2};

/// Deflate shrinks what we write by less than this; a dataset that claims more is not believed.
const LARGEST_RATIO: u64 = 64;

impl Source<'_> {
    /// Rows of `width` labels, flat, each checked to be in `0..end`.
    pub(super) fn label_rows(
        &self,
        file: &hdf5::Group,
        name: &str,
        width: usize,
        end: usize,
    ) -> Result<Vec<i32>> {
        let labels = self.values(file, name, &[None, Some(width)])?;
        self.in_range(name, labels, end)
    }

    /// Where each of `rows` rows starts, with the end of the last: from 0, not decreasing; each of the given size.
    pub(super) fn starts(
        &self,
        file: &hdf5::Group,
        name: &str,
        rows: usize,
        sizes: Option<&[usize]>,
    ) -> Result<Vec<usize>> {
        let found: Vec<i64> = self.values(file, name, &[Some(rows + 1)])?;
        let mut starts = Vec::with_capacity(found.len());
        for (i, &s) in found.iter().enumerate() {
            let least = starts.last().copied().unwrap_or(0);
            let size = if i == 0 { Some(0) } else { sizes.map(|s| s[i - 1]) };
            match usize::try_from(s) {
                Ok(s) if s >= least && size.is_none_or(|size| s - least == size) => starts.push(s),
                _ => {
                    let expected =
                        size.map_or(format!("{least} or more"), |size| format!("{}", least + size));
                    return Err(self.damaged(format!("/{name}[{i}] is {s}, expected {expected}")));
                }
            }
        }
        Ok(starts)
    }

    /// A compressed dataset of `length` values.
    pub(super) fn packed<T: hdf5::H5Type>(
        &self,
        file: &hdf5::Group,
        name: &str,
        length: usize,
    ) -> Result<Vec<T>> {
        let dataset = file
            .dataset(name)
            .map_err(|e| self.damaged(format!("dataset /{name} cannot be opened ({e})")))?;
        let found = dataset.shape();
        let bytes = (length as u64).saturating_mul(size_of::<T>() as u64);
        if found != [length] || bytes > self.bytes().saturating_mul(LARGEST_RATIO) {
            return Err(self.damaged(format!(
                "dataset /{name} has shape {found:?}, expected [{length}]"
            )));
        }
        dataset
            .read_raw()
            .map_err(|e| self.damaged(format!("dataset /{name} cannot be read ({e})")))
    }

    /// A compressed dataset of labels in `0..end`.
    pub(super) fn packed_labels(
        &self,
        file: &hdf5::Group,
        name: &str,
        length: usize,
        end: usize,
    ) -> Result<Vec<i32>> {
        let labels = self.packed(file, name, length)?;
        self.in_range(name, labels, end)
    }

    /// Refuses values that are not finite.
    pub(super) fn check_finite(&self, name: &str, values: &[f64]) -> Result<()> {
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.damaged(format!(
                "value {i} of /{name} is {}, expected a finite one",
                values[i]
            ))),
            None => Ok(()),
        }
    }

    /// Opens a dataset of frames and checks its shape.
    pub(super) fn check_frames(
        &self,
        file: &hdf5::Group,
        name: &str,
        shape: &[usize],
    ) -> Result<hdf5::Dataset> {
        let dataset = file
            .dataset(name)
            .map_err(|e| self.damaged(format!("dataset /{name} cannot be opened ({e})")))?;
        let found = dataset.shape();
        if found != shape {
            return Err(self.damaged(format!("dataset /{name} has shape {found:?}, expected {shape:?}")));
        }
        Ok(dataset)
    }

    /// Values of one frame, flat, all finite. Its size is that of arrays of the file that were read already.
    pub(super) fn frame(
        &self,
        file: &hdf5::Group,
        name: &str,
        shape: &[usize],
        frame: usize,
    ) -> Result<Vec<f32>> {
        let dataset = self.check_frames(file, name, shape)?;
        let values = match shape.len() {
            2 => dataset
                .read_slice::<f32, _, Ix1>((frame, ..))
                .map(|v| v.into_raw_vec_and_offset().0),
            _ => dataset
                .read_slice::<f32, _, Ix2>((frame, .., ..))
                .map(|v| v.into_raw_vec_and_offset().0),
        };
        let values = values.map_err(h5_error(
            self.path,
            &format!("frame {frame} of /{name} is damaged"),
        ))?;
        if values.iter().any(|v| !v.is_finite()) {
            let message = format!("frame {frame} of /{name} holds a value that is not finite");
            return Err(Error::file(self.path, message));
        }
        Ok(values)
    }
}
