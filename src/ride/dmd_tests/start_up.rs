//! Start-ups cut short: a wave whose amplitude follows Stuart and Landau, `dA/dt = s A (1 - A^2)`, in closed form from any state.

use super::*;
use std::f64::consts::TAU;

const GROWTH: f64 = 0.1;
const PERIOD: f64 = 1.4;

fn pattern(i: usize, part: usize) -> f64 {
    (TAU * i as f64 / CELLS as f64 + part as f64 * TAU / 4.0).cos()
}

/// Amplitudes of the two patterns that the wave alternates between.
fn parts(u: &[f64]) -> [f64; 2] {
    [0, 1]
        .map(|part| u.iter().enumerate().map(|(i, u)| u * pattern(i, part)).sum::<f64>() / (CELLS / 2) as f64)
}

fn amplitude(u: &[f64]) -> f64 {
    let [a, b] = parts(u);
    a.hypot(b)
}

fn state([a, b]: [f64; 2]) -> Vec<f64> {
    (0..CELLS).map(|i| 3.0 + a * pattern(i, 0) + b * pattern(i, 1)).collect()
}

/// A step of the solver from this state.
fn advance(u: &[f64]) -> Vec<f64> {
    let [a, b] = parts(u);
    let square = a * a + b * b;
    let now = (1.0 + (1.0 / square - 1.0) * (-2.0 * GROWTH * DELTA_T).exp()).powf(-0.5) / square.sqrt();
    let (sin, cos) = (TAU * DELTA_T / PERIOD).sin_cos();
    state([now * (a * cos - b * sin), now * (a * sin + b * cos)])
}

fn settings(cut: bool) -> String {
    // Jumps in time are not what is looked at.
    let more = format!(
        "\"cutTransient\": {cut}, \"window\": 24, \"jumpTolerance\": 1e-12, \"fitTolerance\": 1e-12, \"initialJump\""
    );
    SETTINGS.replace("\"initialJump\"", &more)
}

fn beginning(settings: &str, first: f64) -> Host {
    Host::fitting(settings, toy::at(0.0, DELTA_T, 60.0, 0), state([first, 0.0]))
}

/// The solver that makes such steps.
fn by(step: fn(&[f64]) -> Vec<f64>) -> impl Fn(f64, &[f64]) -> Values {
    move |_, u| both(step(u))
}

/// A run, and the time from which its amplitude stays within a fiftieth of 1.
fn run(settings: &str, first: f64) -> (Host, f64) {
    let mut host = beginning(settings, first);
    let mut settled = 0.0;
    let stop = &mut |host: &Host| {
        if (amplitude(&host.state[0]) - 1.0).abs() > 0.02 {
            settled = host.time;
        }
        false
    };
    host.run_with(&by(advance), stop).unwrap();
    (host, settled)
}

#[test]
fn a_wave_that_grows_settles_earlier_and_is_the_same() {
    let (plain, late) = run(&settings(false), 0.1);
    assert!(plain.jumps.is_empty() && (late - 38.7).abs() < 1.0, "{late} {:?}", plain.jumps);
    let (host, early) = run(&settings(true), 0.1);
    assert!(early < 0.6 * late, "{early} of {late}\n{}", host.log);
    assert!((amplitude(&host.state[0]) - 1.0).abs() < 2e-3);
    assert!(host.jumps.iter().all(|jump| jump.0 == 1), "{:?}", host.jumps);
    // Nothing is measured beside the solver before a cut: its row has the columns of any jump.
    let rows: Vec<&str> = host.tables[0].lines().collect();
    assert!(rows.iter().any(|row| row.ends_with("\tnan\tnan")), "{rows:?}");
    let head = rows.iter().rfind(|row| row.starts_with('#')).unwrap();
    assert!(head.contains("\tstrideError"), "{head}");
    for words in [
        "start-up: a wave of period 1.4 s, growth 0.09",
        "its amplitude is brought to",
        "the last change is kept",
    ] {
        assert!(host.log.contains(words), "{words}: {}", host.log);
    }
    assert!(!host.log.contains("taken up again"), "{}", host.log);
    assert!(host.log.contains("it stays as it is"), "{}", host.log);
}

/// A wave that seems to end at a half, and grows three times as fast from 0.4 on.
fn runs_away(u: &[f64]) -> Vec<f64> {
    let size = amplitude(u);
    let growth = if size > 0.4 { 3.0 * GROWTH } else { GROWTH * (1.0 - 4.0 * size * size) };
    let (size, [a, b]) = ((growth * DELTA_T).exp(), parts(u));
    let (sin, cos) = (TAU * DELTA_T / PERIOD).sin_cos();
    state([size * (a * cos - b * sin), size * (a * sin + b * cos)])
}

#[test]
fn a_change_after_which_the_wave_grows_faster_is_undone() {
    let mut host = beginning(&settings(true), 0.1);
    host.end = 20.0;
    let mut sizes = Vec::new();
    let stop = &mut |host: &Host| {
        sizes.push(amplitude(&host.state[0]));
        false
    };
    host.run_with(&by(runs_away), stop).unwrap();
    assert_eq!(host.jumps.len(), 2, "a change, and back: {:?}\n{}", host.jumps, host.log);
    assert!(host.log.contains("the state before is taken up again"), "{}", host.log);
    // From far above to where it was
    let falls = |pair: &[f64]| pair[0] > 0.5 && pair[1] < 0.3;
    assert_eq!(sizes.windows(2).filter(|pair| falls(pair)).count(), 1);
}

#[test]
fn what_has_settled_is_not_looked_at_again_where_the_interval_changes() {
    let mut host = beginning(&settings(true), 1.0);
    host.delta_t = |time| if time < 20.0 { DELTA_T } else { 0.22 };
    host.run_with(&by(advance), &mut |_| false).unwrap();
    assert!(host.log.contains("states are kept 4.000e-1 s apart"), "{}", host.log);
    assert_eq!(host.log.matches("it stays as it is").count(), 1, "{}", host.log);
}

#[test]
fn what_has_settled_and_what_soon_will_is_not_touched() {
    for first in [1.0, 0.9] {
        let (host, _) = run(&settings(true), first);
        assert!(host.jumps.is_empty(), "{first} {:?}\n{}", host.jumps, host.log);
    }
}

#[test]
fn a_run_that_is_carried_on_cuts_at_the_same_times() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(true);
    let keeping =
        |name: &str| settings.replacen('{', &format!("{{\"states\": {:?}, ", folder.path().join(name)), 1);
    let (whole, _) = run(&keeping("whole"), 0.1);
    let first = whole.jumps[0].1;
    // Before the change, behind its stride, and while it is judged
    for at in [first - 0.5, first, first + 1.0] {
        let mut host = beginning(&keeping("states"), 0.1);
        host.run_with(&by(advance), &mut |host| host.time > at - 1e-9).unwrap();
        let file = folder.path().join("ride.state");
        host.ride.save(&file).unwrap();
        let begin = toy::at(host.time, DELTA_T, 60.0, host.index);
        let mut next = Host::fitting(&keeping("states"), begin, host.state[0].clone());
        let answer = next.ride.load(&file, next.step(), &view(&next.state)).unwrap();
        next.go_on(answer, &mut |_| false).unwrap();
        next.run_with(&by(advance), &mut |_| false).unwrap();
        assert_eq!(next.bits(), whole.bits(), "{at} {:?} {:?}\n{}", next.jumps, whole.jumps, next.log);
    }
}
