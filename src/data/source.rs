//! What is found in a file, checked before it is believed: sizes against the file's, labels against ranges.

use super::schema::{FORMAT, FieldMeta, LONG, NAME, Split, Text, VERSION, h5_error, quiet};
use hdf5::Dataset;
use m4gn_base::{Error, Result, files};
use ndarray::Ix2;
use std::io::Read;
use std::path::Path;

/// Opens read-only, without HDF5's lock (shared file systems often have none, and files never change).
pub(super) fn open_file(path: &Path) -> Result<hdf5::File> {
    const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";
    quiet();
    let mut head = Vec::with_capacity(8);
    files::check_plain(path)
        .and_then(|()| std::fs::File::open(path))
        .and_then(|f| f.take(8).read_to_end(&mut head))
        .map_err(|e| {
            Error::file(path, format!("cannot be read: {e}; expected a trajectory (*.h5) of m4gn"))
        })?;
    if head != SIGNATURE {
        return Err(Error::file(path, "is not an HDF5 file; expected a trajectory (*.h5) of m4gn"));
    }
    hdf5::FileBuilder::new()
        .with_fapl(|p| p.file_locking(false).libver_v110())
        .open(path)
        .map_err(|e| {
            let why = e.to_string();
            Error::file(path, match why.contains("already open") {
                true => "another program has it open to write, or was ended while it had: wait until it has closed it, or take the mark \
                         off with 'h5clear -s FILE'".to_string(),
                false => format!("is truncated or damaged, record it again ({why})"),
            })
        })
}

/// The file while it is opened: everything found in it is checked against its length before memory is taken.
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: u64,
}

impl<'a> Source<'a> {
    pub(super) fn new(path: &'a Path) -> Result<Self> {
        let bytes = path.metadata().map(|m| m.len()).map_err(Error::cannot("read", path))?;
        Ok(Source { path, bytes })
    }

    pub(super) fn damaged(&self, what: String) -> Error {
        Error::file(self.path, format!("{what}. The file is damaged, record it again"))
    }

    /// What a whole file holds is not what its schema says.
    pub(super) fn wrong(&self, place: &str, error: &Error) -> Error {
        Error::file(self.path, format!("{place}: {error}"))
    }

    /// Whether it is a whole recording of this version of the schema.
    pub(super) fn check_whole(&self, root: &hdf5::Group) -> Result<()> {
        let format = self.text::<NAME>(root, "format").map_err(|_| {
            Error::file(
                self.path,
                format!("is HDF5 but has no attribute format = \"{FORMAT}\": not a trajectory of m4gn"),
            )
        })?;
        if format != FORMAT {
            return Err(Error::file(
                self.path,
                format!("attribute format is \"{format}\", expected \"{FORMAT}\""),
            ));
        }
        let version = self.number(root, "version")?;
        if version != VERSION {
            return Err(Error::file(
                self.path,
                format!(
                    "schema version {version}, this m4gn reads version {VERSION}: record again, or use the m4gn that wrote it"
                ),
            ));
        }
        if self.number(root, "complete").unwrap_or(0) != 1 {
            return Err(Error::file(
                self.path,
                "the recording was not finished (no attribute complete = 1): record it again",
            ));
        }
        Ok(())
    }

    /// Split and provenance.
    pub(super) fn origin(&self, root: &hdf5::Group) -> Result<(Split, serde_json::Value)> {
        let provenance = self.text::<LONG>(root, "provenance")?;
        let provenance: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&provenance)
            .map_err(|e| Error::file(self.path, format!("attribute provenance is not a JSON object: {e}")))?;
        let split = self
            .text::<NAME>(root, "split")?
            .parse()
            .map_err(|e: Error| Error::file(self.path, e.to_string()))?;
        Ok((split, provenance.into()))
    }

    /// The frames' times: at least one, finite, increasing.
    pub(super) fn times(&self, file: &hdf5::File) -> Result<Vec<f64>> {
        let times: Vec<f64> = self.values(file, "times", &[None])?;
        if let Some(i) = (1..times.len()).find(|&i| times[i] <= times[i - 1]) {
            let (a, b) = (times[i - 1], times[i]);
            return Err(self.damaged(format!("times must increase, but frame {i} is at {b} s after {a} s")));
        }
        if times.iter().any(|t| !t.is_finite()) {
            return Err(self.damaged("a time is not finite".into()));
        }
        if times.is_empty() {
            return Err(self.damaged("there are no frames".into()));
        }
        Ok(times)
    }

    pub(super) fn attribute(&self, at: &hdf5::Location, name: &str) -> Result<hdf5::Attribute> {
        at.attr(name).map_err(|_| self.damaged(format!("attribute {name} of {} is missing", at.name())))
    }

    pub(super) fn text<const N: usize>(&self, at: &hdf5::Location, name: &str) -> Result<String> {
        let attribute = self.attribute(at, name)?;
        let text: Text<N> = attribute
            .read_scalar()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not text ({e})", at.name())))?;
        // The bytes come from the file: HDF5 does not promise that they are UTF-8.
        String::from_utf8(text.as_bytes().to_vec())
            .map_err(|_| self.damaged(format!("attribute {name} of {} is not UTF-8", at.name())))
    }

    fn number(&self, at: &hdf5::Location, name: &str) -> Result<u32> {
        self.attribute(at, name)?
            .read_scalar()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not a number ({e})", at.name())))
    }

    pub(super) fn numbers(&self, at: &hdf5::Location, name: &str, most: usize) -> Result<Vec<i32>> {
        let attribute = self.attribute(at, name)?;
        if attribute.size() > most {
            return Err(self.damaged(format!(
                "attribute {name} of {} has {} values",
                at.name(),
                attribute.size()
            )));
        }
        attribute
            .read_raw()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not numbers ({e})", at.name())))
    }

    fn dataset(&self, file: &hdf5::Group, name: &str) -> Result<Dataset> {
        file.dataset(name).map_err(|e| self.damaged(format!("dataset /{name} cannot be opened ({e})")))
    }

    pub(super) fn group(&self, at: &hdf5::Group, name: &str) -> Result<hdf5::Group> {
        let path = at.name();
        at.group(name).map_err(|e| {
            self.damaged(format!("group {}/{name} cannot be opened ({e})", path.trim_end_matches('/')))
        })
    }

    /// A dataset as a flat vector, of the given shape where given.
    pub(super) fn values<T: hdf5::H5Type>(
        &self,
        file: &hdf5::Group,
        name: &str,
        shape: &[Option<usize>],
    ) -> Result<Vec<T>> {
        let dataset = self.dataset(file, name)?;
        let found = dataset.shape();
        let fits =
            found.len() == shape.len() && found.iter().zip(shape).all(|(f, s)| s.is_none_or(|s| s == *f));
        let size = found.iter().try_fold(size_of::<T>(), |a, &n| a.checked_mul(n));
        if !fits || size.is_none_or(|s| s as u64 > self.bytes) {
            return Err(self
                .damaged(format!("dataset /{name} has shape {found:?}, expected {}", display_shape(shape))));
        }
        dataset.read_raw().map_err(|e| self.damaged(format!("dataset /{name} cannot be read ({e})")))
    }

    pub(super) fn vectors(
        &self,
        file: &hdf5::Group,
        name: &str,
        rows: Option<usize>,
    ) -> Result<Vec<[f64; 3]>> {
        let flat: Vec<f64> = self.values(file, name, &[rows, Some(3)])?;
        Ok(flat.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Labels, checked to be in `0..end`.
    pub(super) fn labels(
        &self,
        file: &hdf5::Group,
        name: &str,
        rows: Option<usize>,
        end: usize,
    ) -> Result<Vec<i32>> {
        self.in_range(name, self.values(file, name, &[rows])?, end)
    }

    /// Rows of `N` labels, each checked to be in `0..end`.
    pub(super) fn label_rows<const N: usize>(
        &self,
        file: &hdf5::Group,
        name: &str,
        end: usize,
    ) -> Result<Vec<[i32; N]>> {
        let labels = self.values(file, name, &[None, Some(N)])?;
        Ok(self.in_range(name, labels, end)?.as_chunks().0.to_vec())
    }

    fn in_range(&self, name: &str, labels: Vec<i32>, end: usize) -> Result<Vec<i32>> {
        match labels.iter().position(|&l| usize::try_from(l).map_or(true, |l| l >= end)) {
            Some(i) => Err(self.damaged(format!("/{name}[{i}] is {}, expected 0 to below {end}", labels[i]))),
            None => Ok(labels),
        }
    }

    /// Refuses values that are not finite.
    pub(super) fn check_finite(&self, name: &str, values: &[f64]) -> Result<()> {
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => {
                Err(self.damaged(format!("value {i} of /{name} is {}, expected a finite one", values[i])))
            }
            None => Ok(()),
        }
    }

    /// The recorded fields, by name; their values are checked by [`Source::frames`].
    pub(super) fn fields(&self, file: &hdf5::File) -> Result<Vec<FieldMeta>> {
        let group = self.group(file, "fields")?;
        let mut names = group
            .member_names()
            .map_err(|e| self.damaged(format!("group /fields cannot be listed ({e})")))?;
        names.sort();
        let field = |name: String| {
            let at = self.group(&group, &name)?;
            let vector = self.number(&at, "vector")? != 0;
            let dimensions = self.numbers(&at, "dimensions", 7)?;
            let dimensions = <[i32; 7]>::try_from(dimensions).map_err(|d| {
                self.damaged(format!("field {name} has dimensions {d:?}, expected 7 exponents"))
            })?;
            Ok(FieldMeta { name, vector, dimensions })
        };
        names.into_iter().map(field).collect()
    }

    /// Opens a dataset of frames of the shape frames x rows x components.
    pub(super) fn frames(&self, file: &hdf5::Group, name: &str, shape: [usize; 3]) -> Result<Dataset> {
        let dataset = self.dataset(file, name)?;
        let found = dataset.shape();
        if found != shape {
            return Err(self.damaged(format!("dataset /{name} has shape {found:?}, expected {shape:?}")));
        }
        Ok(dataset)
    }

    /// Values of one frame, flat, all finite. Their number is that of arrays of the file that were read already.
    pub(super) fn frame(&self, dataset: &Dataset, frame: usize) -> Result<Vec<f32>> {
        let name = dataset.name();
        let values = dataset
            .read_slice::<f32, _, Ix2>((frame, .., ..))
            .map_err(h5_error(self.path, &format!("frame {frame} of {name} is damaged")))?
            .into_raw_vec_and_offset()
            .0;
        match values.iter().all(|v| v.is_finite()) {
            true => Ok(values),
            false => Err(Error::file(
                self.path,
                format!("frame {frame} of {name} holds a value that is not finite: record it again"),
            )),
        }
    }
}

fn display_shape(shape: &[Option<usize>]) -> String {
    let parts: Vec<_> = shape.iter().map(|s| s.map_or("any".to_string(), |n| n.to_string())).collect();
    format!("[{}]", parts.join(", "))
}
