//! Series of a run on disk, for one that carries on.

use crate::{Row, Watch};
use m4gn_base::{Error, Result, files};
use std::path::Path;

/// What a file of series begins with.
const MAGIC: &[u8; 8] = b"m4gnAvg2";

/// A series as it was: its name, its state of checks, and its rows.
pub struct Saved {
    /// Name of the series.
    pub name: String,
    /// [`Watch::state`].
    pub state: (usize, u64),
    /// Its rows.
    pub rows: Vec<Row>,
}

/// Writes named series as one whole file: for each its name, its state of checks and its rows, numbers in little
/// endian; last the CRC-32C of what is before.
///
/// # Errors
/// [`Error::File`] where it cannot be written.
pub fn write<'a>(path: &Path, all: impl IntoIterator<Item = (&'a str, &'a Watch)>) -> Result<()> {
    let mut bytes = MAGIC.to_vec();
    for (name, watch) in all {
        let (next, found) = watch.state();
        for number in [name.len() as u64, next as u64, found, watch.series.len() as u64] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(name.as_bytes());
        for row in watch.series.rows() {
            for number in [row.time, row.value, row.weight, f64::from(row.surrogate)] {
                bytes.extend(number.to_le_bytes());
            }
        }
    }
    bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
    files::write_whole(path, &bytes)
}

/// Reads the series of a file.
///
/// # Errors
/// [`Error::File`] where the file cannot be read, and where it is not as [`write`] has left it.
pub fn read(path: &Path) -> Result<Vec<Saved>> {
    let bytes = files::read(path).map_err(Error::cannot("read", path))?;
    parse(&bytes).ok_or_else(|| {
        Error::file(
            path,
            "expected series of m4gnAverages, found a file that is damaged or another one; remove it",
        )
    })
}

/// The same of its bytes; none where a bit is not as it was written.
pub fn parse(bytes: &[u8]) -> Option<Vec<Saved>> {
    let (body, sum) = bytes.split_last_chunk::<4>()?;
    let mut rest = body.strip_prefix(MAGIC).filter(|_| crc32c::crc32c(body).to_le_bytes() == *sum)?;
    let mut all = Vec::new();
    while !rest.is_empty() {
        let mut take = |count: usize| {
            let (part, after) = rest.split_at_checked(count)?;
            rest = after;
            Some(part)
        };
        let head: Vec<u64> = words(take(32)?).map(u64::from_le_bytes).collect();
        let [length, next, count] = [0, 1, 3].map(|i| usize::try_from(head[i]).unwrap_or(usize::MAX));
        let name = String::from_utf8_lossy(take(length)?).into_owned();
        let row = |row: &[u8]| {
            let n: Vec<f64> = words(row).map(f64::from_le_bytes).collect();
            Row { time: n[0], value: n[1], weight: n[2], surrogate: n[3] != 0.0 }
        };
        let rows = take(count.checked_mul(32)?)?.chunks_exact(32).map(row).collect();
        all.push(Saved { name, state: (next, head[2]), rows });
    }
    Some(all)
}

/// Each eight bytes.
fn words(bytes: &[u8]) -> impl Iterator<Item = [u8; 8]> {
    bytes.chunks_exact(8).map(|word| word.try_into().unwrap_or_default())
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
            assert!(parse(&bytes[..end]).is_none(), "{end} bytes");
        }
        assert!(read(&folder.path().join("none")).is_err());
    }
}
