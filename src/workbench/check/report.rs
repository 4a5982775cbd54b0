//! What the function object m4gnSurrogate in mode check has said of a case, and what follows from it.

use crate::generate::parameter::short;
use m4gn_report::number;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// States of a fit where the run is long enough for them: the default.
pub const WINDOW: usize = 40;

/// States of a fit of a shorter run; and those that are kept beside.
const LEAST: usize = 24;
const BESIDE: usize = 11;

/// States in a run that leave room for a window and jumps.
const STATES: f64 = 100.0;

/// States in the time in which a harmonic vibration goes from its mean by its root mean square: a fifteenth of its period.
const PER_SCALE: f64 = 0.4;

/// Most that a time scale may be of the time that was watched for it: a vibration that was watched for a period has 0.16, a straight line 0.29.
const SEEN: f64 = 0.2;

/// A patch.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
pub struct Patch {
    /// Type in the mesh.
    #[serde(rename = "type")]
    pub kind: String,
    /// Node type in a network's graph; none: it carries no values.
    pub node_type: String,
}

/// What the function object has written so far; what it has not come to is as by default.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(default)]
pub struct Report {
    /// dmd, network.
    pub surrogate: String,
    /// Cells of all ranks.
    pub cells: usize,
    /// Ranks.
    pub ranks: usize,
    /// The solver's time step when the surrogate was made, s.
    pub delta_t: f64,
    /// Whether the solver changes its time step.
    pub adjusts: bool,
    /// Where the run starts, s.
    pub start_time: f64,
    /// Where it ends, s.
    pub end_time: f64,
    /// Steps without a jump after which the check ends the run.
    pub most_steps: usize,
    /// Where the check ended, s.
    pub time: f64,
    /// Fields that the surrogate advances. Empty: it was not made.
    pub handed_over: Vec<String>,
    /// Fields that the solver keeps beside, which go with them.
    pub beside: Vec<String>,
    /// Fields that stay as they are in a jump.
    pub frozen: Vec<String>,
    /// Numbers of a state on all ranks.
    pub numbers: f64,
    /// Patches.
    pub patches: BTreeMap<String, Patch>,
    /// Why a network's graph has no node types.
    pub types_refused: String,
    /// Whether there was a jump.
    pub jumped: bool,
    /// Steps of the solver, and those after the jump.
    pub steps: usize,
    /// Steps after the jump.
    pub steps_after: usize,
    /// Wall time of them but the first, s.
    pub wall: f64,
    /// Memory of all ranks when the function object was made, and when the solver had taken over again, bytes.
    pub memory_before: f64,
    /// The latter.
    pub memory_after: f64,
    /// For each field that a fit is made of: the root mean square of what it was off from its mean while it was watched, over that of its
    /// rate of change, s.
    pub scales: BTreeMap<String, f64>,
    /// For how long they were watched, s.
    pub watched: f64,
}

/// A setting of the dmd surrogate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Suggestion {
    /// Time between states, s.
    pub interval: f64,
    /// States in a fit.
    pub window: usize,
    /// Why.
    pub why: String,
}

impl Suggestion {
    /// As entries of m4gnSurrogate.
    pub fn entries(&self) -> String {
        let window = match self.window < WINDOW {
            true => format!(" window {0}; minSnapshots {0};", self.window),
            false => String::new(),
        };
        format!("dmd {{ snapshotInterval {};{window} }}", self.interval)
    }
}

impl Report {
    /// Wall time of a time step, s; none: there was but the first one.
    pub fn a_step(&self) -> Option<f64> {
        (self.steps > 1).then(|| self.wall / (self.steps - 1) as f64)
    }

    /// The memory of a window of the dmd surrogate on all ranks, bytes; less where arrays do not change.
    pub fn window_memory(&self, window: usize) -> f64 {
        8.0 * self.numbers * (window + BESIDE) as f64
    }

    /// Time between states and window, from the run's length and from how fast the fields changed while they were watched; none: the run is
    /// too short for a window and a jump.
    pub fn suggestion(&self) -> Option<Suggestion> {
        let (run, step) = (self.end_time - self.start_time, self.delta_t);
        let by_run = run / STATES;
        let scale = self.scales.values().copied().fold(f64::INFINITY, f64::min);
        let seen = scale < SEEN * self.watched;
        let wanted = if seen { by_run.min(PER_SCALE * scale) } else { by_run };
        // Of steps that change none is met: states are interpolated between two.
        let interval = match self.adjusts {
            true => format!("{wanted:.1e}").parse().unwrap_or(wanted).max(step),
            false => (wanted / step + 1e-6).floor().max(1.0) * step,
        };
        let states = run / interval;
        if !(states.is_finite() && states >= 2.0 * LEAST as f64) {
            return None;
        }
        let why = match seen && PER_SCALE * scale < by_run {
            true => format!("the fields change within {} s", number(scale, 3)),
            false if seen => "a hundredth of the run, well within the time in which the fields change".into(),
            false => {
                let watched = match self.watched > 0.0 {
                    true => format!(
                        " in {} s that were watched no field went to and fro:",
                        number(self.watched, 3)
                    ),
                    false => String::new(),
                };
                format!(
                    "a hundredth of the run;{watched} a tenth to a twentieth of the period is better where it is known"
                )
            }
        };
        // Without the noise of its last digits
        let interval = short(interval, [0.0, interval]);
        Some(Suggestion { interval, window: if states >= STATES { WINDOW } else { LEAST }, why })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(end: f64, scale: f64, watched: f64) -> Report {
        let scales = [("U".to_string(), scale)].into();
        Report { delta_t: 0.002, end_time: end, scales, watched, numbers: 1e6, ..Report::default() }
    }

    #[test]
    fn a_run_and_its_time_scale_say_the_interval() {
        // A period of 0.6 s that was seen: 0.04 s of the 9 s.
        let seen = report(9.0, 0.6 / (2.0 * std::f64::consts::PI), 0.6).suggestion().unwrap();
        assert_eq!((seen.interval, seen.window), (0.038, 40));
        assert!(seen.why.contains("change within"), "{}", seen.why);
        // A straight line of 0.2 s says nothing.
        let line = report(9.0, 0.29 * 0.2, 0.2).suggestion().unwrap();
        assert_eq!((line.interval, line.window), (0.09, 40));
        assert!(line.why.contains("to and fro"), "{}", line.why);
        let adjusts = Report { adjusts: true, ..report(1.234, 1.0, 0.1) };
        assert_eq!(adjusts.suggestion().unwrap().interval, 0.012);
        assert_eq!(report(0.15, 1.0, 0.1).suggestion().unwrap().window, 24);
        assert_eq!(report(0.02, 1.0, 0.1).suggestion(), None);
        assert_eq!(report(0.0, 1.0, 0.1).suggestion(), None);
    }

    #[test]
    fn a_window_takes_its_states() {
        assert_eq!(report(1.0, 1.0, 1.0).window_memory(40), 8.0 * 1e6 * 51.0);
    }

    #[test]
    fn what_was_not_come_to_is_empty() {
        let early: Report =
            serde_json::from_str(r#"{"surrogate": "dmd", "cells": 4, "jumped": true}"#).unwrap();
        assert!(early.handed_over.is_empty() && early.jumped && early.cells == 4);
    }
}
