//! Series of a run on disk, for one that carries on.

use crate::{Row, Watch};
use m4gn_base::{Error, Result, files};
use std::path::Path;

/// What a file of series begins with.
const MAGIC: &[u8; 8] = b"m4gnAvg1";

/// A series as it was: its name, its state of checks, and its rows.
pub struct Saved {
    /// Name of the quantity.
    pub name: String,
    /// [`Watch::state`].
    pub state: (usize, bool),
    /// Its rows.
    pub rows: Vec<Row>,
}

/// Writes named series as one whole file: for each its name, its state of checks and its rows, numbers in little endian.
///
/// # Errors
/// [`Error::File`] where it cannot be written.
pub fn write<'a>(path: &Path, all: impl IntoIterator<Item = (&'a str, &'a Watch)>) -> Result<()> {
    let mut bytes = MAGIC.to_vec();
    for (name, watch) in all {
        let (next, met) = watch.state();
        for number in [name.len(), next, usize::from(met), watch.series.len()] {
            bytes.extend((number as u64).to_le_bytes());
        }
        bytes.extend(name.as_bytes());
        for row in watch.series.rows() {
            for number in [row.time, row.value, row.weight, f64::from(row.surrogate)] {
                bytes.extend(number.to_le_bytes());
            }
        }
    }
    files::write_whole(path, &bytes)
}

/// Reads the series of a file.
///
/// # Errors
/// [`Error::File`] with the byte at which the file is no such file.
pub fn read(path: &Path) -> Result<Vec<Saved>> {
    let bytes = files::read(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    parse(&bytes).map_err(|at| {
        Error::file(
            path,
            format!("expected series of m4gnAverages, found something else at byte {at}; remove it"),
        )
    })
}

/// The same of its bytes; an error is the place of what is wrong.
pub fn parse(bytes: &[u8]) -> std::result::Result<Vec<Saved>, usize> {
    let mut at = MAGIC.len();
    if bytes.get(..at) != Some(MAGIC) {
        return Err(0);
    }
    let mut all = Vec::new();
    while at < bytes.len() {
        let mut take = |count: usize| {
            let end = at.checked_add(count).filter(|end| *end <= bytes.len()).ok_or(at)?;
            let part = &bytes[at..end];
            at = end;
            Ok::<&[u8], usize>(part)
        };
        let head = take(32)?.to_vec();
        let number = |i: usize| {
            usize::try_from(u64::from_le_bytes(head[8 * i..8 * i + 8].try_into().unwrap_or_default()))
        };
        let [Ok(length), Ok(next), Ok(met), Ok(count)] = [0, 1, 2, 3].map(number) else { return Err(at) };
        let name = String::from_utf8_lossy(take(length)?).into_owned();
        let numbers = take(count.checked_mul(32).ok_or(0_usize)?)?;
        let rows = numbers.chunks_exact(32).map(|row| {
            let of = |i: usize| f64::from_le_bytes(row[8 * i..8 * i + 8].try_into().unwrap_or_default());
            Row { time: of(0), value: of(1), weight: of(2), surrogate: of(3) != 0.0 }
        });
        all.push(Saved { name, state: (next, met != 0), rows: rows.collect() });
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Goal;

    #[test]
    fn series_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.state");
        let mut watch = Watch::new(0.95, Goal::default());
        for i in 1..30 {
            let time = f64::from(i);
            watch.series.push(Row { time, value: time.sin(), weight: 1.0, surrogate: i % 5 == 0 });
        }
        watch.check();
        write(&path, [("Cd", &watch), ("Cl", &Watch::new(0.95, Goal::default()))]).unwrap();
        let all = read(&path).unwrap();
        assert_eq!((all[0].name.as_str(), all[0].state), ("Cd", watch.state()));
        assert_eq!(all[0].rows, watch.series.rows());
        assert_eq!((all[1].name.as_str(), all[1].rows.len()), ("Cl", 0));
        let bytes = std::fs::read(&path).unwrap();
        for end in [0, 7, 20, 41, 100] {
            assert!(parse(&bytes[..end]).is_err(), "{end} bytes");
        }
        assert!(read(&folder.path().join("none")).is_err());
    }
}
