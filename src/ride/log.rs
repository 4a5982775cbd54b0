//! What a ride has to say: lines of the log, warnings, rows of its tables. The host takes them and puts them where they belong.

use crate::ride::{Jump, Ride};
use crate::rider::Rider;
use crate::surrogate::Lesson;
use crate::tables::{Digits, row};
use crate::watch::Judgement;

/// What has not been taken yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Log {
    pub text: String,
    pub warnings: Vec<String>,
    /// Whether the last jump was not allowed.
    pub refused: bool,
    pub jumps_head: String,
    pub jumps: String,
    pub strides_head: String,
    pub strides: String,
    pub observed_head: [String; 2],
    pub observed: String,
    pub segments: String,
}

/// A text that a host takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Text {
    /// Lines of the log.
    Log,
    /// One warning.
    Warning,
    /// The table of jumps, a row for each.
    Jumps,
    /// The table of strides beside the solver, a row for each that was measured.
    Strides,
    /// The table of an observer's errors.
    Errors,
    /// The table of its errors in segments.
    SegmentErrors,
}

impl Log {
    pub fn judged(&mut self, judgement: Option<Judgement>) {
        if let Some(Judgement { note, warning }) = judgement {
            self.text += &note;
            self.warnings.extend(warning);
        }
    }

    pub fn not_finite(&mut self, time: &str, bad: Option<String>) {
        self.warnings.extend(bad.map(|what| format!("At time {time}: {what}")));
    }

    pub fn lesson(&mut self, lesson: &Lesson, all: f64, wall: f64) {
        self.text += &format!("m4gn: {}", lesson.note);
        if lesson.steps > 0 && wall > 0.0 {
            let percent = (100.0 * (all / wall).min(1.0) + 0.5) as i64;
            self.text += &format!("; all adaptation so far is {percent} % of the run's wall time");
        }
        self.text += "\n\n";
    }

    /// Says why there is no jump, and when there may be one again.
    pub fn decided(&mut self, time: &str, allowed: bool, riders: &[Rider], digits: Digits) {
        if allowed {
            if std::mem::take(&mut self.refused) {
                self.text += "m4gn: the surrogate may jump again\n\n";
            }
            return;
        }
        self.refused = true;
        for rider in riders {
            let [error, estimate] = rider.expected;
            let tolerance = rider.control.as_ref().map_or(f64::INFINITY, |c| c.settings().tolerance);
            let why = match estimate <= tolerance {
                true => "more than relTol of what the solver changed".to_string(),
                false => format!("and {} is expected of a step", digits.of(estimate)),
            };
            self.text += &format!(
                "m4gn: no jump at time {time}: the surrogate beside the solver was off by {} in a stride, {why}. The solver goes on\n\n",
                digits.of(error)
            );
        }
    }
}

impl Ride<'_> {
    /// Takes what there is to be said; empty: nothing. A table's first rows come with its head.
    pub fn take(&mut self, text: Text) -> String {
        let log = &mut self.log;
        let table = |head: &mut String, rows: &mut String| match rows.is_empty() {
            true => String::new(),
            false => std::mem::take(head) + &std::mem::take(rows),
        };
        match text {
            Text::Log => std::mem::take(&mut log.text),
            Text::Warning if log.warnings.is_empty() => String::new(),
            Text::Warning => log.warnings.remove(0),
            Text::Jumps => table(&mut log.jumps_head, &mut log.jumps),
            Text::Strides => table(&mut log.strides_head, &mut log.strides),
            // An observer's tables are there from its begin.
            Text::Errors => std::mem::take(&mut log.observed_head[0]) + &std::mem::take(&mut log.observed),
            Text::SegmentErrors => {
                std::mem::take(&mut log.observed_head[1]) + &std::mem::take(&mut log.segments)
            }
        }
    }

    /// A jump has ended.
    pub(crate) fn log_jump(&mut self, jump: &Jump, quantities: &[(String, f64)]) {
        let digits = self.digits();
        let rider = &self.riders[jump.surrogate];
        let (stride, source) = (rider.surrogate.stride(), rider.surrogate.source());
        let [surrogate, hand_over] = [0, 1].map(|i| self.totals.seconds[i] - jump.began[i]);
        let mut line = format!(
            "m4gn: jumped {} steps of {} s to time {} in {} s",
            jump.done,
            digits.of(stride),
            self.step.name,
            digits.of(surrogate + hand_over)
        );
        if self.riders.len() > 1 {
            line += &format!(" by {}", rider.surrogate.name());
        }
        for (name, value) in quantities {
            line += &format!("; {name} {}", digits.of(*value));
        }
        if let Some([error, estimate]) = jump.expected {
            line += &format!(
                "; a stride beside the solver was off by {}, {} is expected of the jump",
                digits.of(error),
                digits.of(estimate)
            );
        }
        self.log.text += &(line + "\n\n");
        if self.log.jumps_head.is_empty() && self.totals.rows == 0 {
            let mut names: Vec<String> =
                ["Time", "steps", "surrogate(s)", "handOver(s)"].map(String::from).into();
            names.extend(quantities.iter().map(|(name, _)| name.clone()));
            if jump.expected.is_some() {
                names.extend(["strideError", "estimate"].map(String::from));
            }
            self.log.jumps_head = digits.header(
                &[format!("Jumps of the surrogate {source}")],
                &[("stride (s)", digits.of(stride))],
                &names,
            );
        }
        self.totals.rows += 1;
        let mut columns = vec![
            digits.of(self.step.shown),
            jump.done.to_string(),
            digits.of(surrogate),
            digits.of(hand_over),
        ];
        columns.extend(quantities.iter().map(|(_, value)| digits.of(*value)));
        columns.extend(jump.expected.iter().flatten().map(|v| digits.of(*v)));
        self.log.jumps += &row(&columns);
    }
}
