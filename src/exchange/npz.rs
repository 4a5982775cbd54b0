//! NumPy's archives: a zip file of arrays, stored or deflated, each behind a header that is a Python literal.

use super::array::{Array, Arrays, Dtype, TYPES};
use flate2::Compression;
use flate2::bufread::DeflateDecoder;
use flate2::write::DeflateEncoder;
use m4gn_base::{Error, Result, files};
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveWriter};
use std::io::{Read, Write};
use std::path::Path;

/// Deflate makes at most so many bytes of one.
pub(crate) const MOST_OF_A_BYTE: u64 = 1032;

/// Reads the entries of a zip archive that `wanted` picks, each whole. What is taken into memory is bounded by the file's size.
///
/// # Errors
/// [`Error::File`] naming the entry and the byte at which it begins.
pub fn entries(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Vec<(String, Vec<u8>)>> {
    let bytes = files::read(path).map_err(Error::cannot("read", path))?;
    let damaged = |e| Error::file(path, format!("is no zip archive, or is truncated or damaged ({e})"));
    let archive = ZipArchive::from_slice(&bytes).map_err(damaged)?;
    let (mut found, mut most) = (Vec::new(), MOST_OF_A_BYTE * bytes.len() as u64);
    let mut list = archive.entries();
    while let Some(record) = list.next_entry().map_err(damaged)? {
        let name = String::from_utf8_lossy(record.file_path().as_bytes()).into_owned();
        if !wanted(&name) {
            continue;
        }
        let (at, n) = (record.local_header_offset(), record.uncompressed_size_hint());
        let wrong = |what: String| Error::file(path, format!("{name}, byte {at}: {what}"));
        let entry = archive.get_entry(record.wayfinder()).map_err(|e| wrong(e.to_string()))?;
        most = most
            .checked_sub(n)
            .ok_or_else(|| wrong(format!("{n} bytes are said to be in it, more than it can hold")))?;
        let mut content = Vec::new();
        let read = match record.compression_method() {
            CompressionMethod::STORE => {
                entry.verifying_reader(entry.data()).take(n + 1).read_to_end(&mut content)
            }
            CompressionMethod::DEFLATE => entry
                .verifying_reader(DeflateDecoder::new(entry.data()))
                .take(n + 1)
                .read_to_end(&mut content),
            other => return Err(wrong(format!("compressed by method {other:?}, expected none or deflate"))),
        };
        read.map_err(|e| wrong(format!("damaged: {e}")))?;
        if content.len() as u64 != n {
            return Err(wrong(format!("{} bytes or more, expected {n}", content.len())));
        }
        found.push((name, content));
    }
    Ok(found)
}

/// The arrays of numbers of an archive; text is left out.
///
/// # Errors
/// As [`entries`]; for an array whose header or length is wrong, or that is of a type that is not read.
pub fn read(path: &Path) -> Result<Arrays> {
    let mut arrays = Arrays::new();
    for (name, bytes) in entries(path, |name| name.ends_with(".npy"))? {
        let array = npy(&bytes);
        let array =
            array.map_err(|(at, what)| Error::file(path, format!("{name}, its byte {at}: {what}")))?;
        let name = name.trim_end_matches(".npy").to_string();
        arrays.extend(array.map(|array| (name, array)));
    }
    Ok(arrays)
}

/// An array of the format of `numpy.save`; none of text.
fn npy(bytes: &[u8]) -> std::result::Result<Option<Array>, (usize, String)> {
    let wrong = |at: usize, what: &str| (at, what.to_string());
    let magic = bytes.get(..10).filter(|b| b.starts_with(b"\x93NUMPY"));
    let magic = magic.ok_or_else(|| wrong(0, "expected the signature \\x93NUMPY"))?;
    let (start, length): (usize, usize) = match magic[6] {
        1 => (10, usize::from(u16::from_le_bytes([magic[8], magic[9]]))),
        2 | 3 => {
            let wide = bytes.get(8..12).ok_or_else(|| wrong(8, "truncated"))?;
            (12, wide.iter().rev().fold(0, |n, b| n << 8 | usize::from(*b)))
        }
        v => return Err((6, format!("format version {v}, expected 1 to 3"))),
    };
    let end = start.saturating_add(length);
    let header = bytes.get(start..end).ok_or_else(|| wrong(8, "the header is longer than the array"))?;
    let header = std::str::from_utf8(header).map_err(|_| wrong(start, "the header is not text"))?;
    let value = |key: &str| {
        let (_, rest) = header.split_once(&format!("'{key}':"))?;
        Some(rest.trim_start())
    };
    let missing = |key: &str| (start, format!("the header has no usable '{key}': {header:.120}"));
    let descr = value("descr").ok_or_else(|| missing("descr"))?;
    let kind = descr.strip_prefix('\'').and_then(|v| v.split_once('\'')).map_or(descr, |d| d.0);
    if kind.trim_start_matches(['<', '>', '|', '=']).starts_with(['U', 'S']) {
        return Ok(None);
    }
    let dtype = Dtype::named(kind).ok_or_else(|| {
        (start, format!("numbers of type {kind:.40}, expected {TYPES}: convert them (astype)"))
    })?;
    let fortran = match value("fortran_order") {
        Some(v) if v.starts_with("False") => false,
        Some(v) if v.starts_with("True") => true,
        _ => return Err(missing("fortran_order")),
    };
    let extents = value("shape").and_then(|v| v.strip_prefix('(')?.split_once(')')).map(|v| v.0.split(','));
    let extents = extents.map(|e| e.map(str::trim).filter(|e| !e.is_empty()).map(|e| e.parse().ok()));
    let shape: Vec<usize> = extents.and_then(Iterator::collect).ok_or_else(|| missing("shape"))?;
    let data = &bytes[end..];
    let expected = shape.iter().try_fold(dtype.size(), |a, n| a.checked_mul(*n));
    if expected != Some(data.len()) {
        return Err((end, format!("{} bytes for the shape {shape:?} of {}", data.len(), dtype.name())));
    }
    let data = dtype.decode(data);
    let data = if fortran { transposed(&shape, &data) } else { data };
    Ok(Some(Array { shape, data }))
}

/// From column-major order.
fn transposed(shape: &[usize], data: &[f64]) -> Vec<f64> {
    let mut strides = vec![1; shape.len()];
    (1..shape.len()).for_each(|k| strides[k] = strides[k - 1] * shape[k - 1]);
    let place = |mut i: usize| {
        let axes = shape.iter().zip(&strides).rev();
        axes.map(|(n, stride)| {
            let at = i % n;
            i /= n;
            at * stride
        })
        .sum::<usize>()
    };
    (0..data.len()).map(|i| data[place(i)]).collect()
}

/// Writes arrays, deflated: those named in `whole` as int32, the others as float32.
///
/// # Errors
/// [`Error::File`] when the file cannot be written.
pub fn write(path: &Path, arrays: &Arrays, whole: &[&str]) -> Result<()> {
    let pack = || -> std::result::Result<Vec<u8>, Box<dyn std::error::Error>> {
        let mut packed = Vec::new();
        let mut archive = ZipArchiveWriter::new(&mut packed);
        for (name, array) in arrays {
            let file = format!("{name}.npy");
            let (mut entry, config) =
                archive.new_file(&file).compression_method(CompressionMethod::DEFLATE).start()?;
            let mut writer = config.wrap(DeflateEncoder::new(&mut entry, Compression::fast()));
            writer.write_all(&saved(array, whole.contains(&&name[..])))?;
            let (encoder, descriptor) = writer.finish()?;
            encoder.finish()?;
            entry.finish(descriptor)?;
        }
        archive.finish()?;
        Ok(packed)
    };
    let bytes = pack().map_err(Error::cannot("written", path))?;
    files::write_whole(path, &bytes)
}

/// An array in the format of `numpy.save`.
fn saved(array: &Array, int: bool) -> Vec<u8> {
    let extents: String = array.shape.iter().map(|n| format!("{n},")).collect();
    let kind = if int { "<i4" } else { "<f4" };
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({extents}), }}");
    // The values begin at a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:0$}\n", length - 1).bytes());
    match int {
        true => bytes.extend(array.data.iter().flat_map(|v| (*v as i32).to_le_bytes())),
        false => bytes.extend(array.data.iter().flat_map(|v| (*v as f32).to_le_bytes())),
    }
    bytes
}
