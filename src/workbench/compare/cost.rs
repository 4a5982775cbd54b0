//! What two runs took: whole, with start-up and loading, over the simulated time that both have, and then after the takeover.

use super::Options;
use super::log::{Clock, Log};
use crate::foam_case::FoamCase;
use m4gn_base::Result;
use m4gn_report::{Table, number, percent, seconds};
use serde::Serialize;
use std::path::Path;

/// Seconds of A and B by the same clock.
pub type Pair = [Option<f64>; 2];

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
            Log::read(Path::new(&d.path), &d.application)
        });
        let cost = match (a, b) {
            (Some(a), Some(b)) => Cost::of_logs(&a, &b, takeover),
            _ => Cost::default(),
        };
        Cost {
            wall_a: options.wall_a.or(cost.wall_a),
            wall_b: options.wall_b.or(cost.wall_b),
            wall_measured: options.wall_a.is_some() && options.wall_b.is_some(),
            ..cost
        }
    }

    fn of_logs(a: &Log, b: &Log, takeover: f64) -> Self {
        let whole = |log: &Log| -> Result<()> { log.check_ended() };
        if let Err(e) = whole(a).and_then(|()| whole(b)) {
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
        let wall = |clock: Clock| clock.wall;
        Cost {
            span: Some([from, to]),
            wall_a: wall(whole_a),
            wall_b: wall(whole_b),
            processor_a: Some(whole_a.processor),
            processor_b: Some(whole_b.processor),
            processor_after_a: after(a),
            processor_after_b: after(b),
            ..Cost::default()
        }
    }

    /// Wall seconds, processor seconds, and those after the takeover.
    pub fn pairs(&self) -> [Pair; 3] {
        [
            [self.processor_a, self.processor_b],
            [self.wall_a, self.wall_b],
            [self.processor_after_a, self.processor_after_b],
        ]
    }

    /// The whole runs first, then the stretch in which the surrogate rides.
    pub fn table(&self) -> Table {
        let mut table = Table::new(["", "full", "hybrid", "of the full run's"]);
        let wall = match self.wall_measured {
            true => "whole run: wall time [s]",
            false => "whole run: wall time [s], whole seconds",
        };
        let names = ["whole run: processor time [s]", wall, "after the takeover: processor time [s]"];
        for (name, pair) in names.into_iter().zip(self.pairs()) {
            let [a, b] = pair.map(|v| v.map_or("-".into(), |v| number(v, 4)));
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

/// "25.0 %, 4.00 x as fast".
fn share(pair: Pair) -> String {
    match pair {
        [Some(a), Some(b)] if a > 0.0 && b > 0.0 => {
            format!("{}, {} x as fast", percent(Some(b / a)), number(a / b, 3))
        }
        _ => "-".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(start: f64, steps: &[(f64, f64)], ended: bool) -> Log {
        let clock = |(time, processor): &(f64, f64)| {
            (*time, Clock { processor: *processor, wall: Some(processor.ceil()) })
        };
        Log { path: "log.icoFoam".into(), start, steps: steps.iter().map(clock).collect(), ended }
    }

    /// The full run goes on to 9 s, the other ends at 3 s: what the full run took for 3 s counts.
    #[test]
    fn the_same_span_counts() {
        let full = log(0.0, &[(1.0, 10.0), (3.0, 30.0), (9.0, 90.0)], true);
        let hybrid = log(0.0, &[(1.0, 11.0), (3.0, 15.0)], true);
        let cost = Cost::of_logs(&full, &hybrid, 1.0);
        assert_eq!(cost.span, Some([0.0, 3.0]));
        assert_eq!(cost.pairs()[0], [Some(30.0), Some(15.0)]);
        assert_eq!(cost.pairs()[2], [Some(20.0), Some(4.0)]);
        assert!(cost.table().to_string().contains("50.0 %, 2.00 x as fast"));
        // One that began from the full run's fields at 1 s
        let late = log(1.0, &[(3.0, 5.0)], true);
        let cost = Cost::of_logs(&full, &late, 1.0);
        assert_eq!((cost.span, cost.pairs()[0]), (Some([1.0, 3.0]), [Some(20.0), Some(5.0)]));
    }

    #[test]
    fn a_run_that_did_not_end_has_no_times() {
        let full = log(0.0, &[(1.0, 10.0), (9.0, 90.0)], true);
        let crashed = log(0.0, &[(1.0, 0.8)], false);
        let cost = Cost::of_logs(&full, &crashed, 0.5);
        assert_eq!(cost.pairs(), [[None; 2]; 3]);
        assert!(cost.note().unwrap().contains("no line 'End'"));
        assert!(!cost.table().to_string().contains(" x "));
    }
}
