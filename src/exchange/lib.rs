//! Data sets of others as m4gn's, and back.
//!
//! A trajectory is [`Arrays`] by name on the way: from DeepMind's TFRecords ([`tfrecord`]), NumPy's archives ([`npz`]) or HDF5 copies
//! ([`copies`]). [`points`] makes a mesh and fields of them, [`bodies`] a body and an obstacle. Whatever is in a file, the answer is values or an error that names the file
//! and the record, byte, array or key, and memory is bounded by the size of the file.

mod array;
pub mod bodies;
pub mod copies;
pub mod export;
pub mod import;
pub mod npz;
pub mod points;
pub mod tfrecord;
pub mod weights;

#[cfg(test)]
#[path = "../../tests/samples/records.rs"]
mod records;
#[cfg(test)]
mod refused_tests;
#[cfg(test)]
mod tests;

pub use array::{Array, Arrays, Dtype};
pub use bodies::Bodies;
pub use points::Points;
