//! One run, from a copy of the case to the file that says that it is done.

use super::case::{self, AVERAGES, last_time};
use super::plan::Plan;
use super::record::{self, Cost, DONE, FAILED, Failure, Figure, Record, State};
use super::settings::{Settings, Statistic};
use super::start::{self, Start};
use super::{Campaign, Unit, cycle, source_of};
use crate::compare::surrogate;
use crate::generate::case::program;
use crate::generate::process::{Surroundings, clear, ends, excerpt, full};
use crate::user_case::{averages, has_regions, log, names, times};
use m4gn_base::{Error, Result, files, refuse_any};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A run that is there.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What it left.
    pub record: Record,
    /// Whether it was there before.
    pub before: bool,
}

/// Makes a run, unless it is there. One at a time has its folder: another one waits, and finds it done. `anew`: a run that was made from other
/// contents is made again. `say` is told whom it waits for.
///
/// # Errors
/// [`Error::File`] naming what a finished run was made from that is another now; what fails, which is kept as the file `failed`;
/// [`Error::Interrupted`] when the user stops. No half run counts as one.
pub fn one(
    campaign: &Campaign,
    unit: Unit,
    anew: bool,
    tools: &Surroundings,
    say: &mut dyn FnMut(&str),
) -> Result<Outcome> {
    campaign.check()?;
    let _lock = tools.take_turn(&campaign.folder_of(unit), say)?;
    one_claimed(campaign, unit, anew, tools)
}

/// As [`one`], where the program that started this one has claimed the run's folder.
///
/// # Errors
/// As [`one`].
pub fn one_claimed(campaign: &Campaign, unit: Unit, anew: bool, tools: &Surroundings) -> Result<Outcome> {
    let folder = campaign.folder_of(unit);
    match record::state(&folder, &campaign.made_from(unit))? {
        State::Done(record) => return Ok(Outcome { record: *record, before: true }),
        State::Stale(what) if !anew => return Err(stale(&folder, &what)),
        _ => {}
    }
    for name in [DONE, FAILED] {
        let path = folder.join(name);
        if path.exists() {
            fs::remove_file(&path).map_err(Error::cannot("removed", &path))?;
        }
    }
    let mut all = Clock::new()?;
    let made = make(campaign, unit, &folder.join("case"), tools, (Instant::now(), &mut Clock::new()?), None);
    match made {
        Ok(record) => {
            record::write(&folder.join(DONE), &record)?;
            Ok(Outcome { record, before: false })
        }
        Err(Error::Interrupted(e)) => Err(Error::Interrupted(e)),
        Err(e) => {
            let (message, made_from) = (e.to_string(), campaign.made_from(unit));
            let failure = Failure { message, processor: all.lap().unwrap_or(0.0), made_from };
            // Where it cannot be kept the run is missing, and made again
            record::write(&folder.join(FAILED), &failure)
                .map_err(|kept| Error::Input(format!("{e}; {kept}")))?;
            Err(e)
        }
    }
}

/// What is said of a run that was made from other contents.
pub(super) fn stale(folder: &Path, what: &str) -> Error {
    Error::file(
        folder,
        format!(
            "was made with another content of: {what}. Expected the same content; take back the change, or make the run again with --anew"
        ),
    )
}

/// `failed`: the kind of a start from a sister's fields in place of which it is made cold, why that has no answer, and what it took.
fn make(
    campaign: &Campaign,
    unit: Unit,
    case: &Path,
    tools: &Surroundings,
    (begin, clock): (Instant, &mut Clock),
    failed: Option<(String, String, f64)>,
) -> Result<Record> {
    let (settings, row) = (&campaign.settings, &campaign.table.rows[unit.row]);
    let source = source_of(settings, &campaign.table, row, Some(&campaign.source), &campaign.folder, tools)?;
    clear(case)?;
    let limit = |done: Result<()>| match done {
        Err(Error::File { path, message }) => {
            Err(Error::file(path, message.replace("--timeout", "time_limit of campaign.toml")))
        }
        done => done,
    };
    let place = settings.scale.as_ref().and_then(|s| campaign.table.parameters.iter().position(|p| p == s));
    let scale = place.map(|i| (campaign.table.parameters[i].as_str(), row.values[i].as_str()));
    let sisters = if unit.check { Vec::new() } else { campaign.sisters(unit)? };
    let asked = if unit.check { Start::Cold } else { settings.start };
    let plan = Plan::new(if failed.is_some() { Start::Cold } else { asked }, &sisters);
    let parameters = case::parameters(&campaign.table, row);
    source.copy(case, settings, &parameters)?;
    // The record says what was copied
    if let Some(what) = campaign.source.digests()?.differs(&campaign.files) {
        let folder = &campaign.source.folder;
        return Err(Error::file(
            folder,
            format!("was changed since this program began: {what}. Give the command again"),
        ));
    }
    limit(prepare(settings, case, source.start, tools))?;
    let source = source.prepared(case, &parameters, tools)?;
    source.control(case, settings, unit.check)?;
    let mut cost = Cost { prepare: clock.lap()?, ..Cost::default() };

    let mesh = if asked == Start::Cold { String::new() } else { start::mesh(case)? };
    let mut started = start::make(&plan, (case, &mesh), &sisters, scale, tools)?;
    if let Some((kind, why, seconds)) = failed {
        (started.tried, started.note, cost.tried) = (Some(kind), Some(why), seconds);
    }
    let duration = settings.end_time.unwrap_or(source.end) - source.start;
    let stored = plan.stored(&mesh, &sisters, scale);
    let stored = stored.map(|(every, kept)| (cycle::dividing(every, duration), kept));
    if let Some(stored) = stored {
        source.store(case, stored, None)?;
    }
    let mut solver = settings.solver.clone();
    let regions: &[&str] = if has_regions(case) { &["-allRegions"] } else { &[] };
    if settings.ranks > 1 {
        limit(tools.run(case, &[&["decomposePar", "-force"][..], regions].concat()))?;
        let mpirun = ["mpirun".into(), "-np".into(), settings.ranks.to_string()];
        solver = mpirun.into_iter().chain(solver).chain(["-parallel".to_string()]).collect();
    }
    cost.start = clock.lap()?;
    let log = case.join(format!("log.{}", program(&solver)));
    let solved = limit(tools.run(case, &solver));
    let (quantities, period) = match solved.and_then(|()| figures(campaign, case, &log)) {
        Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
        // Its own fields may serve where a sister's do not
        Err(e) if started.sister.is_some() => {
            let why = format!("from {started} there is no answer: {e}");
            let took = cost.prepare + cost.start + clock.lap()?;
            return make(campaign, unit, case, tools, (begin, clock), Some((started.kind, why, took)));
        }
        found => found?,
    };
    cost.solver = clock.lap()?;
    let end_time = ended(case, source.start, &log)?.1;
    let mut behind =
        plan.behind(&mesh, &sisters, period, end_time - source.start).filter(|_| stored.is_none());
    if let Some(stored) = behind {
        let kept = log.with_extension("answer");
        let moved = |from: &Path, to: &Path| fs::rename(from, to).map_err(Error::cannot("renamed", from));
        moved(&log, &kept)?;
        source.store(case, stored, Some(end_time))?;
        match limit(tools.run(case, &solver)) {
            Ok(()) => {}
            Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
            // The answer is there, and these states are for its sisters
            Err(e) => {
                forget_behind(case, end_time)?;
                behind = None;
                started.noted(format!("its cycle cannot be taken, as it does not go on: {e}"));
            }
        }
        moved(&log, &case.join("log.states"))?;
        moved(&kept, &log)?;
    }
    let last = ended(case, source.start, &log)?.0;
    if settings.ranks > 1 {
        let last: &[&str] = if stored.or(behind).is_some() { &[] } else { &["-latestTime"] };
        match limit(tools.run(case, &[&["reconstructPar"], regions, last].concat())) {
            Ok(()) => {}
            Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
            // The answer is there, as above; a mesh that is refined in the run has no whole state
            Err(e) => {
                forget_behind(case, source.start)?;
                started.noted(format!("its last state cannot be taken: {e}"));
            }
        }
        for folder in of_ranks(case)? {
            let _ = fs::remove_dir_all(folder);
        }
    }
    cost.states = clock.lap()?;
    let state = case.join(&last);
    if state.is_dir() {
        whole(&state)?;
    }
    if let Some(found) = surrogate::read(case)? {
        cost.surrogate = ["surrogate_seconds", "hand_over_seconds"]
            .iter()
            .filter_map(|key| found.summary[*key].as_f64())
            .sum();
    }
    cost.wall = begin.elapsed().as_secs_f64();
    Ok(Record {
        case_name: row.name.clone(),
        parameters: campaign.table.parameters.iter().cloned().zip(row.values.iter().cloned()).collect(),
        start: started,
        quantities,
        end_time,
        last,
        period,
        mesh,
        cost,
        made_from: campaign.made_from(unit),
    })
}

/// Folders of the ranks of a run: each of one rank, or one of all (collated).
fn of_ranks(case: &Path) -> Result<Vec<PathBuf>> {
    let ranks = names(case)?.into_iter().filter(|name| name.starts_with("processor"));
    Ok(ranks.map(|name| case.join(name)).filter(|path| path.is_dir()).collect())
}

/// Runs the commands of `prepare` in a copy of the case, whose runs start at `start` s.
///
/// # Errors
/// What a command says that fails, or one of a script, which itself goes on; as [`clear_ranks`].
pub(super) fn prepare(settings: &Settings, case: &Path, start: f64, tools: &Surroundings) -> Result<()> {
    settings.prepare.iter().try_for_each(|command| tools.run(case, command))?;
    for log in names(case)?.iter().filter(|name| name.starts_with("log.")).map(|name| case.join(name)) {
        refuse_any(
            log::fatal(&excerpt(&log)),
            |m| Error::file(&log, m),
            |(text, _)| {
                format!(
                    "a program of prepare failed: {text}; where runs can do without it, have the script remove this log, or send what that program \
                     writes, errors too (2>&1), elsewhere"
                )
            },
        )?;
    }
    clear_ranks(case)?;
    // Those of a steady run, say, are none of this one's
    forget_behind(case, start)
}

/// Removes the folders of ranks that a case's own script has left: the whole case is run, or decomposed anew. Refuses a mesh that is in them alone,
/// as snappyHexMesh makes it on several ranks; OpenFOAM's programs then remove the places of its cells in that of the whole case.
fn clear_ranks(case: &Path) -> Result<()> {
    for folder in of_ranks(case)? {
        let mesh = folder.join("constant/polyMesh");
        let has =
            |name: &str| names(&mesh).is_ok_and(|all| all.iter().any(|n| n.trim_end_matches(".gz") == name));
        if has("faces") && !has("cellProcAddressing") {
            return Err(Error::file(
                &mesh,
                "is a mesh that prepare has made on several ranks, and no part of the whole case's, which runs are made with: expected the mesh of \
                 the whole case; have its programs run in serial (runApplication snappyHexMesh), or reconstructParMesh -constant behind them in prepare",
            ));
        }
        fs::remove_dir_all(&folder).map_err(Error::cannot("removed", &folder))?;
    }
    Ok(())
}

/// Name and value of the last time of a run, which is in the folders of its ranks until it is reconstructed.
fn ended(case: &Path, start: f64, log: &Path) -> Result<(String, f64)> {
    last_time(of_ranks(case)?.first().map_or(case, PathBuf::as_path), start)?.ok_or_else(|| {
        Error::file(log, format!("expected fields behind time {start} from the run, found none"))
    })
}

/// Removes the times of a run's case that are behind this one, s.
fn forget_behind(case: &Path, end: f64) -> Result<()> {
    for folder in of_ranks(case)?.into_iter().chain([case.to_path_buf()]) {
        for (name, _) in times(&folder)?.into_iter().filter(|(_, time)| *time > end) {
            let path = folder.join(name);
            fs::remove_dir_all(&path).map_err(Error::cannot("removed", &path))?;
        }
    }
    Ok(())
}

/// Refuses a state with a file that is cut off: solvers do not look whether the disk has taken what they write.
fn whole(state: &Path) -> Result<()> {
    for path in names(state)?.iter().map(|name| state.join(name)).filter(|p| p.is_file()) {
        // The name of the format is behind a banner
        let text = ends(&path, 4096);
        if text.is_empty() || text.contains("FoamFile") && !text.trim_end().ends_with("//") {
            let hint = full(state);
            return Err(Error::file(
                &path,
                format!("is cut off: expected the line that ends a file of OpenFOAM{hint}"),
            ));
        }
    }
    Ok(())
}

/// What the last check of our m4gnAverages said: the figures, and the longest period of those that oscillate.
fn figures(campaign: &Campaign, case: &Path, log: &Path) -> Result<(BTreeMap<String, Figure>, Option<f64>)> {
    let (path, all) = averages(case, AVERAGES, log)?;
    let (mut figures, mut period) = (BTreeMap::new(), None::<f64>);
    for q in &campaign.settings.quantity {
        let of = |key: &str| all[&q.name][key].as_f64().filter(|v| v.is_finite());
        let found = match q.statistic {
            Statistic::Mean => of("mean").map(|v| (v, of("half_width"))),
            Statistic::Rms => of("rms").map(|v| (v, of("rms_half_width"))),
        };
        let Some((value, half_width)) = found else {
            return Err(Error::Numerical(format!(
                "{} has no finite figure of {} in {}: {} published {} finite values; expected at least 16, of a run that does not diverge. Probes publish \
                 none; with writeControl writeTime a function object publishes once, as a run writes its last state alone: give it writeControl timeStep",
                log.display(),
                q.name,
                path.display(),
                q.function_object,
                all[&q.name]["rows"]
            )));
        };
        let own = of("frequency").filter(|f| *f > 0.0).map(|f| 1.0 / f);
        period = period.into_iter().chain(own).max_by(f64::total_cmp);
        let asked = q.tolerance.or(q.relative).is_some();
        figures.insert(
            q.name.clone(),
            Figure { value, half_width, known: asked.then(|| all[&q.name]["settled"] == true) },
        );
    }
    Ok((figures, period))
}

/// Processor time of this process and of all that it has waited for.
struct Clock(f64);

impl Clock {
    fn new() -> Result<Self> {
        processor_seconds().map(Clock)
    }

    /// Since the last one, s.
    fn lap(&mut self) -> Result<f64> {
        let now = processor_seconds()?;
        let since = now - self.0;
        self.0 = now;
        Ok((since * 100.0).round() / 100.0)
    }
}

/// `utime`, `stime`, `cutime` and `cstime` of proc(5), which are in hundredths of a second.
fn processor_seconds() -> Result<f64> {
    let path = Path::new("/proc/self/stat");
    let text = files::read_text(path).map_err(Error::cannot("read", path))?;
    // The name of the program, in brackets, may have blanks.
    let words = text.rsplit(')').next().unwrap_or("").split_whitespace();
    Ok(words.skip(11).take(4).filter_map(|w| w.parse::<f64>().ok()).sum::<f64>() / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use m4gn_samples::fails;

    #[test]
    fn a_state_that_is_cut_off_is_none() {
        let text = " ".repeat(600) + "FoamFile { object U; }\ninternalField uniform 0;\n// *** //\n\n";
        let dir = fixtures::folder(&[("U", &text), ("note", "not of OpenFOAM")]);
        whole(dir.path()).unwrap();
        for cut in [0, 640] {
            fixtures::write(dir.path(), &[("p", &text[..cut])]);
            fails(whole(dir.path()), &["p: is cut off: expected the line"]);
        }
    }

    #[test]
    fn a_mesh_that_ranks_alone_have_is_refused() {
        let dir = fixtures::folder(&[
            ("constant/polyMesh/faces", ""),
            ("processor0/constant/polyMesh/faces", ""),
            ("processor0/constant/polyMesh/cellProcAddressing.gz", ""),
        ]);
        clear_ranks(dir.path()).unwrap();
        assert!(
            !dir.path().join("processor0").exists() && dir.path().join("constant/polyMesh/faces").exists()
        );
        fixtures::write(dir.path(), &[("processor0/constant/polyMesh/faces.gz", "")]);
        fails(
            clear_ranks(dir.path()),
            &["processor0/constant/polyMesh: is a mesh that prepare has made on several ranks"],
        );
    }

    #[test]
    fn a_program_that_fails_within_a_script_is_told() {
        let script = |text: &str| {
            let dir = fixtures::folder(&[("Allrun.pre", text), ("0/U", ""), ("0.5/U", "")]);
            let settings = "case = \"c\"\nsolver = [\"icoFoam\"]\nprepare = [[\"sh\", \"Allrun.pre\"]]\n";
            let done = prepare(&toml::from_str(settings).unwrap(), dir.path(), 0.0, &fixtures::tools());
            (done.map_err(|e| e.to_string()), times(dir.path()).unwrap().len())
        };
        assert_eq!(script("echo End > log.blockMesh\n"), (Ok(()), 1));
        let fatal = "echo '--> FOAM FATAL ERROR: ' > log.snappyHexMesh\necho 'no patch' >> log.snappyHexMesh\necho End > log.checkMesh\n";
        fails(script(fatal).0, &["log.snappyHexMesh: a program of prepare failed: no patch; where runs"]);
        let tolerated = format!("{fatal}rm log.snappyHexMesh\n");
        assert_eq!(script(&tolerated), (Ok(()), 1));
    }

    #[test]
    fn times_behind_are_forgotten() {
        let dir =
            fixtures::folder(&[("0/U", ""), ("500/U", ""), ("processor0/0.7/U", ""), ("constant/g", "")]);
        forget_behind(dir.path(), 0.5).unwrap();
        assert_eq!(times(dir.path()).unwrap(), [("0".to_string(), 0.0)]);
        assert!(dir.path().join("constant/g").exists() && !dir.path().join("processor0/0.7").exists());
    }

    #[test]
    fn what_programs_take_is_counted() {
        let begin = processor_seconds().unwrap();
        let mut clock = Clock::new().unwrap();
        let busy = "i=0; while [ $i -lt 100000 ]; do i=$((i + 1)); done";
        std::process::Command::new("sh").args(["-c", busy]).status().unwrap();
        let first = clock.lap().unwrap();
        assert!(first > 0.0, "{first}");
        // Nothing counts twice, whatever other tests in this process take meanwhile
        let both = first + clock.lap().unwrap();
        assert!(both <= processor_seconds().unwrap() - begin + 1e-6, "{both}");
    }
}
