//! Snapshots on disk, files of each rank: a header with the reference state, then a record a snapshot, each with its checksum. What a run is
//! carried on from names the file and the snapshots that it needs. A file that has grown long stays as it is, and the next one begins with
//! the snapshots that are kept; the one before both goes. So each time of the last file and of the one before can be carried on from, and a
//! run that is killed while a file is begun leaves those of the one before.
//!
//! A block is its length (8 bytes), its bytes, and their CRC-32 (4 bytes); all numbers are little endian.

use crate::snapshots::{Entry, Snapshots};
use crate::sums::{Storage, Values};
use m4gn_base::{Error, Result, files};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"m4gnlin2";

/// The file of a run's snapshots.
#[derive(Debug)]
pub(crate) struct Store {
    path: PathBuf,
    /// The files before it have lower numbers.
    pub number: u64,
    /// Where the next record goes.
    end: u64,
    records: usize,
    last: i64,
}

/// What a file holds.
pub(crate) struct Stored {
    pub reference: Vec<Vec<f64>>,
    pub entries: Vec<Entry>,
    pub store: Store,
    /// What was wrong with the rest of the file; empty: nothing.
    pub damage: String,
}

impl Store {
    /// Writes the snapshots that the last file does not have yet; a new file, with this number at least, where there is none, or it has grown
    /// long. `base`: name of the files.
    pub fn save(of: Option<Store>, base: &Path, number: u64, snapshots: &Snapshots) -> Result<Store> {
        let before = of.as_ref().map(|store| store.number);
        // Who clears the folder while a run goes on does not end it.
        let there = of.filter(|store| store.path == file(base, store.number) && store.path.is_file());
        let number = match there {
            Some(store) if store.records <= 3 * snapshots.capacity() => {
                let path = store.path.clone();
                return store.append(snapshots).map_err(|e| failed(&path, e));
            }
            Some(store) => store.number + 1,
            None => before.unwrap_or(number),
        };
        let path = file(base, number);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| failed(&path, e))?;
        }
        if path.exists() {
            // What is written through is not read again, and a pipe is waited for.
            files::check_plain(&path).map_err(|e| failed(&path, e))?;
        }
        let mut bytes = MAGIC.to_vec();
        block(&mut bytes, &header(snapshots)).map_err(|e| failed(&path, e))?;
        files::write_whole(&path, &bytes)?;
        let end = bytes.len() as u64;
        let store = Store { path: path.clone(), number, end, records: 0, last: i64::MIN };
        let store = store.append(snapshots).map_err(|e| failed(&path, e))?;
        for old in numbers(base).into_iter().filter(|n| n + 1 < number) {
            // One that cannot be removed takes room, and no more.
            let _ = fs::remove_file(file(base, old));
        }
        Ok(store)
    }

    fn append(mut self, snapshots: &Snapshots) -> io::Result<Store> {
        let mut file = OpenOptions::new().write(true).open(&self.path)?;
        // What a run that was stopped has left behind goes.
        file.set_len(self.end)?;
        file.seek(SeekFrom::Start(self.end))?;
        let mut out = BufWriter::new(file);
        for entry in snapshots.entries.iter().filter(|e| e.number > self.last) {
            self.end += block(&mut out, &record(entry))?;
            self.records += 1;
        }
        self.last = snapshots.entries.last().map_or(self.last, |e| e.number);
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_data()?;
        Ok(self)
    }

    /// Reads those of the snapshots with the numbers `kept`, ascending, of a run with the same fields that are in the file of this number. What
    /// comes after damage is dropped.
    ///
    /// # Errors
    /// [`Error::File`] where there is none, or it is of other fields.
    pub fn read(base: &Path, number: u64, snapshots: &Snapshots, kept: &[i64]) -> Result<Stored> {
        let path = &file(base, number);
        let bad = |what: String| Error::file(path, what);
        let mut file = files::check_plain(path)
            .and_then(|()| File::open(path))
            .map_err(|e| bad(format!("cannot be read: {e}")))?;
        let mut magic = [0; 8];
        if file.read_exact(&mut magic).is_err() || &magic != MAGIC {
            return Err(bad("expected snapshots of a dmd surrogate, found another format".into()));
        }
        let longest: usize = 64 + snapshots.fields().iter().map(|f| 16 + f.numbers() * 8).sum::<usize>();
        let described = header(snapshots);
        let (head, found) = next(&mut file, longest + 4096)
            .map_err(|e| bad(format!("its header is damaged ({e})")))?
            .ok_or_else(|| bad("its header is missing".into()))?;
        let fields = text(&described).len();
        if head.len() < fields || head[..fields] != described[..fields] {
            return Err(bad("expected the fields, interval and storage of this run, found others".into()));
        }
        let mut values = doubles(&head[fields..]);
        let reference: Vec<Vec<f64>> =
            snapshots.fields().iter().map(|f| values.by_ref().take(f.numbers()).collect()).collect();
        if reference.iter().zip(snapshots.fields()).any(|(r, f)| r.len() != f.numbers()) {
            return Err(bad("its reference state is not as long as the fields".into()));
        }
        let mut store = Store { path: path.clone(), number, end: 8 + found, records: 0, last: i64::MIN };
        let last = kept.last().copied().unwrap_or(i64::MIN);
        let (mut entries, mut damage) = (Vec::new(), String::new());
        // Behind the last one a run that was killed, or a full disk, may have left half a record.
        while store.last < last {
            match next(&mut file, longest) {
                Ok(None) => break,
                Ok(Some((bytes, length))) => match entry(&bytes, snapshots) {
                    Some(e) if e.number > last => break,
                    Some(e) => {
                        (store.last, store.end) = (e.number, store.end + length);
                        store.records += 1;
                        // The file has several windows
                        entries.extend(kept.binary_search(&e.number).is_ok().then_some(e));
                    }
                    None => damage = format!("record {} is none of this run", store.records + 1),
                },
                Err(e) => damage = format!("record {} is damaged ({e})", store.records + 1),
            }
            if !damage.is_empty() {
                break;
            }
        }
        Ok(Stored { reference, entries, store, damage })
    }
}

/// The file of a number.
fn file(base: &Path, number: u64) -> PathBuf {
    let mut name = base.to_path_buf().into_os_string();
    if number > 0 {
        name.push(format!(".{number}"));
    }
    name.into()
}

/// Numbers of the files that are there.
pub(crate) fn numbers(base: &Path) -> Vec<u64> {
    let name = base.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let number = |entry: io::Result<fs::DirEntry>| {
        let found = entry.ok()?.file_name().to_string_lossy().into_owned();
        match found.strip_prefix(&name)? {
            "" => Some(0),
            rest => rest.strip_prefix('.')?.parse().ok().filter(|n| *n > 0),
        }
    };
    let folder = base.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::read_dir(folder).map(|entries| entries.filter_map(number).collect()).unwrap_or_default()
}

fn failed(path: &Path, e: io::Error) -> Error {
    Error::file(path, format!("cannot be written: {e}"))
}

/// Names and shapes of the fields, up to a zero byte; then the reference.
fn header(snapshots: &Snapshots) -> Vec<u8> {
    let fields = snapshots.fields().iter();
    let mut bytes: Vec<u8> = fields
        .flat_map(|f| format!("{} {} {} {:?}\n", f.name, f.numbers(), f.components, f.floor).into_bytes())
        .collect();
    bytes.extend(format!("{:?}\0", snapshots.storage()).bytes());
    snapshots.reference.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

fn text(header: &[u8]) -> &[u8] {
    let end = header.iter().position(|b| *b == 0).map_or(header.len(), |i| i + 1);
    &header[..end]
}

fn record(entry: &Entry) -> Vec<u8> {
    let mut bytes = entry.number.to_le_bytes().to_vec();
    bytes.extend((entry.slot as u64).to_le_bytes());
    entry.least.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes.extend(entry.values.iter().map(|v| u8::from(*v != Values::Same)));
    for values in &entry.values {
        match values {
            Values::Double(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
            Values::Single(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
            Values::Same => {}
        }
    }
    bytes
}

fn entry(bytes: &[u8], snapshots: &Snapshots) -> Option<Entry> {
    let (fields, storage) = (snapshots.fields(), snapshots.storage());
    let width = if storage == Storage::Double { 8 } else { 4 };
    let (head, rest) = bytes.split_at_checked(16 + 8 * fields.len())?;
    let (there, rest) = rest.split_at_checked(fields.len())?;
    let numbers: usize = fields.iter().zip(there).filter(|(_, t)| **t != 0).map(|(f, _)| f.numbers()).sum();
    if rest.len() != numbers * width {
        return None;
    }
    let whole = |i: usize| head[8 * i..].first_chunk::<8>().copied().unwrap_or_default();
    let slot = usize::try_from(u64::from_le_bytes(whole(1))).ok().filter(|s| *s < snapshots.capacity())?;
    let mut at = 0;
    let values = fields.iter().zip(there).map(|(f, there)| {
        if *there == 0 {
            return Values::Same;
        }
        let part = &rest[at..at + f.numbers() * width];
        at += f.numbers() * width;
        match storage {
            Storage::Double => Values::Double(doubles(part).collect()),
            Storage::Single => {
                let singles = part.chunks_exact(4).map(|c| c.first_chunk::<4>().copied().unwrap_or_default());
                Values::Single(singles.map(f32::from_le_bytes).collect())
            }
        }
    });
    Some(Entry {
        values: values.collect(),
        number: i64::from_le_bytes(whole(0)),
        slot,
        least: doubles(&head[16..]).collect(),
    })
}

fn doubles(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    bytes.chunks_exact(8).map(|c| f64::from_le_bytes(c.first_chunk::<8>().copied().unwrap_or_default()))
}

/// Bytes written.
fn block(out: &mut impl Write, bytes: &[u8]) -> io::Result<u64> {
    out.write_all(&(bytes.len() as u64).to_le_bytes())?;
    out.write_all(bytes)?;
    out.write_all(&crc32fast::hash(bytes).to_le_bytes())?;
    Ok(bytes.len() as u64 + 12)
}

/// The next block and its length in the file; none at the end.
fn next(file: &mut File, longest: usize) -> io::Result<Option<(Vec<u8>, u64)>> {
    let mut length = [0; 8];
    if file.read(&mut length[..1])? == 0 {
        return Ok(None);
    }
    file.read_exact(&mut length[1..])?;
    let length = u64::from_le_bytes(length);
    if length > longest as u64 {
        return Err(io::Error::other(format!("{length} bytes where at most {longest} are expected")));
    }
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes)?;
    let mut sum = [0; 4];
    file.read_exact(&mut sum)?;
    match u32::from_le_bytes(sum) == crc32fast::hash(&bytes) {
        true => Ok(Some((bytes, length + 12))),
        false => Err(io::Error::other("its checksum is another")),
    }
}
