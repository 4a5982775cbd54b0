//! Series of VTK's unstructured grids, as ParaView, meshio and m4gn write them: *.pvd, or numbered *.vtu.
//!
//! Arrays are in text, in base64, or appended, deflated or not. <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>

use super::array::{Array, Arrays, Dtype, TYPES};
use super::npz::MOST_OF_A_BYTE;
use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::bufread::ZlibDecoder;
use m4gn_base::{Error, Result, files, refuse};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::ops::Bound;
use std::path::{Path, PathBuf};

/// What is wrong, and at which byte of the file.
type Wrong = (usize, String);

/// The arrays of a series of one mesh of triangles in the x-y plane that does not move: `mesh_pos`, `cells`, and of each array at the points its
/// values in all frames, `node_type` in the first; `dt` where the series says times.
///
/// # Errors
/// [`Error::File`] naming the file, and the byte or the array, that cannot be read or does not fit the first frame.
pub fn read(path: &Path) -> Result<Arrays> {
    let mut arrays = Arrays::new();
    let series = match path.extension().is_some_and(|e| e == "pvd") {
        true => collection(path, &mut arrays)?,
        false => numbered(path)?,
    };
    let mut first: Option<(&Path, Arrays)> = None;
    for file in &series {
        let grid = grid(file)?;
        let wrong = |what: String| Error::file(file, what);
        let Some((of_first, known)) = &first else {
            arrays.extend(mesh(&grid).map_err(wrong)?);
            for (name, array) in &grid {
                let Some(name) = name.strip_prefix("PointData/") else { continue };
                let frames = if name == "node_type" { 1 } else { series.len() };
                let shape = [&[frames], &array.shape[..]].concat();
                arrays.insert(name.into(), Array { shape, data: array.data.clone() });
            }
            first = Some((file, grid));
            continue;
        };
        for (name, array) in known {
            let found = grid
                .get(name)
                .ok_or_else(|| wrong(format!("no array {name}, which {} has", of_first.display())))?;
            let field = name.strip_prefix("PointData/").filter(|field| *field != "node_type");
            let Some(field) = field else {
                if found != array {
                    return Err(wrong(format!(
                        "{name} differs from that of {}: expected one mesh that does not move",
                        of_first.display()
                    )));
                }
                continue;
            };
            refuse(found.shape != array.shape, wrong, || {
                format!("{name} has shape {:?}, in {} {:?}", found.shape, of_first.display(), array.shape)
            })?;
            if let Some(values) = arrays.get_mut(field) {
                values.data.extend(&found.data);
            }
        }
        if let Some(name) = grid.keys().find(|name| !known.contains_key(*name)) {
            return Err(wrong(format!("{name}: {} has no such array", of_first.display())));
        }
    }
    // Vectors in the plane.
    for array in arrays.values_mut().filter(|a| a.shape.len() == 3 && a.shape[2] == 3) {
        let rows = array.data.as_chunks::<3>().0;
        if rows.iter().all(|v| v[2] == 0.0) {
            array.data = rows.iter().flat_map(|v| [v[0], v[1]]).collect();
            array.shape[2] = 2;
        }
    }
    Ok(arrays)
}

/// The points and the triangles of a grid.
fn mesh(grid: &Arrays) -> std::result::Result<[(String, Array); 2], String> {
    let get = |name: &str| grid.get(name).ok_or_else(|| format!("no array {name}"));
    let points = get("Points")?.data.as_chunks::<3>().0;
    if let Some(i) = points.iter().position(|p| p[2] != points[0][2]) {
        return Err(format!(
            "Points: z of point {i} is {}, of point 0 {}: expected triangles in the x-y plane",
            points[i][2], points[0][2]
        ));
    }
    let [points_of, ends, kinds] =
        ["connectivity", "offsets", "types"].map(|name| get(&format!("Cells/{name}")));
    let (points_of, ends, kinds) = (&points_of?.data, &ends?.data, &kinds?.data);
    if ends.len() != kinds.len() {
        return Err(format!("Cells/types has {} cells, Cells/offsets {}", kinds.len(), ends.len()));
    }
    let (mut start, mut cells) = (0, Vec::new());
    for (i, (end, kind)) in ends.iter().zip(kinds).enumerate() {
        // Whole numbers below 2^53, or they are no place in an array.
        let points = points_of.get(start..*end as usize).ok_or_else(|| {
            format!("Cells/offsets: cell {i} ends at {end}, expected {start} to {}", points_of.len())
        })?;
        start = *end as usize;
        match (*kind as i64, points) {
            (5, [_, _, _]) => cells.extend(points),
            // Vertices and lines, with which some mark boundaries.
            (1 | 3, _) => {}
            _ => {
                return Err(format!(
                    "Cells/types: cell {i} is of type {kind} with {} points, expected 5 with 3: triangles",
                    points.len()
                ));
            }
        }
    }
    let flat: Vec<f64> = points.iter().flat_map(|p| [p[0], p[1]]).collect();
    Ok([
        ("mesh_pos".into(), Array { shape: vec![points.len(), 2], data: flat }),
        ("cells".into(), Array { shape: vec![cells.len() / 3, 3], data: cells }),
    ])
}

/// This file and those beside it with the same name and larger numbers, which have equal distances.
fn numbered(path: &Path) -> Result<Vec<PathBuf>> {
    let name = |path: &Path| {
        let stem = path.file_stem()?.to_str()?;
        let head = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        Some((head.to_string(), stem[head.len()..].parse::<u64>().ok()?))
    };
    let (head, number) = name(path).ok_or_else(|| {
        Error::file(
            path,
            "expected the first of a series, whose name ends in a number (a_0000.vtu), or a series (*.pvd)",
        )
    })?;
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let listed = folder.read_dir().and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let listed = listed.map_err(|e| Error::file(folder, format!("cannot be listed: {e}")))?;
    let others =
        listed.into_iter().map(|entry| entry.path()).filter(|p| p.extension().is_some_and(|e| e == "vtu"));
    let mut files = BTreeMap::from([(number, path.to_path_buf())]);
    let named = others.filter_map(|p| Some((name(&p).filter(|n| n.0 == head && n.1 >= number)?.1, p)));
    for (number, file) in named.filter(|(_, file)| file.file_name() != path.file_name()) {
        if let Some(other) = files.insert(number, file.clone()) {
            return Err(Error::file(
                file,
                format!("has the number of {}: expected one of each", other.display()),
            ));
        }
    }
    let numbers: Vec<u64> = files.keys().copied().collect();
    if let [first, second, ..] = numbers[..]
        && let Some(w) = numbers.windows(2).find(|w| w[1] - w[0] != second - first)
    {
        return Err(Error::file(
            path,
            format!(
                "between {head}{} and {head}{} of its series files are missing, or do not belong to it: expected numbers at equal distances",
                w[0], w[1]
            ),
        ));
    }
    Ok(files.into_values().collect())
}

/// The files of a *.pvd; the time between them goes to the arrays.
fn collection(path: &Path, arrays: &mut Arrays) -> Result<Vec<PathBuf>> {
    let (mut series, mut times, mut seen) = (Vec::new(), Vec::new(), BTreeSet::new());
    let bytes = load(path)?;
    elements(&bytes, |at, e, _| {
        match e.name().as_ref() {
            "VTKFile" => expect(e, at, "type", &["Collection"])?,
            "DataSet" => {
                let file = attribute(e, at, "file")?.ok_or((at, "DataSet: no file".to_string()))?;
                let time = attribute(e, at, "timestep")?.unwrap_or_default();
                let time = time.parse().ok().filter(|t: &f64| t.is_finite());
                times.push(time.ok_or((at, format!("DataSet {file}: timestep: expected a time in s")))?);
                if !file.ends_with(".vtu") || !seen.insert(file.clone()) {
                    return Err((at, format!("DataSet {file}: expected another *.vtu in each")));
                }
                series.push(path.with_file_name(file));
            }
            _ => {}
        }
        Ok(())
    })
    .map_err(|(at, what)| Error::file(path, format!("byte {at}: {what}")))?;
    if let [first, .., last] = times[..] {
        let dt = (last - first) / (times.len() - 1) as f64;
        let off = |(i, t): (usize, &f64)| (t - first - i as f64 * dt).abs() > 1e-4 * dt;
        if let Some(i) = times.iter().enumerate().position(off) {
            let expected = first + i as f64 * dt;
            return Err(Error::file(
                path,
                format!("timestep {i} is {} s, expected {expected}: equal distances", times[i]),
            ));
        }
        arrays.insert("dt".into(), Array { shape: vec![], data: vec![dt] });
    }
    match series.is_empty() {
        true => Err(Error::file(path, "lists no DataSet")),
        false => Ok(series),
    }
}

fn load(path: &Path) -> Result<Vec<u8>> {
    files::read(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))
}

fn attribute(e: &BytesStart, at: usize, name: &str) -> std::result::Result<Option<String>, Wrong> {
    let wrong = |what: String| (at, format!("{}, {name}: {what}", e.name().as_ref()));
    let found = e.try_get_attribute(name).map_err(|e| wrong(e.to_string()))?;
    let value = found.map(|a| a.normalized_value(XmlVersion::Implicit1_0).map(|v| v.into_owned()));
    value.transpose().map_err(|e| wrong(e.to_string()))
}

/// An attribute has, where it is there, one of these values.
fn expect(e: &BytesStart, at: usize, name: &str, values: &[&str]) -> std::result::Result<(), Wrong> {
    match attribute(e, at, name)? {
        Some(v) if !values.contains(&&v[..]) => {
            Err((at, format!("{}, {name}: expected {}, found {v}", e.name().as_ref(), values.join(" or "))))
        }
        _ => Ok(()),
    }
}

/// Calls `each` with the byte, the start and the text of each element, up to the appended data. Returns where these begin, or the end.
fn elements<'a>(
    bytes: &'a [u8],
    mut each: impl FnMut(usize, &BytesStart, &'a str) -> std::result::Result<(), Wrong>,
) -> std::result::Result<usize, Wrong> {
    let tag = b"<AppendedData";
    let appended = bytes.windows(tag.len()).position(|w| w == tag);
    let end = appended
        .and_then(|at| Some(at + bytes[at..].iter().position(|b| *b == b'>')? + 1))
        .unwrap_or(bytes.len());
    let text = str::from_utf8(&bytes[..end]).map_err(|e| (e.valid_up_to(), "no UTF-8".to_string()))?;
    let mut reader = Reader::from_str(text);
    let mut closed = false;
    loop {
        let at = reader.buffer_position() as usize;
        let event = reader.read_event().map_err(|e| (reader.error_position() as usize, e.to_string()))?;
        match event {
            Event::Start(e) | Event::Empty(e) => {
                let content = text.get(reader.buffer_position() as usize..).and_then(|t| t.split('<').next());
                each(at, &e, content.unwrap_or_default())?;
            }
            Event::End(e) => closed |= e.name().as_ref() == "VTKFile",
            Event::Eof if closed || appended.is_some() => return Ok(end),
            Event::Eof => return Err((end, "ends before </VTKFile>".into())),
            _ => {}
        }
    }
}

/// How the numbers of a file are stored.
#[derive(Default)]
struct Storage {
    /// Bytes of a number in a header.
    word: usize,
    deflated: bool,
    /// Appended data are base64.
    encoded: bool,
}

/// An array before its numbers are read.
struct Stored<'a> {
    at: usize,
    name: String,
    kind: String,
    components: usize,
    format: String,
    offset: usize,
    text: &'a str,
}

/// The arrays of a *.vtu: `Points`, `Cells/NAME`, `PointData/NAME`.
fn grid(path: &Path) -> Result<Arrays> {
    let bytes = load(path)?;
    arrays(&bytes).map_err(|(at, what)| Error::file(path, format!("byte {at}: {what}")))
}

fn arrays(bytes: &[u8]) -> std::result::Result<Arrays, Wrong> {
    let (mut storage, mut section, mut list, mut points) =
        (Storage::default(), String::new(), Vec::new(), None);
    let end = elements(bytes, |at, e, text| {
        let number = |name: &str, missing: Option<usize>| match attribute(e, at, name)? {
            None => missing.ok_or((at, format!("{}: no {name}", e.name().as_ref()))),
            Some(v) => v
                .trim()
                .parse()
                .map_err(|_| (at, format!("{}, {name}: found {v}, expected a number", e.name().as_ref()))),
        };
        match e.name().as_ref() {
            "VTKFile" => {
                expect(e, at, "type", &["UnstructuredGrid"])?;
                expect(e, at, "byte_order", &["LittleEndian"])?;
                expect(e, at, "compressor", &["vtkZLibDataCompressor"])?;
                expect(e, at, "header_type", &["UInt32", "UInt64"])?;
                let wide = attribute(e, at, "header_type")?.is_some_and(|t| t == "UInt64");
                storage.word = if wide { 8 } else { 4 };
                storage.deflated = attribute(e, at, "compressor")?.is_some();
            }
            "Piece" if points.is_some() => return Err((at, "a second Piece, expected one".into())),
            "Piece" => points = Some(number("NumberOfPoints", None)?),
            "AppendedData" => {
                expect(e, at, "encoding", &["raw", "base64"])?;
                storage.encoded = attribute(e, at, "encoding")?.is_some_and(|c| c == "base64");
            }
            name @ ("Points" | "Cells" | "PointData" | "CellData" | "FieldData") => section = name.into(),
            "DataArray" if section == "CellData" => {
                let kind = attribute(e, at, "type")?.unwrap_or_default();
                let own = attribute(e, at, "Name")?.unwrap_or_default();
                // Text, and what ParaView notes for itself.
                if kind != "String" && !own.starts_with("vtk") {
                    let what = "of arrays at points alone fields are made: interpolate it to the points, or take it out";
                    return Err((at, format!("CellData/{own}: {what}")));
                }
            }
            "DataArray" if ["Points", "Cells", "PointData"].contains(&&section[..]) => {
                let own = attribute(e, at, "Name")?.unwrap_or_default();
                let format = attribute(e, at, "format")?.unwrap_or_default();
                list.push(Stored {
                    at,
                    name: if section == "Points" { section.clone() } else { format!("{section}/{own}") },
                    kind: attribute(e, at, "type")?.unwrap_or_default(),
                    components: number("NumberOfComponents", Some(1))?,
                    offset: number("offset", if format == "appended" { None } else { Some(0) })?,
                    format,
                    text,
                });
            }
            _ => {}
        }
        Ok(())
    })?;
    let points = points.ok_or((end, "no Piece".to_string()))?;
    let data = bytes[end..].trim_ascii_start().strip_prefix(b"_").unwrap_or_default();
    // Each array has the bytes up to the next one.
    let mut offsets = BTreeSet::new();
    for s in list.iter().filter(|s| s.format == "appended") {
        if !offsets.insert(s.offset) {
            return Err((s.at, format!("{}: another array begins at offset {} too", s.name, s.offset)));
        }
    }
    let mut found = Arrays::new();
    for stored in &list {
        let wrong = |what: String| (stored.at, format!("{}: {what}", stored.name));
        let next = offsets.range((Bound::Excluded(stored.offset), Bound::Unbounded)).next();
        let values = stored
            .numbers(&storage, &data[..next.map_or(data.len(), |end| data.len().min(*end))])
            .map_err(wrong)?;
        let c = stored.components;
        let rows = values.len() / c.max(1);
        if c == 0 || rows.checked_mul(c) != Some(values.len()) {
            return Err(wrong(format!("{} numbers for {c} components", values.len())));
        }
        if !stored.name.starts_with("Cells/") && rows != points {
            return Err(wrong(format!("{rows} rows, expected {points}: NumberOfPoints")));
        }
        refuse(stored.name == "Points" && c != 3, wrong, || format!("{c} components, expected 3"))?;
        found.insert(stored.name.clone(), Array { shape: vec![rows, c], data: values });
    }
    Ok(found)
}

impl Stored<'_> {
    fn numbers(&self, storage: &Storage, data: &[u8]) -> std::result::Result<Vec<f64>, String> {
        let bytes: Cow<[u8]> = match &self.format[..] {
            "ascii" => {
                let number = |word: &str| word.parse().map_err(|_| format!("`{word}` is no number"));
                return self.text.split_ascii_whitespace().map(number).collect();
            }
            "binary" => base64(self.text.as_bytes())?.into(),
            "appended" => {
                let from = data.get(self.offset..).ok_or_else(|| {
                    format!("begins at {} of the appended data, which have {} bytes", self.offset, data.len())
                })?;
                match storage.encoded {
                    true => base64(from.split(|b| *b == b'<').next().unwrap_or_default())?.into(),
                    false => from.into(),
                }
            }
            other => return Err(format!("format {other:?}, expected ascii, binary or appended")),
        };
        decode(&self.kind, &storage.content(&bytes)?)
    }
}

/// The bytes of base64; a header may be encoded by itself, with its own padding.
fn base64(text: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let text: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let mut bytes = Vec::new();
    for part in text.chunk_by(|a, b| *a != b'=' || *b == b'=') {
        STANDARD.decode_vec(part, &mut bytes).map_err(|e| format!("no base64: {e}"))?;
    }
    Ok(bytes)
}

impl Storage {
    /// What a header says that follows it: its length, or blocks that are deflated.
    fn content(&self, bytes: &[u8]) -> std::result::Result<Vec<u8>, String> {
        let short = || format!("truncated: {} bytes are too few", bytes.len());
        let word = |i: usize| {
            let at = i.checked_mul(self.word).ok_or_else(short)?;
            let bytes = bytes.get(at..).and_then(|b| b.get(..self.word)).ok_or_else(short)?;
            let number = bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
            usize::try_from(number).map_err(|e| e.to_string())
        };
        let first = word(0)?;
        if !self.deflated {
            let data = bytes[self.word..].get(..first);
            let there = bytes.len() - self.word;
            return Ok(data
                .ok_or_else(|| format!("{first} bytes are said to be in it, {there} are there"))?
                .to_vec());
        }
        let mut content = Vec::new();
        let mut at = first.checked_add(3).and_then(|n| n.checked_mul(self.word)).ok_or_else(short)?;
        for block in 0..first {
            let size = word(3 + block)?;
            let deflated = bytes.get(at..).and_then(|b| b.get(..size)).ok_or_else(short)?;
            // The last one may be shorter; 0 says that it is not.
            let expected = match word(2)? {
                last if block + 1 == first && last > 0 => last,
                _ => word(1)?,
            } as u64;
            if expected > MOST_OF_A_BYTE * size as u64 {
                return Err(format!(
                    "block {block} is said to hold {expected} bytes, more than {size} can become"
                ));
            }
            let read = ZlibDecoder::new(deflated).take(expected + 1).read_to_end(&mut content);
            let read = read.map_err(|e| format!("block {block}: {e}"))?;
            if read as u64 != expected {
                return Err(format!("block {block} holds {read} bytes or more, expected {expected}"));
            }
            at += size;
        }
        Ok(content)
    }
}

/// Numbers of one of VTK's types.
fn decode(kind: &str, bytes: &[u8]) -> std::result::Result<Vec<f64>, String> {
    let dtype = Dtype::named(&kind.to_lowercase());
    Ok(dtype.ok_or_else(|| format!("type {kind:?}, expected {TYPES}"))?.decode(bytes))
}
