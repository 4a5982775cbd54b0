//! All runs that are missing, each in a process of its own, and what there is of a campaign.

use super::order::{self, Known};
use super::record::{FAILED, Record, State};
use super::settings::{FILE, Quantity};
use super::{Campaign, Unit, one, table};
use crate::generate::process::Surroundings;
use crate::generate::queue::in_parallel;
use m4gn_base::{Error, Result, listed, lock, refuse};
use m4gn_report::{Table, number};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// What `m4gn campaign run` is asked for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Order {
    /// Runs at once; none: what `campaign.toml` says.
    pub jobs: Option<usize>,
    /// Part i of n of the runs, i from 1.
    pub shard: Option<(usize, usize)>,
    /// Make runs of other contents again.
    pub anew: bool,
    /// Make runs that failed again.
    pub retry: bool,
}

/// What became of a run.
enum Ended {
    Done(Box<Record>),
    Failed(String),
    /// Another program makes it.
    Held,
}

/// Makes the runs that are missing, spread over the parameters first, then where the finished ones foretell worst. Returns how many are not there in the end, and how many were asked for.
///
/// Each is a process `m4gn campaign one`; runs that another program makes are waited for at the end. `say` is told of each as it ends.
///
/// # Errors
/// [`Error::File`] naming runs that were made from other contents, before anything is run; [`Error::Interrupted`] when the user stops. Runs that
/// fail are told, and the others go on.
pub fn run(
    campaign: &Campaign,
    asked: Order,
    tools: &Surroundings,
    say: &mut dyn FnMut(&str),
) -> Result<(usize, usize)> {
    campaign.check()?;
    let all = shard(campaign.units(), asked.shard)?;
    let (mut missing, mut stale, mut failed) = (Vec::new(), Vec::new(), 0);
    for &unit in &all {
        match campaign.state(unit)? {
            State::Done(_) => {}
            State::Stale(what) if !asked.anew => stale.push((unit, what)),
            State::Failed(why, _) if !asked.retry => {
                failed += 1;
                let file = campaign.folder_of(unit).join(FAILED);
                say(&format!(
                    "{} failed before, and is not made again without --retry or {}: {why}",
                    campaign.name(unit),
                    file.display()
                ));
            }
            _ => missing.push(unit),
        }
    }
    if let Some((first, what)) = stale.first() {
        let names: Vec<String> = stale.iter().take(8).map(|(unit, _)| campaign.name(*unit)).collect();
        let more = if stale.len() > names.len() {
            format!(" and {} more", stale.len() - names.len())
        } else {
            String::new()
        };
        let error = one::stale(&campaign.folder_of(*first), what);
        return Err(Error::Input(format!(
            "{} of {} runs are of other contents ({}{more}), such as {error}",
            stale.len(),
            all.len(),
            names.join(", ")
        )));
    }
    say(&format!(
        "{} of {} runs are there, {} to make",
        all.len() - missing.len() - failed,
        all.len(),
        missing.len()
    ));
    let (mut ended_runs, since) = (0, Instant::now());
    let jobs = asked.jobs.unwrap_or(campaign.settings.jobs);
    let mut held = Vec::new();
    for waits in [false, true] {
        let units = if waits { std::mem::take(&mut held) } else { missing.clone() };
        let (count, pool) =
            (units.len(), Mutex::new(Pool { left: units, begun: BTreeSet::new(), known: BTreeMap::new() }));
        let work = |_| {
            let unit = next(campaign, &mut pool.lock().unwrap_or_else(PoisonError::into_inner))?;
            match made(campaign, unit, asked, waits, tools) {
                Err(Error::Interrupted(_)) => None,
                Err(e) => Some((unit, Ended::Failed(e.to_string()))),
                Ok(ended) => Some((unit, ended)),
            }
        };
        in_parallel((jobs, count), tools, work, |_, (unit, ended)| {
            let text = match ended {
                Ended::Held => return held.push(unit),
                Ended::Done(record) => line(&record),
                Ended::Failed(why) => {
                    failed += 1;
                    format!("failed: {why}")
                }
            };
            ended_runs += 1;
            let (done, count) = (ended_runs, missing.len());
            let left = since.elapsed().as_secs_f64() / done as f64 * (count - done) as f64;
            let left = if count > done { format!("; {} left", duration(left)) } else { String::new() };
            say(&format!("{done}/{count} {}{text}{left}", called(campaign, unit)));
        });
        if tools.stopped() {
            return Err(Error::Interrupted(
                "stopped by the user; the same command goes on with what is missing".into(),
            ));
        }
    }
    Ok((failed, all.len()))
}

/// Runs that are to be made, rows that were begun, and what finished ones say, by their rows: a record is read once.
struct Pool {
    left: Vec<Unit>,
    begun: BTreeSet<usize>,
    known: BTreeMap<usize, Known>,
}

/// Takes the run that is made next: the one that the finished ones foretell worst, else the first that is left.
fn next(campaign: &Campaign, pool: &mut Pool) -> Option<Unit> {
    let left: Vec<usize> = pool.left.iter().filter(|u| !u.check).map(|u| u.row).collect();
    for row in 0..campaign.table.rows.len() {
        if !pool.known.contains_key(&row)
            && let Some(found) = known(campaign, row)
        {
            pool.known.insert(row, found);
        }
    }
    let known: Vec<Known> = pool.known.values().cloned().collect();
    let worst = order::worst(&campaign.places, &left, &pool.begun, &known);
    let at = worst.and_then(|row| pool.left.iter().position(|u| !u.check && u.row == row)).unwrap_or(0);
    let unit = (at < pool.left.len()).then(|| pool.left.remove(at))?;
    if !unit.check {
        pool.begun.insert(unit.row);
    }
    Some(unit)
}

/// What a finished run says of each quantity with a tolerance.
fn known(campaign: &Campaign, row: usize) -> Option<Known> {
    let Ok(State::Done(record)) = campaign.state(Unit { row, check: false }) else { return None };
    let figure = |q: &Quantity| {
        let value = record.quantities.get(&q.name)?.value;
        Some((value, q.tolerance_at(value)?))
    };
    Some(Known { row, figures: campaign.settings.quantity.iter().filter_map(figure).collect() })
}

/// Part i of n in the order of the runs.
fn shard(units: Vec<Unit>, shard: Option<(usize, usize)>) -> Result<Vec<Unit>> {
    let (part, of) = shard.unwrap_or((1, 1));
    refuse(part == 0 || part > of, Error::Input, || {
        format!("--shard {part}/{of}: expected i/n with i from 1 to n")
    })?;
    Ok(units.into_iter().enumerate().filter(|(i, _)| i % of == part - 1).map(|(_, unit)| unit).collect())
}

/// Makes one run in a process of its own. Its folder is claimed here until that has ended: a claim of that process alone would come only when it has
/// read the campaign, and another program would begin the same run before.
fn made(campaign: &Campaign, unit: Unit, asked: Order, waits: bool, tools: &Surroundings) -> Result<Ended> {
    let folder = campaign.folder_of(unit);
    let _lock = match lock::folder(&folder) {
        Ok(lock) => lock,
        Err(_) if waits => tools.take_turn(&folder, &mut |_| {})?,
        // Another program that works there keeps it until it is done
        Err(_) if folder.is_dir() => return Ok(Ended::Held),
        Err(e) => return Err(e),
    };
    // What another program has made of it meanwhile
    match campaign.state(unit)? {
        State::Done(record) => return Ok(Ended::Done(record)),
        State::Failed(why, _) if waits || !asked.retry => return Ok(Ended::Failed(why)),
        _ => {}
    }
    let program =
        std::env::current_exe().map_err(|e| Error::Input(format!("this program is not found: {e}")))?;
    let mut command = vec![
        program.display().to_string(),
        "campaign".into(),
        "one".into(),
        "--claimed".into(),
        campaign.table.rows[unit.row].name.clone(),
    ];
    command.extend(["--store".into(), campaign.folder.display().to_string()]);
    command.extend(unit.check.then(|| "--check".into()));
    command.extend(asked.anew.then(|| "--anew".into()));
    // A program that is stopped here stops its own; its limit is that of each of its programs
    let tools = Surroundings { asks: true, timeout: std::time::Duration::MAX, ..tools.clone() };
    let done = tools.run(&folder, &command);
    match (done, campaign.state(unit)?) {
        (Err(Error::Interrupted(e)), _) => Err(Error::Interrupted(e)),
        (_, State::Done(record)) => Ok(Ended::Done(record)),
        (_, State::Failed(why, _)) => Ok(Ended::Failed(why)),
        (Err(e), _) => Err(e),
        (Ok(()), _) => Err(Error::file(
            &folder,
            format!(
                "is not there: {FILE}, {} or the case was changed meanwhile; expected no change while runs are made",
                table::FILE
            ),
        )),
    }
}

/// A run's name and parameters.
fn called(campaign: &Campaign, unit: Unit) -> String {
    let row = &campaign.table.rows[unit.row];
    let parameters = campaign.table.parameters.iter().zip(&row.values).map(|(p, v)| format!("{p} {v}"));
    format!("{} ({}): ", campaign.name(unit), listed(parameters))
}

/// What there is to say of a run that is done.
pub fn line(record: &Record) -> String {
    let figures = record.quantities.iter().map(|(name, f)| {
        let unknown = if f.known == Some(false) { " (not known)" } else { "" };
        format!("{name} {f}{unknown}")
    });
    let note = record.start.note.as_ref().map_or(String::new(), |n| format!(" ({n})"));
    format!(
        "{}, from {}{note}, to {} s, {} s of processor time",
        listed(figures),
        record.start,
        number(record.end_time, 4),
        number(record.cost.total(), 3)
    )
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A line for each run, and how many are there.
///
/// # Errors
/// [`Error::File`] for a record that is damaged.
pub fn status(campaign: &Campaign) -> Result<(Table, usize)> {
    let mut table = Table::new(["run", "state", "start", "why", "end [s]", "processor [s]"]);
    let mut there = 0;
    for unit in campaign.units() {
        let folder = campaign.folder_of(unit);
        let (state, record) = match (campaign.state(unit)?, holder(&folder)) {
            (State::Done(record), _) => ("done".into(), Some(record)),
            (_, Some(who)) => (format!("is made by {who}"), None),
            // Its case is of a run that was stopped, or that failed with other contents
            (State::Missing, None) if folder.join("case").exists() => {
                ("to make anew, from its begin".into(), None)
            }
            (State::Missing, None) => ("to make".into(), None),
            (State::Failed(why, _), None) => (format!("failed: {why}"), None),
            (State::Stale(what), None) => (format!("of another content of: {what}"), None),
        };
        there += usize::from(record.is_some());
        let of = |f: &dyn Fn(&Record) -> String| record.as_deref().map_or(String::new(), f);
        table.row([
            campaign.name(unit),
            state,
            of(&|r| r.start.to_string()),
            of(&|r| r.start.note.clone().unwrap_or_default()),
            of(&|r| number(r.end_time, 4)),
            of(&|r| number(r.cost.total(), 3)),
        ]);
    }
    Ok((table, there))
}

/// Who makes a run at present, without its command.
fn holder(folder: &Path) -> Option<String> {
    lock::holder(folder).map(|who| who.split(" (").next().unwrap_or_default().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_the_runs() {
        let all: Vec<Unit> = (0..7).map(|row| Unit { row, check: false }).collect();
        let part = |i: usize| shard(all.clone(), Some((i, 3))).unwrap();
        assert_eq!(part(2).iter().map(|u| u.row).collect::<Vec<_>>(), [1, 4]);
        assert_eq!((1..=3).map(|i| part(i).len()).sum::<usize>(), 7);
        assert_eq!(shard(all.clone(), None).unwrap(), all);
        assert!(shard(all.clone(), Some((0, 3))).is_err() && shard(all, Some((4, 3))).is_err());
    }

    #[test]
    fn times_are_told_in_units_that_fit() {
        assert_eq!([9.6, 125.0, 9000.0].map(duration), ["10 s", "2 min", "2.5 h"]);
    }
}
