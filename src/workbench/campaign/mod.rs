//! A campaign: runs of one case over its parameters, in one folder.
//!
//! ```text
//! FOLDER/campaign.toml     settings          what all runs have in common
//! FOLDER/parameters.csv    table             a row a run
//! FOLDER/runs/NAME         one, record       case (the copy), done or failed
//! FOLDER/checks/NAME                         the same run made cold and plain and to the end
//! FOLDER/results.csv       report            and report.html
//! ```
//!
//! A run is there when its file `done` is, which is written last; that says from which contents it was made ([`case::MadeFrom`]).

pub mod case;
pub mod cycle;
pub mod dakota;
mod init;
mod one;
pub mod order;
pub mod plan;
mod quantities;
pub mod record;
mod report;
mod run;
pub mod sampling;
pub mod settings;
pub mod start;
mod survey;
pub mod table;

pub use init::{Found, Request, init};
pub use one::{Outcome, one, one_claimed};
pub use report::{Report, report};
pub use run::{Order, line, run, status};

use crate::generate::openfoam::{environment, lies_in, plain_path, scratch};
use crate::generate::process::Surroundings;
use case::{MadeFrom, Source};
use m4gn_base::{Error, Result, listed, refuse};
use record::State;
use sampling::{Parameter, Values};
use settings::Settings;
use start::Sister;
use std::path::{Path, PathBuf};
use std::time::Duration;
use table::{Row, Table};

/// An open campaign.
pub struct Campaign {
    /// Its folder.
    pub folder: PathBuf,
    /// What all runs have in common.
    pub settings: Settings,
    /// The runs.
    pub table: Table,
    source: Source,
    files: MadeFrom,
    places: Vec<Vec<f64>>,
}

/// A run of a campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Number of its row.
    pub row: usize,
    /// Whether it is the one that is made cold and plain and to the end.
    pub check: bool,
}

/// Refuses a folder of a campaign that would be copied into each run.
fn check_apart(folder: &Path, case: &Path) -> Result<()> {
    let inside = |m: String| Error::file(folder, m);
    refuse(lies_in(folder, case), inside, || "lies in the case: expected a folder outside of it")
}

/// The case as it is with a row's parameters, on which its times may depend.
///
/// # Errors
/// As [`Source::read`]; [`Error::File`] for a run that would end before it starts.
fn source_of(
    s: &Settings,
    table: &Table,
    row: &Row,
    first: Option<&Source>,
    folder: &Path,
    tools: &Surroundings,
) -> Result<Source> {
    let scratch = scratch()?;
    let source = Source::read(&s.case, scratch.path(), &case::parameters(table, row), first, tools)?;
    match s.end_time.unwrap_or(source.end) {
        end if end > source.start => Ok(source),
        end => Err(Error::file(
            folder.join(settings::FILE),
            format!("end_time = {end}: expected a time behind the case's startTime {}", source.start),
        )),
    }
}

impl Campaign {
    /// Opens the campaign of a folder.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Input`] for files of the campaign or the case that are missing or wrong.
    pub fn open(folder: &Path, tools: &mut Surroundings) -> Result<Self> {
        let folder = plain_path(folder)?;
        let mut settings = Settings::read(&folder)?;
        settings.case = plain_path(&settings.case)?;
        check_apart(&folder, &settings.case)?;
        let table = Table::read(&folder)?;
        if let Some(scale) = settings.scale.as_ref().filter(|s| !table.parameters.contains(s)) {
            let (path, all) = (folder.join(settings::FILE), table.parameters.join(", "));
            return Err(Error::file(path, format!("scale = \"{scale}\": expected a parameter ({all})")));
        }
        let named = settings.prepare.iter().chain([&settings.solver]).map(|c| c[0].as_str());
        // Scripts of the case are no programs in PATH
        let programs: Vec<&str> =
            named.chain((settings.ranks > 1).then_some("mpirun")).filter(|p| !p.contains('/')).collect();
        environment(&programs)?;
        tools.timeout = Duration::from_secs(settings.time_limit);
        let source = source_of(&settings, &table, &table.rows[0], None, &folder, tools)?;
        let (files, places) = (source.digests()?, table.places());
        Ok(Campaign { folder, settings, table, source, files, places })
    }

    /// What has to be there before a run is made: a quantity, and a file of the case, or a command of `prepare`, that uses each parameter, also one that
    /// was added to the table.
    ///
    /// # Errors
    /// As [`Settings::check_quantities`] and [`survey::check_uses`].
    fn check(&self) -> Result<()> {
        self.settings.check_quantities(&self.folder)?;
        let values = |i: usize| self.table.rows.iter().map(|row| row.values[i].clone()).collect();
        let parameter =
            |(i, name): (usize, &String)| Parameter { name: name.clone(), values: Values::List(values(i)) };
        let all: Vec<Parameter> = self.table.parameters.iter().enumerate().map(parameter).collect();
        let mut texts = survey::texts(&self.source)?;
        let commands: Vec<String> = self.settings.prepare.iter().map(|command| command.join(" ")).collect();
        texts.push((format!("prepare in {}", settings::FILE), commands.join("\n")));
        survey::check_uses(&self.source, &all, &texts).map(drop)
    }

    /// The run of a row.
    ///
    /// # Errors
    /// [`Error::File`] where there is no such row, naming some that are there.
    pub fn unit(&self, name: &str, check: bool) -> Result<Unit> {
        let row = self.table.rows.iter().position(|r| r.name == name).ok_or_else(|| {
            let some = listed(self.table.rows.iter().take(6).map(|r| &r.name));
            Error::file(
                self.folder.join(table::FILE),
                format!("has no run {name}: expected one of {some}, ..."),
            )
        })?;
        Ok(Unit { row, check })
    }

    /// All runs: in the order in which they are made while none is finished.
    pub fn units(&self) -> Vec<Unit> {
        let rows = order::spread(&self.places).into_iter().map(|row| Unit { row, check: false });
        rows.chain(self.checks().into_iter().map(|row| Unit { row, check: true })).collect()
    }

    /// Rows that are made once more as a check: those that are there, though rows were added since, and others up to the share. The run that is made
    /// first is cold itself, and says nothing of starts: another one in its place, where not all are asked for.
    fn checks(&self) -> Vec<usize> {
        let there =
            |row: &usize| self.folder_of(Unit { row: *row, check: true }).join(record::DONE).is_file();
        let (all, first) = (self.table.rows.len(), order::middle(&self.places));
        let mut asked = sampling::held_out(all, self.settings.held_out);
        if let Some(at) = asked.iter().position(|&row| Some(row) == first) {
            let behind = (1..all).map(|i| (asked[at] + i) % all).find(|row| !asked.contains(row));
            asked[at] = behind.unwrap_or(asked[at]);
        }
        let mut rows: Vec<usize> = (0..all).filter(there).collect();
        let missing = asked.len().saturating_sub(rows.len());
        rows.extend(asked.into_iter().filter(|row| !there(row)).take(missing));
        rows.sort_unstable();
        rows
    }

    /// Name of a run, for people.
    pub fn name(&self, unit: Unit) -> String {
        let name = &self.table.rows[unit.row].name;
        if unit.check { format!("{name} (check)") } else { name.clone() }
    }

    /// Folder of a run.
    pub fn folder_of(&self, unit: Unit) -> PathBuf {
        self.folder.join(if unit.check { "checks" } else { "runs" }).join(&self.table.rows[unit.row].name)
    }

    /// What a run would be made from now.
    pub fn made_from(&self, unit: Unit) -> MadeFrom {
        self.files.of_run(&self.settings, &self.table, &self.table.rows[unit.row], unit.check)
    }

    /// What a run's folder says.
    ///
    /// # Errors
    /// [`Error::File`] for a record that is damaged.
    pub fn state(&self, unit: Unit) -> Result<State> {
        record::state(&self.folder_of(unit), &self.made_from(unit))
    }

    /// The finished runs but this one, nearest first.
    fn sisters(&self, unit: Unit) -> Result<Vec<Sister>> {
        let mut sisters = Vec::new();
        for row in (0..self.table.rows.len()).filter(|&row| row != unit.row) {
            let other = Unit { row, check: false };
            if let State::Done(record) = self.state(other)? {
                let words =
                    |row: usize| self.table.rows[row].values.iter().filter(|v| table::number(v).is_none());
                sisters.push(Sister {
                    record: *record,
                    case: self.folder_of(other).join("case"),
                    offset: cycle::offset(&self.places[unit.row], &self.places[row]),
                    same_words: words(row).eq(words(unit.row)),
                });
            }
        }
        start::nearest_first(&mut sisters);
        Ok(sisters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    #[test]
    fn a_campaign_in_its_case_is_refused() {
        let dir = fixtures::folder(&[("study/campaign.toml", "case = \"..\"\nsolver = [\"icoFoam\"]\n")]);
        let opened = Campaign::open(&dir.path().join("study"), &mut fixtures::tools());
        let message = opened.err().expect("it was opened").to_string();
        assert!(message.contains("study: lies in the case"), "{message}");
    }

    #[test]
    fn checks_that_are_there_count_though_rows_are_added() {
        let dir = tempfile::tempdir().unwrap();
        let settings = "case = \"c\"\nsolver = [\"icoFoam\"]\nheld_out = 0.1\n";
        let mut campaign = Campaign {
            folder: dir.path().to_path_buf(),
            settings: toml::from_str(settings).unwrap(),
            table: Table { parameters: vec!["u".into()], rows: Vec::new() },
            source: Source::default(),
            files: MadeFrom::default(),
            places: Vec::new(),
        };
        campaign.places = (0..3).map(|i| vec![f64::from(i) / 2.0]).collect();
        campaign.table.rows = vec![Row { name: "a".into(), values: Vec::new() }; 3];
        assert_eq!(campaign.checks(), [2], "the first run is the one in the middle");
        campaign.places.clear();
        let mut checks = |rows: usize| {
            let row = |i: usize| Row { name: format!("r{i}"), values: vec![i.to_string()] };
            campaign.table.rows = (0..rows).map(row).collect();
            campaign.checks()
        };
        assert_eq!((checks(7), checks(8)), (vec![3], vec![4]));
        fixtures::write(dir.path(), &[("checks/r3/done", "")]);
        assert_eq!((checks(7), checks(8), checks(17)), (vec![3], vec![3], vec![3, 4]));
    }
}
