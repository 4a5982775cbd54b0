//! What a run decides, as data: a file of JSON lines, which the first rank writes. Its lines are listed in docs/reference/run-files.md.

use crate::schedule::Step;
use m4gn_base::files;
use serde_json::Value;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What has been decided.
#[derive(Debug, Default)]
pub(crate) struct Decisions {
    /// How many, in all parts of the run.
    pub count: usize,
    /// Where they go; none: nowhere.
    path: Option<PathBuf>,
    file: Option<File>,
    /// Why there is no file; it has not been said yet.
    pub failed: Option<String>,
}

impl Decisions {
    /// For a run from this time on; `path`: of the first rank. Of an earlier run into the same file what was decided up to then stays.
    pub fn new(path: Option<PathBuf>, start: &Step) -> Self {
        let mut new = Decisions { path, ..Decisions::default() };
        let latest = start.output_time + 1e-9 * start.output_time.abs();
        new.keep(|_, line| {
            let time = serde_json::from_str::<Value>(line).ok().and_then(|line| line["time"].as_f64());
            time.is_some_and(|time| time <= latest)
        });
        new
    }

    /// Goes on behind so many.
    pub fn carry_on(&mut self, count: usize) {
        self.keep(|i, _| i < count);
        self.count = count;
    }

    /// A decision at a step; `fields`: an object with what belongs to it. What is no finite number is null there.
    pub fn tell(&mut self, step: &Step, event: &str, fields: &Value) {
        self.count += 1;
        let Some(path) = &self.path else { return };
        let rest = fields.to_string();
        let rest = rest.trim_start_matches('{');
        let comma = if rest == "}" { "" } else { "," };
        let line =
            format!("{{\"time\":{},\"event\":\"{event}\"{comma}{rest}\n", Value::from(step.output_time));
        let written = match &mut self.file {
            Some(file) => file.write_all(line.as_bytes()),
            None => open(path).and_then(|mut file| {
                file.write_all(line.as_bytes())?;
                self.file = Some(file);
                Ok(())
            }),
        };
        self.give_up(written);
    }

    /// Keeps the first lines of the file that are whole and wanted, by number and text.
    fn keep(&mut self, wanted: impl Fn(usize, &str) -> bool) {
        let Some(path) = self.path.clone().filter(|path| path.exists()) else { return };
        let cut = || -> io::Result<()> {
            let text = files::read_text(&path)?;
            let lines = text.split_inclusive('\n').enumerate();
            let whole = lines.take_while(|(i, line)| line.ends_with('\n') && wanted(*i, line));
            let whole: usize = whole.map(|(_, line)| line.len()).sum();
            match whole == text.len() {
                true => Ok(()),
                false => files::write_whole(&path, &text.as_bytes()[..whole]).map_err(io::Error::other),
            }
        };
        self.file = None;
        self.give_up(cut());
    }

    fn give_up(&mut self, done: io::Result<()>) {
        if let (Err(e), Some(path)) = (done, &self.path) {
            self.failed = Some(format!(
                "{}: cannot be written: {e}. What is decided is not kept there",
                path.display()
            ));
            self.path = None;
        }
    }
}

fn open(path: &Path) -> io::Result<File> {
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    if path.exists() {
        files::check_plain(path)?;
    }
    OpenOptions::new().create(true).append(true).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::at;
    use serde_json::json;

    fn lines(path: &Path) -> Vec<String> {
        std::fs::read_to_string(path).unwrap().lines().map(String::from).collect()
    }

    #[test]
    fn a_run_that_is_carried_on_has_each_decision_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("postProcessing/test/decisions.jsonl");
        let step = |time| at(time, 0.1, 9.0, 0);
        let mut first = Decisions::new(Some(path.clone()), &step(0.0));
        assert!(!path.exists());
        first.tell(&step(1.0), "fit", &json!({"error": 0.5}));
        first.tell(&step(2.0), "jump_begun", &json!({}));
        let saved = first.count;
        first.tell(&step(2.0), "jump_ended", &json!({"error": f64::INFINITY}));
        first.tell(&step(3.0), "end", &json!({}));
        let whole = lines(&path);
        assert_eq!(whole[0], r#"{"time":1.0,"event":"fit","error":0.5}"#);
        assert_eq!(
            whole[1..3],
            [r#"{"time":2.0,"event":"jump_begun"}"#, r#"{"time":2.0,"event":"jump_ended","error":null}"#]
        );

        let mut second = Decisions::new(Some(path.clone()), &step(2.0));
        second.carry_on(saved);
        second.tell(&step(2.0), "jump_ended", &json!({"error": f64::INFINITY}));
        second.tell(&step(3.0), "end", &json!({}));
        assert_eq!((lines(&path), second.count), (whole, 4));
        // One that begins anew
        let mut third = Decisions::new(Some(path.clone()), &step(0.0));
        third.tell(&step(0.5), "end", &json!({}));
        assert_eq!(lines(&path), [r#"{"time":0.5,"event":"end"}"#]);
        assert_eq!((first.failed, second.failed, third.failed), (None, None, None));
    }

    #[test]
    fn half_a_line_of_a_run_that_was_killed_goes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("decisions.jsonl");
        std::fs::write(&path, "{\"time\":1.0,\"event\":\"fit\"}\n{\"time\":1.0,\"ev").unwrap();
        Decisions::new(Some(path.clone()), &at(2.0, 0.1, 9.0, 0));
        assert_eq!(lines(&path).len(), 1);
    }

    #[test]
    fn what_cannot_be_written_is_said_and_the_run_goes_on() {
        let dir = tempfile::tempdir().unwrap();
        let mut to_a_folder = Decisions::new(Some(dir.path().into()), &at(0.0, 0.1, 9.0, 0));
        to_a_folder.tell(&at(1.0, 0.1, 9.0, 0), "end", &json!({}));
        assert!(to_a_folder.failed.unwrap().contains("cannot be written"));
        // Nobody asked for a file
        let mut silent = Decisions::new(None, &at(0.0, 0.1, 9.0, 0));
        silent.tell(&at(1.0, 0.1, 9.0, 0), "end", &json!({}));
        assert_eq!((silent.count, silent.failed), (1, None));
    }
}
