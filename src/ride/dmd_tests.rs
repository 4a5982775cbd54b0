//! The fit in a ride: two waves that a fit knows exactly, and what happens where it does not.

use crate::schedule::Step;
use crate::tests::hosting::{Host, view};
use crate::toy;
use crate::{Action, Answer, Host as Guest, Ride, RideSettings};
use beside_a_network::trained;
use m4gn_parallel::Comm;
use m4gn_state::{Array, Layout, Values};
use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;

mod beside_a_network;
mod interval;
mod restarting;
mod start_up;

const CELLS: usize = 12;
const DELTA_T: f64 = 0.05;

/// Waves of constant size; from `broken` on of another frequency, or at rest where it is negative, but for noise of a millionth below -100;
/// with some noise where it is infinite. Noise alone where it is not a number.
fn solver(time: f64, broken: f64) -> Vec<f64> {
    let number =
        |i: usize| 43758.5453 * (12.9898 * (time / DELTA_T * 50.0).round() + 78.233 * i as f64).sin();
    let noise = (0..CELLS).map(|i| number(i).rem_euclid(1.0));
    let noisy = |u: Vec<f64>, size: f64| u.iter().zip(noise.clone()).map(|(u, n)| u + size * n).collect();
    if broken.is_nan() {
        return noise.collect();
    }
    if broken.is_infinite() {
        return noisy(solver(time, 1e9), 0.005);
    }
    if broken < -100.0 {
        return noisy(solver(time, broken + 100.0), 1e-6);
    }
    if broken < 0.0 {
        return solver(time.min(-broken), 1e9);
    }
    let late = (time - broken).max(0.0);
    let x = |i: usize| i as f64 * 0.5;
    (0..CELLS)
        .map(|i| 3.0 + (x(i) + 1.9 * time + 2.0 * late).sin() + 0.3 * (2.0 * x(i) - 3.1 * time).cos())
        .collect()
}

/// A flux: differences of the field.
fn flux(u: &[f64]) -> Vec<f64> {
    (0..CELLS).map(|i| u[i] - u[(i + 1) % CELLS]).collect()
}

/// What the host has, without a network.
fn guest() -> Guest<'static> {
    Guest {
        layout: layout(),
        network: None,
        ahead: None,
        global: (0..CELLS as i64).collect(),
        owners: Vec::new(),
    }
}

/// The solver of the waves, for a host.
fn waves(broken: f64) -> impl Fn(f64, &[f64]) -> Values {
    move |time, _| both(solver(time, broken))
}

fn both(u: Vec<f64>) -> Values {
    let phi = flux(&u);
    vec![u, phi]
}

fn layout() -> Arc<Layout> {
    let arrays = vec![Array::solved("u", 1, vec![1.0; CELLS]), Array::carried("phi", CELLS)];
    Arc::new(Layout::new(arrays).unwrap())
}

impl Host {
    /// A ride of a fit that begins at such a step, from this field.
    fn fitting(settings: &str, begin: Step, u: Vec<f64>) -> Self {
        let settings = RideSettings::parse(settings).unwrap();
        let clock = Rc::new(Cell::new(begin.time));
        let guest = Guest { network: settings.has("network").then(|| trained(&clock, 0)), ..guest() };
        let ride = Ride::new(Comm::serial(), guest, settings, begin.clone()).unwrap();
        Host { delta_t: |_| DELTA_T, ..Host::at(ride, &begin, both(u), clock) }
    }

    /// One of the waves, at 0 s.
    fn waves(settings: &str, end: f64) -> Self {
        Host::fitting(settings, toy::at(0.0, DELTA_T, end, 0), solver(0.0, 1e9))
    }

    /// One that has run from 0 s to the end with this solver.
    fn met(settings: &str, end: f64, broken: f64) -> Self {
        let mut host = Host::fitting(settings, toy::at(0.0, DELTA_T, end, 0), solver(0.0, broken));
        host.until(broken, |_| false);
        host
    }

    /// Until the end, or until `stop` says so behind a step or a stride.
    fn until(&mut self, broken: f64, mut stop: impl FnMut(&Self) -> bool) {
        self.run_with(&waves(broken), &mut stop).unwrap();
    }

    fn bits(&self) -> Vec<u64> {
        self.state[0].iter().map(|v| v.to_bits()).collect()
    }
}

const SETTINGS: &str = r#"{"mode": "replace", "surrogates": ["dmd"], "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24, "initialJump": 5, "jumpGrowth": 2, "maxJump": 40}}"#;

/// Takes up the largest error of the states, of waves that stay as they are; for a run that nothing stops.
fn watch(worst: &mut f64) -> impl FnMut(&Host) -> bool {
    |host| {
        *worst = worst.max(largest(&host.state[0], &solver(host.time, 1e9)));
        false
    }
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn jumps_grow_while_the_fit_holds_and_end_states_are_exact() {
    let host = Host::met(SETTINGS, 60.0, 1e9);
    let strides: Vec<usize> = host.jumps.iter().map(|j| j.0).collect();
    assert_eq!(strides[..4], [5, 10, 20, 40], "{}", host.log);
    // 24 states, the first at 0.2 s; one stride beside the solver.
    let (first, end, _) = host.jumps[0];
    assert!((end - first as f64 * 0.2 - (0.2 + 24.0 * 0.2)).abs() < 1e-9, "{end}");
    assert!(host.solved < 220, "{}", host.solved);
    assert!(largest(&host.state[0], &solver(host.time, 1e9)) < 1e-5);
    // The waves of the solver as modes: 1.9 and 3.1 1/s, of constant size, the second of a tenth of the energy.
    let rows: Vec<&str> = host.tables[4].lines().filter(|l| !l.starts_with('#')).collect();
    for (row, frequency) in rows.iter().zip([1.9, 3.1].map(|omega| omega / std::f64::consts::TAU)) {
        let figures: Vec<f64> = row.split('\t').map(|v| v.parse().unwrap()).collect();
        assert!((figures[0] - 5.0).abs() < 0.21 && (figures[1] - frequency).abs() < 1e-5, "{row}");
        assert!(figures[2].abs() < 1e-4, "{row}");
    }
    assert!(host.log.contains("it is used: period 3.31 s, growth "), "{}", host.log);
    for words in ["keeps up to 40 states 0.2 s apart: ", "it is used", "the next jump may have 20 strides"] {
        assert!(host.log.contains(words), "{words}: {}", host.log);
    }
}

/// The solver makes steps of a length that no stride is a multiple of, and each of them is looked at.
#[test]
fn a_jump_has_the_states_of_the_solvers_own_steps() {
    let mut host = Host::waves(SETTINGS, 60.0);
    (host.delta_t, host.looks) = (|_| 0.03, 1.0);
    let mut worst = 0.0;
    host.until(1e9, watch(&mut worst));
    let steps: Vec<usize> = host.jumps.iter().map(|j| j.0).collect();
    // Strides of 0.2 s: jumps of 5, 10, 20, 40 of them are 1, 2, 4, 8 s.
    for (steps, seconds) in steps.iter().zip([1.0, 2.0, 4.0, 8.0]) {
        let gone = *steps as f64 * 0.03;
        assert!(gone >= seconds - 0.031 && gone < seconds + 0.03, "{steps} {seconds}\n{}", host.log);
    }
    let ends = host.jumps.iter().map(|j| j.1 / 0.03);
    ends.for_each(|end| assert!((end - end.round()).abs() < 1e-6, "{end}"));
    assert!(worst < 1e-2, "{worst}");
    // The name of the table is that of strides.
    assert!(host.log.contains("jumped 5 steps of 0.2 s"), "{}", host.log);
    let steps: usize = steps.iter().sum();
    assert_eq!(host.index as usize, steps + host.solved);
    let replaced = host.ride.end().lines().find(|l| l.contains("\"replaced_time\"")).map(String::from);
    let replaced: f64 = replaced.unwrap().split([':', ',']).nth(1).unwrap().trim().parse().unwrap();
    assert!((replaced - steps as f64 * 0.03).abs() < 1e-3, "{replaced}");
}

#[test]
fn a_run_without_a_jump_says_why() {
    for (settings, end, broken, words) in [
        (
            SETTINGS,
            3.0,
            1e9,
            "no fit: it takes 24 states 2.000e-1 s apart without a gap (minSnapshots), and at the end there were 15; a first one comes at 4.8 s",
        ),
        // Noise
        (SETTINGS, 30.0, f64::NAN, "fits, the best with an error of "),
    ] {
        let mut host = Host::met(settings, end, broken);
        host.ride.end();
        host.listen();
        assert_eq!((host.jumps.len(), host.solved), (0, (end / DELTA_T).round() as usize));
        assert!(host.log.contains(words), "{words}: {}", host.log);
    }
}

#[test]
fn the_largest_wave_of_a_fit_is_most_of_the_state() {
    let mut host = Host::waves(SETTINGS, 20.0);
    assert!(host.ride.wave(0, 0, 1, 0).is_none(), "there is no fit");
    // Within the first jump
    host.until(1e9, |h| h.time > 5.55);
    let [mean, wave] = [0, 1].map(|part| host.ride.wave(0, 0, part, 0).unwrap());
    let now = solver(host.time, 1e9);
    let with: Vec<f64> = mean.iter().zip(&wave).map(|(m, w)| m + w).collect();
    assert!(largest(&with, &now) < 0.6 * largest(&mean, &now), "{with:?} {mean:?} {now:?}");
    assert!(host.ride.wave(0, 99, 1, 0).is_none() && host.ride.wave(0, 0, 4, 0).is_none());
    // In each cell that of sin and 0.3 cos
    let rms = host.ride.wave(0, 0, 3, 0).unwrap();
    assert!(largest(&rms, &[0.545f64.sqrt(); CELLS]) < 0.01, "{rms:?}");
    assert!(host.ride.wave(0, 1, 3, 0).is_none());
}

#[test]
fn an_old_level_is_a_state_on_the_way() {
    let mut host = Host::waves(SETTINGS, 20.0);
    // Behind the third stride of the first jump.
    host.until(1e9, |h| h.time > 5.55);
    // What is handed out is one combination for all arrays.
    assert!(largest(&host.state[1], &flux(&host.state[0])) < 1e-13);
    let (mut u, mut phi) = (vec![0.0; CELLS], vec![0.0; CELLS]);
    host.ride.old_level(DELTA_T, &mut [&mut u, &mut phi]).unwrap();
    let (own, before) = (solver(host.time, 1e9), solver(host.time - DELTA_T, 1e9));
    assert!(largest(&u, &before) < 1e-5 && largest(&own, &before) > 1e-3, "{u:?}");
    assert!(largest(&phi, &flux(&u)) < 1e-13);
}

#[test]
fn a_fit_that_no_longer_holds_is_dropped_and_another_is_made() {
    let host = Host::met(SETTINGS, 60.0, 7.0);
    assert!(host.log.contains("the fit is dropped"), "{}", host.log);
    assert!(host.jumps.len() > 3, "{:?}", host.jumps);
    let (_, dropped, _) = host.jumps[1];
    let again = host.jumps.iter().find(|j| j.1 > dropped + 24.0 * 0.2 && j.0 == 5);
    assert!(again.is_some(), "{:?}\n{}", host.jumps, host.log);
}

#[test]
fn a_fit_that_agrees_to_the_tolerance_alone_has_shorter_jumps() {
    let settings = SETTINGS.replace("\"initialJump\"", "\"jumpTolerance\": 10, \"initialJump\"");
    let host = Host::met(&settings, 8.5, 6.5);
    assert!(host.log.contains("error of 1.083 of holding; the next jump may have 5 strides"), "{}", host.log);
    assert!(!host.log.contains("the fit is dropped"), "{}", host.log);
}

#[test]
fn what_has_come_to_rest_is_jumped() {
    let host = Host::met(SETTINGS, 60.0, -4.0);
    // 24 states after 4 s
    assert!(host.jumps.len() > 3 && host.solved < 300, "{:?}\n{}", host.jumps, host.log);
    assert!(largest(&host.state[0], &solver(4.0, 1e9)) < 1e-12);
    // Noise below what counts as no change, and noise above it where that is given
    let host = Host::met(SETTINGS, 60.0, -104.0);
    assert!(host.jumps.len() > 3 && host.solved < 300, "{:?}\n{}", host.jumps, host.log);
    assert!(largest(&host.state[0], &solver(4.0, 1e9)) < 2e-6);
    let settings = SETTINGS.replace("\"initialJump\"", "\"rest\": {\"u\": 1e-9}, \"initialJump\"");
    let host = Host::met(&settings, 30.0, -104.0);
    assert!(host.jumps.is_empty(), "{:?}\n{}", host.jumps, host.log);
    let settings = SETTINGS.replace("\"initialJump\"", "\"rest\": {\"T\": 1}, \"initialJump\"");
    let settings = RideSettings::parse(&settings).unwrap();
    let made = Ride::new(Comm::serial(), guest(), settings, toy::at(0.0, DELTA_T, 9.0, 0));
    m4gn_samples::fails(made, &["rest: T: expected some of the fields"]);
}
