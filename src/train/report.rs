//! What a training says while it runs: a progress bar on a terminal, plain lines otherwise.

use super::log::{Row, Validation};
use indicatif::{ProgressBar, ProgressStyle};
use m4gn_report::number;
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::time::Instant;

/// The terminal, or lines on standard error.
pub struct Report {
    /// Of several ranks one speaks.
    speaks: bool,
    terminal: bool,
    bar: RefCell<ProgressBar>,
    since: RefCell<(Instant, u64)>,
}

impl Report {
    /// Looks at what standard error is.
    pub fn new(speaks: bool) -> Self {
        Report {
            speaks,
            terminal: speaks && std::io::stderr().is_terminal(),
            bar: RefCell::new(ProgressBar::hidden()),
            since: RefCell::new((Instant::now(), 0)),
        }
    }

    /// A line that stays.
    pub fn line(&self, text: &str) {
        if self.terminal {
            self.bar.borrow().suspend(|| say(text));
        } else if self.speaks {
            say(text);
        }
    }

    /// Before reading `total` trajectories.
    pub fn begin_loading(&self, total: u64) {
        self.line(&format!("reading {total} trajectories, making their graphs and segments"));
        self.start(total, 0, "{bar:30} {pos}/{len} trajectories");
    }

    /// One trajectory was read.
    pub fn loaded(&self) {
        self.bar.borrow().inc(1);
    }

    /// Before the first of `steps` steps, `done` of which an earlier run made.
    pub fn begin(&self, steps: u64, done: u64) {
        self.start(steps, done, "{bar:30} {pos}/{len} steps, {msg}, {eta} left");
        *self.since.borrow_mut() = (Instant::now(), done);
    }

    /// After a step.
    pub fn advance(&self, step: u64) {
        self.bar.borrow().set_position(step);
    }

    /// After an interval of the log; `fields` are those that the losses are of.
    pub fn row(&self, row: &Row, fields: &[&str]) {
        let mut since = self.since.borrow_mut();
        let rate = (row.step - since.1.min(row.step)) as f64 / since.0.elapsed().as_secs_f64().max(1e-9);
        *since = (Instant::now(), row.step);
        let each = fields.iter().zip(&row.losses).map(|(f, loss)| format!("{f} {}", number(*loss, 4)));
        let loss = match row.samples {
            0 => "no update yet, normalisers are accumulated".into(),
            _ => format!("loss {} ({})", number(row.loss, 4), each.collect::<Vec<_>>().join(", ")),
        };
        let text = format!("{loss}, {} steps/s", number(rate, 3));
        if self.terminal {
            self.bar.borrow().set_message(text);
        } else if self.speaks {
            say(&format!(
                "step {}, {:.0} s: {text}, learning rate {:.2e}",
                row.step, row.seconds, row.learning_rate
            ));
        }
    }

    /// After a validation of these fields; the first says whether it is a better one.
    pub fn validation(&self, step: u64, fields: &[String], all: &[Validation], better: bool) {
        for (i, (field, v)) in fields.iter().zip(all).enumerate() {
            let best = if better && i == 0 { ", best so far" } else { "" };
            self.line(&format!("validation of {field} at step {step}: {}{best}", v.relative()));
        }
    }

    /// Takes the bar away.
    pub fn end(&self) {
        self.bar.borrow().finish_and_clear();
    }

    fn start(&self, total: u64, done: u64, template: &str) {
        if self.terminal {
            let bar = ProgressBar::new(total).with_position(done);
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style);
            }
            bar.reset_eta();
            *self.bar.borrow_mut() = bar;
        }
    }
}

/// Prints a line on standard error. A training goes on where nobody reads it any more.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
