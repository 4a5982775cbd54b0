//! The jumps of a finished run, recomputed by its solver: from the last time that is written up to a jump's begin to those that are written in it,
//! in copies of the case. What the run has there is compared with what the solver makes, by errors that are those of the run's own control: root
//! mean squares over cells and solved components, over the largest variation of the field so far.

mod jumps;
mod report;
mod solver;

pub use jumps::Jump;
pub use report::{Report, Verified};

use crate::foam_case::FoamCase;
use crate::generate::openfoam::{lies_in, plain_path, scratch, surroundings};
use crate::generate::queue::in_parallel;
use crate::user_case::{Copy, LEFT_OUT, copy_all, is_collated, names};
use jumps::Stretch;
use m4gn_base::{Error, Result, refuse};
use solver::Run;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU8;
use std::time::Duration;

/// What to verify and how.
#[derive(Debug)]
pub struct Plan {
    /// Folder of the run.
    pub case: PathBuf,
    /// Largest error of a jump, in place of the run's own tolerance.
    pub tolerance: Option<f64>,
    /// Folder that is made, with the case and the solver's own fields where the run has a surrogate's.
    pub keep: Option<PathBuf>,
    /// Jumps at once.
    pub jobs: usize,
    /// Longest time of a program.
    pub timeout: Duration,
    /// The user's wish to stop.
    pub stop: &'static AtomicU8,
}

/// A field at the end of a stretch, root mean squares in its unit.
struct Figures {
    error: f64,
    change: f64,
    variation: f64,
}

/// Recomputes the jumps of a run. `progress(done, of)` is called as each ends.
///
/// # Errors
/// [`Error::Input`] and [`Error::File`] for a folder that is no finished run with jumps, or that cannot be copied; [`Error::Interrupted`].
pub fn run(plan: &Plan, mut progress: impl FnMut(usize, usize)) -> Result<Report> {
    let case = plain_path(&plan.case)?;
    let tools = surroundings(plan.stop, plan.timeout)?;
    let mut run = FoamCase::open(&case)?;
    let (name, decisions) = jumps::decisions(&case)?;
    let mut all: Vec<Verified> =
        jumps::jumps(&decisions)?.into_iter().map(|jump| Verified { jump, ..Verified::default() }).collect();
    let ranks = run.description().processors;
    if is_collated(&case) {
        return Err(Error::file(
            &case,
            "its ranks' times are in one folder (collated): run reconstructPar before",
        ));
    }
    let solver = Run { case: &case, name: &name, ranks, tools: &tools };
    let times = solver.times()?;
    let values: Vec<f64> = times.iter().map(|t| t.1).collect();
    let stretches = stretches(&mut all, &values);
    let room = scratch()?;
    let room_path = plain_path(room.path())?;
    let kept = plan.keep.as_deref().map(|keep| CaseCopy::new(&case, keep)).transpose()?;

    let mut figures: BTreeMap<usize, BTreeMap<String, Figures>> = BTreeMap::new();
    let mut done = 0;
    let places = |s: &Stretch| [s.from].iter().chain(&s.to).map(|i| &times[*i]).collect::<Vec<_>>();
    let beside = |i: usize| room_path.join(i.to_string());
    let work = |i: usize| {
        let (number, stretch) = &stretches[i];
        let copy = solver.recompute(&places(stretch), &beside(*number));
        (!matches!(copy, Err(Error::Interrupted(_)))).then_some(copy)
    };
    in_parallel((plan.jobs, stretches.len()), &tools, work, |i, copy| {
        let (number, stretch) = &stretches[i];
        let ends = [stretch.from, stretch.to[stretch.to.len() - 1]].map(|i| values[i]);
        let compared = copy.and_then(|copy| {
            let found = compare(&mut run, &copy, &all[*number].jump, ends)?;
            kept.as_ref().map_or(Ok(()), |kept| solver::replace(&copy, &places(stretch), kept.path()))?;
            Ok(found)
        });
        match compared {
            Ok(found) => drop(figures.insert(*number, found)),
            Err(e) => (all[*number].why, all[*number].failed) = (Some(e.to_string()), true),
        }
        let _ = std::fs::remove_dir_all(beside(*number));
        done += 1;
        progress(done, stretches.len());
    });
    refuse(tools.stopped(), Error::Interrupted, || "stopped by the user")?;
    judge(&mut all, &figures, plan.tolerance);
    if let Some(kept) = kept {
        kept.put()?;
    }
    let description = run.description();
    Ok(Report {
        case: description.path.clone(),
        application: description.application.clone(),
        jumps: all,
        capped: jumps::capped(&decisions),
    })
}

/// What of each jump is recomputed, with the jump's number.
fn stretches(all: &mut [Verified], times: &[f64]) -> Vec<(usize, Stretch)> {
    let mut found = Vec::new();
    for i in 0..all.len() {
        let Some(stretch) = all[i].jump.stretch(times) else {
            all[i].why = Some("no times are there to recompute it from and to compare at".into());
            continue;
        };
        let (from, to) = (times[stretch.from], times[stretch.to[stretch.to.len() - 1]]);
        all[i].earlier_jumps = all[..i].iter().filter(|other| other.jump.is_behind(from)).count();
        (all[i].from, all[i].to) = (Some(from), Some(to));
        found.push((i, stretch));
    }
    found
}

/// What the run has at the end of a stretch against what the solver has made; times of its ends, s.
fn compare(
    run: &mut FoamCase,
    copy: &Copy,
    jump: &Jump,
    ends: [f64; 2],
) -> Result<BTreeMap<String, Figures>> {
    let mut own = FoamCase::open(&copy.folder)?;
    let at = |case: &FoamCase, time: f64| {
        jumps::number_of(time, &case.description().times)
            .ok_or_else(|| Error::Input(format!("{} has no time {time} s", case.description().path)))
    };
    let (from, to, end) = (at(run, ends[0])?, at(run, ends[1])?, at(&own, ends[1])?);
    let mut found = BTreeMap::new();
    for name in &jump.fields {
        let (truth, scalar) = field(&mut own, name, end)?;
        let (has, start) = (field(run, name, to)?.0, field(run, name, from)?.0);
        refuse(truth.len() != has.len(), Error::Input, || {
            format!("{name}: the solver's field has {} values, the run's {}", truth.len(), has.len())
        })?;
        let level = if scalar { truth.iter().sum::<f64>() / truth.len().max(1) as f64 } else { 0.0 };
        let rms = |other: &dyn Fn(usize) -> f64| {
            let sum: f64 = truth.iter().enumerate().map(|(i, v)| (v - other(i)).powi(2)).sum();
            (sum / truth.len().max(1) as f64).sqrt()
        };
        let change = rms(&|i| start[i]);
        let variation = rms(&|_| level).max(change);
        found.insert(name.clone(), Figures { error: rms(&|i| has[i]), change, variation });
    }
    Ok(found)
}

/// Values of a field at the cells, of a vector its solved components, and whether it is a scalar.
fn field(case: &mut FoamCase, name: &str, time: usize) -> Result<(Vec<f64>, bool)> {
    match case.scalar_field(name, time) {
        Ok(values) => return Ok((values, true)),
        // It is a scalar
        Err(Error::Numerical(e)) => return Err(Error::Numerical(e)),
        Err(_) => {}
    }
    let directions = case.description().directions.clone();
    let values = case.vector_field(name, time)?;
    Ok((values.iter().flat_map(|v| directions.iter().map(|d| v[*d])).collect(), false))
}

/// Errors over the largest variation up to each jump, and whether they are within the tolerance.
fn judge(all: &mut [Verified], figures: &BTreeMap<usize, BTreeMap<String, Figures>>, tolerance: Option<f64>) {
    let mut largest: BTreeMap<&str, f64> = BTreeMap::new();
    for (i, fields) in figures {
        let one = &mut all[*i];
        for (name, f) in fields {
            let variation = largest.entry(name).or_default();
            *variation = variation.max(f.variation);
            let over = |error: f64| if error == 0.0 { 0.0 } else { error / *variation };
            one.errors.insert(name.clone(), over(f.error));
            one.holding.insert(name.clone(), over(f.change));
        }
        let held = &one.jump.held;
        let counts = |name: &String| held.is_empty() || held.contains(name);
        one.worst = one.errors.iter().filter(|(name, _)| counts(name)).map(|(_, e)| *e).reduce(f64::max);
        let tolerance = tolerance.or(one.jump.tolerance);
        one.within = one.worst.zip(tolerance).map(|(worst, tolerance)| worst <= tolerance);
    }
}

/// A copy of the whole case, which gets its name when it is whole.
struct CaseCopy {
    room: tempfile::TempDir,
    name: PathBuf,
}

impl CaseCopy {
    fn new(case: &Path, keep: &Path) -> Result<Self> {
        let name = plain_path(keep)?;
        if name.exists() {
            return Err(Error::file(name, "is there already: --keep makes a folder of its own"));
        }
        if lies_in(&name, case) {
            return Err(Error::file(name, "lies in the case: expected a folder outside of it"));
        }
        let parent = name.parent().unwrap_or(Path::new("/"));
        let room = tempfile::Builder::new()
            .prefix(".m4gn-verify")
            .tempdir_in(parent)
            .map_err(|e| Error::file(parent, format!("no folder can be made in it: {e}")))?;
        let kept = CaseCopy { room, name };
        for name in names(case)?.iter().filter(|name| !LEFT_OUT.contains(&name.as_str())) {
            copy_all(&case.join(name), &kept.path().join(name))?;
        }
        Ok(kept)
    }

    fn path(&self) -> &Path {
        self.room.path()
    }

    fn put(self) -> Result<()> {
        use std::os::unix::fs::PermissionsExt;
        let failed = |e: std::io::Error| Error::file(&self.name, format!("cannot be made: {e}"));
        // As a folder that a user makes
        std::fs::set_permissions(self.path(), std::fs::Permissions::from_mode(0o755)).map_err(failed)?;
        std::fs::rename(self.path(), &self.name).map_err(failed)?;
        let _ = self.room.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verified(begun: f64, ended: f64, held: &[&str]) -> Verified {
        let held = held.iter().map(|h| h.to_string()).collect();
        let jump = Jump { begun, ended, held, tolerance: Some(0.05), ..Jump::default() };
        Verified { jump, ..Verified::default() }
    }

    #[test]
    fn errors_are_over_the_largest_variation_so_far() {
        let mut all = vec![verified(1.0, 2.0, &["U"]), verified(3.0, 4.0, &["U"]), verified(5.0, 6.0, &[])];
        let figures = |error: f64, variation: f64| {
            let one = |error| Figures { error, change: 0.5, variation };
            BTreeMap::from([("U".to_string(), one(error)), ("p".to_string(), one(1.0))])
        };
        let found =
            BTreeMap::from([(0, figures(0.04, 1.0)), (1, figures(0.04, 0.1)), (2, figures(0.2, 2.0))]);
        judge(&mut all, &found, None);
        assert_eq!((all[0].worst, all[0].within), (Some(0.04), Some(true)), "p is not held");
        assert_eq!(all[1].worst, Some(0.04), "the variation was larger before");
        assert_eq!((all[2].worst, all[2].within), (Some(0.5), Some(false)), "none is named: all count");
        assert!((all[0].of_holding().unwrap() - 0.08).abs() < 1e-12);
        judge(&mut all, &found, Some(0.01));
        assert_eq!(all[0].within, Some(false));
        let report = Report { jumps: all, ..Report::default() };
        assert!(report.fault().unwrap().contains("3 of 3"));
        assert_eq!(report.table().rows[0].len(), report.table().headers.len());
    }

    #[test]
    fn what_cannot_be_recomputed_is_told() {
        let mut all = vec![verified(1.0, 2.0, &[]), verified(2.2, 3.0, &[]), verified(3.1, 3.2, &[])];
        let found = stretches(&mut all, &[0.0, 1.5, 2.5, 4.0]);
        assert_eq!(found.iter().map(|(i, s)| (*i, s.from)).collect::<Vec<_>>(), [(0, 0), (1, 1)]);
        assert_eq!(all.iter().map(|j| j.earlier_jumps).collect::<Vec<_>>(), [0, 1, 0]);
        let report = Report { jumps: all, capped: Some(20), ..Report::default() };
        let notes = report.notes().join("\n");
        for text in [
            "in 1 the errors",
            "2 are compared within",
            "1 cannot be verified",
            "writeJumps yes;",
            "purgeWrite 0;",
            "at nCorrectors 20",
        ] {
            assert!(notes.contains(text), "{notes}");
        }
        assert!(report.fault().unwrap().contains("no jump"));
    }
}
