//! Names, versions and small types that the reader and the writer share.

use hdf5::types::FixedUnicode;
use m4gn_base::{Error, Result, refuse};
use std::path::Path;
use std::str::FromStr;

/// Value of the root attribute `format`.
pub(super) const FORMAT: &str = "m4gn-trajectory";
/// Schema version that is written and read.
pub(super) const VERSION: u32 = 3;
/// Triangles over nodes that are points.
pub(super) const TRIANGLES: &str = "mesh/triangles";

/// What a trajectory is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Weights are fitted to it.
    Train,
    /// The best weights are chosen by it.
    Valid,
    /// Errors are reported on it.
    Test,
}

m4gn_base::names! { Split: Train "train", Valid "valid", Test "test" }

impl FromStr for Split {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|split| split.name() == name);
        found.ok_or_else(|| Error::Input(format!("split '{name}': expected train, valid or test")))
    }
}

/// A recorded field.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct FieldMeta {
    /// OpenFOAM's name, `U`.
    pub name: String,
    /// True: one component a solved direction; false: a scalar.
    pub vector: bool,
    /// `dimensionSet` exponents: mass, length, time, temperature, moles, current, luminous intensity.
    pub dimensions: [i32; 7],
}

impl FieldMeta {
    /// Stored components in `dim` solved directions.
    pub fn components(&self, dim: usize) -> usize {
        if self.vector { dim } else { 1 }
    }

    /// Refuses names that HDF5 would take for paths.
    pub(super) fn check(&self) -> Result<()> {
        let bad = self.name.is_empty() || self.name == "." || self.name.contains(['/', '\0']);
        refuse(bad, Error::Input, || {
            format!("field name {:?} cannot be stored: expected a name without '/'", self.name)
        })
    }
}

/// One field at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Values at the cells, or at the points of a body `[N x c]`.
    pub cells: Vec<f32>,
    /// Boundary face values `[B x c]`; a body at points has none.
    pub boundary: Vec<f32>,
}

/// Turns an HDF5 error into ours, naming the file and what was being done.
pub(super) fn h5_error(path: &Path, doing: &str) -> impl FnOnce(hdf5::Error) -> Error {
    move |e| {
        let text = e.to_string();
        // Where the system refused, its reason says more than HDF5's path to it.
        let errno =
            text.split("errno = ").nth(1).and_then(|rest| rest.split(',').next()?.trim().parse().ok());
        match errno {
            Some(n) => Error::file(path, format!("{doing}: {}", std::io::Error::from_raw_os_error(n))),
            None => Error::file(path, format!("{doing}: {text}")),
        }
    }
}

/// HDF5 prints its error stack to stderr by default; every failure is reported once, by us.
pub(super) fn quiet() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| hdf5::silence_errors(true));
}

/// Text in a file is fixed-length, padded with zeros: HDF5 keeps variable-length text in its global heap, the one
/// part of a file without a checksum, where flipped bytes make the library loop for ever.
pub(super) type Text<const N: usize> = FixedUnicode<N>;
/// Bytes of short text (names).
pub(super) const NAME: usize = 128;
/// Bytes of long text (provenance); attributes end at 64 KiB.
pub(super) const LONG: usize = 60_000;

/// Text that fits.
pub(super) fn h5_text<const N: usize>(text: &str) -> Result<Text<N>> {
    if text.len() > N || text.contains('\0') {
        let start: String = text.chars().take(60).collect();
        return Err(Error::Input(format!(
            "text of {} bytes cannot be stored, expected at most {N} and no zeros: {start:?} ...",
            text.len()
        )));
    }
    Text::from_str(text).map_err(|e| Error::Input(format!("text cannot be stored in HDF5 ({e})")))
}
