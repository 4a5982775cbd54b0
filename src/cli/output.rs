//! Figures as JSON, and progress on a terminal or as plain lines.

use crate::{Error, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::path::Path;

/// Writes figures where `--json FILE` says, atomically; does nothing without a file.
///
/// # Errors
/// [`Error::File`] when the file cannot be written.
pub fn write_json(path: Option<&Path>, figures: &serde_json::Value) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let failed = |e: std::io::Error| Error::file(path, format!("cannot be written: {e}"));
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    let mut text = format!("{figures:#}");
    text.push('\n');
    std::fs::write(file.path(), text).map_err(failed)?;
    let file = file.persist(path).map_err(|e| failed(e.error))?;
    // A temporary file is made for its owner alone.
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    file.set_permissions(mode).map_err(failed)
}

/// A progress bar over `length` things on a terminal; None where stderr is no terminal: print plain lines then.
pub fn progress_bar(length: u64, unit: &str) -> Option<ProgressBar> {
    if !std::io::stderr().is_terminal() {
        return None;
    }
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
    let template = format!("{{bar:40}} {{pos}}/{{len}} {unit} [{{elapsed}} < {{eta}}] {{msg}}");
    // The template is ours; the default style is good enough should it ever be wrong.
    bar.set_style(ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    Some(bar)
}
