//! Tables of text: of OpenFOAM's function objects, and any other with a number for the time first in each row.

use crate::{Row, Series};
use m4gn_base::{Error, Result, files};
use std::path::{Path, PathBuf};

/// A column of a table over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// Times of the rows, s, increasing.
    pub times: Vec<f64>,
    /// Values of the column.
    pub values: Vec<f64>,
    /// Rows at which what a later start has left begins.
    begins: Vec<usize>,
    /// Number of rows that are left out, without the columns of a field that was not solved for.
    short: usize,
}

impl Column {
    /// The rows from `start` on, as a series: each stands for the time since the one before, the first for as long as the second. So does the first of a
    /// later start, and one that is its only row for as long as the row before, where that is less: what is missing before it counts for nothing.
    pub fn series(&self, start: f64) -> Series {
        let (mut series, times) = (Series::default(), &self.times);
        let first = times.partition_point(|t| *t < start);
        let begins = |i: usize| self.begins.binary_search(&i).is_ok();
        let mut before = f64::INFINITY;
        for (i, (&time, &value)) in times.iter().zip(&self.values).enumerate().skip(first) {
            let since = if i > first { time - times[i - 1] } else { f64::INFINITY };
            let own = match times.get(i + 1) {
                _ if i > first && !begins(i) => f64::INFINITY,
                Some(next) if i == first || !begins(i + 1) => next - time,
                _ => before,
            };
            let weight = Some(since.min(own)).filter(|weight| weight.is_finite()).unwrap_or(1.0);
            before = weight;
            series.push(Row { time, value, weight, surrogate: false });
        }
        series
    }

    /// Takes another one's rows in place of its own from that one's first row on.
    fn carried_on(&mut self, later: Column) {
        self.short += later.short;
        let Some(first) = later.times.first() else { return };
        let keep = self.times.partition_point(|t| t < first);
        self.times.truncate(keep);
        self.values.truncate(keep);
        self.begins.retain(|i| *i < keep);
        self.begins.push(keep);
        self.times.extend(later.times);
        self.values.extend(later.values);
    }
}

/// Reads the column `name` of a table.
///
/// `path` is a file, or `FOLDER/FILE` where the restarts of a run have left `FOLDER/0/FILE`, `FOLDER/0.5/FILE`, ...: these are joined
/// in the order of their folders, each in place of what earlier ones have from its first row on. A run that begins again at a time leaves
/// `FOLDER/0/FILE_0` beside `FOLDER/0/FILE` (OpenFOAM's `writeFile`), which comes behind it. What is read of a file: [`column`].
///
/// # Errors
/// [`Error::File`] with line and column.
pub fn read(path: &Path, name: &str) -> Result<Column> {
    let mut all = Column::default();
    for part in files_of(path)? {
        let text = files::read_text(&part).map_err(Error::cannot("read", &part))?;
        // A restart that was ended before its first step has left no rows
        all.carried_on(rows(&text, name).map_err(|message| Error::file(&part, message))?);
    }
    some(all).map_err(|message| Error::file(path, message))
}

/// The file, or those of its name in folders that are named by times.
///
/// # Errors
/// [`Error::File`] where there is none.
pub fn files_of(path: &Path) -> Result<Vec<PathBuf>> {
    let (Some(name), false) = (path.file_name(), path.exists()) else {
        return Ok(vec![path.to_path_buf()]);
    };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let found = parts(folder, &name.to_string_lossy());
    if found.is_empty() {
        return Err(Error::file(
            path,
            "is not there, nor a file of this name in folders beside it that are named by times (0, 0.5, ...)",
        ));
    }
    Ok(found)
}

/// The files of a function object's table, in order: `FOLDER/TIME/FILE` of each start, and behind it that of a run that began there again, with
/// `_TIME` behind its stem (`writeFile::createFile`).
pub fn parts(folder: &Path, file: &str) -> Vec<PathBuf> {
    let named = |time: &String| {
        // Probes have files without an end, and begin them anew
        let again = file.rsplit_once('.').map(|(stem, end)| format!("{stem}_{time}.{end}"));
        let place = folder.join(time);
        std::iter::once(file.to_string()).chain(again).map(move |name| place.join(name))
    };
    starts(folder).iter().flat_map(named).filter(|path| path.exists()).collect()
}

/// Names of the folders of a function object's starts, in the order of their times.
pub fn starts(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<(f64, String)> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            Some((name.parse().ok().filter(|t: &f64| t.is_finite())?, name))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|(_, name)| name).collect()
}

/// The column `name` of a table's text.
///
/// Lines that begin with `#` are comments; the last one before the first row names the columns. So does a later one with the same first word: a function
/// object that is read again begins with another header. The columns of a vector `force`, which has brackets in the rows, are `force_x`, `force_y`,
/// `force_z`; those of tensors end in `_xx` and so on. Columns without a name have their number, from 1 behind the time. Only the time and the column that
/// is asked for have to be numbers. A last line that does not end is left out: it may not be whole. So are rows of OpenFOAM's solverInfo without the columns
/// of a field that was not solved for: they do not say of which.
///
/// # Errors
/// What was expected and found, with line and column.
pub fn column(text: &str, name: &str) -> std::result::Result<Column, String> {
    rows(text, name).and_then(some)
}

/// The column, unless it is without rows.
fn some(column: Column) -> std::result::Result<Column, String> {
    match (column.times.is_empty(), column.short) {
        (false, _) => Ok(column),
        (true, 0) => Err("expected rows of numbers, found none".into()),
        (true, short) => Err(format!(
            "expected a row with all columns of the header, found {short} without those of a field that was not solved for; give \
             solverInfo the fields alone that are, or name the column by its number from 1 behind the time"
        )),
    }
}

/// As [`column`], of a text that may be without rows.
fn rows(text: &str, name: &str) -> std::result::Result<Column, String> {
    // Which programs of Windows put in front
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    let mut header = "";
    let mut place: Option<(usize, usize)> = None;
    let mut found = Column::default();
    let mut all = 0;
    for (i, line) in whole.lines().enumerate() {
        let line = line.trim_end();
        if let Some(comment) = line.trim_start().strip_prefix('#') {
            if place.is_none() || comment.split_whitespace().next() == header.split_whitespace().next() {
                (header, place) = (comment, None);
                all = if name.parse::<usize>().is_err() { columns_of_solves(header) } else { 0 };
            }
            continue;
        }
        let mut words = words(line);
        let Some(time) = words.next() else { continue };
        let hint = if place.is_none() { "; names of columns stand in a line that begins with #" } else { "" };
        let time = number(time, i).map_err(|e| e + hint)?;
        let words: Vec<(usize, &str)> = words.collect();
        if words.len() < all {
            found.short += 1;
            continue;
        }
        let (at, count) = match place {
            Some(place) => place,
            None => {
                let names = names(header, line);
                let at = names.iter().position(|n| n == name).ok_or_else(|| unknown(name, &names, i))?;
                *place.insert((at, words.len()))
            }
        };
        if words.len() != count {
            return Err(format!(
                "line {}: expected {} columns as in the rows before, found {}",
                i + 1,
                count + 1,
                words.len() + 1
            ));
        }
        if found.times.last().is_some_and(|last| time <= *last) {
            return Err(format!(
                "line {}: expected a time later than that of the row before ({}), found {time}; a table has one row for each time (fieldMinMax: with one \
                 field, or location no), with as many digits as tell steps apart (timePrecision of controlDict)",
                i + 1,
                found.times[found.times.len() - 1]
            ));
        }
        found.times.push(time);
        found.values.push(number(words[at], i)?);
    }
    Ok(found)
}

/// Columns behind the time of a row of OpenFOAM's solverInfo, where all fields of the header were solved for; 0: it is of another table.
fn columns_of_solves(header: &str) -> usize {
    let names: Vec<&str> = header.split_whitespace().skip(1).collect();
    if names.iter().any(|name| name.ends_with("_solver")) { names.len() } else { 0 }
}

/// Whether words end here.
fn is_gap(c: char) -> bool {
    c.is_whitespace() || c == '(' || c == ')' || c == ','
}

/// Whether a bracket opens behind a name, as in `mag(U)` of OpenFOAM's fieldMinMax, and is none of a vector. It is asked of each character in turn.
fn opens_in_name() -> impl FnMut(char) -> bool {
    let mut before = ' ';
    move |c| {
        let before = std::mem::replace(&mut before, c);
        c == '(' && before.is_alphabetic()
    }
}

/// The words of a line with their columns in the text, from 1; brackets are spaces.
fn words(line: &str) -> impl Iterator<Item = (usize, &str)> {
    let start = line.as_ptr() as usize;
    let mut in_name = opens_in_name();
    line.split(move |c| !in_name(c) && is_gap(c))
        .filter(|w| !w.is_empty())
        .map(move |w| (w.as_ptr() as usize - start + 1, w))
}

fn number((column, word): (usize, &str), line: usize) -> std::result::Result<f64, String> {
    let place = || format!("line {}, column {column}", line + 1);
    let excerpt: String = word.chars().take(40).collect();
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(format!("{}: expected a finite number, found {excerpt}", place())),
        Err(_) => Err(format!("{}: expected a number, found '{excerpt}'", place())),
    }
}

fn unknown(name: &str, names: &[String], line: usize) -> String {
    let excerpt: Vec<&str> = names.iter().take(40).map(String::as_str).collect();
    let more = if names.len() > excerpt.len() { ", ..." } else { "" };
    format!("line {}: expected a column {name}, found {}{more}", line + 1, excerpt.join(", "))
}

/// Numbers of each value behind the time of a row: one without brackets, those within the innermost brackets of others.
fn sizes(row: &str) -> Vec<usize> {
    let values = row.trim_start_matches(is_gap).split_once(is_gap).map_or("", |(_time, values)| values);
    let values =
        values.replace(opens_in_name(), "[").replace(',', " ").replace('(', " ( ").replace(')', " ) ");
    let (mut sizes, mut size, mut depth) = (Vec::new(), 0, 0);
    for word in values.split_whitespace() {
        match word {
            "(" | ")" => {
                sizes.extend(Some(size).filter(|size| *size > 0));
                size = 0;
                depth = if word == "(" { depth + 1 } else { (depth - 1).max(0) };
            }
            _ if depth > 0 => size += 1,
            _ => sizes.push(1),
        }
    }
    sizes.extend(Some(size).filter(|size| *size > 0));
    sizes
}

/// What stands behind the name of a value of so many numbers, for each of them; none: OpenFOAM has no such value.
fn components(size: usize) -> Option<&'static [&'static str]> {
    let all: &'static [&'static str] = match size {
        1 => &[""],
        3 => &["_x", "_y", "_z"],
        6 => &["_xx", "_xy", "_xz", "_yy", "_yz", "_zz"],
        9 => &["_xx", "_xy", "_xz", "_yx", "_yy", "_yz", "_zx", "_zy", "_zz"],
        _ => return None,
    };
    Some(all)
}

/// Names of the columns behind the time of a table with this first row, by a header's words, the first of which names the time.
pub fn names<'a>(header: &'a str, row: &str) -> Vec<String> {
    let mut named: Vec<String> = Vec::new();
    let mut group = "";
    // Commas within brackets are of a name
    let parts = |word: &'a str| word.split(move |c| c == ',' && !word.contains('('));
    let words = header.split_whitespace().flat_map(parts).filter(|word| !word.is_empty());
    for word in words.skip(1).map(|word| word.trim_end_matches(',')) {
        let (open, closed) = (word.matches('(').count(), word.matches(')').count());
        let (mut of, mut rest) = (group, word);
        if open > closed {
            (of, rest) = word.split_once('(').unwrap_or(("", word));
            group = of;
        } else if closed > open {
            rest = word.trim_end_matches(')');
            group = "";
        }
        if !rest.is_empty() {
            named.push(if of.is_empty() { rest.into() } else { format!("{of}_{rest}") });
        }
    }
    let sizes = sizes(row);
    let count: usize = sizes.iter().sum();
    if named.len() == count {
        return named;
    }
    let of = |(name, size): (&String, &usize)| {
        Some(components(*size)?.iter().map(|c| format!("{name}{c}")).collect::<Vec<_>>())
    };
    let all: Option<Vec<_>> = named.iter().zip(&sizes).map(of).collect();
    match all.filter(|_| named.len() == sizes.len()) {
        Some(all) => all.concat(),
        None => (1..=count).map(|i| i.to_string()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with these files.
    fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (file, text) in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }

    #[test]
    fn what_lies_between_two_starts_and_is_in_no_table_counts_for_nothing() {
        let folder = folder_of(&[
            ("0/a", "-1 5\n0 5\n1 5\n"),
            ("1/a", "2 5\n"),
            ("8/a", "8.5 1\n9 1\n"),
            ("9/a", "9.5 1\n"),
            ("14/a", "15 1\n"),
            ("20/a", "20 1\n"),
        ]);
        let series = read(&folder.path().join("a"), "1").unwrap().series(f64::NEG_INFINITY);
        let weights: Vec<f64> = series.rows().iter().map(|row| row.weight).collect();
        assert_eq!(weights, [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5]);
    }

    #[test]
    fn tables_of_openfoam_are_read_by_the_names_of_their_columns() {
        let coefficients = "# Force coefficients\n# dragDir : (1 0 0)\n#\n# Time \tCd\tCd(f)\tCl\n0.1\t1\t2\t3\n0.2 4 5 6\n0.3 7";
        let read = column(coefficients, "Cd(f)").unwrap();
        assert_eq!((read.times, read.values), (vec![0.1, 0.2], vec![2.0, 5.0]));
        let forces =
            "# Time (total_x total_y total_z) (pressure_x pressure_y pressure_z)\n1 ((1 2 3) (4 5 6))\n";
        assert_eq!(column(forces, "pressure_y").unwrap().values, [5.0]);
        let grouped = "# Time forces(pressure viscous) moment(pressure viscous)\n1 ((1 2 3) (4 5 6)) ((7 8 9) (10 11 12))\n";
        assert_eq!(column(grouped, "moment_pressure_z").unwrap().values, [9.0]);
        let mixed = "# Time average(U) average(grad(U)) average(p)\n1 (1 2 3) (4 5 6 7 8 9 10 11 12) 13\n";
        for (name, value) in [("average(U)_z", 3.0), ("average(grad(U))_yx", 7.0), ("average(p)", 13.0)] {
            assert_eq!(column(mixed, name).unwrap().values, [value], "{name}");
        }
        let two = "# Time average(U) average(grad(U))\n1 (1 2 3) (4 5 6 7 8 9 10 11 12)\n";
        assert_eq!(column(two, "average(grad(U))_xx").unwrap().values, [4.0]);
        let extremes = "# Time field max location(max)\n1 p 5 (6 7 8)\n";
        assert_eq!(column(extremes, "location(max)_y").unwrap().values, [7.0]);
        let of_speed = "# Time field min location(min) processor max\n1 mag(U) 0 (6 7 8) 1 9\n";
        assert_eq!(column(of_speed, "location(min)_z").unwrap().values, [8.0]);
        assert_eq!(column(of_speed, "max").unwrap().values, [9.0]);
        let probes = "# Probe 0 (0 0 0)\n# Probe 1 (1 0 0)\n#  Probe  0  1\n#  Time\n 0.1 (1 2 3) (4 5 6)\n";
        assert_eq!(column(probes, "5").unwrap().values, [5.0]);
        let commas = "# time, Cd, Cl\n1, 2, 3\n";
        assert_eq!(column(commas, "Cd").unwrap().values, [2.0]);
        let commas = "# Time,Cd,Cl\n1,2,3\n";
        assert_eq!(column(commas, "Cl").unwrap().values, [3.0]);
        let of_name = "# Time average(in,p) sum(out,p)\n1 2 3\n";
        assert_eq!(column(of_name, "average(in,p)").unwrap().values, [2.0]);
        assert_eq!(column("1 2\n3 4\n", "1").unwrap().values, [2.0, 4.0]);
    }

    #[test]
    fn a_header_behind_rows_names_the_columns_from_there_on() {
        let table =
            "# Time a b\n1 2 3\n# a remark\n2 4 5\n# Faces : 1\n# Time b a\n3 6 7\n# Time b c a\n4 8 0 9\n";
        assert_eq!(column(table, "a").unwrap().values, [2.0, 4.0, 7.0, 9.0]);
        assert_eq!(column(table, "c").unwrap_err(), "line 2: expected a column c, found a, b");
        let other = column("# Time a\n1 2\n# Time b\n2 3\n", "a").unwrap_err();
        assert_eq!(other, "line 4: expected a column a, found b");
    }

    #[test]
    fn steps_that_do_not_solve_for_a_field_have_no_row() {
        let table = |rows: &str| {
            let header =
                "# Solver information\n# Time\tT_solver\tT_initial\tp_solver\tp_initial\tp_converged\n";
            format!("{header}{rows}")
        };
        let rows = |rows: &str| column(&table(rows), "p_initial");
        let read =
            rows("1 PCG 0.1 true\n2 PBiCG 0.5 PCG 0.2 true\n3 PCG 0.3 true\n4 PBiCG 0.5 PCG 0.4 true\n")
                .unwrap();
        assert_eq!((read.times, read.values), (vec![2.0, 4.0], vec![0.2, 0.4]));
        let none = rows("1 PCG 0.1 true\n2 PCG 0.2 true\n").unwrap_err();
        assert!(none.contains("all columns of the header, found 2 without"), "{none}");
        // A restart that has no other rows
        let [first, short] = ["1 PBiCG 0.5 PCG 0.2 true\n", "2 PCG 0.3 true\n"].map(table);
        let folder = folder_of(&[("0/s.dat", &first), ("1/s.dat", &short), ("2/none.dat", &short)]);
        let joined = |file: &str| super::read(&folder.path().join(file), "p_initial");
        assert_eq!(joined("s.dat").unwrap().values, [0.2]);
        let none = joined("none.dat").unwrap_err().to_string();
        assert!(none.contains("none.dat: expected a row") && none.contains("found 1 without"), "{none}");
        assert_eq!(column("# Time p_solver p_initial U_solver\n1 PCG 0.1\n", "2").unwrap().values, [0.1]);
    }

    #[test]
    fn the_tables_of_a_run_that_began_again_are_joined() {
        let folder = folder_of(&[
            ("0/Cd.dat", "1 1\n2 1\n3 1\n"),
            ("0/Cd_0.dat", "2 2\n3 2\n4 2\n5 2\n"),
            ("4/Cd.dat", "5 3\n"),
            ("4/Cd_0.dat", "6 9\n"),
            ("5/Cd.dat", "5.5 7\n"),
            ("5.5/Cd.dat", "# Time Cd\n"),
            ("5.5/none.dat", "# Time Cd\n"),
        ]);
        let all = read(&folder.path().join("Cd.dat"), "1").unwrap();
        assert_eq!(all.times, [1.0, 2.0, 3.0, 4.0, 5.0, 5.5]);
        assert_eq!(all.values, [1.0, 2.0, 2.0, 2.0, 3.0, 7.0]);
        let one = read(&folder.path().join("0/Cd.dat"), "1").unwrap();
        assert_eq!((one.times.len(), one.series(2.0).len()), (3, 2));
        let gone = read(&folder.path().join("b.dat"), "1").unwrap_err().to_string();
        assert!(gone.contains("b.dat: is not there"), "{gone}");
        let none = read(&folder.path().join("none.dat"), "1").unwrap_err().to_string();
        assert!(none.contains("none.dat: expected rows of numbers, found none"), "{none}");
    }

    #[test]
    fn what_is_wrong_has_its_line_and_column() {
        let fails = |text: &str, name: &str| column(text, name).unwrap_err();
        assert_eq!(fails("# t a b\n1 2 3\n", "c"), "line 2: expected a column c, found a, b");
        assert_eq!(fails("# t a\n1 2\n2 x\n", "a"), "line 3, column 3: expected a number, found 'x'");
        assert_eq!(fails("# t a\n1 nan\n", "a"), "line 2, column 3: expected a finite number, found nan");
        assert_eq!(
            fails("# t a\n1 2\n2 3 4\n", "a"),
            "line 3: expected 2 columns as in the rows before, found 3"
        );
        assert!(fails("1 2\n1 3\n", "1").starts_with("line 2: expected a time later than"));
        assert_eq!(fails("# t a\n", "a"), "expected rows of numbers, found none");
        assert_eq!(
            fails("t,a\n1,2\n", "a"),
            "line 1, column 1: expected a number, found 't'; names of columns stand in a line that begins with #"
        );
        assert_eq!(column("\u{feff}# t a\r\n1 2\r\n", "a").unwrap().values, [2.0], "as Windows writes it");
        assert_eq!(column("# t a word\n1 2 U\n", "a").unwrap().values, [2.0], "other columns may be words");
    }
}
