//! A campaign made of a case: its three files.

use super::case::{PARAMETERS, Source, parameters};
use super::one::prepare;
use super::quantities::{Entries, largest, quantities};
use super::sampling::{Method, Parameter, sample};
use super::survey::{beside, check_uses, commands, texts};
use super::{check_apart, settings, table};
use crate::check::{self, Case, Plan};
use crate::generate::openfoam::{plain_path, scratch};
use crate::generate::process::Surroundings;
use crate::user_case::{entry, keywords, times};
use m4gn_base::{Error, Result, files, refuse};
use m4gn_report::number;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Wall time of the solver in a check, s, as in `m4gn check`.
const SECONDS: u64 = 6;
/// Longest time for a program that makes its mesh, s.
const MESH_SECONDS: u64 = 60;
/// What the commented entries of the surrogate are where a check suggests no other.
const ENTRIES: &str = "dmd { snapshotInterval 0.05; }";

/// What a campaign is to be made of.
#[derive(Clone, Debug)]
pub struct Request {
    /// The case.
    pub case: PathBuf,
    /// Folder of the campaign.
    pub out: PathBuf,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// How their values are chosen; none: as [`sample`] says.
    pub method: Option<Method>,
    /// Runs, or values of each range in a grid.
    pub count: usize,
    /// Of the draw.
    pub seed: u64,
    /// Ranks of the solver; none: as the case's own script has it.
    pub ranks: Option<usize>,
}

/// What was found and made.
#[derive(Clone, Debug)]
pub struct Found {
    /// Runs.
    pub runs: usize,
    /// What the user should know or look at.
    pub notes: Vec<String>,
}

/// Makes the campaign's folder and its files, and the case's [`PARAMETERS`] where it has none.
///
/// # Errors
/// [`Error::File`] where there is a campaign already, and for what the case lacks; [`Error::Input`] for a parameter that no file uses. Nothing is
/// written then, and none of the files stays where one cannot be written.
pub fn init(request: &Request, tools: &Surroundings) -> Result<Found> {
    let (case, out) = (plain_path(&request.case)?, plain_path(&request.out)?);
    let file = out.join(settings::FILE);
    for there in [&file, &out.join(table::FILE)] {
        refuse(
            there.exists(),
            |m| Error::file(there, m),
            || "is there already: expected a folder without a campaign; edit that file, or choose another folder",
        )?;
    }
    check_apart(&out, &case)?;
    refuse(
        request.parameters.is_empty(),
        Error::Input,
        || "expected --parameter NAME=LOW:HIGH or NAME=VALUE,VALUE,..., at least one",
    )?;
    let table = sample(&request.parameters, request.method, request.count, request.seed)?;
    let scratch = scratch()?;
    let read = Source::read(&case, scratch.path(), &parameters(&table, &table.rows[0]), None, tools);
    // What lies beside a case may be why it cannot be read
    let unread = Source { folder: case.clone(), ..Source::default() };
    let texts = texts(read.as_ref().unwrap_or(&unread))?;
    let beside = beside(&case, &texts)?;
    let source = read.map_err(|e| match (e, &beside) {
        (Error::File { path, message }, Some(note)) => Error::file(path, format!("{message}; {note}")),
        (e, _) => e,
    })?;
    let alone = check_uses(&source, &request.parameters, &texts)?;
    let mut notes: Vec<String> = beside.into_iter().collect();
    if !alone.is_empty() {
        notes.push(format!(
            "{} uses a parameter and does not include {PARAMETERS} itself: unless a file that it includes does, add #include \"<system>/simulationParameters\"",
            alone.join(", ")
        ));
    }
    let control = scratch.path().join("system/controlDict");
    notes.extend(other_start(&source, entry(scratch.path(), &control, "startFrom", tools)?.as_deref())?);
    let shared = case.join(PARAMETERS);
    check_shared(&shared, &request.parameters, scratch.path(), tools)?;
    let commands = commands(&source, &request.parameters);
    let ranks = match (request.ranks, commands.parallel) {
        (None, false) => 1,
        (ranks, _) => decomposed(&source, ranks, scratch.path(), tools)?,
    };
    if !commands.unknown.is_empty() {
        notes.push(format!(
            "Allrun also has: {}; where a run needs it, add it to prepare in {}",
            commands.unknown.join(" | "),
            settings::FILE
        ));
    }
    let entries = Entries {
        value: &|path| entry(scratch.path(), &control, path, tools).ok().flatten(),
        keywords: &|path| keywords(scratch.path(), &control, path, tools),
    };
    let (quantities, known) = quantities(&source.functions, &entries)?;
    if !known {
        notes.push(format!(
            "no quantity is known of this case: write at least one [[quantity]] into {}",
            settings::FILE
        ));
    }
    let of_averages = |name: &str, usual: f64| largest(&source.functions, &entries, name, usual);
    let known_when = (of_averages("minTime", 0.0).max(0.0), of_averages("confidence", 0.95));
    let mut text = text(&source, &commands.prepare, ranks, &request.parameters, known_when, &quantities);
    let (found, suggested) = checked(&source, &text, &parameters(&table, &table.rows[0]), tools)?;
    notes.push(found);
    if let Some(entries) = suggested {
        text = text.replace(ENTRIES, &entries);
    }

    std::fs::create_dir_all(&out).map_err(Error::cannot("made", &out))?;
    let mut all = vec![(out.join(table::FILE), table.text()?), (file, text)];
    if !shared.exists() {
        notes.push(format!(
            "{} is written, with the values of {}, so that the case runs by itself",
            shared.display(),
            table.rows[0].name
        ));
        all.push((shared, parameters(&table, &table.rows[0])));
    }
    for (i, (path, text)) in all.iter().enumerate() {
        files::write_whole(path, text.as_bytes()).inspect_err(|_| {
            // One of them alone, as a full disk leaves it, would be taken for a campaign
            for (path, _) in &all[..i] {
                let _ = std::fs::remove_file(path);
            }
        })?;
    }
    Ok(Found { runs: table.rows.len(), notes })
}

/// What is said of a case whose own run starts from another time than those of a campaign. `from`: its `startFrom`.
fn other_start(source: &Source, from: Option<&str>) -> Result<Option<String>> {
    let all = times(&source.folder)?;
    let from = from.unwrap_or("latestTime");
    let own = match from {
        "startTime" => None,
        "firstTime" => all.first(),
        _ => all.last(),
    };
    let start = source.start;
    Ok(own.filter(|(_, time)| *time != start).map(|(name, _)| {
        format!(
            "the case starts from time {name} (startFrom {from}), its runs in a campaign from startTime {start}: where they are to start from {name}, \
             set startTime {name}"
        )
    }))
}

/// What `m4gn check` finds of the first run, in short, and the entries of the dmd surrogate that it suggests.
fn checked(
    source: &Source,
    text: &str,
    parameters: &str,
    tools: &Surroundings,
) -> Result<(String, Option<String>)> {
    let scratch = scratch()?;
    let settings: settings::Settings = toml::from_str(text).map_err(|e| Error::Internal(e.to_string()))?;
    let copy = scratch.path().join(source.folder.file_name().unwrap_or("case".as_ref()));
    let quick = Surroundings { timeout: Duration::from_secs(MESH_SECONDS), ..tools.clone() };
    let made = source
        .copy(&copy, &settings, parameters)
        .and_then(|()| prepare(&settings, &copy, source.start, &quick));
    let plan = Plan {
        case: Case::Folder(copy.clone()),
        model: None,
        config: None,
        seconds: SECONDS,
        stop: tools.stop,
    };
    let found = match made.and_then(|()| check::run(&plan)) {
        Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
        found => found,
    };
    let words =
        |text: String| text.replace(&copy.display().to_string(), &source.folder.display().to_string());
    let first = match &found {
        Err(e) => {
            // A program's log is gone with the copy
            let is_log =
                |path: &Path| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("log."));
            let why = match e {
                Error::File { path, message } if is_log(path) => message.clone(),
                e => e.to_string(),
            };
            let why = words(why).replace(" (--timeout)", "");
            let text = format!(
                "check: the first run was not made: {why}; 'm4gn check' says more of a case with its mesh"
            );
            return Ok((text, None));
        }
        Ok(checked) => &checked.findings[0],
    };
    let step = first.report.a_step().map_or(String::new(), |s| format!("{} s a time step; ", number(s, 2)));
    let suggested = first.report.suggestion().filter(|_| first.why.is_none()).map(|s| s.entries());
    let fits = match &suggested {
        _ if first.why.is_some() => words(first.verdict()),
        None => "fits, but the run has too few time steps for a jump".into(),
        Some(entries) => format!("fits, with {entries}"),
    };
    Ok((format!("check: {step}surrogate = \"dmd\" {fits}"), suggested))
}

/// The case's own file of parameters may have nothing else: runs have another one.
fn check_shared(path: &Path, parameters: &[Parameter], scratch: &Path, tools: &Surroundings) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    tools.run(scratch, &["foamDictionary", "-keywords", &path.display().to_string()])?;
    let log = crate::generate::process::excerpt(&scratch.join("log.foamDictionary"));
    let own = |word: &str| word == "FoamFile" || parameters.iter().any(|p| p.name == word);
    match log.lines().map(str::trim).find(|l| !l.is_empty() && !own(l)) {
        None => Ok(()),
        Some(word) => Err(Error::file(
            path,
            format!(
                "has the entry {word}: expected the campaign's parameters alone, as each run has this file anew; put it into another file"
            ),
        )),
    }
}

/// Ranks of a case that is decomposed.
fn decomposed(source: &Source, wanted: Option<usize>, scratch: &Path, tools: &Surroundings) -> Result<usize> {
    if wanted == Some(1) {
        return Ok(1);
    }
    let path = source.folder.join("system/decomposeParDict");
    refuse(
        !path.is_file(),
        |m| Error::file(&path, m),
        || "is not there: expected it for a solver on several ranks; write it, or give --ranks 1",
    )?;
    let found = entry(scratch, &path, "numberOfSubdomains", tools)?.unwrap_or_default();
    match (found.parse::<usize>(), wanted) {
        (Ok(n), None) if n > 0 => Ok(n),
        (Ok(n), Some(wanted)) if n == wanted => Ok(n),
        (_, wanted) => Err(Error::file(
            &path,
            format!(
                "numberOfSubdomains is {found}: expected {}",
                wanted.map_or("a number".into(), |n| format!("the {n} of --ranks"))
            ),
        )),
    }
}

fn text(
    source: &Source,
    prepare: &[Vec<String>],
    ranks: usize,
    parameters: &[Parameter],
    (min_time, confidence): (f64, f64),
    quantities: &str,
) -> String {
    let prepare = toml::Value::from(prepare.to_vec());
    let solver = toml::Value::from(vec![source.application.clone()]);
    let case = toml::Value::from(source.folder.display().to_string());
    let first = &parameters[0].name;
    format!(
        "# A campaign of m4gn: docs/how-to/run-a-campaign.md. Runs and their parameters are the rows of parameters.csv, which may be edited.

# Each run is a copy of this case with its own {PARAMETERS}
case = {case}
# Commands in the copy before the solver: mesh, first fields
prepare = {prepare}
solver = {solver}
# Above 1: decomposePar, mpirun, reconstructPar
ranks = {ranks}

# How a run starts. \"cold\": from the case's own fields; \"nearest\": from the last state of the nearest finished run; \"auto\": from the limit
# cycles of the finished runs around it, from that state, or cold, whichever has cost the finished runs least
start = \"auto\"
# A parameter that is a velocity, by which the fields of finished runs are scaled
# scale = \"{first}\"
# A surrogate within the runs, with entries of m4gnSurrogate (docs/how-to/choose-snapshots.md)
# surrogate = \"dmd\"
# surrogate_entries = \"{ENTRIES}\"

# A run ends when all quantities with a tolerance are known, not before min_time, and at end_time (the case's endTime) at the latest
stop = true
min_time = {min_time:?}
# end_time = {}
confidence = {confidence:?}
# Share of the runs that are made a second time as a check: cold, without a surrogate, to end_time
held_out = 0.1

# Runs at once, and the longest time of a program, s
jobs = 1
time_limit = 86400

# Quantities, results of the case's function objects. `tolerance` is in the quantity's unit, `relative` over it (docs/how-to/know-when-a-mean-is-known.md)
{quantities}",
        source.end
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_from_another_time_is_told() {
        let dir = crate::fixtures::folder(&[("0/U", ""), ("500/U", ""), ("constant/g", "")]);
        let source = Source { folder: dir.path().to_path_buf(), ..Source::default() };
        let told = |from: Option<&str>| other_start(&source, from).unwrap();
        assert_eq!((told(Some("startTime")), told(Some("firstTime"))), (None, None));
        for from in [Some("latestTime"), None] {
            let note = told(from).unwrap();
            assert!(
                note.contains("from time 500 (startFrom latestTime)") && note.ends_with("set startTime 500"),
                "{note}"
            );
        }
    }

    #[test]
    fn what_is_written_can_be_read() {
        let source =
            Source { folder: "/a/\"case\"".into(), application: "icoFoam".into(), ..Source::default() };
        let prepare = [vec!["blockMesh".to_string(), "-dict".to_string()]];
        let quantities = "[[quantity]]\nname = \"Cd\"\nfunction_object = \"forces\"\nresult = \"Cd\"\n";
        let text = text(&source, &prepare, 2, &["Uin=1:2".parse().unwrap()], (1e30, 0.9), quantities);
        let read: settings::Settings = toml::from_str(&text).unwrap();
        assert_eq!((&read.case, &read.prepare[..], read.ranks), (&source.folder, &prepare[..], 2));
        assert_eq!((read.quantity.len(), read.min_time, read.confidence), (1, 1e30, 0.9));
    }
}
