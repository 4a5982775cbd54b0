//! What became of the cases of a data set.

use m4gn_base::{Error, Result, refuse};
use serde_json::{Value, json};
use std::path::Path;

/// What became of the cases so far.
#[derive(Default)]
pub(super) struct Tally {
    /// Figures of the cases that were made.
    pub(super) made: Vec<Value>,
    pub(super) there: u64,
    failed: Vec<(u64, String)>,
    pub(super) bytes: u64,
}

impl Tally {
    /// Counts a failed case; the line to print about it.
    pub(super) fn failed(&mut self, index: u64, error: &Error) -> String {
        self.failed.push((index, error.to_string()));
        format!("{index:04}  failed, skipped: {error}")
    }

    pub(super) fn summary(&self, folder: &Path, seconds: f64) -> String {
        let mut text = format!(
            "{}: {} trajectories made in {seconds:.0} s ({:.1} MB), {} there before, {} failed",
            folder.display(),
            self.made.len(),
            self.bytes as f64 * 1e-6,
            self.there,
            self.failed.len()
        );
        if !self.failed.is_empty() {
            text += "; their logs are in the folder cases there, the same command tries again";
        }
        text
    }

    /// The figures for `--json`.
    pub(super) fn figures(&self, count: u64, seed: u64, seconds: f64) -> Value {
        let failed: Vec<_> =
            self.failed.iter().map(|(index, message)| json!({"index": index, "message": message})).collect();
        json!({
            "count": count, "seed": seed, "made": self.made, "there_before": self.there, "failed": failed,
            "seconds": seconds, "bytes": self.bytes,
        })
    }

    /// # Errors
    /// [`Error::Input`] with the list of the cases that failed.
    pub(super) fn fail_if_any(&self, count: u64) -> Result<()> {
        let cases: Vec<_> =
            self.failed.iter().map(|(index, message)| format!("\n  {index:04}: {message}")).collect();
        refuse(!cases.is_empty(), Error::Input, || {
            format!("{} of {count} cases failed:{}", cases.len(), cases.concat())
        })
    }
}
