//! The state of a ride on disk: one file a write time, from which a run that is carried on goes on as the uninterrupted one.
//!
//! ```text
//! M4GNRIDE  version (u32)  length of the description (u64)  description (JSON)  parts, one after the other  CRC-32 of all that (u32)
//! ```
//! Numbers are little-endian; the description says how long each part is. Values at cells are in the order of the undecomposed mesh.

use m4gn_base::{Error, Result, files};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;

const MAGIC: &[u8; 8] = b"M4GNRIDE";
const VERSION: u32 = 7;

/// What to do about a state that is of no use.
const REMEDY: &str = "start from an earlier time, or remove it, and the schedule begins anew";

/// Bytes before the description, and behind everything.
const HEAD: usize = 8 + 4 + 8;
const TAIL: usize = 4;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Whole<T> {
    parts: Vec<u64>,
    state: T,
}

/// Writes a state; its parts are referred to by their numbers.
///
/// # Errors
/// [`Error::File`]; what was there before then stays, and a pipe is not waited for.
pub fn write<T: Serialize>(path: &Path, state: &T, parts: &[Vec<u8>]) -> Result<()> {
    if path.exists() {
        // What is written through is not read again, and a pipe is waited for.
        files::check_plain(path).map_err(Error::cannot("written", path))?;
    }
    let whole = Whole { parts: parts.iter().map(|part| part.len() as u64).collect(), state };
    let text =
        serde_json::to_vec(&whole).map_err(|e| Error::Internal(format!("the state of a ride: {e}")))?;
    let mut bytes = Vec::with_capacity(HEAD + text.len() + parts.iter().map(Vec::len).sum::<usize>() + TAIL);
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((text.len() as u64).to_le_bytes());
    bytes.extend(text);
    parts.iter().for_each(|part| bytes.extend(part));
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    files::write_whole(path, &bytes)
}

/// The bytes of the file.
///
/// # Errors
/// [`Error::File`] where it is no plain file, or cannot be read.
pub fn bytes(path: &Path) -> Result<Vec<u8>> {
    files::read(path).map_err(|e| Error::file(path, format!("{e}: {REMEDY}")))
}

/// Reads a state and its parts from the bytes of a file.
///
/// # Errors
/// [`Error::File`] for bytes that are no such state, are damaged, or are of another version.
pub fn read<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<(T, Vec<Vec<u8>>)> {
    let bad = |what: String| Error::file(path, format!("{what}: {REMEDY}"));
    if bytes.len() < HEAD + TAIL || &bytes[..8] != MAGIC {
        return Err(bad("it is not the state of a run".into()));
    }
    let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let (body, tail) = (&bytes[..bytes.len() - TAIL], bytes.len() - TAIL);
    if number(8) != VERSION {
        return Err(bad(format!(
            "it is the state of a run of version {}, this library reads {VERSION}",
            number(8)
        )));
    }
    if crc32fast::hash(body) != number(tail) {
        return Err(bad(
            "it is the state of a run, and damaged: its checksum is not that of its bytes".into()
        ));
    }
    let length = usize::try_from(u64::from(number(12)) | u64::from(number(16)) << 32);
    let text = length.ok().and_then(|length| body[HEAD..].get(..length));
    let text = text.ok_or_else(|| bad("its description is longer than the file".into()))?;
    let whole: Whole<T> = serde_json::from_slice(text).map_err(|e| bad(format!("its description: {e}")))?;
    let mut rest = &body[HEAD + text.len()..];
    let mut parts = Vec::new();
    for length in whole.parts {
        let part = usize::try_from(length).ok().and_then(|n| rest.split_at_checked(n));
        let (part, behind) = part.ok_or_else(|| bad("a part of it is longer than the file".into()))?;
        parts.push(part.to_vec());
        rest = behind;
    }
    match rest.is_empty() {
        true => Ok((whole.state, parts)),
        false => Err(bad("there is more behind its parts".into())),
    }
}

/// Values as a part.
pub fn bytes_of(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A part as so many values.
///
/// # Errors
/// [`Error::Input`] for another number.
pub fn values_of(bytes: &[u8], expected: usize) -> Result<Vec<f64>> {
    let (values, rest) = bytes.as_chunks::<8>();
    match values.len() == expected && rest.is_empty() {
        true => Ok(values.iter().map(|v| f64::from_le_bytes(*v)).collect()),
        false => Err(Error::Input(format!(
            "a field of the state has {} bytes, and this mesh {expected} values",
            bytes.len()
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Sample {
        time: f64,
    }

    fn file() -> (tempfile::TempDir, std::path::PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("test.state");
        let parts = [bytes_of(&[1.0, -0.0]), Vec::new(), vec![7]];
        write(&path, &Sample { time: 0.1 + 0.2 }, &parts).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        (folder, path, bytes)
    }

    #[test]
    fn what_is_written_is_read_to_the_bit() {
        let (_folder, path, bytes) = file();
        let (state, parts) = read::<Sample>(&path, &bytes).unwrap();
        assert_eq!(state, Sample { time: 0.1 + 0.2 });
        assert_eq!((parts[1].len(), &parts[2][..]), (0, &[7][..]));
        let values = values_of(&parts[0], 2).unwrap();
        assert!(values[1].is_sign_negative() && values[0] == 1.0);
        assert!(values_of(&parts[0], 3).is_err() && values_of(&parts[2], 0).is_err());
    }

    #[test]
    fn every_bit_that_is_another_is_seen_and_every_cut() {
        let (_folder, path, bytes) = file();
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                fails(read::<Sample>(&path, &damaged), &["test.state"]);
            }
            assert!(read::<Sample>(&path, &bytes[..at]).is_err());
        }
        let text = b"FoamFile { version 2.0; }\nleft maybe;".to_vec();
        fails(read::<Sample>(&path, &text), &["is not the state of a run"]);
    }

    #[test]
    fn another_version_and_another_description_are_named() {
        let (_folder, path, bytes) = file();
        let sealed = |mut bytes: Vec<u8>| {
            let tail = bytes.len() - 4;
            let crc = crc32fast::hash(&bytes[..tail]).to_le_bytes();
            bytes[tail..].copy_from_slice(&crc);
            read::<Sample>(&path, &bytes)
        };
        let mut newer = bytes.clone();
        newer[8] = 8;
        fails(sealed(newer), &["of version 8, this library reads 7"]);
        let mut long = bytes.clone();
        long[12] = 255;
        fails(sealed(long), &["longer than the file"]);
        let mut more = bytes.clone();
        more.splice(more.len() - 4..more.len() - 4, [0]);
        fails(sealed(more), &["more behind"]);
        write(&path, &3, &[]).unwrap();
        let other = std::fs::read(&path).unwrap();
        fails(read::<Sample>(&path, &other), &["description"]);
    }
}
