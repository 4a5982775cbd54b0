//! The result of a run, as it is kept beside the cases.

use super::score::Score;
use m4gn_base::files;
use m4gn_report::{figure, number, percent};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// What a run took.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Cost {
    /// Wall seconds of the solver with what rides in it, measured around its process.
    pub wall: f64,
    /// Processor seconds (`ExecutionTime` of the log).
    pub processor: f64,
    /// Those after the takeover: without the start-up, which all runs have.
    pub after_takeover: f64,
}

/// A finished run, as it is kept.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RunRecord {
    /// Digest of all that the run was made from: another one is run anew.
    pub made_with: String,
    /// What it took.
    pub cost: Cost,
    /// Its figures against the full run; none of the full run itself.
    pub score: Option<Score>,
    /// The whole comparison.
    pub comparison: Option<Value>,
}

impl RunRecord {
    /// What came of it, in a line: times and error of the whole run, the error over that of holding.
    pub(super) fn line(&self) -> String {
        let (processor, wall) = (number(self.cost.processor, 3), number(self.cost.wall, 3));
        let mut text = format!("  {processor} s of processor time, {wall} s in all");
        let Some(score) = &self.score else { return text };
        text += &match score.answer {
            Some(_) => {
                let ended = number(score.ended.unwrap_or_default(), 3);
                format!(", ended at {ended} s, figures within {}", percent(score.answer))
            }
            None => format!(", error over the run {} of holding", figure(score.end, 3)),
        };
        if score.replaced.is_some() {
            text += &format!(", {} replaced", percent(score.replaced));
        }
        text
    }
}

/// The record of a run that is finished and was made with this; none where it must be run.
pub(super) fn finished_record(folder: &Path, name: &str, made_with: &str) -> Option<RunRecord> {
    let text = files::read(folder.join(format!("{name}.json"))).ok()?;
    let record: RunRecord = serde_json::from_slice(&text).ok()?;
    (record.made_with == made_with).then_some(record)
}

/// Removes a case, first the file that says it is whole.
pub(super) fn remove(case: &Path) {
    let _ = std::fs::remove_file(case.join("system/controlDict"));
    let _ = std::fs::remove_dir_all(case);
}
