use super::hosting::{Event::*, Host, ride, view};
use crate::Action;
use crate::toy::{self, Toy, at};
use m4gn_samples::fails;

const FIVE_TWO: &str = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "timeStart": 1}"#;

#[test]
fn solver_and_surrogate_take_turns_and_the_solver_ends_the_run() {
    let mut host = Host::ran(FIVE_TWO, Toy::new(0.5), 5.0);
    // The first jump begins at 1 s; the last one has no room for a second stride that leaves the solver a step.
    let expected = [Solved(10), Jumped(0, 2), Solved(5), Jumped(0, 2), Solved(5), Jumped(0, 1), Solved(5)];
    assert_eq!(host.events, expected);
    assert_eq!(host.index, 50);
    assert_eq!(host.strides[0], (0.5, 5));
    // An exact surrogate: where the solver alone would be.
    let error = (host.state[0][0] - toy::solver(5.0)[0]).abs();
    assert!(error < 1e-12, "{error}");
    let summary = host.ride.end();
    for entry in [
        "\"replaced_time\": 2.5,",
        "\"solver_time\": 1.5,",
        "\"replaced_fraction\": 0.625,",
        "\"takeover_time\": 1,",
        "\"jumps\": 3,",
        "\"jumps_ended_early\": 0,",
        "\"surrogate_steps\": 5,",
        "\"stride\": 0.5,",
        "\"surrogate_seconds\": 1.25,",
        "\"hand_over_seconds\": 2.5,",
    ] {
        assert!(summary.contains(entry), "{entry} {summary}");
    }
    let lines: Vec<&str> = host.tables[0].lines().filter(|l| !l.starts_with('#')).collect();
    assert_eq!(lines, ["2\t2\t0.5\t1\t0.5", "3.5\t2\t0.5\t1\t0.5", "4.5\t1\t0.25\t0.5\t0.5"]);
    assert!(host.tables[0].contains("handOver(s)") && host.tables[0].contains("\tenergy"));
    assert!(host.log.contains("jumped 2 steps of 0.5 s to time 2 in 1.5 s; energy 0.5\n"), "{}", host.log);
}

#[test]
fn the_schedule_ends_at_its_time_and_has_a_summary() {
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 9, "timeEnd": 2}"#;
    let mut host = Host::ran(settings, Toy::new(0.5), 4.0);
    assert_eq!(host.events, [Solved(5), Jumped(0, 3), Solved(20)]);
    let summary = host.ride.end();
    // Of the 1.9 s from its first step on.
    assert!(summary.contains("\"replaced_fraction\": 0.789474,"), "{summary}");
    assert!(
        host.ride.take(crate::Text::Log).contains("replacedFraction = 0.789474 (1.5 s of 1.9 s in 1 jumps")
    );
}

#[test]
fn a_quantity_that_is_off_at_the_end_of_a_jump_makes_the_next_ones_shorter() {
    // The first component is reported: in a jump as it is, or with more than that.
    let quantities = r#""quantities": [{"object": "probe", "result": "first", "tolerance": 0.05}]"#;
    let settings = format!(
        r#"{{"mode": "replace", "solverSteps": 10, "surrogateSteps": 8, "timeStart": 9, {quantities}}}"#
    );
    for more in [0.0, 0.3] {
        let mut host = Host::of(&settings, Toy::new(0.5), 40.0);
        host.report = Some(more);
        host.run().unwrap();
        let strides: Vec<usize> = host
            .events
            .iter()
            .filter_map(|e| match e {
                Jumped(_, n) => Some(*n),
                Solved(_) => None,
            })
            .collect();
        assert_eq!(strides[0], 8);
        let summary = host.ride.end();
        match more {
            0.0 => assert!(strides.iter().rev().skip(1).all(|n| *n == 8), "{strides:?} {}", host.log),
            _ => assert!(
                strides[..3] == [8, 4, 2] && host.log.contains("the next jumps have 4 strides at most"),
                "{strides:?} {}",
                host.log
            ),
        }
        assert!(summary.contains("\"worst_probe_first\""), "{summary}");
    }
    let wrong = host_error(&settings);
    assert!(wrong.contains("0 quantities: expected 1"), "{wrong}");
}

#[test]
fn a_state_that_is_reported_again_counts_once() {
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 1,
        "quantities": [{"object": "probe", "result": "first", "tolerance": 0.05}]}"#;
    let mut r = ride(settings, Some(Toy::new(0.5))).unwrap();
    let (fields, mut next) = (toy::of([1.0, 2.0]), toy::of([1.0, 2.0]));
    let state = view(&fields);
    let step = |time: f64| at(time, 0.1, 9.0, (10.0 * time).round() as i64);
    assert_eq!(r.solved(step(1.0), Some(&state)).unwrap().action, Action::Stride);
    r.reported(&[1.0]).unwrap();
    r.stride(&mut next.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>()).unwrap();
    assert_eq!(r.advanced(step(1.5), Some(&state)).unwrap().action, Action::HandBack);
    r.reported(&[1.5]).unwrap();
    r.handed_back(step(1.5), Some(&state), &[]).unwrap();
    for time in [1.6, 1.6, 1.7, 1.7] {
        if time > r.step.time {
            r.solved(step(time), None).unwrap();
        }
        r.reported(&[time]).unwrap();
    }
    let summary = r.end();
    assert!(summary.contains("\"quantities_judged\": 1,"), "{summary}");
    assert!(summary.contains("\"quantities_beyond\": 0,"), "{summary}");
}

fn host_error(settings: &str) -> String {
    let mut host = Host::of(settings, Toy::new(0.5), 1.0);
    host.ride.reported(&[]).unwrap_err().to_string()
}

#[test]
fn before_its_start_there_is_no_summary() {
    let mut host = Host::ran(FIVE_TWO, Toy::new(0.5), 0.5);
    assert_eq!((host.events.clone(), host.ride.end()), (vec![Solved(5)], String::new()));
}

#[test]
fn without_room_for_a_stride_there_is_no_jump() {
    let host = Host::ran(FIVE_TWO, Toy::new(0.5), 1.5);
    assert_eq!(host.events, [Solved(15)]);
}

#[test]
fn a_prediction_that_is_not_finite_ends_a_jump_or_keeps_it_from_beginning() {
    // The first component falls from 1.5 at 1 s, and rises above again at 8.9 s.
    let toy = Toy::new(0.5).broken_above(1.0);
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 20}"#;
    let mut host = Host::ran(settings, toy, 9.5);
    let begin = (1..).find(|n| toy::solver(f64::from(*n) * 0.1)[0] <= 1.0).unwrap() as usize;
    assert_eq!(host.events[0], Solved(begin), "refused until then: {:?}", host.events);
    let Jumped(0, strides) = host.events[1] else { panic!("{:?}", host.events) };
    assert!(strides < 16 && host.events.len() > 2, "{:?}", host.events);
    assert!(host.warnings[0].starts_with("At time 0.5: the result is not finite"), "{:?}", host.warnings);
    let summary = host.ride.end();
    let early = host.warnings.len();
    assert!(summary.contains(&format!("\"jumps_ended_early\": {early},")), "{summary} {early}");
}

#[test]
fn correctors_at_their_cap_make_jumps_shorter() {
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 4}"#;
    let mut host = Host::of(settings, Toy::new(0.5), 12.0);
    host.correctors = vec![[3, 10]; 5];
    host.correctors.extend(vec![[10, 10]; 200]);
    host.run().unwrap();
    let jumps: Vec<_> = host.events.iter().filter(|e| matches!(e, Jumped(..))).collect();
    assert_eq!(jumps, [&Jumped(0, 4), &Jumped(0, 2), &Jumped(0, 1)]);
    assert!(host.warnings.last().unwrap().contains("The run goes on with the solver alone"));
    let summary = host.ride.end();
    for entry in [
        "\"jumps_watched\": 3,",
        "\"correctors_before\": 3,",
        "\"correctors_after\": 10,",
        "\"jumps_to_the_cap\": 3,",
    ] {
        assert!(summary.contains(entry), "{entry} {summary}");
    }
}

#[test]
fn calls_out_of_turn_are_refused_by_name() {
    let mut r = ride(FIVE_TWO, Some(Toy::new(0.5))).unwrap();
    let fields = toy::of([1.0, 2.0]);
    let state = view(&fields);
    fails(r.stride(&mut []), &["stride was called where solved"]);
    let step = |time: f64| at(time, 0.1, 9.0, (10.0 * time).round() as i64);
    fails(r.advanced(step(1.0), None), &["advanced was called"]);
    fails(r.handed_back(step(1.0), None, &[]), &["handed_back was called"]);
    fails(r.old_level(0.1, &mut []), &["old_level was called"]);
    fails(r.solved(step(-1.0), None), &["times must increase"]);
    assert!(r.wants(&step(1.0)) && !r.wants(&step(0.3)));
    fails(r.solved(step(1.0), None), &["solved needs the state"]);
    fails(r.solved(step(1.0), Some(&state[..1])), &["1 arrays: expected 3"]);
    assert_eq!(r.solved(step(1.0), Some(&state)).unwrap().action, Action::Stride);
    fails(r.solved(step(1.1), None), &["solved was called where stride is due"]);
    fails(r.stride(&mut []), &["the places for the prediction"]);
    fails(r.load(std::path::Path::new("none"), step(1.0), &state), &["before the first step"]);
    let mut next = fields.clone();
    r.stride(&mut next.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>()).unwrap();
    fails(r.save(std::path::Path::new("none")), &["save was called where advanced is due"]);
}

#[test]
fn what_does_not_fit_is_refused_at_the_start() {
    fails(ride(FIVE_TWO, None), &["network is named, and the host has none"]);
    let dmd = r#"{"mode": "replace", "surrogates": ["dmd"]}"#;
    fails(ride(dmd, Some(Toy::new(0.5))), &["surrogates does not name it"]);
    fails(ride(FIVE_TWO, Some(Toy::new(0.05))), &["shorter than the solver's time step, 0.1 s"]);
    let two =
        FIVE_TWO.replace("\"solverSteps\"", "\"surrogates\": [\"network\", \"trend\"], \"solverSteps\"");
    fails(ride(&two, Some(Toy::new(0.5))), &["2 surrogates: which one jumps"]);
}

#[test]
fn a_stride_that_the_solver_s_step_has_outgrown_does_not_jump() {
    let mut r = ride(FIVE_TWO, Some(Toy::new(0.5))).unwrap();
    let fields = toy::of([1.0, 2.0]);
    let state = view(&fields);
    for (time, index) in [(1.0, 10), (1.6, 11)] {
        assert_eq!(r.solved(at(time, 0.6, 9.0, index), Some(&state)).unwrap().action, Action::Solve);
    }
    assert!(r.take(crate::Text::Warning).contains("0.5 s, is shorter than the solver's time step, 0.6 s"));
    assert_eq!(r.take(crate::Text::Warning), "");
    assert_eq!(r.solved(at(1.7, 0.1, 9.0, 12), Some(&state)).unwrap().action, Action::Stride);
}
