//! What a command prints, figures as JSON, and progress on a terminal or as plain lines.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use m4gn_base::files::write_whole;
use m4gn_base::lock::{self, Lock};
use m4gn_base::{Error, Result};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::io::IsTerminal;
use std::io::Write as _;
use std::path::Path;
use std::sync::Mutex;

/// In place of the standard macro, which panics on a closed pipe and a full device, in all commands.
macro_rules! println {
    () => { $crate::output::say(format_args!("\n")) };
    ($($part:tt)*) => { $crate::output::say(format_args!("{}\n", format_args!($($part)*))) };
}

/// As `println`, without the end of the line.
macro_rules! print {
    ($($part:tt)*) => { $crate::output::say(format_args!($($part)*)) };
}

/// As `println`, on standard error.
macro_rules! eprintln {
    ($($part:tt)*) => { $crate::output::complain(format_args!($($part)*)) };
}

/// What is wrong with standard output since this process began to print.
static OUTPUT: Mutex<Option<ErrorKind>> = Mutex::new(None);

/// Prints on standard output. A failure is kept for [`printed`]; nothing more is printed then, and the command goes on.
pub(super) fn say(text: std::fmt::Arguments) {
    let mut state = OUTPUT.lock().unwrap_or_else(|e| e.into_inner());
    if state.is_none() {
        let mut out = std::io::stdout().lock();
        let done = out.write_all(plain(&text.to_string()).as_bytes()).and_then(|()| out.flush());
        *state = done.err().map(|e| e.kind());
    }
}

/// Prints a line on standard error, if there is one.
pub(super) fn complain(text: std::fmt::Arguments) {
    let _ = std::io::stderr().lock().write_all(format!("{}\n", plain(&text.to_string())).as_bytes());
}

/// Whether all that was said was printed. A reader that has closed its pipe (`| head`) has seen enough.
pub(super) fn printed() -> Result<()> {
    match *OUTPUT.lock().unwrap_or_else(|e| e.into_inner()) {
        None | Some(ErrorKind::BrokenPipe) => Ok(()),
        Some(kind) => Err(Error::Input(format!("standard output cannot be written: {kind}"))),
    }
}

/// Text without what a terminal would obey or hide: names in files may hold anything.
pub(super) fn plain(text: &str) -> String {
    let mut clean = String::with_capacity(text.len());
    for c in text.chars() {
        let hidden = matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}');
        match c {
            '\n' | '\t' => clean.push(c),
            c if c.is_control() || hidden => {
                let _ = write!(clean, "{}", c.escape_unicode());
            }
            c => clean.push(c),
        }
    }
    clean
}

/// A text with figures: `{POINTER}` is what a JSON pointer without its first slash leads to, `{POINTER:2}` a number with so many
/// decimals, `{POINTER:0%}` in per cent.
pub(super) fn filled(template: &str, figures: &Value) -> String {
    let mut parts = template.split('{');
    let mut text = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let (key, rest) = part.split_once('}').unwrap_or((part, ""));
        let (pointer, form) = key.split_once(':').unwrap_or((key, ""));
        let value = figures.pointer(&format!("/{pointer}")).unwrap_or(&Value::Null);
        text += &match (form, value.as_str()) {
            ("", Some(word)) => word.to_string(),
            ("", None) => value.to_string(),
            (form, _) => {
                let (digits, unit) = form.strip_suffix('%').map_or((form, 1.0), |d| (d, 100.0));
                let decimals: usize = digits.parse().unwrap_or(0);
                format!("{:.decimals$}", unit * value.as_f64().unwrap_or(f64::NAN))
            }
        };
        text += rest;
    }
    text
}

/// Writes figures where `--json FILE` says ([`write_whole`]); does nothing without a file.
pub fn write_json(path: Option<&Path>, figures: &impl Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let figures = serde_json::to_value(figures).map_err(|e| Error::Internal(e.to_string()))?;
    write_whole(path, format!("{figures:#}\n").as_bytes())
}

/// Claims the places of files that were asked for, none of which may be read as well ([`lock::outputs`]), before anything is computed.
pub fn claim_outputs<'a>(
    paths: impl IntoIterator<Item = Option<&'a Path>>,
    inputs: impl IntoIterator<Item = Option<&'a Path>>,
) -> Result<Vec<Lock>> {
    lock::outputs(paths.into_iter().flatten(), inputs.into_iter().flatten())
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

/// Work that says how many things are done, of how many: on a terminal in a progress bar, which ends with it.
pub fn counted<T>(unit: &str, work: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let bar = progress_bar(0, unit);
    let done = work(&mut |done, of| {
        bar.iter().for_each(|bar| {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        });
    });
    bar.iter().for_each(|b| b.finish_and_clear());
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_stand_in_a_text() {
        let figures = serde_json::json!({ "a": 2.345, "b": { "c": "fp32" }, "d": [1, 0.5] });
        let text = filled("{a:2} s, {b/c}: {d/0} and {d/1:0%} %, {none:1} {none}", &figures);
        assert_eq!(text, "2.35 s, fp32: 1 and 50 %, NaN null");
    }

    #[test]
    fn a_terminal_is_told_nothing() {
        assert_eq!(plain("U\u{1b}[31m\u{7}\r\u{202e}x\n\tö"), "U\\u{1b}[31m\\u{7}\\u{d}\\u{202e}x\n\tö");
    }
}
