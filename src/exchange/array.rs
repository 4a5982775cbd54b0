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

/// Names of the types that [`Dtype::named`] knows, for people.
pub const TYPES: &str = "float32, float64, bool, int8 to int64 or uint8 to uint64";

macro_rules! numbers {
    ($($variant:ident $t:ty, $long:literal, $short:literal);*) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        enum Number { $($variant),* }

        impl Dtype {
            /// By NumPy's names, long and short, these with a byte order.
            pub fn named(name: &str) -> Option<Self> {
                let bare = name.trim_start_matches(['<', '>', '|', '=']);
                let number = match bare {
                    $($long | $short => Number::$variant,)*
                    _ => return None,
                };
                Some(Dtype { number, big: name.starts_with('>') })
            }

            /// NumPy's long name.
            pub fn name(self) -> &'static str {
                match self.number { $(Number::$variant => $long),* }
            }

            /// Bytes of a number.
            pub fn size(self) -> usize {
                match self.number { $(Number::$variant => size_of::<$t>()),* }
            }

            /// The numbers in these bytes; what is left over is left out.
            pub fn decode(self, bytes: &[u8]) -> Vec<f64> {
                match self.number {
                    $(Number::$variant => {
                        let number = |b: &[u8; size_of::<$t>()]| match self.big {
                            true => <$t>::from_be_bytes(*b) as f64,
                            false => <$t>::from_le_bytes(*b) as f64,
                        };
                        bytes.as_chunks().0.iter().map(number).collect()
                    })*
                }
            }
        }
    };
}

/// A type of numbers in files, with its byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dtype {
    number: Number,
    big: bool,
}

numbers!(
    F32 f32, "float32", "f4"; F64 f64, "float64", "f8"; Bool u8, "bool", "b1";
    I8 i8, "int8", "i1"; I16 i16, "int16", "i2"; I32 i32, "int32", "i4"; I64 i64, "int64", "i8";
    U8 u8, "uint8", "u1"; U16 u16, "uint16", "u2"; U32 u32, "uint32", "u4"; U64 u64, "uint64", "u8"
);

impl Array {
    /// What does not change in time: `[n, c]`, `[1, n, c]`, or the same in all frames `[T, n, c]`, which is checked. The rows, `c` numbers each; `[n]` and
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
        let size = n.checked_mul(c).filter(|size| *size > 0 && *size <= self.data.len());
        let size =
            size.ok_or_else(|| Error::file(path, format!("{name} has shape {shape:?} and no frame")))?;
        let mut frames = self.data.chunks_exact(size);
        let first = frames.next().unwrap_or_default();
        match frames.position(|frame| frame != first) {
            None => Ok(first),
            Some(i) => Err(Error::file(
                path,
                format!("{name} of frame {} is another than that of frame 0: expected one that stays", i + 1),
            )),
        }
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
