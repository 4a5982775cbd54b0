//! The tables that OpenFOAM's own function objects wrote in a run: `postProcessing/NAME/START/FILE`.

use super::series::{Row, Series, Statistics, relative};
use crate::foam_case::{Description, FunctionObject};
use crate::user_case;
use m4gn_averages::table::{names, parts, starts};
use m4gn_base::files;
use m4gn_report::percent;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Folder of a case that has them.
const TABLES: &str = "postProcessing";

/// Values from here on are none: OpenFOAM writes -1e+300 for a probe that is in no cell.
const UNSET: f64 = 1e299;

/// The rows of all parts of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Table {
    /// Names of the columns; the first is the time.
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// The table of this file of a function object; none: there is none with rows. Of parts that begin before others end, the later counts.
    pub fn read(case: &Path, object: &str, file: &str) -> Option<Table> {
        let mut whole = Table::default();
        for path in parts(&case.join(TABLES).join(object), file) {
            let Ok(text) = files::read_text(path) else { continue };
            let part = Table::parse(&text);
            let Some(first) = part.rows.first().map(|row| row[0]) else { continue };
            if part.columns != whole.columns {
                whole = Table { columns: part.columns, rows: Vec::new() };
            }
            whole.rows.retain(|row| row[0] < first);
            whole.rows.extend(part.rows);
        }
        (!whole.rows.is_empty()).then_some(whole)
    }

    /// What stands before a header with other columns does not count.
    fn parse(text: &str) -> Table {
        let numbers = |line: &str| -> Option<Vec<f64>> {
            let words = line.split(|c: char| c.is_whitespace() || "()".contains(c)).filter(|w| !w.is_empty());
            words.map(|w| w.parse().ok()).collect()
        };
        // The last line of a run that was killed may be cut
        let text = text.rfind('\n').map_or("", |end| &text[..end]);
        let (mut head, mut begin) = ("", 0);
        for (i, line) in text.lines().enumerate() {
            let names = line.strip_prefix('#').filter(|h| h.split_whitespace().next() == Some("Time"));
            if let Some(names) = names.filter(|names| *names != head) {
                (head, begin) = (names, i);
            }
        }
        let lines = text.lines().skip(begin).filter(|line| !line.starts_with('#'));
        let rows = lines.filter_map(|line| Some((line, numbers(line)?)));
        let mut rows = rows.filter(|(_, row)| row.len() > 1 && row[0].is_finite()).peekable();
        let (first, width) = rows.peek().map_or(("", 0), |(line, row)| (*line, row.len()));
        let columns = std::iter::once("Time".into()).chain(names(head, first)).collect();
        let mut rows: Vec<Vec<f64>> = rows.map(|(_, row)| row).filter(|row| row.len() == width).collect();
        rows.dedup_by(|b, a| b[0] <= a[0]);
        Table { columns, rows }
    }

    /// A figure of each row, where it is finite and set.
    fn series(&self, of: impl Fn(&[f64]) -> f64) -> Series {
        let all = self.rows.iter().map(|row| (row[0], of(row)));
        let (times, values) = all.filter(|(_, value)| value.abs() < UNSET).unzip();
        Series { times, values }
    }

    /// The values of a column.
    pub fn column(&self, number: usize) -> Series {
        self.series(|row| row[number])
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == name)
    }

    /// Drag and lift coefficient, of the function object `forceCoeffs`.
    pub fn coefficients(&self) -> Option<[Series; 2]> {
        Some([self.column(self.place("Cd")?), self.column(self.place("Cl")?)])
    }

    /// The whole force along a direction, of the function object `forces`.
    pub fn force(&self, along: [f64; 3]) -> Option<Series> {
        let x = self.place("total_x").filter(|x| x + 3 <= self.columns.len())?;
        Some(self.series(|row| (0..3).map(|d| row[x + d] * along[d]).sum()))
    }
}

/// Function objects of these types that both runs have.
pub(super) fn common<'a>(
    [a, b]: [&'a Description; 2],
    kinds: &'a [&str],
) -> impl Iterator<Item = &'a FunctionObject> {
    let both = move |f: &&FunctionObject| b.functions.iter().any(|g| g.name == f.name && g.kind == f.kind);
    a.functions.iter().filter(move |f| kinds.contains(&f.kind.as_str())).filter(both)
}

/// A component at a probe, in both runs.
#[derive(Clone, Debug, Serialize)]
pub struct Probe {
    /// Name of the function object.
    pub object: String,
    /// Name of the field.
    pub field: String,
    /// Number of the column of its table, from 1: of a vector three for each probe.
    pub column: usize,
    /// Of A and B.
    pub statistics: [Statistics; 2],
}

/// All columns of all tables of probes that both runs have, from this time on, s.
pub(super) fn probes(cases: [&Description; 2], from: f64) -> Vec<Probe> {
    let mut found = Vec::new();
    for object in common(cases, &["probes", "patchProbes"]) {
        let paths = cases.map(|c| Path::new(&c.path));
        let folder = paths[0].join(TABLES).join(&object.name);
        let fields: BTreeSet<String> = starts(&folder)
            .iter()
            .flat_map(|start| user_case::names(&folder.join(start)).unwrap_or_default())
            .collect();
        for field in fields {
            let [Some(a), Some(b)] = paths.map(|path| Table::read(path, &object.name, &field)) else {
                continue;
            };
            if a.rows[0].len() != b.rows[0].len() {
                continue;
            }
            for column in 1..a.rows[0].len() {
                let statistics = over([&a, &b].map(|table| table.column(column)), from, f64::INFINITY);
                found.push(Probe { object: object.name.clone(), field: field.clone(), column, statistics });
            }
        }
    }
    found
}

/// What is told of both runs from a time on, s, as long as both go.
pub(super) fn over(both: [Series; 2], from: f64, longest: f64) -> [Statistics; 2] {
    let to = both.iter().filter_map(|s| s.times.last().copied()).fold(f64::INFINITY, f64::min);
    both.map(|series| series.between(from, to).statistics(longest))
}

/// Of each field of each function object the column that varies most in A.
pub(super) fn rows(probes: &[Probe]) -> Vec<Row> {
    let mut rows = Vec::new();
    for group in probes.chunk_by(|p, q| (&p.object, &p.field) == (&q.object, &q.field)) {
        let rms = |p: &&Probe| p.statistics[0].rms.unwrap_or(0.0);
        let Some(most) = group.iter().max_by(|p, q| rms(p).total_cmp(&rms(q))) else { continue };
        let of = format!("{} of {}, column {}", most.field, most.object, most.column);
        let mut row = |what: &str, pair: [Option<f64>; 2]| {
            rows.push((format!("{what} of {of}"), pair, percent(relative(pair))));
        };
        row("mean", most.statistics.map(|s| s.mean));
        row("rms", most.statistics.map(|s| s.rms));
        row("frequency [1/s]", most.statistics.map(|s| s.frequency));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    #[test]
    fn parts_of_a_run_are_one_table() {
        let head = "# Force coefficients\n# Time \tCd\tCs\tCl\n";
        let dir = fixtures::folder(&[
            ("postProcessing/drag/0/coefficient.dat", &format!("{head}1\t2\t0\t3\n2\t4\t0\t5\n3\t9\t0\t9\n")),
            ("postProcessing/drag/2/coefficient.dat", &format!("{head}2.5\t6\t0\t7\n3\t8\t0\t1.2e-0")),
        ]);
        let [drag, lift] =
            Table::read(dir.path(), "drag", "coefficient.dat").unwrap().coefficients().unwrap();
        assert_eq!((&drag.times[..], &drag.values[..]), (&[1.0, 2.0, 2.5][..], &[2.0, 4.0, 6.0][..]));
        assert_eq!(lift.values, [3.0, 5.0, 7.0]);
        assert_eq!(Table::read(dir.path(), "drag", "other.dat"), None);
        // Begun again at the same time
        let again = format!("{head}2.5\t1\t0\t1\n");
        fixtures::write(dir.path(), &[("postProcessing/drag/2/coefficient_2.dat", &again)]);
        let [drag, _] = Table::read(dir.path(), "drag", "coefficient.dat").unwrap().coefficients().unwrap();
        assert_eq!(drag.values, [2.0, 4.0, 1.0]);
        // Two files of other columns that were joined by hand
        let joined = "# Time Cl Cd\n1 2 3\n2 2 3\n# Time Cd Cl\n3 7 8\n# Time Cd Cl\n4 7 8\n";
        let [drag, _] = Table::parse(joined).coefficients().unwrap();
        assert_eq!((&drag.times[..], &drag.values[..]), (&[3.0, 4.0][..], &[7.0, 7.0][..]));
    }

    #[test]
    fn forces_and_probes_are_vectors() {
        let dir = fixtures::folder(&[
            (
                "postProcessing/f/0/force.dat",
                "# Force\n# Time (total_x total_y total_z) (pressure_x pressure_y pressure_z)\n1 (1 2 3) (0 0 0)\n",
            ),
            ("postProcessing/n/0/coefficient.dat", "# Time Cd Cl\n1 2\n"),
            (
                "postProcessing/p/0/U",
                "# Probe 0 (0 0 0)\n#       Probe 0\n#        Time\n1 (1 2 3)\n2 (4 5 6)\n",
            ),
        ]);
        let force = Table::read(dir.path(), "f", "force.dat").unwrap().force([0.0, 1.0, 0.0]).unwrap();
        assert_eq!((force.times, force.values), (vec![1.0], vec![2.0]));
        assert_eq!(
            Table::read(dir.path(), "n", "coefficient.dat").unwrap().coefficients(),
            None,
            "rows without lift"
        );
        assert_eq!(Table::read(dir.path(), "p", "U").unwrap().column(2).values, [2.0, 5.0]);
        // The second probe is outside of the mesh
        let rows: String = (1..10).map(|t| format!("{t} {} -1e+300\n", t % 2)).collect();
        fixtures::write(dir.path(), &[("postProcessing/q/0/p", &format!("#        Time\n{rows}"))]);
        let case = Description {
            path: dir.path().display().to_string(),
            functions: vec![FunctionObject {
                name: "q".into(),
                kind: "probes".into(),
                ..FunctionObject::default()
            }],
            ..Description::default()
        };
        let found = probes([&case, &case], 0.0);
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].statistics, [Statistics::default(); 2]);
        assert!(super::rows(&found).iter().all(|row| row.0.ends_with("column 1")));
    }
}
