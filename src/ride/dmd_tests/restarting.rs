//! A run of a fit that is carried on.

use super::*;
use std::path::Path;

/// Settings that keep states there, and what is decided in a file of this name.
fn telling(folder: &Path, decisions: &str) -> String {
    let files =
        format!("{{\"states\": {:?}, \"decisions\": {:?}, ", folder.join("states"), folder.join(decisions));
    SETTINGS.replacen('{', &files, 1)
}

fn keeping(folder: &Path) -> String {
    telling(folder, "decisions.jsonl")
}

/// Times and events of what was decided.
fn decided(file: &Path) -> Vec<(f64, String)> {
    let text = std::fs::read_to_string(file).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.map(|line| (line["time"].as_f64().unwrap(), line["event"].to_string())).collect()
}

/// A run to a time, saved there under these conditions.
fn stopped(folder: &Path, at: f64, conditions: &str) -> Host {
    let mut host = Host::waves(&keeping(folder), 25.0);
    host.until(1e9, |h| h.time > at - 1e-9);
    host.ride.made_under(conditions).unwrap();
    host.ride.save(&folder.join("ride.state")).unwrap();
    host
}

/// The host that goes on from it, and what it is told.
fn carried_on(folder: &Path, from: &Host, settings: &str, conditions: &str) -> (Host, Answer) {
    let begin = toy::at(from.time, DELTA_T, 25.0, from.index);
    let mut host = Host::fitting(settings, begin, from.state[0].clone());
    host.ride.made_under(conditions).unwrap();
    let answer = host.ride.load(&folder.join("ride.state"), host.step(), &view(&host.state)).unwrap();
    host.listen();
    (host, answer)
}

#[test]
fn a_run_that_is_carried_on_in_a_jump_and_beside_the_solver_has_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let settings = |decisions: &str| telling(folder.path(), decisions);
    // In the second jump, between two samples of the solver, and where the last states are all the same; then with steps that do not
    // meet the samples, in a jump, behind it, and beside a sample that is interpolated.
    let even: (fn(f64) -> f64, f64) = (|_| DELTA_T, 0.0);
    let uneven: (fn(f64) -> f64, f64) = (|time| 0.03 + 0.01 * time.sin(), 1.0);
    for (broken, at, (delta_t, looks)) in [
        (1e9, 7.65, even),
        (1e9, 9.05, even),
        (1e9, 4.9, even),
        (-4.0, 6.9, even),
        (1e9, 4.0, uneven),
        (1e9, 5.5, uneven),
        (1e9, 6.1, uneven),
        (1e9, 7.2, uneven),
        (1e9, 8.35, uneven),
    ] {
        let host = |decisions, time, index, u| {
            let made = Host::fitting(&settings(decisions), toy::at(time, DELTA_T, 25.0, index), u);
            Host { delta_t, looks, ..made }
        };
        let mut whole = host("whole", 0.0, 0, solver(0.0, broken));
        whole.until(broken, |_| false);
        let path = folder.path().join("ride.state");
        let mut first = host("parts", 0.0, 0, solver(0.0, broken));
        first.until(broken, |h| h.time > at - 1e-9);
        first.ride.save(&path).unwrap();
        let mut second = host("parts", first.time, first.index, first.state[0].clone());
        // Within a jump the solver's step is that of the state.
        let delta_t = if first.ride.left() < 0 { second.step().delta_t } else { 0.0 };
        let now = Step { delta_t, ..second.step() };
        let answer = second.ride.load(&path, now, &view(&second.state)).unwrap();
        second.go_on(answer, &mut |_| false).unwrap();
        second.until(broken, |_| false);
        assert_eq!(whole.bits(), second.bits(), "{at}: {:?} {:?}", whole.jumps, second.jumps);
        assert_eq!(whole.jumps.last(), second.jumps.last());
        let [whole, parts] = ["whole", "parts"].map(|name| decided(&folder.path().join(name)));
        assert_eq!(whole, parts, "{at}");
    }
}

/// Times beside the solver, and in the second jump.
const TIMES: [f64; 2] = [4.9, 7.65];

#[test]
fn what_was_fitted_under_other_conditions_is_dropped_and_what_has_changed_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let settings = keeping(folder.path());
    for at in TIMES {
        let first = stopped(folder.path(), at, r#"{"inlet": [1.0, 0.0], "scheme": "Euler"}"#);
        let (same, answer) =
            carried_on(folder.path(), &first, &settings, r#"{"inlet": [1.00001, 0.0], "scheme": "Euler"}"#);
        assert!(!same.log.contains("other conditions"), "{}", same.log);
        assert_eq!(answer.action == Action::Stride, at > 7.0);
        let (mut other, answer) =
            carried_on(folder.path(), &first, &settings, r#"{"inlet": [1.5, 0.0], "scheme": "Euler"}"#);
        assert_eq!(answer.action, Action::Solve);
        let line = "goes on from its state at time";
        assert!(
            other.log.contains(line) && other.log.contains("other conditions: inlet was"),
            "{}",
            other.log
        );
        // Its waves are others from here on: a window of them comes before the first jump, and a stride beside the solver.
        other.until(at, |_| false);
        let window = 23.0 * 0.2;
        assert!(other.jumps.first().is_some_and(|(_, end, _)| *end > at + window + 0.2), "{:?}", other.jumps);
        assert!(largest(&other.state[0], &solver(other.time, at)) < 1e-6);
        // What earlier times are carried on from is still there.
        other.ride.save(&folder.path().join("later.state")).unwrap();
        let (again, _) =
            carried_on(folder.path(), &first, &settings, r#"{"inlet": [1.0, 0.0], "scheme": "Euler"}"#);
        assert!(!again.log.contains("other conditions"), "{}", again.log);
    }
}

#[test]
fn the_rest_of_a_jump_is_taken_though_the_solver_has_made_a_field_anew() {
    let folder = tempfile::tempdir().unwrap();
    let whole = Host::met(&keeping(folder.path()), 25.0, 1e9);
    let mut first = stopped(folder.path(), TIMES[1], "{}");
    first.state[0].iter_mut().for_each(|v| *v += 0.5);
    let (mut second, answer) = carried_on(folder.path(), &first, &keeping(folder.path()), "{}");
    assert_eq!(answer.action, Action::Stride);
    second.go_on(answer, &mut |_| false).unwrap();
    second.until(1e9, |_| false);
    assert_eq!(whole.bits(), second.bits());
    assert_eq!(whole.jumps.last(), second.jumps.last());
}

#[test]
fn a_run_that_goes_on_from_the_end_of_a_jump_tells_that_it_was_handed_back() {
    let folder = tempfile::tempdir().unwrap();
    let whole = Host::met(&telling(folder.path(), "whole"), 25.0, 1e9);
    let end = whole.jumps[1].1;
    let first = stopped(folder.path(), end, "{}");
    let (mut second, answer) = carried_on(folder.path(), &first, &keeping(folder.path()), "{}");
    assert_eq!(answer.action, Action::HandBack);
    second.go_on(answer, &mut |_| false).unwrap();
    second.until(1e9, |_| false);
    let [whole, parts] = ["whole", "decisions.jsonl"].map(|name| decided(&folder.path().join(name)));
    assert_eq!(whole, parts);
    // Where its rest is dropped the jump ends as well
    let first = stopped(folder.path(), TIMES[1], r#"{"scheme": "Euler"}"#);
    carried_on(folder.path(), &first, &keeping(folder.path()), r#"{"scheme": "backward"}"#);
    let last = decided(&folder.path().join("decisions.jsonl")).pop().unwrap();
    assert!((last.0 - first.time).abs() < 1e-9 && last.1 == r#""handed_back""#, "{last:?}");
}

/// A jump that had no room before the end of a run begins where the run goes on, though the name of that time is rounded.
#[test]
fn a_run_goes_on_from_a_time_whose_name_is_rounded() {
    let folder = tempfile::tempdir().unwrap();
    let settings = keeping(folder.path());
    let mut first = Host::waves(&settings, 5.0);
    first.until(1e9, |_| false);
    assert!((first.time - 5.0).abs() < 1e-9 && first.jumps.is_empty(), "{}", first.log);
    first.ride.made_under("{}").unwrap();
    first.ride.save(&folder.path().join("ride.state")).unwrap();
    for rounding in [0.0, 3e-6] {
        first.time += rounding;
        let (mut second, answer) = carried_on(folder.path(), &first, &settings, "{}");
        assert_eq!(answer.action, Action::Stride, "{rounding}");
        let mut worst = 0.0;
        second.go_on(answer, &mut watch(&mut worst)).unwrap();
        second.until(1e9, watch(&mut worst));
        assert!(second.jumps.len() > 2 && worst < 1e-3, "{:?} {worst}", second.jumps);
    }
}

#[test]
fn an_observer_carries_on_a_run_that_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let settings = keeping(folder.path()).replace("\"replace\"", "\"observe\"");
    for at in TIMES {
        let first = stopped(folder.path(), at, "{}");
        let (mut host, answer) = carried_on(folder.path(), &first, &settings, "{}");
        assert_eq!(answer.action, Action::Solve);
        host.until(1e9, |_| false);
        assert!(host.jumps.is_empty() && host.log.contains("begins to observe"), "{}", host.log);
    }
}
