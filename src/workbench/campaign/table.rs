//! `parameters.csv`: a run a row, its name and its parameters.

use crate::generate::parameter::is_word;
use m4gn_base::{Error, Result, files};
use std::collections::HashSet;
use std::path::Path;

/// Name of the file in the campaign's folder.
pub const FILE: &str = "parameters.csv";
/// Its first column.
pub const NAME: &str = "case_name";
/// Columns of `results.csv` behind the parameters.
pub(super) const OF_RESULTS: [&str; 8] =
    ["quantity", "value", "half_width", "known", "start", "solver_s", "surrogate_s", "end_time"];

/// A run's name and the values of its parameters, in the order of [`Table::parameters`].
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Names its folder.
    pub name: String,
    /// A number in the fewest digits, or a word, each: other programs write 1 as 1.0.
    pub values: Vec<String>,
}

/// The file.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Names of the parameters.
    pub parameters: Vec<String>,
    /// The runs.
    pub rows: Vec<Row>,
}

impl Table {
    /// Reads and checks the file of a campaign's folder.
    ///
    /// # Errors
    /// [`Error::File`] with the line.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = files::read_text(&path).map_err(Error::cannot("read", &path))?;
        Table::parse(&text).map_err(|message| Error::file(&path, message))
    }

    fn parse(text: &str) -> std::result::Result<Self, String> {
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let header = reader.headers().map_err(|e| e.to_string())?.clone();
        let mut columns = header.iter();
        if columns.next() != Some(NAME) {
            return Err(format!(
                "the first row: expected {NAME} and the names of parameters with commas between them, found '{}' as the first",
                header.iter().next().unwrap_or_default()
            ));
        }
        let parameters: Vec<String> = columns.map(String::from).collect();
        check_names(&parameters)?;
        let (mut rows, mut names): (Vec<Row>, HashSet<String>) = (Vec::new(), HashSet::new());
        let (mut record, mut line, mut counted) = (csv::StringRecord::new(), 1, 0);
        while reader.read_record(&mut record).map_err(|e| e.to_string())? {
            // csv's own count is of where it began to look: before blank lines and comments, and the end of a line in two characters
            let end = (reader.position().byte() as usize).min(text.len());
            let more = text.as_bytes()[counted..end].trim_ascii_end();
            line += more.iter().filter(|b| **b == b'\n').count();
            counted += more.len();
            let name = record[0].to_string();
            if !is_name(&name) {
                return Err(format!(
                    "line {line}: expected a name of letters, digits, _ . + - =, which names a folder and begins with no . or -, found '{name}'"
                ));
            }
            let values = record.iter().skip(1).map(|text| {
                value(text).ok_or_else(|| {
                    format!("line {line}: expected a number or a word of OpenFOAM, found '{text}'")
                })
            });
            let values = values.collect::<std::result::Result<Vec<String>, String>>()?;
            if !names.insert(name.clone()) {
                return Err(format!(
                    "line {line}: there is another run of the name {name}: expected each name once"
                ));
            }
            rows.push(Row { name, values });
        }
        match rows.is_empty() {
            true => Err("expected a row for each run, found none".into()),
            false => Ok(Table { parameters, rows }),
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// [`Error::Internal`] for rows of different lengths.
    pub fn text(&self) -> Result<String> {
        let header = [NAME.to_string()].into_iter().chain(self.parameters.iter().cloned());
        let rows = self
            .rows
            .iter()
            .map(|row| [row.name.clone()].into_iter().chain(row.values.iter().cloned()).collect());
        csv_text([header.collect()].into_iter().chain(rows))
    }

    /// Where each run lies among the others: each parameter from 0 to 1 over its range. A word is a place of its own, in the order of
    /// first occurrence.
    pub fn places(&self) -> Vec<Vec<f64>> {
        let columns = (0..self.parameters.len())
            .map(|c| column(self.rows.iter().map(|r| r.values[c].as_str()).collect()));
        let columns: Vec<Vec<f64>> = columns.collect();
        (0..self.rows.len()).map(|r| columns.iter().map(|c| c[r]).collect()).collect()
    }
}

/// The run of a campaign's table that has these values, to twelve digits; one is appended to the file where there is none. The rest of the file
/// stays as it is. One program at a time may do so.
///
/// # Errors
/// As [`Table::read`]; [`Error::File`] where the file cannot be written, or its end takes no row.
pub fn with_row(folder: &Path, values: Vec<String>) -> Result<String> {
    let (path, table) = (folder.join(FILE), Table::read(folder)?);
    let same = |a: &String, b: &String| match (number(a), number(b)) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-12 * a.abs().max(b.abs()),
        _ => a == b,
    };
    if let Some(row) = table.rows.iter().find(|r| r.values.iter().zip(&values).all(|(a, b)| same(a, b))) {
        return Ok(row.name.clone());
    }
    // Of a row that was taken out the run may be there
    let of_run = |name: &String| folder.join("runs").join(name).exists();
    let taken = |name: &String| table.rows.iter().any(|r| r.name == *name) || of_run(name);
    let first = table.rows.len() + 1;
    let name = (first..).map(|i| format!("r{i:02}")).find(|name| !taken(name)).unwrap_or_default();
    let mut text = files::read_text(&path).map_err(Error::cannot("read", &path))?;
    if !text.ends_with('\n') {
        text.push('\n');
    }
    text += &csv_text([[vec![name.clone()], values].concat()])?;
    // A quote that is open at the file's end would take the new row into its value
    if Table::parse(&text).is_ok_and(|with| with.rows.len() == table.rows.len() + 1) {
        files::write_whole(&path, text.as_bytes())?;
        return Ok(name);
    }
    Err(Error::file(
        &path,
        "no row can be added, as its last value begins with a quote that is not closed: expected one at its end",
    ))
}

/// A value in the fewest digits that say the same; none: it is neither a number nor a word.
pub(super) fn value(text: &str) -> Option<String> {
    let shortest = |v: f64| {
        let plain = v == 0.0 || (1e-6..1e15).contains(&v.abs());
        if plain { v.to_string() } else { format!("{v:e}") }
    };
    number(text).map(shortest).or_else(|| is_value(text).then(|| text.to_string()))
}

fn column(values: Vec<&str>) -> Vec<f64> {
    let numbers: Option<Vec<f64>> = values.iter().map(|v| number(v)).collect();
    let values = numbers.unwrap_or_else(|| {
        let mut words = Vec::<&str>::new();
        let places = values.iter().map(|v| {
            words.iter().position(|w| w == v).unwrap_or_else(|| {
                words.push(*v);
                words.len() - 1
            }) as f64
        });
        places.collect()
    });
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    values.iter().map(|v| if high > low { (v - low) / (high - low) } else { 0.0 }).collect()
}

/// Rows as CSV.
pub(super) fn csv_text(rows: impl IntoIterator<Item = Vec<String>>) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let failed = |e: &dyn std::fmt::Display| Error::Internal(format!("a table of a campaign: {e}"));
    for row in rows {
        writer.write_record(row).map_err(|e| failed(&e))?;
    }
    let bytes = writer.into_inner().map_err(|e| failed(&e))?;
    String::from_utf8(bytes).map_err(|e| failed(&e))
}

/// A value as a finite number; none: it is a word.
pub(super) fn number(value: &str) -> Option<f64> {
    value.parse().ok().filter(|v: &f64| v.is_finite())
}

/// Checks that names can be names of OpenFOAM's entries, each once.
pub(super) fn check_names(parameters: &[String]) -> std::result::Result<(), String> {
    let mut names: HashSet<&str> = OF_RESULTS.into_iter().chain([NAME]).collect();
    match parameters.iter().find(|p| !is_word(p) || p.contains('-') || !names.insert(p.as_str())) {
        Some(name) => Err(format!(
            "parameter '{name}': expected a name of its own, of at most 64 letters, digits and _, and no column of results.csv"
        )),
        None => Ok(()),
    }
}

fn is_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_.+-=".contains(c);
    !name.is_empty() && name.len() <= 100 && !name.starts_with(['.', '-']) && name.chars().all(plain)
}

fn is_value(value: &str) -> bool {
    number(value).is_some() || (is_word(value) && value.parse::<f64>().is_err())
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    #[test]
    fn what_is_written_is_read() {
        let text = "case_name,Uin,model\na,1.5,kEpsilon\nb,0.3,kOmegaSST\n";
        let table = Table::parse(text).unwrap();
        assert_eq!(table.text().unwrap(), text);
        assert_eq!(table.places(), [[1.0, 0.0], [0.0, 1.0]]);
        assert_eq!(column(vec!["a", "b", "a", "c"]), [0.0, 0.5, 0.0, 1.0]);
        let spaced =
            Table::parse("# drawn\ncase_name, Uin, model\na, 1.50, kEpsilon\nb, 3e-1, kOmegaSST\n").unwrap();
        assert_eq!(spaced, table);
    }

    #[test]
    fn a_run_is_found_by_its_values_or_appended() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE);
        let text = "# drawn\ncase_name, Uin, model\nr03, 0.30000000000000004, a\nr01, 2e-7, b";
        std::fs::write(&path, text).unwrap();
        let of =
            |uin: &str, model: &str| with_row(dir.path(), vec![value(uin).unwrap(), model.into()]).unwrap();
        assert_eq!(of("3.000000000000000e-01", "a"), "r03");
        assert_eq!(of("2.000000000000000e-07", "b"), "r01");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "nothing is appended");
        assert_eq!(
            [of("3.000000000000000e-01", "b"), of("-4.000000000000000e+00", "a")],
            ["r04", "r05"],
            "r03 is there"
        );
        assert_eq!([of("0.3", "b"), of("4e20", "a")], ["r04", "r06"]);
        let all = std::fs::read_to_string(&path).unwrap();
        assert_eq!(all, format!("{text}\nr04,0.3,b\nr05,-4,a\nr06,4e20,a\n"));
        std::fs::create_dir_all(dir.path().join("runs/r07")).unwrap();
        assert_eq!(of("5", "a"), "r08", "a run of r07 is there");
        assert_eq!([value("nan"), value("a b"), value("")], [None, None, None]);
        let open = "case_name,Uin,model\nr01,1,\"a";
        std::fs::write(&path, open).unwrap();
        fails(with_row(dir.path(), vec!["2".into(), "a".into()]), &["a quote that is not closed"]);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), open, "it is as it was");
    }

    #[test]
    fn faults_have_their_line() {
        for (text, expected) in [
            ("U;case_name\n1;a\n", "the first row: expected case_name"),
            ("U,case_name\n1,a\n", "found 'U' as the first"),
            ("case_name,U,U\na,1,2\n", "parameter 'U': expected a name of its own"),
            ("case_name,value\na,1\n", "parameter 'value': expected a name of its own"),
            ("case_name,U\n", "found none"),
            ("case_name,U\n../a,1\n", "line 2: expected a name"),
            ("case_name,U\na,1\na,2\n", "line 3: there is another run"),
            ("case_name,U\na,1; b\n", "line 2: expected a number or a word"),
            ("case_name,U\na,nan\n", "line 2: expected a number or a word"),
            (
                "\u{feff}# drawn\r\ncase_name,U\r\n\r\na,1\r\n\r\nb,nan\r\n\r\n",
                "line 6: expected a number or a word",
            ),
            ("case_name,U\na\n", "fields"),
        ] {
            fails(Table::parse(text), &[expected]);
        }
    }
}
