//! The dmd surrogate in a ride: two waves that a fit knows exactly, and what happens where it does not.

use crate::linear::settled;
use crate::schedule::Step;
use crate::{Action, Advanced, DmdSettings, Fitted, Given, Kind, Mode, Ride, RideSettings, Surrogate, Text};
use m4gn_linear::Field as Array;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use m4gn_step::{Field, FieldMut};
use std::cell::Cell;
use std::rc::Rc;

const CELLS: usize = 12;
const DELTA_T: f64 = 0.05;

/// Waves of constant size; from `broken` on of another frequency, or at rest where it is negative. Noise where it is not a number.
fn solver(time: f64, broken: f64) -> Vec<f64> {
    if broken < 0.0 {
        return solver(time.min(-broken), 1e9);
    }
    if broken.is_nan() {
        let noise = |i: usize| 43758.5453 * (12.9898 * (time / DELTA_T).round() + 78.233 * i as f64).sin();
        return (0..CELLS).map(|i| noise(i).rem_euclid(1.0)).collect();
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

struct Host {
    ride: Ride<'static>,
    time: f64,
    index: i64,
    end: f64,
    u: Vec<f64>,
    phi: Vec<f64>,
    /// Strides of each jump, and the time at which it ended.
    jumps: Vec<(usize, f64)>,
    /// Who jumped.
    by: Vec<usize>,
    solved: usize,
    log: String,
    /// Of strides, and of an observer's errors.
    tables: [String; 2],
    clock: Rc<Cell<f64>>,
}

/// A network's place: the solver a stride later, but for a hundredth.
struct Trained {
    fields: Vec<Advanced>,
    clock: Rc<Cell<f64>>,
}

impl Surrogate for Trained {
    fn name(&self) -> &str {
        "network"
    }

    fn source(&self) -> String {
        "trained".into()
    }

    fn digest(&self) -> String {
        "trained".into()
    }

    fn stride(&self) -> f64 {
        0.2
    }

    fn advances(&self) -> &[Advanced] {
        &self.fields
    }

    fn growth(&self, _: &str) -> Option<Vec<f64>> {
        Some(vec![1.0; 8])
    }

    fn step(&mut self, _: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let later = solver(self.clock.get() + 0.2, 1e9);
        out[0].cells.iter_mut().zip(later).for_each(|(o, v)| *o = v + 0.01);
        Ok(())
    }
}

fn step(time: f64, index: i64, end: f64) -> Step {
    Step {
        time,
        delta_t: DELTA_T,
        end_time: end,
        index,
        name: format!("{time:.3}"),
        shown: time,
        correctors: None,
        wall: 0.0,
    }
}

impl Host {
    fn new(settings: &str, start: f64, index: i64, end: f64, u: Vec<f64>) -> Self {
        let settings = RideSettings::parse(settings).unwrap();
        let arrays = vec![Array::weighted("u", 1, vec![1.0; CELLS]), Array::carried("phi", CELLS)];
        let advanced = vec![Advanced { name: "u".into(), components: 1, solved: 1 }];
        let comm = Comm::serial();
        let begin = step(start, index, end);
        let own: DmdSettings = settings.dmd.clone().unwrap();
        let observes = settings.mode == Mode::Observe;
        let fitted = Fitted::new(&comm, arrays, advanced, own, observes, &begin).unwrap();
        let clock = Rc::new(Cell::new(start));
        let mut riding: Vec<Box<dyn Surrogate>> = vec![Box::new(fitted)];
        if settings.has(Kind::Network) {
            let fields = vec![Advanced { name: "u".into(), components: 1, solved: 1 }];
            riding.insert(0, Box::new(Trained { fields, clock: clock.clone() }));
        }
        let ride = Ride::new(comm, riding, settings, (0..CELLS as i64).collect(), begin).unwrap();
        let phi = flux(&u);
        let (jumps, log, tables) = (Vec::new(), String::new(), Default::default());
        Host { ride, time: start, index, end, u, phi, jumps, by: Vec::new(), solved: 0, log, tables, clock }
    }

    fn now(&self) -> Step {
        step(self.time, self.index, self.end)
    }

    fn with<T>(&mut self, call: impl FnOnce(&mut Ride<'static>, &Given) -> T) -> T {
        self.clock.set(self.time);
        let fields = [Field { name: "u", components: 1, cells: &self.u, boundary: &[] }];
        call(&mut self.ride, &Given { fields: &fields, held: &[], owners: &[] })
    }

    /// Until the end, or until `stop` says so behind a step or a stride.
    fn run(&mut self, broken: f64, stop: impl Fn(&Self) -> bool) {
        while self.time < self.end - 0.5 * DELTA_T {
            self.index += 1;
            self.time += DELTA_T;
            // The solver goes on from where it is: its waves have no memory but the time.
            self.u = solver(self.time, broken);
            self.phi = flux(&self.u);
            self.solved += 1;
            let answer = self.ride.solved(self.now()).unwrap();
            if answer.arrays {
                let (u, phi) = (self.u.clone(), self.phi.clone());
                self.ride.record(&[&u, &phi]).unwrap();
            }
            if stop(self) {
                return;
            }
            let answer = self.with(|ride, given| ride.decide(given)).unwrap();
            self.listen();
            if answer.action == Action::Stride && self.jump(&stop) {
                return;
            }
        }
    }

    fn listen(&mut self) {
        self.log += &self.ride.take(Text::Log);
        self.tables[0] += &self.ride.take(Text::Strides);
        self.tables[1] += &self.ride.take(Text::Errors);
    }

    /// Whether it was stopped.
    fn jump(&mut self, stop: &impl Fn(&Self) -> bool) -> bool {
        let (mut strides, mut who) = (0, 0);
        loop {
            let mut out = vec![0.0; CELLS];
            let places = &mut [FieldMut { name: "u", components: 1, cells: &mut out }];
            let answer = self.with(|ride, given| ride.stride(given, places)).unwrap();
            if answer.action == Action::HandBack {
                break;
            }
            assert_eq!(answer.action, Action::Advance);
            who = answer.surrogate;
            // A network has no arrays.
            match self.ride.arrays(0.0, &mut [&mut self.u, &mut self.phi]) {
                Ok(()) => assert_eq!(out, self.u),
                Err(_) => self.u.copy_from_slice(&out),
            }
            (self.time, self.index) = (self.time + answer.duration, self.index + answer.solver_steps);
            strides += 1;
            let answer = self.ride.advanced(self.now()).unwrap();
            if stop(self) {
                return true;
            }
            if answer.action == Action::HandBack {
                break;
            }
        }
        self.jumps.push((strides, self.time));
        self.by.push(who);
        let now = self.now();
        self.with(|ride, given| ride.handed_back(now, &[], given)).unwrap();
        self.listen();
        false
    }
}

const SETTINGS: &str = r#"{"mode": "replace", "surrogates": ["dmd"], "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24, "initialJump": 5, "jumpGrowth": 2, "maxJump": 40}}"#;

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn jumps_grow_while_the_fit_holds_and_end_states_are_exact() {
    let mut host = Host::new(SETTINGS, 0.0, 0, 60.0, solver(0.0, 1e9));
    host.run(1e9, |_| false);
    let strides: Vec<usize> = host.jumps.iter().map(|j| j.0).collect();
    assert_eq!(strides[..4], [5, 10, 20, 40], "{}", host.log);
    // 24 states, the first at 0.2 s; one stride beside the solver.
    let (first, end) = host.jumps[0];
    assert!((end - first as f64 * 0.2 - (0.2 + 24.0 * 0.2)).abs() < 1e-9, "{end}");
    assert!(host.solved < 220, "{}", host.solved);
    assert!(largest(&host.u, &solver(host.time, 1e9)) < 1e-5);
    for words in ["keeps up to 40 states 0.2 s apart: ", "it is used", "the next jump may have 20 strides"] {
        assert!(host.log.contains(words), "{words}: {}", host.log);
    }
}

#[test]
fn what_is_handed_out_is_one_combination_for_all_arrays() {
    let mut host = Host::new(SETTINGS, 0.0, 0, 20.0, solver(0.0, 1e9));
    host.run(1e9, |h| h.jumps.len() == 1);
    assert!(largest(&host.phi, &flux(&host.u)) < 1e-13);
}

#[test]
fn an_old_level_is_a_state_on_the_way() {
    let mut host = Host::new(SETTINGS, 0.0, 0, 20.0, solver(0.0, 1e9));
    // Behind the third stride of the first jump.
    host.run(1e9, |h| h.time > 5.55);
    let (mut u, mut phi) = (vec![0.0; CELLS], vec![0.0; CELLS]);
    host.ride.arrays(DELTA_T, &mut [&mut u, &mut phi]).unwrap();
    let (own, before) = (solver(host.time, 1e9), solver(host.time - DELTA_T, 1e9));
    assert!(largest(&u, &before) < 1e-5 && largest(&own, &before) > 1e-3, "{u:?}");
    assert!(largest(&phi, &flux(&u)) < 1e-13);
}

#[test]
fn a_fit_that_no_longer_holds_is_dropped_and_another_is_made() {
    let mut host = Host::new(SETTINGS, 0.0, 0, 60.0, solver(0.0, 7.0));
    host.run(7.0, |_| false);
    assert!(host.log.contains("the fit is dropped"), "{}", host.log);
    assert!(host.jumps.len() > 3, "{:?}", host.jumps);
    let (_, dropped) = host.jumps[1];
    let again = host.jumps.iter().find(|j| j.1 > dropped + 24.0 * 0.2 && j.0 == 5);
    assert!(again.is_some(), "{:?}\n{}", host.jumps, host.log);
}

#[test]
fn a_fit_that_agrees_to_the_tolerance_alone_has_shorter_jumps() {
    let settings = SETTINGS.replace("\"first\"", "\"tolerance\": 10, \"first\"");
    let mut host = Host::new(&settings, 0.0, 0, 8.5, solver(0.0, 6.5));
    host.run(6.5, |_| false);
    assert!(
        host.log.contains("off by 1.083 of what holding would be; the next jump may have 5 strides"),
        "{}",
        host.log
    );
    assert!(!host.log.contains("the fit is dropped"), "{}", host.log);
}

const BOTH: &str = r#"{"mode": "replace", "surrogates": ["network", "dmd"], "timeStart": 6,
    "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24, "initialJump": 5, "jumpGrowth": 2, "maxJump": 40}}"#;

#[test]
fn of_a_network_and_a_fit_the_nearer_one_jumps() {
    let mut host = Host::new(BOTH, 0.0, 0, 40.0, solver(0.0, 1e9));
    host.run(1e9, |_| false);
    assert!(!host.by.is_empty() && host.by.iter().all(|who| *who == 1), "{:?}\n{}", host.by, host.log);
    assert!(host.log.contains("the network surrogate beside the solver was off by 0.0"), "{}", host.log);
    assert!(host.log.contains(": the dmd surrogate jumps"), "{}", host.log);
    assert!(
        host.tables[0].contains("\tanother\t") && host.tables[0].contains("\tjumps\t"),
        "{}",
        host.tables[0]
    );
    assert!(largest(&host.u, &solver(host.time, 1e9)) < 1e-5);
    let summary = host.ride.end();
    assert!(summary.contains("\"jumps_network\": 0,"), "{summary}");
}

#[test]
fn a_network_jumps_before_there_is_a_fit_and_leaves_the_solver_time_for_one() {
    let settings = BOTH.replace("\"timeStart\": 6", "\"timeStart\": 0.5");
    let mut host = Host::new(&settings, 0.0, 0, 60.0, solver(0.0, 1e9));
    host.run(1e9, |_| false);
    let first =
        host.by.iter().position(|who| *who == 1).unwrap_or_else(|| panic!("{:?}\n{}", host.by, host.log));
    assert!(first > 2 && host.by[..first].iter().all(|who| *who == 0), "{:?}", host.by);
    // Forty strides are the network's; then 24 states of the solver.
    let [before, after] = [host.jumps[first - 1].1, host.jumps[first].1 - 0.2 * host.jumps[first].0 as f64];
    assert!(before >= 8.0 && after - before >= 23.0 * 0.2, "{:?}", host.jumps);
    assert!(host.by[first..].iter().all(|who| *who == 1), "{:?}", host.by);
    let said = |words: &str| host.log.matches(words).count();
    assert_eq!(
        said("the network surrogate waits, not measured, while the dmd surrogate is given"),
        1,
        "{}",
        host.log
    );
    assert_eq!(said("the network surrogate is measured again, beside a fit that holds"), 1, "{}", host.log);
    let summary = host.ride.end();
    let waited = summary.lines().find_map(|l| l.trim().strip_prefix("\"waited\": ")).unwrap();
    let waited: f64 = waited.trim_end_matches(',').parse().unwrap();
    assert!((waited - (after - before)).abs() < 0.41, "{waited} of {before} to {after}");
}

/// Fits that were far off before there was anything to wait for, in noise, do not make the network's turn longer.
#[test]
fn a_turn_is_longer_only_after_waiting_in_vain() {
    let mut host = Host::new(BOTH, 0.0, 0, 60.0, solver(0.0, 1e9));
    host.run(f64::NAN, |host| host.time > 12.0);
    assert!(host.jumps.is_empty() && host.log.matches("the solver goes on\n").count() > 3, "{}", host.log);
    host.run(1e9, |_| false);
    let first = host.by.iter().position(|who| *who == 1).unwrap_or_else(|| panic!("{}", host.log));
    let strides: usize = host.jumps[..first].iter().map(|jump| jump.0).sum();
    assert!((40..=48).contains(&strides), "{:?}", host.jumps);
}

#[test]
fn surrogates_without_a_field_in_common_are_refused() {
    let settings = RideSettings::parse(BOTH).unwrap();
    let begin = step(0.0, 0, 9.0);
    let arrays = vec![Array::weighted("T", 1, vec![1.0; CELLS])];
    let advanced = vec![Advanced { name: "T".into(), components: 1, solved: 1 }];
    let own = settings.dmd.clone().unwrap();
    let fitted = Fitted::new(&Comm::serial(), arrays, advanced, own, false, &begin).unwrap();
    let fields = vec![Advanced { name: "u".into(), components: 1, solved: 1 }];
    let trained = Trained { fields, clock: Rc::default() };
    let global = (0..CELLS as i64).collect();
    let made = Ride::new(Comm::serial(), vec![Box::new(trained), Box::new(fitted)], settings, global, begin);
    let said = made.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("network advances u, dmd advances T"), "{said}");
}

#[test]
fn an_observer_compares_rollouts_of_the_fit_and_leaves_the_run_alone() {
    let settings = r#"{"mode": "observe", "surrogates": ["network", "dmd"], "rolloutSteps": 60,
        "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24}}"#;
    let mut host = Host::new(settings, 0.0, 0, 30.0, solver(0.0, 20.0));
    host.run(20.0, |_| false);
    assert_eq!((host.jumps.len(), host.solved), (0, 600));
    let rows = host.tables[1].lines().filter(|l| !l.starts_with('#'));
    let rows: Vec<Vec<String>> = rows.map(|l| l.split('\t').map(String::from).collect()).collect();
    let number = |text: &String| text.parse::<f64>().unwrap();
    let of = |name: &'static str| rows.iter().filter(move |r| r[1] == name);
    // Time, name, steps, oneStep, hold, rollout: after the first fit a rollout of sixty strides, from states that are long gone at its end,
    // until the waves change.
    let dmd: Vec<_> = of("dmd").collect();
    assert!((number(&dmd[0][0]) - 5.0).abs() < 1e-9, "{:?}", dmd[0]);
    let steps: Vec<f64> = dmd.iter().map(|r| number(&r[2])).collect();
    assert_eq!(steps[..60], (1..=60).map(f64::from).collect::<Vec<_>>()[..]);
    assert!(dmd[..60].iter().all(|r| number(&r[5]) < 1e-3 && number(&r[4]) > 0.0), "{:?}", dmd[59]);
    // What the fit does not know is told, though it was dropped: the rollout that met it goes on.
    let late = dmd.iter().filter(|r| number(&r[0]) > 22.0);
    assert!(late.clone().any(|r| number(&r[5]) > 0.5), "{:?}", dmd.last());
    assert!(of("network").all(|r| (number(&r[3]) - 0.01).abs() < 1e-6 || number(&r[0]) > 20.0));
    host.ride.end();
    host.listen();
    assert!(host.log.contains("mean rms errors of the dmd surrogate"), "{}", host.log);
}

#[test]
fn noise_is_never_jumped() {
    let mut host = Host::new(SETTINGS, 0.0, 0, 30.0, solver(0.0, f64::NAN));
    host.run(f64::NAN, |_| false);
    assert_eq!((host.jumps.len(), host.solved), (0, 600));
    host.log += &host.ride.take(Text::Log);
    assert!(host.log.contains("the solver goes on"), "{}", host.log);
}

#[test]
fn a_run_that_is_carried_on_in_a_jump_and_beside_the_solver_has_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("states");
    let settings = SETTINGS.replace("\"first\"", &format!("\"file\": {:?}, \"first\"", file));
    // In the second jump, between two samples of the solver, and where the last states are all the same.
    for (broken, at) in [(1e9, 7.65), (1e9, 9.05), (1e9, 4.9), (-4.0, 6.9)] {
        let mut whole = Host::new(&settings, 0.0, 0, 25.0, solver(0.0, broken));
        whole.run(broken, |_| false);
        let path = folder.path().join("ride.state");
        let mut first = Host::new(&settings, 0.0, 0, 25.0, solver(0.0, broken));
        first.run(broken, |h| h.time > at - 1e-9);
        first.ride.save(&path).unwrap();
        let mut second = Host::new(&settings, first.time, first.index, 25.0, first.u.clone());
        let now = second.now();
        let answer = second.ride.load(&path, now).unwrap();
        let stopped = match answer.action {
            Action::Decide => {
                if answer.arrays {
                    let (u, phi) = (second.u.clone(), second.phi.clone());
                    second.ride.record(&[&u, &phi]).unwrap();
                }
                let answer = second.with(|ride, given| ride.decide(given)).unwrap();
                answer.action == Action::Stride && second.jump(&|_| false)
            }
            Action::Stride => second.jump(&|_| false),
            _ => false,
        };
        assert!(!stopped);
        second.run(broken, |_| false);
        let bits = |h: &Host| h.u.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&whole), bits(&second), "{at}: {:?} {:?}", whole.jumps, second.jumps);
        assert_eq!(whole.jumps.last(), second.jumps.last());
    }
}

#[test]
fn settings_that_cannot_be_are_named() {
    for (dmd, words) in [
        (r#"{"snapshotInterval": 0}"#, "snapshotInterval"),
        (r#"{"jumpTolerance": -1}"#, "jumpTolerance"),
        (r#"{"jumpGrowth": 0.5}"#, "jumpGrowth"),
        (r#"{"maxJump": 3}"#, "maxJump"),
        (r#"{"maxJump": 2147483647}"#, "maxJump"),
        (r#"{"holdOut": 18446744073709551615}"#, "minSnapshots"),
        (r#"{"minSnapshots": 3}"#, "minSnapshots"),
        (r#"{"windo": 3}"#, "window"),
    ] {
        let text = format!(r#"{{"mode": "replace", "surrogates": ["dmd"], "dmd": {dmd}}}"#);
        let error = RideSettings::parse(&text).unwrap_err().to_string();
        assert!(error.contains(words), "{dmd}: {error}");
    }
    let small = r#"{"mode": "replace", "surrogates": ["dmd"], "dmd": {"window": 24}}"#;
    RideSettings::parse(small).expect("a smaller window needs no other entry");
    for (text, words) in [
        (r#"{"mode": "replace", "surrogates": ["dmd", "dmd"]}"#, "each once"),
        (r#"{"mode": "replace", "solverSteps": 1, "surrogateSteps": 1, "dmd": {}}"#, "does not name it"),
        (r#"{"mode": "replace", "surrogates": ["quadratic"]}"#, "dmd"),
    ] {
        let error = RideSettings::parse(text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn a_fit_waits_while_fits_get_better() {
    assert!(!settled(&[], 0.01) && !settled(&[0.01, 0.01], 0.01), "too few tries to tell");
    assert!(!settled(&[0.04, 0.02, 0.012], 0.01), "it still falls");
    assert!(settled(&[0.011, 0.009, 0.013], 0.01), "noise");
    assert!(settled(&[0.9, 0.011, 0.009, 0.013], 0.01), "what was long before does not count");
}
