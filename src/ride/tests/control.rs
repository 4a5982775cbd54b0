use super::hosting::{Event::*, Host, ride};
use crate::toy::{self, Toy};
use m4gn_samples::fails;

/// With a tolerance, and more entries.
fn settings(control: &str) -> String {
    format!(
        r#"{{"mode": "replace", "solverSteps": 5, "surrogateSteps": 4, "timeStart": 1, "control": {{{control}}}}}"#
    )
}

#[test]
fn jumps_are_as_long_as_the_measured_error_allows() {
    // Both components are off by 0.01 in a stride. The field's variation is the largest that a stride has ended with: half of the difference
    // of its components, or their change, at 1 s, where the first stride that began after 0 s ends.
    let toy = || Toy::new(0.5).biased(0.01);
    let tolerance = 0.06;
    let mut host = Host::ran(&settings(r#""tolerance": 0.06"#), toy(), 6.0);
    let (begin, end) = (toy::solver(0.5), toy::solver(1.0));
    let change = toy::rms_of(&[end[0] - begin[0], end[1] - begin[1]]);
    let variation = change.max((end[0] - end[1]).abs() / 2.0);
    let most = (tolerance / (0.01 / variation)).floor() as usize;
    assert!((2..4).contains(&most), "{most}");
    assert_eq!(host.events[..2], [Solved(10), Jumped(0, most)]);
    // Each stride that was measured is a row and a line, whether a jump followed or not.
    let rows = host.tables[1].lines().filter(|l| !l.starts_with('#')).count();
    let lines = host.log.matches("the surrogate beside the solver had an error of").count();
    let summary = host.ride.end();
    assert!(rows > 2 && rows == lines, "{rows} {lines}");
    // What was measured before the solver had made its five steps was decided on then.
    assert!(summary.contains(&format!("\"strides_measured\": {},", rows - 1)), "{summary} {rows}");
    assert!(summary.contains("\"jumps_refused\": 0,"), "{summary}");
    assert!(host.log.contains("; a stride beside the solver had an error of 0.0"), "{}", host.log);
    assert!(host.log.contains("does not say how its errors of a grow"), "{}", host.log);
    let row: Vec<&str> = host.tables[1].lines().last().unwrap().split('\t').collect();
    assert_eq!((row[1], row.len()), ("toy", 7));
    assert!(host.tables[1].contains("error(a)"), "{}", host.tables[1]);
}

#[test]
fn growth_that_is_known_is_heeded() {
    // 0.02 times 1, 3 and 9.
    let toy = Toy::new(0.5).biased(0.01).growing(&[1.0, 3.0, 9.0]);
    let host = Host::ran(&settings(r#""tolerance": 0.1"#), toy, 4.0);
    assert_eq!(host.events[1], Jumped(0, 2));
    assert!(!host.log.contains("does not say how"), "{}", host.log);
}

#[test]
fn a_bad_surrogate_leaves_the_run_to_the_solver_and_each_refusal_is_said() {
    let toy = Toy::new(0.5).biased(0.5);
    let mut host = Host::ran(&settings(r#""tolerance": 0.02"#), toy, 6.0);
    assert_eq!(host.events, [Solved(60)]);
    assert_eq!(host.state[0], (0..60).fold(toy::solver(0.0), |s, _| toy::later(s, 0.1)), "to the bit");
    let refused = host.log.matches("m4gn: no jump at time").count();
    assert!(refused > 5, "{refused}");
    assert!(host.log.contains("is expected of a step. The solver goes on"), "{}", host.log);
    assert!(host.ride.end().contains(&format!("\"jumps_refused\": {refused},")));
}

#[test]
fn it_may_jump_again_where_it_becomes_good() {
    // Off by a half from states whose second component is above 1.2, good below.
    let toy = Toy::new(0.5).jumping(1.2, 0.5);
    let host = Host::ran(&settings(r#""tolerance": 0.02"#), toy, 12.0);
    assert!(host.log.contains("no jump at time") && host.log.contains("may jump again"), "{}", host.log);
    assert!(host.events.iter().any(|e| matches!(e, Jumped(..))));
}

#[test]
fn rel_tol_is_named_where_it_refuses() {
    let toy = Toy::new(0.5).biased(0.001);
    let host = Host::ran(&settings(r#""tolerance": 0.5, "relTol": 1e-6"#), toy, 3.0);
    assert_eq!(host.events, [Solved(30)]);
    assert!(host.log.contains("more than relTol of what the solver changed"), "{}", host.log);
}

/// Toy is exact, but a prediction of .5 s is none of a step of .9 s.
#[test]
fn steps_that_have_outgrown_the_stride_are_no_errors_of_it() {
    let stop = settings(r#""tolerance": 0.02, "onFailure": "stop", "patience": 3"#);
    let mut r = ride(&stop, Some(Toy::new(0.5))).unwrap();
    for index in 1..20i32 {
        let time = 0.9 * f64::from(index);
        let state = toy::state(time);
        let step = toy::at(time, 0.9, 99.0, i64::from(index));
        let answer = r.solved(step, Some(&super::hosting::view(&state))).unwrap();
        assert_eq!(answer.action, crate::Action::Solve);
    }
    assert!(r.take(crate::Text::Warning).contains("is shorter than the solver's time step, 0.9 s"));
    assert!(r.end().contains("\"strides_measured\": 0,"));
}

/// The second one never has a turn.
#[test]
fn the_run_stops_where_the_one_of_two_that_may_jump_stays_bad() {
    let toy = Toy::new(0.5).biased(0.5);
    let stop = settings(r#""tolerance": 0.02, "onFailure": "stop", "patience": 3"#)
        .replace("\"timeStart\"", "\"surrogates\": [\"network\", \"trend\"], \"timeStart\"");
    let mut host = Host::of(&stop, toy, 9.0);
    fails(host.run(), &["in 3 strides in a row"]);
    // The row of the last stride is not lost.
    let rows = host.ride.take(crate::Text::Strides);
    assert!(rows.lines().any(|row| !row.starts_with('#')), "{rows}");
}

#[test]
fn a_stride_of_a_jump_that_changes_too_much_is_not_used() {
    // Good where it is measured; after one stride of the jump, at a state further on, it changes the field by 50.
    let toy = Toy::new(0.5).jumping(1.35, 50.0);
    let mut host = Host::ran(&settings(r#""tolerance": 0.5"#), toy, 2.6);
    let jumped = host.events.iter().find(|e| matches!(e, Jumped(..)));
    assert_eq!(jumped, Some(&Jumped(0, 1)), "{:?}", host.events);
    assert!(host.ride.end().contains("\"jumps_ended_early\": 1,"));
    assert!(host.warnings.is_empty());
}

#[test]
fn a_stride_that_is_not_finite_beside_the_solver_allows_nothing() {
    let toy = Toy::new(0.5).broken_above(f64::NEG_INFINITY);
    let host = Host::ran(&settings(r#""tolerance": 0.5"#), toy, 3.0);
    assert_eq!(host.events, [Solved(30)]);
    assert!(host.log.contains("could not predict a stride"), "{}", host.log);
    assert!(host.warnings[0].contains("not finite"));
}

#[test]
fn a_surrogate_of_another_file_is_registered_by_one_line() {
    let settings = settings(r#""tolerance": 0.5, "relTol": 0.9"#)
        .replace("\"timeStart\"", "\"surrogates\": [\"trend\"], \"timeStart\"");
    let mut host = Host::new(ride(&settings, None).unwrap(), 6.0);
    host.run().unwrap();
    assert!(host.events.iter().any(|e| matches!(e, Jumped(0, _))), "{:?}\n{}", host.events, host.log);
    assert!(host.tables[1].contains("\ttrend\t"), "{}", host.tables[1]);
}

#[test]
fn without_a_stride_that_was_measured_there_is_no_jump() {
    // The solver's two steps between jumps are less than a stride: it goes on to the end of one.
    let settings = r#"{"mode": "replace", "solverSteps": 2, "surrogateSteps": 2, "timeStart": 1, "control": {"tolerance": 9}}"#;
    let host = Host::ran(settings, Toy::new(0.5), 5.0);
    assert_eq!(host.events[..3], [Solved(10), Jumped(0, 2), Solved(5)]);
}

#[test]
fn steps_that_miss_the_ends_of_strides_are_refused() {
    let observe = r#"{"mode": "observe"}"#;
    for (settings, every, fits) in [
        (observe, 5, true),
        (observe, 1, true),
        (observe, 7, false),
        (&settings(r#""tolerance": 1"#)[..], 7, false),
        (r#"{"mode": "replace", "solverSteps": 7, "surrogateSteps": 2}"#, 7, true),
    ] {
        let mut host = Host::of(settings, Toy::new(0.5), 4.0);
        host.every = every;
        match host.run() {
            Ok(()) => assert!(fits, "{settings} {every}"),
            Err(e) => assert!(!fits && e.to_string().contains("executeInterval 1"), "{e}"),
        }
    }
}
