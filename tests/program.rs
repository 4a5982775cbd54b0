//! The program m4gn from outside.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

pub fn m4gn() -> Command {
    Command::new(env!("CARGO_BIN_EXE_m4gn"))
}

/// A run in a folder.
pub fn run_in(folder: &Path, arguments: &[&str]) -> Output {
    m4gn().current_dir(folder).args(arguments).output().unwrap()
}

/// All that a run has printed.
pub fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// What a run that must end well has printed on the standard output.
pub fn success(output: &Output) -> String {
    assert!(output.status.success(), "{}", text(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The message of a run that must end with status 1.
pub fn failure(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(1), "{}", text(output));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// It must end with a message of ours that has these words, not with a panic or a signal.
pub fn fails(output: &Output, words: &str) {
    let said = failure(output);
    assert!(said.starts_with("m4gn: ") && said.contains(words), "expected '{words}' in '{said}'");
}

/// It must end with status 1, and these words in what it says.
pub fn refused(output: &Output, words: &str) {
    assert_eq!(output.status.code(), Some(1), "{}", text(output));
    assert!(text(output).contains(words), "expected '{words}': {}", text(output));
}

/// The figures of a file that a run has written.
pub fn figures(file: impl AsRef<Path>) -> Value {
    serde_json::from_slice(&fs::read(file).unwrap()).unwrap()
}

/// Names in a folder, in order.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
