//! What a run leaves: a file that is written last, whole.

use super::case::MadeFrom;
use m4gn_base::{Error, Result, files};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Of a run that is finished, in its folder.
pub const DONE: &str = "done";
/// Of a run that failed.
pub const FAILED: &str = "failed";

/// A finished run.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Record {
    /// Name of the run.
    pub case_name: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, String>,
    /// What it started from.
    pub start: Started,
    /// Each figure.
    pub quantities: BTreeMap<String, Figure>,
    /// Time at which it ended, s.
    pub end_time: f64,
    /// Name of that state's folder in the run's case.
    pub last: String,
    /// Longest period of its figures, s, where one oscillates.
    #[serde(default)]
    pub period: Option<f64>,
    /// Digest of its mesh; empty of a run that asks for no start.
    #[serde(default)]
    pub mesh: String,
    /// What it took.
    pub cost: Cost,
    /// All that it was made from.
    pub made_from: MadeFrom,
}

/// What a run started from.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Started {
    /// `cold`, `nearest` or `cycle`.
    pub kind: String,
    /// The run whose last state it was, or the runs whose cycles.
    pub sister: Option<String>,
    /// Ratio of velocities by which it was scaled.
    pub ratio: Option<f64>,
    /// Whether it was mapped onto another mesh.
    pub mapped: bool,
    /// Distance of the nearest finished run in the parameters, each of which goes from 0 to 1; none: there was none.
    #[serde(default)]
    pub far: Option<f64>,
    /// The kind of start that was tried before, and gave no answer.
    #[serde(default)]
    pub tried: Option<String>,
    /// Why it was this one.
    pub note: Option<String>,
}

impl Started {
    /// Adds to the note.
    pub fn noted(&mut self, what: String) {
        let notes = self.note.take().into_iter().chain([what]);
        self.note = Some(notes.collect::<Vec<_>>().join("; "));
    }
}

impl std::fmt::Display for Started {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.sister {
            None => write!(f, "{}", self.kind),
            Some(sister) => write!(f, "{} {sister}", self.kind),
        }?;
        self.ratio.map_or(Ok(()), |ratio| write!(f, " x {}", m4gn_report::number(ratio, 3)))?;
        if self.mapped { write!(f, " mapped") } else { Ok(()) }
    }
}

/// A figure with its interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Figure {
    /// Mean or rms.
    pub value: f64,
    /// Half-width of its confidence interval; none: it is not known to any.
    pub half_width: Option<f64>,
    /// Whether it is within its tolerance; none: it has none.
    pub known: Option<bool>,
}

impl std::fmt::Display for Figure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&m4gn_averages::with_half_width(self.value, self.half_width.unwrap_or(f64::INFINITY)))
    }
}

/// Processor seconds of all programs of a run, and the wall time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Cost {
    /// Of the mesh and the first fields.
    pub prepare: f64,
    /// Of all of a run from a sister's fields that gave no answer, before this one.
    #[serde(default)]
    pub tried: f64,
    /// Of taking what it starts from, and of decomposing.
    pub start: f64,
    /// Of the solver with all that rides in it.
    pub solver: f64,
    /// Of these, those of the surrogate's strides and of handing states over (wall time).
    pub surrogate: f64,
    /// Of going on behind its end for states that its sisters may take, and of reconstructing.
    #[serde(default)]
    pub states: f64,
    /// Wall time of everything, s.
    pub wall: f64,
}

impl Cost {
    /// Processor seconds of everything.
    pub fn total(&self) -> f64 {
        self.prepare + self.tried + self.to_answer() + self.states
    }

    /// Those that depend on the start.
    pub fn to_answer(&self) -> f64 {
        self.start + self.solver
    }
}

/// Why a run failed.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Failure {
    /// In one paragraph.
    pub message: String,
    /// What it took until then, processor s.
    #[serde(default)]
    pub processor: f64,
    /// All that it was made from.
    pub made_from: MadeFrom,
}

/// What a run's folder says.
#[derive(Clone, Debug)]
pub enum State {
    /// Nothing, or half of a run.
    Missing,
    /// It is finished, and made from what is there now.
    Done(Box<Record>),
    /// It failed, with what is there now: why, and the processor seconds that it took.
    Failed(String, f64),
    /// It is finished, and made from something else, which is named.
    Stale(String),
}

/// What `folder` says of a run that would now be made from `now`.
///
/// # Errors
/// [`Error::File`] for a record that is damaged.
pub fn state(folder: &Path, now: &MadeFrom) -> Result<State> {
    if let Some(record) = read::<Record>(&folder.join(DONE))? {
        return Ok(match record.made_from.differs(now) {
            None => State::Done(Box::new(record)),
            Some(what) => State::Stale(what),
        });
    }
    Ok(match read::<Failure>(&folder.join(FAILED))? {
        Some(failure) if failure.made_from.differs(now).is_none() => {
            State::Failed(failure.message, failure.processor)
        }
        _ => State::Missing,
    })
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.exists() {
        return Ok(None);
    }
    let damaged = |e: &dyn std::fmt::Display| {
        Error::file(
            path,
            format!("is not what 'm4gn campaign' wrote: {e}; remove it, and the run is made again"),
        )
    };
    let text = files::read_text(path).map_err(|e| damaged(&e))?;
    serde_json::from_str(&text).map(Some).map_err(|e| damaged(&e))
}

/// Writes a record, whole.
///
/// # Errors
/// [`Error::File`] where it cannot be written.
pub fn write(path: &Path, record: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(record).map_err(|e| Error::Internal(e.to_string()))?;
    files::write_whole(path, format!("{text}\n").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_of_what_it_was_made_from() {
        let dir = tempfile::tempdir().unwrap();
        let of = |u: &str| {
            MadeFrom([("case 0/U".to_string(), u.to_string()), ("solver".into(), "s".into())].into())
        };
        let is = |now: &MadeFrom| format!("{:?}", state(dir.path(), now).unwrap());
        assert_eq!(is(&of("1")), "Missing");
        let failure = Failure { message: "diverged".into(), processor: 3.5, made_from: of("1") };
        write(&dir.path().join(FAILED), &failure).unwrap();
        assert_eq!((is(&of("1")), is(&of("2"))), ("Failed(\"diverged\", 3.5)".into(), "Missing".into()));
        let record = Record {
            case_name: "a".into(),
            parameters: [("U".to_string(), "1".to_string())].into(),
            start: Started {
                kind: "nearest".into(),
                sister: Some("b".into()),
                ratio: Some(1.25),
                mapped: true,
                ..Started::default()
            },
            made_from: of("1"),
            ..Record::default()
        };
        assert_eq!(record.start.to_string(), "nearest b x 1.25 mapped");
        write(&dir.path().join(DONE), &record).unwrap();
        assert!(is(&of("1")).starts_with("Done"));
        assert_eq!(is(&of("2")), "Stale(\"case 0/U\")");
        std::fs::write(dir.path().join(DONE), "{").unwrap();
        m4gn_samples::fails(state(dir.path(), &of("1")), &["done: is not what 'm4gn campaign' wrote"]);
    }
}
