//! What a run starts from.

use super::cycle::{self, length};
use super::plan::{Kind, Plan};
use super::record::{Record, Started};
use super::table::number;
use crate::cycle::Cycle;
use crate::foam_case::{FoamCase, Source};
use crate::generate::case::put;
use crate::generate::process::Surroundings;
use crate::user_case::{copy_all, has_regions, header, names, times};
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Starts that a campaign can ask for. Another one is a variant, and its arm in [`super::plan::Plan::new`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// The case's own first fields.
    Cold,
    /// The last state of the finished run that is nearest in its parameters; the case's own fields while there is none.
    Nearest,
    /// Of [`Kind`] what finished runs show to pay, else the case's own fields.
    #[default]
    Auto,
}

/// A finished run that another may start from.
#[derive(Clone, Debug)]
pub struct Sister {
    /// What it left.
    pub record: Record,
    /// Its case.
    pub case: PathBuf,
    /// Its place in the parameters, each of which goes from 0 to 1, less the other's.
    pub offset: Vec<f64>,
    /// Whether both have the same words among their parameters.
    pub same_words: bool,
}

impl Sister {
    pub(super) fn far(&self) -> f64 {
        length(&self.offset)
    }
}

/// Sorts runs, the nearest first.
pub fn nearest_first(sisters: &mut [Sister]) {
    sisters.sort_by(|a, b| a.far().total_cmp(&b.far()));
}

/// A run's velocity: name and value of the parameter.
pub type Scale<'a> = Option<(&'a str, &'a str)>;

/// Puts the fields that a run is to start from into the first time of its case, whose mesh has this digest ([`mesh`]). `sisters`: nearest first.
/// `scale`: the parameter that is a velocity, and its value.
///
/// A start that cannot be had is followed by the next one, at last the case's own, with a note that says why.
///
/// # Errors
/// [`Error::Interrupted`] when the user stops.
pub fn make(
    plan: &Plan,
    (case, own): (&Path, &str),
    sisters: &[Sister],
    scale: Scale<'_>,
    tools: &Surroundings,
) -> Result<Started> {
    let far = sisters.first().map(Sister::far);
    let mut notes = Vec::new();
    let kinds: &[(Kind, Option<String>)] = if own.is_empty() { &[] } else { &plan.kinds };
    if kinds.len() < plan.kinds.len() {
        notes.push("runs of several regions are cold".to_string());
    }
    for (kind, why) in kinds {
        // The user may have removed its case, and a state of ranks may not have been put together
        let kept = || sisters.iter().find(|s| s.case.join(&s.record.last).is_dir());
        let made = match kind {
            Kind::Cycle => cycles((case, own), sisters, scale),
            Kind::Nearest => match kept() {
                Some(sister) => nearest((case, own), sister, scale, tools).map(Some),
                None if sisters.is_empty() => Ok(None),
                None => Err(Error::Input("no finished run has kept its last state".into())),
            },
        };
        match made {
            Ok(Some(started)) => {
                notes.extend(why.clone());
                return Ok(Started { far, note: joined(notes), ..started });
            }
            Ok(None) => {}
            Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e)),
            Err(e) => notes.push(format!("{} cannot be taken: {e}", kind.name())),
        }
    }
    notes.extend(plan.cold.clone());
    Ok(Started { kind: "cold".into(), far, note: joined(notes), ..Started::default() })
}

fn joined(notes: Vec<String>) -> Option<String> {
    (!notes.is_empty()).then(|| notes.join("; "))
}

fn nearest(
    (case, own): (&Path, &str),
    sister: &Sister,
    scale: Scale<'_>,
    tools: &Surroundings,
) -> Result<Started> {
    let own_ratio = ratio(scale, &sister.record)?;
    let mapped = own != sister.record.mesh;
    let mut open = FoamCase::open(case)?;
    let first = open.start_folder();
    let of = |folder: PathBuf, ratio: f64| [Source { folder, weight: 1.0, ratio }];
    taken(case, &first, || {
        if !mapped {
            return take(&mut open, &of(sister.case.join(&sister.record.last), own_ratio));
        }
        // Cells and fields that the sister has not stay the run's own when all is scaled
        if scale.is_some() {
            take(&mut open, &of(first.clone(), 1.0 / own_ratio))?;
        }
        // Only cells are mapped: the values of boundaries are the run's own
        put(
            &case.join("system/mapFieldsDict"),
            &(header("mapFieldsDict") + "patchMap ();\ncuttingPatches ();\n"),
        )?;
        let theirs = sister.case.display().to_string();
        tools.run(
            case,
            &["mapFields", &theirs, "-sourceTime", &sister.record.last, "-mapMethod", "interpolate"],
        )?;
        match scale {
            None => Ok(()),
            Some(_) => take(&mut open, &of(first.clone(), own_ratio)),
        }
    })?;
    Ok(Started {
        kind: "nearest".into(),
        sister: Some(sister.record.case_name.clone()),
        ratio: scale.map(|_| own_ratio),
        mapped,
        ..Started::default()
    })
}

/// Changes the fields that a case begins with, which are in `first`; what is half changed is put back.
fn taken(case: &Path, first: &Path, change: impl FnOnce() -> Result<()>) -> Result<()> {
    let kept = case.join("start.cold");
    copy_all(first, &kept)?;
    let done = change();
    if done.is_err() {
        std::fs::remove_dir_all(first)
            .and_then(|()| std::fs::rename(&kept, first))
            .map_err(Error::cannot("put back", first))?;
    }
    let _ = std::fs::remove_dir_all(&kept);
    done
}

fn take(case: &mut FoamCase, sources: &[Source]) -> Result<()> {
    match case.take_start(sources)? {
        0 => {
            let source = sources.first().map_or(Path::new(""), |s| &s.folder);
            Err(Error::file(source, "has none of the fields that the run begins with: expected some"))
        }
        _ => Ok(()),
    }
}

/// The start from the cycles of the runs around a run, the nearest first; none where they lie not around it, are of other meshes, are no cycles, or
/// are not kept.
fn cycles((case, own): (&Path, &str), sisters: &[Sister], scale: Scale<'_>) -> Result<Option<Started>> {
    let all: Vec<&Sister> = sisters.iter().filter(|s| s.same_words).collect();
    let offsets: Vec<Vec<f64>> = all.iter().map(|s| s.offset.clone()).collect();
    let most = cycle::looked_at(cycle::spanned(&offsets).first().map_or(0, Vec::len));
    let (mut some, mut folders) = (Vec::new(), Vec::new());
    for sister in all {
        let (Some(period), true) = (sister.record.period, some.len() < most) else { continue };
        if sister.record.mesh == own {
            let Some((times, of_it)) = states(&sister.case).ok().filter(|s| Cycle::covers(&s.0, period))
            else {
                continue;
            };
            some.push((sister, period, times, folders.len()));
            folders.extend(of_it);
        }
    }
    // Before their states are read
    let places: Vec<Vec<f64>> = some.iter().map(|s| s.0.offset.clone()).collect();
    if places.len() < 2 || cycle::weights(&places).is_none() {
        return Ok(None);
    }
    let mut open = FoamCase::open(case)?;
    let products = open.products(&folders)?;
    let mut known: Vec<(&Sister, Cycle, f64, usize)> = Vec::new();
    for (sister, period, times, from) in some {
        let Some(cycle) = Cycle::new(&times, period, &|i, j| products[from + i][from + j]) else { continue };
        let phase = match known.first() {
            None => 0.0,
            Some((_, first, _, at)) => cycle.ahead_of(first, &|i, j| products[at + i][from + j]),
        };
        known.push((sister, cycle, phase, from));
    }
    let offsets: Vec<Vec<f64>> = known.iter().map(|k| k.0.offset.clone()).collect();
    let Some(weights) = cycle::weights(&offsets) else { return Ok(None) };
    let mut sources = Vec::new();
    for ((sister, cycle, phase, from), share) in known.iter().zip(&weights) {
        let ratio = ratio(scale, &sister.record)?;
        let of_it = folders[*from..].iter().zip(cycle.weights(*phase));
        sources.extend(of_it.map(|(folder, w)| Source { folder: folder.clone(), weight: share * w, ratio }));
    }
    taken(case, &open.start_folder(), || take(&mut open, &sources))?;
    let names: Vec<&str> = known.iter().map(|k| k.0.record.case_name.as_str()).collect();
    Ok(Some(Started { kind: "cycle".into(), sister: Some(names.join(" ")), ..Started::default() }))
}

/// Times and folders of the states that a run has stored, in order, without the one that it began with, which is the first.
fn states(case: &Path) -> Result<(Vec<f64>, Vec<PathBuf>)> {
    Ok(times(case)?.into_iter().skip(1).map(|(name, t)| (t, case.join(name))).unzip())
}

/// The run's value of the velocity over the sister's; 1 of none.
pub(super) fn ratio(scale: Scale<'_>, sister: &Record) -> Result<f64> {
    let Some((name, value)) = scale else { return Ok(1.0) };
    let theirs = sister.parameters.get(name).map_or("", String::as_str);
    let found = number(value).zip(number(theirs)).map(|(own, other)| own / other);
    // A flow that is turned round is another one, and omega would be negative
    found.filter(|r| *r > 0.0 && r.is_finite()).ok_or_else(|| {
        Error::Input(format!(
            "scale = \"{name}\": expected numbers of one sign, and not 0, found {value} and {theirs}"
        ))
    })
}

/// Digest of a case's mesh; empty: it has none, or several regions.
///
/// # Errors
/// [`Error::File`] for a mesh that cannot be read.
pub fn mesh(case: &Path) -> Result<String> {
    let folder = case.join("constant/polyMesh");
    // The mesh that splitMeshRegions has cut may still be there
    if has_regions(case) || !folder.is_dir() {
        return Ok(String::new());
    }
    let mut files = names(&folder)?;
    files.retain(|n| {
        ["points", "faces", "owner", "neighbour", "boundary"].iter().any(|f| n.trim_end_matches(".gz") == *f)
    });
    files.sort();
    let mut digest = Digest::default();
    for name in &files {
        digest.add_file(name, &folder.join(name))?;
    }
    Ok(digest.text())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::campaign::record::Cost;
    use crate::fixtures::tools;

    /// A finished run at a place, of this kind and cost, whose nearest one was so far.
    pub fn at(place: f64, kind: &str, cost: f64, far: Option<f64>) -> Sister {
        Sister {
            record: Record {
                case_name: format!("at {place}"),
                parameters: [("U".to_string(), place.to_string())].into(),
                start: Started { kind: kind.into(), far, ..Started::default() },
                period: Some(0.25),
                mesh: "m".into(),
                cost: Cost { solver: cost, ..Cost::default() },
                ..Record::default()
            },
            case: ".".into(),
            offset: vec![place],
            same_words: true,
        }
    }

    #[test]
    fn a_start_that_cannot_be_had_is_cold_and_says_why() {
        let dir = tempfile::tempdir().unwrap();
        let of_mesh = |mesh: &str, sisters: &[Sister], start: Start| {
            let case = (dir.path(), mesh);
            make(&Plan::new(start, sisters), case, sisters, Some(("U", "2")), &tools()).unwrap()
        };
        let of = |sisters: &[Sister], start: Start| of_mesh("another mesh", sisters, start);
        let none = of(&[], Start::Nearest);
        assert_eq!((none.kind.as_str(), none.note.as_deref()), ("cold", Some("no sister is finished")));
        assert_eq!(of(&[], Start::Cold).note, None);
        let zero = of(&[at(0.0, "cold", 1.0, None)], Start::Nearest);
        assert!(zero.note.unwrap().contains("numbers of one sign, and not 0, found 2 and 0"));
        let turned = of(&[at(-1.0, "cold", 1.0, None)], Start::Nearest);
        assert!(turned.note.unwrap().contains("numbers of one sign, and not 0, found 2 and -1"));
        let gone = Sister { case: dir.path().join("none"), ..at(1.0, "cold", 1.0, None) };
        let gone = of(&[gone], Start::Auto).note.unwrap();
        assert_eq!(gone, "nearest cannot be taken: no finished run has kept its last state");
        let split = [("constant/polyMesh/faces", ""), ("constant/regionProperties", "")];
        crate::fixtures::write(dir.path(), &split);
        let regions = of_mesh(&mesh(dir.path()).unwrap(), &[at(1.0, "cold", 1.0, None)], Start::Nearest);
        assert!(regions.kind == "cold" && regions.note.unwrap().contains("several regions"));
    }
}
