//! What a ride has to say: lines of the log, warnings, rows of its tables. The host takes them and puts them where they belong.

use crate::decisions::Decisions;
use crate::jump::Jump;
use crate::ride::Ride;
use crate::schedule::Step;
use crate::tables::row;
use crate::watch::Judgement;
use serde_json::{Map, Value, json};

/// What has not been taken yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Log {
    pub text: String,
    pub warnings: Vec<String>,
    /// Whether the last jump was not allowed.
    pub refused: bool,
    /// Whether a stride that is shorter than the solver's time step was told.
    pub short: bool,
    pub jumps: Table,
    /// Names of the quantities that are its columns.
    pub quantities: Vec<String>,
    pub strides: Table,
    pub modes: Table,
    pub observed: String,
    pub segments: String,
}

/// A table whose head comes with its first rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Table {
    pub begun: bool,
    pub text: String,
}

impl Table {
    pub fn begin(&mut self, head: String) {
        (self.begun, self.text) = (true, head);
    }
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
    /// The table of the modes of fits that are used, a row for each.
    Modes,
}

impl Log {
    /// What is left of the next jumps after this one, by the solver's correctors or by quantities.
    pub fn judged(&mut self, step: &Step, by: &str, judgement: Option<Judgement>, decisions: &mut Decisions) {
        if let Some(Judgement { note, warning, decided }) = judgement {
            self.text += &note;
            self.warnings.extend(warning);
            decisions.tell(step, by, &decided);
        }
    }

    /// No jump of a stride that is shorter than a step of the solver, which saves nothing: told once.
    pub fn short_stride(&mut self, time: &str, source: &str, [stride, delta_t]: [String; 2]) {
        if !std::mem::replace(&mut self.short, true) {
            self.warnings.push(format!(
                "At time {time}: the stride of {source}, {stride} s, is shorter than the solver's time step, {delta_t} s: it does not jump \
                 while that is so; give the solver a smaller maxDeltaT, or take a model with a longer stride"
            ));
        }
    }

    pub fn not_finite(&mut self, time: &str, bad: Option<String>) {
        self.warnings.extend(bad.map(|what| format!("At time {time}: {what}")));
    }
}

impl Ride<'_> {
    /// Takes what there is to be said; empty: nothing. A table's first rows come with its head.
    pub fn take(&mut self, text: Text) -> String {
        let log = &mut self.log;
        log.warnings.extend(self.decisions.failed.take());
        match text {
            Text::Warning if log.warnings.is_empty() => String::new(),
            Text::Warning => log.warnings.remove(0),
            Text::Log => std::mem::take(&mut log.text),
            Text::Jumps => std::mem::take(&mut log.jumps.text),
            Text::Strides => std::mem::take(&mut log.strides.text),
            Text::Modes => std::mem::take(&mut log.modes.text),
            Text::Errors => std::mem::take(&mut log.observed),
            Text::SegmentErrors => std::mem::take(&mut log.segments),
        }
    }

    /// Fits that are used from this time on: a row for each of their modes.
    pub(crate) fn log_modes(&mut self) {
        let (digits, time) = (self.digits(), self.step.output_time);
        let fits = self.candidates.iter_mut().filter_map(|c| c.surrogate.fits_mut());
        for mode in fits.flat_map(|fits| std::mem::take(&mut fits.control.modes)) {
            if !self.log.modes.begun {
                let names =
                    ["Time", "frequency(Hz)", "growthRate(1/s)", "amplitude", "energy"].map(String::from);
                self.log.modes.begin(digits.header(&["Modes of the fits that are used".into()], &[], &names));
            }
            let figures = [time, mode.frequency, mode.growth_rate, mode.amplitude, mode.energy];
            self.log.modes.text += &row(&figures.map(|v| digits.of(v)));
        }
    }

    /// A jump has ended, for the decisions: its strides, the seconds of the surrogate and of handing over, and results of other function objects.
    fn tell_back(
        &mut self,
        surrogate: usize,
        strides: usize,
        seconds: [f64; 2],
        quantities: &[(String, f64)],
    ) {
        let quantities: Map<String, Value> =
            quantities.iter().map(|(name, v)| (name.clone(), json!(v))).collect();
        let decided = json!({
            "surrogate": self.candidates[surrogate].describe().name, "strides": strides, "surrogate_seconds": seconds[0],
            "hand_over_seconds": seconds[1], "quantities": quantities,
        });
        self.decisions.tell(&self.step, "handed_back", &decided);
    }

    /// A jump that another run made has ended at the time that this one goes on from: what was told of it behind that state is dropped.
    pub(crate) fn tell_back_at_restart(&mut self, surrogate: usize) {
        self.tell_back(surrogate, self.totals.last_jump(), [0.0; 2], &[]);
    }

    /// A jump has ended.
    pub(crate) fn log_jump(&mut self, jump: &Jump, quantities: &[(String, f64)]) {
        let digits = self.digits();
        let jumper = self.candidates[jump.surrogate].describe();
        let stride = jumper.stride;
        let [surrogate, hand_over] = [0, 1].map(|i| self.totals.seconds[i] - jump.began[i]);
        let mut line = format!(
            "m4gn: jumped {} steps of {} s to time {} in {} s",
            jump.done,
            digits.of(stride),
            self.step.name,
            digits.of(surrogate + hand_over)
        );
        if self.candidates.len() > 1 {
            line += &format!(" by {}", jumper.name);
        }
        for (name, value) in quantities {
            line += &format!("; {name} {}", digits.of(*value));
        }
        if let Some(cut) = &jump.cut {
            line += &format!("; ended early: {cut}");
        }
        if let Some([error, estimate]) = jump.expected {
            line += &format!(
                "; a stride beside the solver had an error of {}, {} is expected of the jump",
                digits.of(error),
                digits.of(estimate)
            );
        }
        self.log.text += &(line + "\n\n");
        if !self.log.jumps.begun {
            let mut names: Vec<String> =
                ["Time", "steps", "surrogate(s)", "handOver(s)"].map(String::from).into();
            self.log.quantities = quantities.iter().map(|(name, _)| name.clone()).collect();
            names.extend(self.log.quantities.clone());
            if self.candidates.len() > 1 {
                names.push("surrogate".into());
            }
            if self.settings.control.is_some() {
                names.extend(["strideError", "estimate"].map(String::from));
            }
            let lines =
                self.candidates.iter().map(|c| format!("Jumps of the surrogate {}", c.describe().source));
            let strides = self.candidates.iter().map(|c| ("stride (s)", digits.of(c.stride())));
            let head = digits.header(&lines.collect::<Vec<_>>(), &strides.collect::<Vec<_>>(), &names);
            self.log.jumps.begin(head);
        }
        let mut columns = vec![
            digits.of(self.step.output_time),
            jump.done.to_string(),
            digits.of(surrogate),
            digits.of(hand_over),
        ];
        let of = |name: &String| quantities.iter().find(|q| q.0 == *name).map_or(f64::NAN, |q| q.1);
        columns.extend(self.log.quantities.iter().map(|name| digits.of(of(name))));
        if self.candidates.len() > 1 {
            columns.push(jumper.name.clone());
        }
        if self.settings.control.is_some() {
            // Nothing is expected of what cuts a start-up short
            columns.extend(jump.expected.unwrap_or([f64::NAN; 2]).map(|v| digits.of(v)));
        }
        self.log.jumps.text += &row(&columns);
        self.tell_back(jump.surrogate, jump.done, [surrogate, hand_over], quantities);
    }
}
