//! What a run starts from.

use super::case::write;
use super::record::{Record, Started};
use super::table::number;
use crate::check::copy::{header, names};
use crate::digest::Digest;
use crate::foam_case::FoamCase;
use crate::generate::process::Surroundings;
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Starts that a campaign can ask for. Another one is a variant, and its arm in [`make`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// The case's own first fields.
    Cold,
    /// The last state of the finished run that is nearest in its parameters; the case's own fields while there is none.
    #[default]
    Nearest,
}

/// A finished run that another may start from.
#[derive(Clone, Debug)]
pub struct Sister {
    /// What it left.
    pub record: Record,
    /// Its case.
    pub case: PathBuf,
    /// Distance of its parameters ([`distance`]).
    pub far: f64,
}

/// Distance of two places in the parameters, each of which goes from 0 to 1.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

/// Puts the fields that a run is to start from into the first time of its case, whose mesh is made. `scale`: the parameter that is a velocity,
/// and its value.
///
/// A start that cannot be had is the case's own, with a note that says why.
///
/// # Errors
/// [`Error::Interrupted`] when the user stops.
pub fn make(
    start: Start,
    case: &Path,
    sisters: Vec<Sister>,
    scale: Option<(&str, &str)>,
    tools: &Surroundings,
) -> Result<Started> {
    let cold = |note: Option<String>| Started { kind: "cold".into(), note, ..Started::default() };
    match start {
        Start::Cold => Ok(cold(None)),
        Start::Nearest => {
            let Some(sister) = sisters.into_iter().min_by(|a, b| a.far.total_cmp(&b.far)) else {
                return Ok(cold(Some("no sister is finished".into())));
            };
            match nearest(case, &sister, scale, tools) {
                Ok(started) => Ok(started),
                Err(Error::Interrupted(e)) => Err(Error::Interrupted(e)),
                Err(e) => {
                    Ok(cold(Some(format!("the state of {} cannot be taken: {e}", sister.record.case_name))))
                }
            }
        }
    }
}

fn nearest(
    case: &Path,
    sister: &Sister,
    scale: Option<(&str, &str)>,
    tools: &Surroundings,
) -> Result<Started> {
    let ratio = match scale {
        Some((name, value)) => Some(ratio(name, value, &sister.record)?),
        None => None,
    };
    let mapped = mesh(case)? != mesh(&sister.case)?;
    let first = first_fields(case)?;
    let kept = case.join("start.cold");
    // What is half taken is put back
    crate::check::copy::copy_all(&first, &kept)?;
    let taken = take(case, sister, ratio, mapped, &first, tools);
    if taken.is_err() {
        std::fs::remove_dir_all(&first)
            .and_then(|()| std::fs::rename(&kept, &first))
            .map_err(|e| Error::file(&first, format!("cannot be put back: {e}")))?;
    }
    let _ = std::fs::remove_dir_all(&kept);
    taken?;
    Ok(Started {
        kind: "nearest".into(),
        sister: Some(sister.record.case_name.clone()),
        ratio,
        mapped,
        note: None,
    })
}

fn take(
    case: &Path,
    sister: &Sister,
    ratio: Option<f64>,
    mapped: bool,
    first: &Path,
    tools: &Surroundings,
) -> Result<()> {
    let source = match mapped {
        false => sister.case.join(&sister.record.last),
        true => {
            // Only cells are mapped: the values of boundaries are the run's own
            write(
                &case.join("system/mapFieldsDict"),
                &(header("mapFieldsDict") + "patchMap ();\ncuttingPatches ();\n"),
            )?;
            let from = sister.case.display().to_string();
            tools.run(
                case,
                &["mapFields", &from, "-sourceTime", &sister.record.last, "-mapMethod", "interpolate"],
            )?;
            first.to_path_buf()
        }
    };
    if mapped && ratio.is_none() {
        return Ok(());
    }
    match FoamCase::open(case)?.take_start(&source, ratio.unwrap_or(1.0))? {
        0 => Err(Error::file(&source, "has none of the fields that the run begins with: expected some")),
        _ => Ok(()),
    }
}

/// The folder of the fields that a case begins with.
fn first_fields(case: &Path) -> Result<PathBuf> {
    Ok(FoamCase::open(case)?.start_folder())
}

/// The run's value of the velocity over the sister's.
fn ratio(name: &str, value: &str, sister: &Record) -> Result<f64> {
    let theirs = sister.parameters.get(name).map_or("", String::as_str);
    match (number(value), number(theirs)) {
        (Some(own), Some(other)) if other != 0.0 && own != 0.0 => Ok(own / other),
        _ => Err(Error::Input(format!(
            "scale = \"{name}\": expected numbers other than 0, found {value} and {theirs}"
        ))),
    }
}

/// Digest of a mesh.
fn mesh(case: &Path) -> Result<String> {
    let folder = case.join("constant/polyMesh");
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
mod tests {
    use super::*;

    static GO: std::sync::atomic::AtomicU8 = std::sync::atomic::AtomicU8::new(0);

    #[test]
    fn a_start_that_cannot_be_had_is_cold_and_says_why() {
        let tools = Surroundings {
            stop: &GO,
            timeout: std::time::Duration::from_secs(9),
            asks: false,
            environment: Vec::new(),
        };
        let dir = tempfile::tempdir().unwrap();
        let of = |sisters: Vec<Sister>, start: Start| {
            make(start, dir.path(), sisters, Some(("U", "2")), &tools).unwrap()
        };
        let none = of(Vec::new(), Start::Nearest);
        assert_eq!((none.kind.as_str(), none.note.as_deref()), ("cold", Some("no sister is finished")));
        assert_eq!(of(Vec::new(), Start::Cold).note, None);
        let sister = |u: &str| Sister {
            record: Record {
                case_name: "s".into(),
                parameters: [("U".to_string(), u.to_string())].into(),
                start: Started::default(),
                quantities: Default::default(),
                end_time: 1.0,
                last: "1".into(),
                cost: Default::default(),
                made_from: Default::default(),
            },
            case: dir.path().to_path_buf(),
            far: 0.1,
        };
        let zero = of(vec![sister("0")], Start::Nearest);
        assert!(zero.note.unwrap().contains("scale = \"U\": expected numbers other than 0, found 2 and 0"));
    }
}
