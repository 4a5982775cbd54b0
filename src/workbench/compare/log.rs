//! The log of a solver: what its time steps took, and whether it came to its end.

use m4gn_base::{Error, Result, files};
use std::path::{Path, PathBuf};

/// What a run took since its start, as its log says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clock {
    /// Processor seconds of the first rank, its threads included, in hundredths (`ExecutionTime`).
    pub processor: f64,
    /// Wall time in whole seconds (`ClockTime`).
    pub wall: Option<f64>,
}

/// The clock at the end of each time step of a run.
#[derive(Clone, Debug)]
pub struct Log {
    /// The file.
    pub path: PathBuf,
    /// Simulated time that the run began from, s.
    pub start: f64,
    /// Simulated time, s, and clock of each step; more than one process may have written the log.
    pub steps: Vec<(f64, Clock)>,
    /// Whether the solver said `End`.
    pub ended: bool,
}

impl Log {
    /// Reads `log.APPLICATION` of a case; none where there is no such log, or no step in it.
    pub fn read(case: &Path, application: &str) -> Option<Self> {
        if application.is_empty() {
            return None;
        }
        let path = case.join(format!("log.{application}"));
        let text = files::read(&path).ok()?;
        Log::parse(path, &String::from_utf8_lossy(&text))
    }

    fn parse(path: PathBuf, text: &str) -> Option<Self> {
        // Newer versions write the unit behind the time: 2s
        let number = |text: &str| text.split_whitespace().next()?.trim_end_matches('s').parse::<f64>().ok();
        let (mut time, mut said, mut ended) = (f64::NEG_INFINITY, None, false);
        let (mut steps, mut before): (Vec<(f64, Clock)>, _) = (Vec::new(), Clock::default());
        let mut last = 0.0;
        for line in text.lines().map(str::trim) {
            // solidDisplacementFoam says Iteration
            let begins = line.strip_prefix("Iteration:");
            let begins = begins.or_else(|| line.strip_prefix("Time")?.trim_start().strip_prefix('='));
            if let Some(t) = begins.and_then(number).filter(|t| t.is_finite()) {
                (time, ended) = (t, false);
            }
            let seconds = |key: &str| {
                let rest = line[line.find(key)? + key.len()..].trim_start();
                number(rest.strip_prefix('=')?)
            };
            if line.starts_with("ExecutionTime")
                && let Some(processor) = seconds("ExecutionTime")
            {
                // Another process goes on in the same log
                if processor < last {
                    before = steps.last().map_or(before, |s| s.1);
                }
                last = processor;
                let wall = seconds("ClockTime").map(|w| before.wall.unwrap_or(0.0) + w);
                steps.push((time, Clock { processor: before.processor + processor, wall }));
            }
            if let Some(rest) = line.strip_prefix("Create mesh for time =") {
                said = said.or_else(|| rest.trim().parse().ok());
                // A process begins, whose first step may take longer than all of the one before
                last = f64::INFINITY;
            }
            ended |= line == "End";
        }
        let (first, second) = (steps.first()?.0, steps.get(1).map(|s| s.0));
        let start = said.unwrap_or_else(|| first - (second.unwrap_or(first) - first).max(0.0));
        Some(Log { path, start, steps, ended })
    }

    /// The clock when the run had come to a simulated time, s: zero before its first step.
    pub fn at(&self, time: f64) -> Clock {
        let slack = 1e-6 * time.abs().max(1e-6);
        let done = self.steps.iter().rfind(|(t, _)| *t <= time + slack);
        done.map_or(Clock { processor: 0.0, wall: Some(0.0) }, |s| s.1)
    }

    /// The last simulated time, s.
    pub fn end(&self) -> f64 {
        self.steps.last().map_or(self.start, |s| s.0)
    }

    /// Between two simulated times, s.
    pub fn between(&self, from: f64, to: f64) -> Clock {
        let (a, b) = (self.at(from), self.at(to));
        Clock { processor: b.processor - a.processor, wall: a.wall.zip(b.wall).map(|(a, b)| b - a) }
    }

    /// Fails for a log whose solver did not say `End`.
    ///
    /// # Errors
    /// [`Error::File`] naming it.
    pub fn check_ended(&self) -> Result<()> {
        match self.ended {
            true => Ok(()),
            false => Err(Error::file(
                &self.path,
                "has no line 'End': the run crashed, was stopped or goes on, and its time says nothing",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(text: &str) -> Option<Log> {
        Log::parse("log.icoFoam".into(), text)
    }

    #[test]
    fn clocks_of_a_log() {
        let found = log(
            "Time = 1\nExecutionTime = 0.5 s  ClockTime = 0 s\n\nTime = 2s\nExecutionTime = 1.86 s  ClockTime = 4 s\n\nEnd\n",
        )
        .unwrap();
        assert!(found.ended && found.check_ended().is_ok());
        let (processor, wall) = (1.86, Some(4.0));
        assert_eq!(found.at(2.0), Clock { processor, wall });
        assert_eq!((found.start, found.end()), (0.0, 2.0));
        assert!((found.between(1.0, 2.0).processor - 1.36).abs() < 1e-12);
        assert_eq!(found.between(0.5, 9.0).processor, 1.86);
        // solidDisplacementFoam's; it did not come to its end
        let text =
            "Iteration: 1\n\nExecutionTime = 0.5 s  ClockTime = 0 s\n\nIteration: 2\n\nExecutionTime = 2 s\n";
        let found = log(text).unwrap();
        assert_eq!(found.between(1.0, 2.0), Clock { processor: 1.5, wall: None });
        assert!(found.check_ended().unwrap_err().to_string().contains("no line 'End'"));
        assert!(log("no times\n").is_none() && log("").is_none());
    }

    /// A run that was stopped and carried on with `>>`: what both processes took counts.
    #[test]
    fn a_log_of_two_processes() {
        let text = "Create mesh for time = 3\n\nTime = 4\nExecutionTime = 5 s  ClockTime = 6 s\nCreate mesh for time = 4\n\
             Time = 5\nExecutionTime = 2 s  ClockTime = 3 s\nEnd\n";
        let found = log(text).unwrap();
        assert_eq!((found.start, found.end()), (3.0, 5.0));
        assert_eq!(found.at(5.0), Clock { processor: 7.0, wall: Some(9.0) });
        // The later one loads for longer than the first has run
        let found = log(&text.replace("= 2 s  ClockTime = 3", "= 8 s  ClockTime = 9")).unwrap();
        assert_eq!(found.at(5.0), Clock { processor: 13.0, wall: Some(15.0) });
    }
}
