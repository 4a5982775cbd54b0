//! What two runs took: whole, with start-up and loading, over the simulated time that both have, and then after the takeover.

use super::Options;
use super::log::Log;
use crate::foam_case::FoamCase;
use m4gn_report::{Table, figure, number, percent, seconds};
use serde::Serialize;
use std::path::Path;

/// What two runs took.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cost {
    /// Simulated times between which the logs of both runs are compared, s; none without two logs that came to their end.
    pub span: Option<[f64; 2]>,
    /// Wall seconds of A over the span, or as given.
    pub wall_a: Option<f64>,
    /// Wall seconds of B.
    pub wall_b: Option<f64>,
    /// Whether both were given; the logs have whole seconds.
    pub wall_measured: bool,
    /// Processor seconds of A over the span: `ExecutionTime` of its log, of the first rank and all its threads, in hundredths.
    pub processor_a: Option<f64>,
    /// The same of B.
    pub processor_b: Option<f64>,
    /// Processor seconds of A from the takeover to the end of the span.
    pub processor_after_a: Option<f64>,
    /// The same of B.
    pub processor_after_b: Option<f64>,
    /// Why the logs say nothing; none where they do.
    pub without_logs: Option<String>,
}

impl Cost {
    pub(super) fn of(a: &FoamCase, b: &FoamCase, takeover: f64, options: &Options) -> Self {
        let [a, b] = [a, b].map(|case| {
            let d = case.description();
            Log::read(Path::new(&d.path), &d.application).ok_or_else(|| {
                format!(
                    "expected lines 'ExecutionTime = .. s' in {}/log.{}, found none",
                    d.path, d.application
                )
            })
        });
        let cost = match (a, b) {
            (Ok(a), Ok(b)) => Cost::of_logs(&a, &b, takeover),
            (Err(why), _) | (_, Err(why)) => Cost { without_logs: Some(why), ..Cost::default() },
        };
        Cost {
            wall_a: options.wall_a.or(cost.wall_a),
            wall_b: options.wall_b.or(cost.wall_b),
            wall_measured: options.wall_a.is_some() && options.wall_b.is_some(),
            ..cost
        }
    }

    fn of_logs(a: &Log, b: &Log, takeover: f64) -> Self {
        if let Err(e) = a.check_ended().and_then(|()| b.check_ended()) {
            return Cost { without_logs: Some(e.to_string()), ..Cost::default() };
        }
        let (from, to) = (a.start.max(b.start), a.end().min(b.end()));
        if from >= to {
            return Cost {
                without_logs: Some(format!(
                    "{} and {} have no simulated time in common",
                    a.path.display(),
                    b.path.display()
                )),
                ..Cost::default()
            };
        }
        let [whole_a, whole_b] = [a, b].map(|log| log.between(from, to));
        let after = |log: &Log| (takeover >= from).then(|| log.between(takeover, to).processor);
        Cost {
            span: Some([from, to]),
            wall_a: whole_a.wall,
            wall_b: whole_b.wall,
            processor_a: Some(whole_a.processor),
            processor_b: Some(whole_b.processor),
            processor_after_a: after(a),
            processor_after_b: after(b),
            ..Cost::default()
        }
    }

    /// The whole runs first, then the stretch in which the surrogate rides.
    pub fn table(&self) -> Table {
        let mut table = Table::new(["", "full", "hybrid", "of the full run's"]);
        let wall = match self.wall_measured {
            true => "whole run: wall time [s]",
            false => "whole run: wall time [s], whole seconds",
        };
        let rows = [
            ("whole run: processor time [s]", [self.processor_a, self.processor_b]),
            (wall, [self.wall_a, self.wall_b]),
            ("after the takeover: processor time [s]", [self.processor_after_a, self.processor_after_b]),
        ];
        for (name, pair) in rows {
            let [a, b] = pair.map(|v| figure(v, 4));
            table.row([name.to_string(), a, b, share(pair)]);
        }
        table
    }

    /// Over which simulated time the logs are compared, or why they are not.
    pub fn note(&self) -> Option<String> {
        let span = self.span.map(|[from, to]| {
            format!(
                "times of the logs from {} to {} s of both runs, with start-up and loading",
                seconds(from),
                seconds(to)
            )
        });
        span.or_else(|| self.without_logs.as_ref().map(|why| format!("no times of the logs: {why}")))
    }
}

/// Of seconds of A and B by the same clock: "25.0 %, 4.00 x as fast".
fn share(pair: [Option<f64>; 2]) -> String {
    match pair {
        [Some(a), Some(b)] if a > 0.0 && b > 0.0 => {
            format!("{}, {} x as fast", percent(Some(b / a)), number(a / b, 3))
        }
        _ => "-".into(),
    }
}
