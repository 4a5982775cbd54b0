//! Named arrays of numbers with a JSON description, in a safetensors file: what checkpoints and states are kept in. Behind the description
//! stands a line with the CRC-32 of it and of all names and arrays, in eight hexadecimal digits.

use m4gn_base::files::write_whole;
use m4gn_base::{Error, Result};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::path::Path;

/// Arrays to be written.
#[derive(Debug, Default)]
pub struct Arrays(Vec<(String, Dtype, Vec<u8>)>);

impl Arrays {
    /// Adds single precision.
    pub fn floats(&mut self, name: &str, values: &[f32]) {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.0.push((name.into(), Dtype::F32, bytes));
    }

    /// Adds double precision.
    pub fn doubles(&mut self, name: &str, values: &[f64]) {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.0.push((name.into(), Dtype::F64, bytes));
    }

    /// The file's bytes, with the description under `entry` of its header.
    pub fn bytes(&self, entry: &str, description: &impl Serialize) -> std::result::Result<Vec<u8>, String> {
        let views = self.0.iter().map(|(name, kind, bytes)| {
            let count = bytes.len() / if *kind == Dtype::F32 { 4 } else { 8 };
            TensorView::new(*kind, vec![count], bytes).map(|view| (name.as_str(), view))
        });
        let views = views.collect::<std::result::Result<Vec<_>, _>>().map_err(|e| e.to_string())?;
        let text = serde_json::to_string(description).map_err(|e| e.to_string())?;
        let sum = checksum(&text, self.0.iter().map(|(name, _, bytes)| (&name[..], &bytes[..])));
        let header = HashMap::from([(entry.to_string(), format!("{text}\n{sum}"))]);
        safetensors::serialize(views, Some(header)).map_err(|e| e.to_string())
    }

    /// Writes a temporary file and puts it in the place of the old one; `what` it is, for people.
    pub fn write(&self, path: &Path, what: &str, entry: &str, description: &impl Serialize) -> Result<()> {
        let bytes = self.bytes(entry, description);
        write_whole(path, &bytes.map_err(|e| Error::file(path, format!("cannot write the {what}: {e}")))?)
    }
}

/// Of the description and all arrays, whatever their order.
fn checksum<'a>(text: &str, arrays: impl Iterator<Item = (&'a str, &'a [u8])>) -> String {
    let mut arrays: Vec<_> = arrays.collect();
    arrays.sort_unstable();
    let mut sum = crc32fast::Hasher::new();
    sum.update(text.as_bytes());
    arrays.iter().flat_map(|(name, bytes)| [name.as_bytes(), bytes]).for_each(|part| sum.update(part));
    format!("{:08x}", sum.finalize())
}

/// A file that was read.
pub struct TensorFile<'a>(SafeTensors<'a>);

impl<'a> TensorFile<'a> {
    /// The description under `entry`, and the arrays.
    pub fn parse<T: DeserializeOwned>(
        bytes: &'a [u8],
        entry: &str,
    ) -> std::result::Result<(T, Self), String> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
        let text = header.metadata().as_ref().and_then(|m| m.get(entry).cloned());
        let text = text.ok_or_else(|| format!("no `{entry}` entry in its header"))?;
        let (text, sum) = text.rsplit_once('\n').ok_or("no checksum in its header")?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
        if checksum(text, file.iter().map(|(name, view)| (name, view.data()))) != sum {
            return Err("damaged: its checksum is another".into());
        }
        let description = serde_json::from_str(text).map_err(|e| e.to_string())?;
        Ok((description, TensorFile(file)))
    }

    /// An array of single precision, if it is there.
    pub fn floats(&self, name: &str) -> Option<Vec<f32>> {
        let view = self.0.tensor(name).ok().filter(|v| v.dtype() == Dtype::F32)?;
        let numbers = view.data().as_chunks::<4>().0.iter();
        Some(numbers.map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// An array of double precision, if it is there.
    pub fn doubles(&self, name: &str) -> Option<Vec<f64>> {
        let view = self.0.tensor(name).ok().filter(|v| v.dtype() == Dtype::F64)?;
        let numbers = view.data().as_chunks::<8>().0.iter();
        Some(numbers.map(|b| f64::from_le_bytes(*b)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_bit_is_found_wherever_it_is() {
        let mut arrays = Arrays::default();
        arrays.floats("b", &[1.0, 2.0]);
        arrays.doubles("a", &[3.0]);
        let bytes = arrays.bytes("state", &[4, 5]).unwrap();
        let (description, file) = TensorFile::parse::<Vec<i32>>(&bytes, "state").unwrap();
        assert_eq!((description, file.floats("b")), (vec![4, 5], Some(vec![1.0, 2.0])));
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            let found = TensorFile::parse::<Vec<i32>>(&damaged, "state");
            // White space of the header says nothing
            assert!(found.is_err() || bytes[at] == b' ', "byte {at}");
        }
    }
}
