//! Arrays of numbers by name, whatever file they come from.

use m4gn_base::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// An array in row-major order. Double precision holds all that these files have: fp32, fp64, and integers that are labels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Array {
    /// Extents, slowest first; none of a single number.
    pub shape: Vec<usize>,
    /// Values.
    pub data: Vec<f64>,
}

/// Arrays by name: one trajectory.
pub type Arrays = BTreeMap<String, Array>;

/// Types of numbers in files, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Signed, 4 bytes.
    I32,
    /// Signed, 8 bytes.
    I64,
}

impl Dtype {
    /// By NumPy's names, long and short.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "float32" | "<f4" => Dtype::F32,
            "float64" | "<f8" => Dtype::F64,
            "int32" | "<i4" => Dtype::I32,
            "int64" | "<i8" => Dtype::I64,
            _ => return None,
        })
    }

    /// Bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Dtype::F32 | Dtype::I32 => 4,
            Dtype::F64 | Dtype::I64 => 8,
        }
    }

    /// The numbers in these bytes; what is left over is left out.
    pub fn decode(self, bytes: &[u8]) -> Vec<f64> {
        match self {
            Dtype::F32 => bytes.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(),
            Dtype::F64 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            Dtype::I32 => bytes.as_chunks().0.iter().map(|b| f64::from(i32::from_le_bytes(*b))).collect(),
            Dtype::I64 => bytes.as_chunks().0.iter().map(|b| i64::from_le_bytes(*b) as f64).collect(),
        }
    }
}

impl Array {
    /// What does not change in time: `[n, c]`, `[1, n, c]`, or the same in all frames `[T, n, c]`. The rows, `c` numbers each; `[n]` and
    /// `[1, n]` count as one number a row.
    pub fn fixed(&self, name: &str, c: usize, path: &Path) -> Result<&[f64]> {
        let shape = &self.shape[..];
        let n = match shape {
            [n] | [1, n] if c == 1 => *n,
            [n, last] | [_, n, last] if *last == c => *n,
            _ => {
                let wanted = format!("[nodes, {c}], [1, nodes, {c}] or [frames, nodes, {c}]");
                return Err(Error::file(path, format!("{name} has shape {shape:?}, expected {wanted}")));
            }
        };
        let rows = n.checked_mul(c).and_then(|count| self.data.get(..count));
        rows.ok_or_else(|| Error::file(path, format!("{name} has shape {shape:?} and no frame")))
    }

    /// As [`Array::fixed`], whole numbers that are labels in `0..end`.
    pub fn labels(&self, name: &str, c: usize, end: usize, path: &Path) -> Result<Vec<i32>> {
        let label = |(i, v): (usize, &f64)| {
            let fits = v.fract() == 0.0 && *v >= 0.0 && (*v as usize) < end.min(i32::MAX as usize);
            fits.then_some(*v as i32).ok_or_else(|| {
                Error::file(
                    path,
                    format!("{name}: value {i} is {v}, expected a whole number from 0 to below {end}"),
                )
            })
        };
        self.fixed(name, c, path)?.iter().enumerate().map(label).collect()
    }
}
