use super::hosting::{Event::*, Host, ride};
use crate::Text;
use crate::toy::{self, Toy};

fn columns(table: &str) -> Vec<Vec<f64>> {
    let rows = table.lines().filter(|l| !l.starts_with('#'));
    rows.map(|l| l.split('\t').map(|v| v.parse().unwrap()).collect()).collect()
}

#[test]
fn errors_are_those_on_paper_and_the_run_is_the_solvers() {
    let toy = Toy::new(0.5).biased(0.01);
    let boundary = toy.boundary.clone();
    let settings = r#"{"mode": "observe", "rolloutSteps": 3, "timeStart": 1, "writeErrors": true, "writePrecision": 17}"#;
    let mut host = Host::ran(settings, toy, 4.0);
    assert_eq!(host.events, [Solved(40)]);
    assert_eq!(host.state[0], (0..40).fold(toy::solver(0.0), |s, _| toy::later(s, 0.1)), "to the bit");
    let rows = columns(&host.tables[2]);
    // Time, steps, oneStep, hold, rollout, holdFirst, rms; rollouts of three strides from 1 s.
    let times: Vec<f64> = rows.iter().map(|r| r[0]).collect();
    let steps: Vec<f64> = rows.iter().map(|r| r[1]).collect();
    assert_eq!(times, [1.5, 2.0, 2.5, 3.0, 3.5, 4.0]);
    assert_eq!(steps, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]);
    let rms = |a: [f64; 2], b: [f64; 2]| toy::rms_of(&[a[0] - b[0], a[1] - b[1]]);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-10, "{a} {b}");
    // The bias of the strides adds up, each turned as the flow turns.
    let biased = |s: [f64; 2]| toy::later(s, 0.5).map(|v| v + 0.01);
    let mut rollout = toy::solver(1.0);
    for row in &rows[..3] {
        rollout = biased(rollout);
        let now = toy::solver(row[0]);
        near(row[2], 0.01);
        near(row[3], rms(toy::solver(row[0] - 0.5), now));
        near(row[4], rms(rollout, now));
        near(row[5], rms(toy::solver(1.0), now));
        near(row[6], toy::rms_of(&now));
    }
    // A cell is a segment.
    let segments = columns(&host.tables[3]);
    near(segments[2][1], (rollout[0] - toy::solver(2.5)[0]).abs());
    near(segments[2][2], (rollout[1] - toy::solver(2.5)[1]).abs());
    assert!(host.tables[3].contains("a:0") && host.tables[3].contains("a:1"));
    let (difference, time) = host.ride.difference(0, 0).unwrap();
    assert_eq!((difference.len(), time), (2, "4"));
    // The face that holds its value has the host's, the other its cell's.
    assert_eq!(boundary.borrow()[0], 9.0);
    assert!(host.ride.end().is_empty());
    let log = host.ride.take(Text::Log);
    assert!(log.contains("at 6 times") && log.contains("    a: one step 0.0"), "{log}");
}

#[test]
fn a_rollouts_boundary_follows_its_own_cells_where_it_is_not_held() {
    let toy = Toy::new(0.5).biased(0.01);
    let boundary = toy.boundary.clone();
    Host::ran(r#"{"mode": "observe", "rolloutSteps": 9, "timeStart": 1}"#, toy, 2.0);
    // The last step was the third of the rollout: from the second, which is not the solver's.
    let biased = |s: [f64; 2]| toy::later(s, 0.5).map(|v| v + 0.01);
    let second = biased(biased(toy::solver(1.0)));
    assert_eq!(boundary.borrow()[0], 9.0);
    assert!((boundary.borrow()[1] - second[1]).abs() < 1e-10, "{:?} {second:?}", boundary.borrow());
}

#[test]
fn control_tells_what_it_would_have_done() {
    let settings = r#"{"mode": "observe", "rolloutSteps": 4, "timeStart": 1, "control": {"tolerance": 0.02, "onFailure": "stop", "patience": 1}}"#;
    let mut host = Host::ran(settings, Toy::new(0.5).biased(0.01), 8.0);
    let rows = columns(&host.tables[2]);
    // The first stride only measures; then error and estimate are the last columns.
    assert_eq!((rows[0][0], rows[0].len()), (2.0, 9));
    let (begin, end) = (toy::solver(1.0), toy::solver(1.5));
    let change = toy::rms_of(&[end[0] - begin[0], end[1] - begin[1]]);
    let size = change.max((end[0] - end[1]).abs() / 2.0);
    let later = toy::solver(2.0);
    let larger = size.max((later[0] - later[1]).abs() / 2.0);
    assert!((rows[0][7] - 0.01 / larger).abs() < 1e-6 && (rows[0][8] - 0.01 / size).abs() < 1e-6, "{rows:?}");
    assert!((rows[1][8] - 0.02 / size).abs() < 1e-6, "{rows:?}");
    host.ride.end();
    let log = host.ride.take(Text::Log);
    assert!(log.contains("control would have let") && log.contains("within the tolerance 0.02"), "{log}");
    // An observer ends no run, however bad the surrogate, and says how often it would not have let go.
    let mut host = Host::ran(settings, Toy::new(0.5).biased(0.5), 8.0);
    host.ride.end();
    let log = host.ride.take(Text::Log);
    assert!(log.contains("would have let 0 rollouts go"), "{log}");
}

#[test]
fn a_rollout_that_is_not_finite_begins_anew() {
    // Not finite from states whose first component is above 1.5: at 1 s the solver's is 1.45.
    let host = Host::ran(
        r#"{"mode": "observe", "rolloutSteps": 50, "timeStart": 1, "writeErrors": true}"#,
        Toy::new(0.5).biased(-0.4).broken_above(1.2),
        12.0,
    );
    let rows = columns(&host.tables[2]);
    assert!(rows.iter().any(|r| r[4] == 1e15), "{rows:?}");
    assert!(rows.iter().filter(|r| r[1] == 1.0).count() > 1, "it began anew: {rows:?}");
    assert!(columns(&host.tables[3]).len() < rows.len(), "it has no errors in segments");
    assert!(!host.warnings.is_empty());
}

#[test]
fn a_run_that_is_shorter_than_a_stride_says_so() {
    let mut host = Host::ran(r#"{"mode": "observe"}"#, Toy::new(0.5), 0.3);
    host.ride.end();
    assert!(host.ride.take(Text::Log).contains("came to no end of a stride"));
    assert!(ride(r#"{"mode": "observe"}"#, Some(Toy::new(0.5))).unwrap().end().is_empty());
}

#[test]
fn the_observer_ends_at_its_time_and_tells() {
    let mut host = Host::ran(r#"{"mode": "observe", "timeEnd": 1.1}"#, Toy::new(0.5), 4.0);
    host.ride.end();
    assert!(host.ride.take(Text::Log).contains("at 2 times"), "{}", host.tables[2]);
}
