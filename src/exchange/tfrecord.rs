//! TensorFlow's record files: records with checksums, each a `tf.train.Example` in protobuf's wire format, whose features are raw arrays
//! as `meta.json` beside the file describes them.
//!
//! A record: its length n (u64, little-endian), a masked CRC-32C of these 8 bytes, n bytes, a masked CRC-32C of them. Masked is
//! `rotate_right(crc, 15) + 0xa282ead8`.

use super::array::{Array, Arrays, Dtype, TYPES};
use m4gn_base::{Error, Result, files};
use serde_json::Value;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Bytes before and behind a record's own.
const HEAD: u64 = 12;
const TAIL: u64 = 4;

/// The checksum as it is stored.
fn masked(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// The trajectories of a file, one a record, read one after the other.
#[derive(Debug)]
pub struct TfRecord {
    path: PathBuf,
    meta: Meta,
    file: BufReader<File>,
    length: u64,
    offset: u64,
    record: usize,
}

impl TfRecord {
    /// Opens the file and reads `meta.json` beside it.
    ///
    /// # Errors
    /// [`Error::File`] for a file that cannot be read; what [`Meta::read`] says.
    pub fn open(path: &Path) -> Result<Self> {
        let meta = Meta::read(&path.with_file_name("meta.json"))?;
        let failed = |e| Error::file(path, format!("cannot be read: {e}"));
        files::check_plain(path).map_err(failed)?;
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        Ok(TfRecord { path: path.into(), meta, file: BufReader::new(file), length, offset: 0, record: 0 })
    }

    /// The next trajectory, with the `dt` of `meta.json`; none at the end of the file.
    pub fn next_arrays(&mut self) -> Result<Option<Arrays>> {
        let (start, record) = (self.offset, self.record);
        let Some(bytes) = self.next_record()? else { return Ok(None) };
        let wrong = |(at, what): (usize, String)| {
            let byte = start + HEAD + at as u64;
            Error::file(&self.path, format!("record {record}, byte {byte}: {what}"))
        };
        let features = example(&bytes).map_err(wrong)?;
        let arrays = self.meta.features.iter().map(|(name, feature)| {
            let found = features.iter().rfind(|f| f.0 == name.as_bytes());
            let (_, at, parts) = found.ok_or_else(|| {
                let names = features.iter().take(12).map(|f| String::from_utf8_lossy(f.0));
                let names: Vec<_> = names.collect();
                wrong((0, format!("no feature `{name}`, which meta.json names; found {}", names.join(", "))))
            })?;
            let array =
                feature.array(parts).map_err(|what| wrong((*at, format!("feature `{name}`: {what}"))))?;
            Ok((name.clone(), array))
        });
        let dt = self.meta.dt.map(|dt| Ok(("dt".to_string(), Array { shape: vec![], data: vec![dt] })));
        arrays.chain(dt).collect::<Result<_>>().map(Some)
    }

    fn next_record(&mut self) -> Result<Option<Vec<u8>>> {
        let left = self.length - self.offset;
        if left == 0 {
            return Ok(None);
        }
        let (record, offset) = (self.record, self.offset);
        let wrong = |byte: u64, what: String| {
            Error::file(&self.path, format!("record {record}, byte {byte}: {what}"))
        };
        let truncated = |needed: u64| {
            wrong(
                offset,
                format!("needs {needed} bytes, the file has {left} more: it is truncated, or not a TFRecord"),
            )
        };
        if left < HEAD {
            return Err(truncated(HEAD + TAIL));
        }
        let mut read =
            |bytes: &mut [u8]| self.file.read_exact(bytes).map_err(|e| wrong(offset, e.to_string()));
        let mut head = [0; HEAD as usize];
        read(&mut head)?;
        let (length, sum) = head.split_at(8);
        let check = |bytes: &[u8], sum: &[u8], at: u64, what: &str| match sum == masked(bytes).to_le_bytes() {
            true => Ok(()),
            false => Err(wrong(at, format!("the checksum of {what} is another: the file is damaged"))),
        };
        check(length, sum, offset, "its length")?;
        let n = length.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
        // What is left bounds what is allocated.
        if n > left.saturating_sub(HEAD + TAIL) {
            return Err(truncated(n.saturating_add(HEAD + TAIL)));
        }
        let mut bytes = vec![0; n as usize];
        read(&mut bytes)?;
        let mut tail = [0; TAIL as usize];
        read(&mut tail)?;
        check(&bytes, &tail, offset + HEAD, "its content")?;
        self.offset += HEAD + n + TAIL;
        self.record += 1;
        Ok(Some(bytes))
    }
}

/// A feature's name, where its values begin in the record, and these.
type Feature<'a> = (&'a [u8], usize, Vec<&'a [u8]>);

/// What is wrong, and where in the record.
type Parsed<T> = std::result::Result<T, (usize, String)>;

/// The features of a `tf.train.Example` that hold bytes: `Example { Features features = 1 }`, `Features { map<string, Feature> feature
/// = 1 }`, `Feature { BytesList bytes_list = 1 }`, `BytesList { repeated bytes value = 1 }`.
fn example(bytes: &[u8]) -> Parsed<Vec<Feature<'_>>> {
    let mut found = Vec::new();
    let mut example = Message { bytes, start: 0, at: 0 };
    while let Some(mut features) = example.next(1)? {
        while let Some(mut entry) = features.next(1)? {
            let (mut name, mut at, mut values) = (&[][..], entry.start, Vec::new());
            while let Some((number, part)) = entry.next_field()? {
                match (number, part) {
                    (1, Some(key)) => name = key.bytes,
                    (2, Some(mut feature)) => {
                        at = feature.start;
                        while let Some(mut list) = feature.next(1)? {
                            while let Some(value) = list.next(1)? {
                                values.push(value.bytes);
                            }
                        }
                    }
                    _ => {}
                }
            }
            found.push((name, at, values));
        }
    }
    Ok(found)
}

/// A part of a record that is read field by field.
struct Message<'a> {
    bytes: &'a [u8],
    /// Where it begins in the record.
    start: usize,
    /// Where reading is.
    at: usize,
}

impl<'a> Message<'a> {
    /// The next field of this number that has a length.
    fn next(&mut self, number: u64) -> Parsed<Option<Message<'a>>> {
        while let Some((found, part)) = self.next_field()? {
            if let (true, Some(part)) = (found == number, part) {
                return Ok(Some(part));
            }
        }
        Ok(None)
    }

    /// The next field, and what it holds where that has a length.
    fn next_field(&mut self) -> Parsed<Option<(u64, Option<Message<'a>>)>> {
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let from = self.start + self.at;
        let tag = self.varint()?;
        let n = match tag & 7 {
            0 => {
                self.varint()?;
                return Ok(Some((tag >> 3, None)));
            }
            1 => 8,
            2 => self.varint()?,
            5 => 4,
            kind => return Err((from, format!("protobuf's wire type {kind}, expected 0, 1, 2 or 5"))),
        };
        let start = self.at;
        let end = usize::try_from(n).ok().and_then(|n| start.checked_add(n));
        let part = end.and_then(|end| Some((end, self.bytes.get(start..end)?)));
        let Some((end, bytes)) = part else {
            let left = self.bytes.len() - start;
            return Err((from, format!("a field of {n} bytes where {left} are left")));
        };
        self.at = end;
        let part = Message { bytes, start: self.start + start, at: 0 };
        Ok(Some((tag >> 3, (tag & 7 == 2).then_some(part))))
    }

    fn varint(&mut self) -> Parsed<u64> {
        let from = self.start + self.at;
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let Some(byte) = self.bytes.get(self.at) else { break };
            self.at += 1;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err((from, "a number without end".into()))
    }
}

/// What `meta.json` says of a file's features.
#[derive(Clone, Debug)]
pub struct Meta {
    /// Time between frames, s, where it is said.
    pub dt: Option<f64>,
    features: Vec<(String, Description)>,
}

#[derive(Clone, Debug)]
struct Description {
    dtype: Dtype,
    /// None where the extent follows from the number of bytes.
    shape: Vec<Option<usize>>,
}

impl Meta {
    /// Reads it.
    ///
    /// # Errors
    /// [`Error::File`] naming the key that is missing or has another value.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::read_text(path);
        let text = text.map_err(|e| {
            Error::file(
                path,
                format!("cannot be read: {e}; a TFRecord needs the meta.json that it came with"),
            )
        })?;
        let all: Value =
            serde_json::from_str(&text).map_err(|e| Error::file(path, format!("is not JSON: {e}")))?;
        let wrong = |key: &str, found: &Value, expected: &str| {
            let found: String = found.to_string().chars().take(60).collect();
            Error::file(path, format!("{key}: expected {expected}, found {found}"))
        };
        let dt = match &all["dt"] {
            Value::Null => None,
            found => Some(found.as_f64().ok_or_else(|| wrong("dt", found, "a time in s"))?),
        };
        let Some(entries) = all["features"].as_object() else {
            return Err(wrong("features", &all["features"], "an object"));
        };
        let feature = |(name, about): (&String, &Value)| {
            let key = |of: &str| format!("features.{name}.{of}");
            match about["type"].as_str() {
                Some("static" | "dynamic") => {}
                _ => return Err(wrong(&key("type"), &about["type"], "\"static\" or \"dynamic\"")),
            }
            let dtype = about["dtype"]
                .as_str()
                .and_then(Dtype::named)
                .ok_or_else(|| wrong(&key("dtype"), &about["dtype"], TYPES))?;
            let extent = |v: &Value| match v.as_i64() {
                Some(-1) => Some(None),
                n => usize::try_from(n?).ok().filter(|n| *n > 0).map(Some),
            };
            let shape: Option<Vec<_>> =
                about["shape"].as_array().and_then(|s| s.iter().map(extent).collect());
            let open = |s: &Vec<Option<usize>>| s.iter().filter(|n| n.is_none()).count() <= 1;
            let shape = shape.filter(|s| !s.is_empty() && open(s)).ok_or_else(|| {
                wrong(&key("shape"), &about["shape"], "positive numbers, one of which may be -1")
            })?;
            Ok((name.clone(), Description { dtype, shape }))
        };
        let features = entries.iter().map(feature).collect::<Result<_>>()?;
        Ok(Meta { dt, features })
    }
}

impl Description {
    /// The array in these bytes, one part after the other.
    fn array(&self, parts: &[&[u8]]) -> std::result::Result<Array, String> {
        let bytes: usize = parts.iter().map(|p| p.len()).sum();
        let known = self.shape.iter().flatten().try_fold(self.dtype.size(), |a, n| a.checked_mul(*n));
        let open = self.shape.contains(&None);
        let fits = |known: usize| if open { bytes.is_multiple_of(known) } else { bytes == known };
        let Some(known) = known.filter(|known| fits(*known)) else {
            let shape: Vec<i64> = self.shape.iter().map(|n| n.map_or(-1, |n| n as i64)).collect();
            return Err(format!(
                "{bytes} bytes for the shape {shape:?} of {} in meta.json",
                self.dtype.name()
            ));
        };
        let shape = self.shape.iter().map(|n| n.unwrap_or(bytes / known)).collect();
        Ok(Array { shape, data: self.dtype.decode(&parts.concat()) })
    }
}
