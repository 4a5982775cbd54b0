//! Whether a surrogate fits, by how far its run came and how that ended.

use super::{CALLED, Report};
use crate::decisions::{Decision, last};
use crate::user_case::log;
use m4gn_base::Error;

/// Steps that a jump takes, and the solver's next ones.
const FEWEST: usize = 25;

/// What came of a surrogate.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Verdict {
    /// It has jumped, and the solver went on.
    Fits,
    /// It does not fit, and why.
    No(String),
    /// The run was ended before it could be told, and what is to be done.
    Open(String),
}

/// How the solver's run ended.
#[derive(Debug)]
pub(super) struct End<'a> {
    /// Of a long one both ends.
    pub log: &'a str,
    /// None: with status 0.
    pub failed: Option<&'a Error>,
    /// Whether it was ended since it took too long.
    pub late: bool,
    /// Wall time that it was to take, s.
    pub seconds: u64,
    pub decisions: &'a [Decision],
}

impl Verdict {
    pub fn of(report: &Report, end: &End, solver: &str) -> Self {
        let more = |seconds: f64| format!("give --seconds {}", (1.5 * seconds).ceil().max(2.0));
        if end.late {
            let seconds = 5.0 * end.seconds as f64;
            return Verdict::Open(format!(
                "{solver} was ended in step {} of those that a jump takes: {}",
                report.steps + 1,
                more(seconds)
            ));
        }
        if let Some(failed) = end.failed {
            let said = log::words(end.log, failed);
            return Verdict::No(match log::fatal(end.log) {
                Some((text, true)) => text,
                _ if report.jumped => format!("{solver} did not carry on from the jump: {said}"),
                _ => format!("{solver} itself ended in an error, before any jump: {said}"),
            });
        }
        let refused = |why: &str| last(end.decisions, "jump_ended").is_some_and(|d| d["why"] == why);
        let to_its_end = report.time > report.end_time - 0.5 * report.delta_t;
        let has_fit = last(end.decisions, "fit").is_some();
        let in_time = report.steps < report.most_steps && !to_its_end;
        match report {
            Report { jumped: true, steps_after: 1.., .. } => Verdict::Fits,
            r if r.surrogate.is_empty() => match log::dropped(end.log, CALLED) {
                Some(text) => Verdict::No(format!("{solver} goes on without the function object: {text}")),
                None if end.log.contains("Time = ") => {
                    Verdict::No(format!("{solver} executes no function objects"))
                }
                None => Verdict::Open(format!(
                    "{solver} made no time step: where the run begins at its end, give a later endTime, or startFrom startTime"
                )),
            },
            Report { steps: 0, .. } => Verdict::No(format!("{solver} made no time step")),
            r if r.steps < FEWEST && to_its_end => Verdict::No(format!(
                "the run ends after {} steps of {solver}, too few for a jump: expected at least {FEWEST}",
                r.steps
            )),
            r if r.steps < FEWEST => Verdict::Open(format!(
                "{} steps of {solver} in {} s were too few for a jump, which takes {FEWEST}: {}",
                r.steps,
                end.seconds,
                more((end.seconds as f64).max(r.wall) * FEWEST as f64 / r.steps as f64)
            )),
            // States are as far apart as its steps
            r if r.adjusts && r.time - r.start_time > 2.0 * r.steps as f64 * r.delta_t => {
                Verdict::Open(format!(
                    "there was no jump in {} steps of {solver} up to time {}, in which its time step grew: give a deltaT nearer to what it becomes, \
                 or a start at which it has grown",
                    r.steps, r.time
                ))
            }
            r if refused("not_finite") => Verdict::No(format!(
                "no jump was accepted in {} steps of {solver} up to time {}: what was predicted was not finite",
                r.steps, r.time
            )),
            r if refused("not_accepted") => Verdict::Open(format!(
                "no jump was accepted in {} steps of {solver} up to time {}: a stride would have changed a field by more than 3 times the most that \
                 the solver has in one, as where a flow starts up: give a start at which it has developed",
                r.steps, r.time
            )),
            r if has_fit || in_time => Verdict::Open(format!(
                "{} in {} steps of {solver} up to time {}: {}",
                if has_fit { "there was a fit, but no jump" } else { "there was no jump" },
                r.steps,
                r.time,
                match () {
                    () if to_its_end => "give a later endTime".into(),
                    () if in_time => more(2.0 * (end.seconds as f64).max(r.wall)),
                    () if r.adjusts => "give a deltaT nearer to what the time step becomes".into(),
                    () => "give a start at which its flow has developed".to_string(),
                }
            )),
            r => Verdict::No(format!(
                "there was no jump in {} steps of {solver} up to time {}: its fields do not change",
                r.steps, r.time
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(report: &Report, log: &str, failed: Option<&Error>, late: bool) -> Verdict {
        Verdict::of(report, &End { log, failed, late, seconds: 6, decisions: &[] }, "icoFoam")
    }

    fn no(report: &Report, log: &str) -> String {
        match of(report, log, None, false) {
            Verdict::No(why) => why,
            other => panic!("{other:?}"),
        }
    }

    /// A run to 1 s that came to `time` in so many steps.
    fn made(steps: usize, time: f64) -> Report {
        Report {
            surrogate: "dmd".into(),
            steps,
            most_steps: 100,
            time,
            end_time: 1.0,
            delta_t: 0.01,
            ..Report::default()
        }
    }

    #[test]
    fn an_error_is_told_as_the_solver_s_or_as_that_of_the_jump() {
        let failed = Error::file("log.icoFoam", "icoFoam failed (exit status: 1)");
        let before = of(&Report::default(), "--> FOAM FATAL ERROR:\nno U\n\n From x\n", Some(&failed), false);
        assert_eq!(before, Verdict::No("icoFoam itself ended in an error, before any jump: no U".into()));
        let after = of(&Report { jumped: true, ..made(3, 0.1) }, "Time = 3", Some(&failed), false);
        assert!(
            matches!(after, Verdict::No(why) if why.contains("did not carry on") && why.contains("status: 1"))
        );
    }

    #[test]
    fn a_run_that_ends_well_may_not_have_jumped() {
        assert!(no(&Report::default(), "Time = 1\n").contains("executes no function objects"));
        let ended = of(&Report::default(), "Create mesh for time = 1\nEnd\n", None, false);
        assert!(matches!(&ended, Verdict::Open(what) if what.contains("a later endTime")), "{ended:?}");
        let regions = "--> FOAM Warning : \n\n    no region0\n\n    From x\n--> while loading function object 'surrogate'\n";
        assert_eq!(
            no(&Report::default(), regions),
            "icoFoam goes on without the function object: no region0"
        );
        assert!(no(&made(0, 0.0), "").contains("no time step"));
        assert!(no(&made(9, 1.0), "").contains("ends after 9 steps of icoFoam, too few"));
        assert!(no(&made(100, 0.5), "").contains("no jump in 100 steps"));
        let jumped = Report { jumped: true, steps_after: 5, ..made(30, 0.3) };
        assert_eq!(of(&jumped, "", None, false), Verdict::Fits);
    }

    #[test]
    fn a_run_that_only_needs_more_time_is_not_said_not_to_fit() {
        let slow = of(&Report { wall: 6.0, ..made(5, 0.05) }, "", None, false);
        assert!(matches!(&slow, Verdict::Open(what) if what.ends_with("give --seconds 45")), "{slow:?}");
        let failed = Error::file("log.icoFoam", "icoFoam was ended after 240 s (--timeout)");
        let late = of(&Report::default(), "", Some(&failed), true);
        assert!(matches!(&late, Verdict::Open(what) if what.ends_with("give --seconds 45")), "{late:?}");
        // Steps of 1e-4 s that grow
        let grows = Report { adjusts: true, delta_t: 1e-4, ..made(100, 0.5) };
        assert!(
            matches!(of(&grows, "", None, false), Verdict::Open(what) if what.contains("time step grew"))
        );
        assert!(no(&Report { adjusts: true, ..made(100, 0.99) }, "").contains("do not change"));
        let few = of(&made(60, 0.6), "", None, false);
        assert!(matches!(&few, Verdict::Open(what) if what.ends_with("give --seconds 18")), "{few:?}");
        let decided = |event: &str, why: &str, time: f64| {
            let decisions = [serde_json::json!({ "time": 0.5, "event": event, "why": why })];
            let end = End { log: "", failed: None, late: false, seconds: 6, decisions: &decisions };
            match Verdict::of(&Report { adjusts: true, ..made(100, time) }, &end, "icoFoam") {
                Verdict::Open(what) | Verdict::No(what) => what,
                other => panic!("{other:?}"),
            }
        };
        assert!(
            decided("jump_ended", "not_accepted", 0.5).ends_with("give a start at which it has developed")
        );
        assert!(decided("jump_ended", "not_finite", 0.5).ends_with("what was predicted was not finite"));
        assert!(decided("fit", "settled", 0.5).contains(
            "there was a fit, but no jump in 100 steps of icoFoam up to time 0.5: give a deltaT nearer"
        ));
        assert!(decided("fit", "settled", 1.0).ends_with("up to time 1: give a later endTime"));
    }
}
