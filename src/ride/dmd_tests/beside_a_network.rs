//! A fit and a network in one run: whose turn it is, and rollouts of both.

use super::*;
use crate::{Description, Growth, Start, Surrogate};
use m4gn_base::Result;
use m4gn_state::Values;

/// A network's place: the solver a stride later, but for a hundredth.
struct Trained {
    description: Description,
    clock: Rc<Cell<f64>>,
}

pub(super) fn trained(clock: &Rc<Cell<f64>>, array: usize) -> Box<dyn Surrogate> {
    let description = Description {
        name: "network".into(),
        source: "trained".into(),
        digest: "trained".into(),
        stride: 0.2,
        advances: vec![array],
        growth: vec![Growth::Factors(vec![1.0; 8])],
        ..Description::default()
    };
    Box::new(Trained { description, clock: clock.clone() })
}

impl Surrogate for Trained {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, _: Start, next: &mut Values) -> Result<()> {
        next[0] = solver(self.clock.get() + 0.2, 1e9).iter().map(|v| v + 0.01).collect();
        Ok(())
    }
}

const BOTH: &str = r#"{"mode": "replace", "surrogates": ["network", "dmd"], "timeStart": 6,
    "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24, "initialJump": 5, "jumpGrowth": 2, "maxJump": 40}}"#;

#[test]
fn a_fit_that_holds_goes_before_a_network() {
    let mut host = Host::met(BOTH, 40.0, 1e9);
    assert!(!host.jumps.is_empty() && host.jumps.iter().all(|j| j.2 == 1), "{:?}\n{}", host.jumps, host.log);
    assert!(host.log.contains(": the dmd surrogate jumps"), "{}", host.log);
    assert!(largest(&host.state[0], &solver(host.time, 1e9)) < 1e-5);
    let summary = host.ride.end();
    assert!(summary.contains("\"jumps_network\": 0,"), "{summary}");
}

#[test]
fn a_network_jumps_before_there_is_a_fit_and_leaves_the_solver_time_for_one() {
    let settings = BOTH.replace("\"timeStart\": 6", "\"timeStart\": 0.5");
    let host = Host::met(&settings, 60.0, 1e9);
    let first =
        host.jumps.iter().position(|j| j.2 == 1).unwrap_or_else(|| panic!("{:?}\n{}", host.jumps, host.log));
    assert!(first > 2 && host.jumps[..first].iter().all(|j| j.2 == 0), "{:?}", host.jumps);
    // Forty strides are the network's; then 24 states of the solver.
    let [before, after] = [host.jumps[first - 1].1, host.jumps[first].1 - 0.2 * host.jumps[first].0 as f64];
    assert!(before >= 8.0 && after - before >= 23.0 * 0.2, "{:?}", host.jumps);
    assert!(host.jumps[first..].iter().all(|j| j.2 == 1), "{:?}", host.jumps);
}

/// Where no fit holds, the network goes on: the solver has a window of its own after each forty strides.
#[test]
fn a_network_goes_on_where_no_fit_holds() {
    let mut host = Host::waves(BOTH, 60.0);
    host.until(f64::NAN, |host| host.time > 12.0);
    assert!(host.jumps.is_empty() && host.log.matches("the solver goes on\n").count() > 3, "{}", host.log);
    host.until(1e9, |_| false);
    let first = host.jumps.iter().position(|j| j.2 == 1).unwrap_or_else(|| panic!("{}", host.log));
    let strides: usize = host.jumps[..first].iter().map(|jump| jump.0).sum();
    assert!((40..=48).contains(&strides), "{:?}", host.jumps);
}

/// The network is measured before there is a fit, and the fit from then on.
#[test]
#[should_panic(expected = "in 3 strides in a row")]
fn the_run_stops_where_network_and_fit_stay_bad() {
    let control = r#""control": {"tolerance": 1e-15, "onFailure": "stop", "patience": 3}, "timeStart": 0.5"#;
    let settings = BOTH.replace("\"timeStart\": 6", control);
    let mut host = Host::waves(&settings, 40.0);
    host.until(1e9, |_| false);
}

#[test]
fn surrogates_without_a_field_in_common_are_refused() {
    let settings = RideSettings::parse(BOTH).unwrap();
    let arrays = vec![Array::solved("T", 1, vec![1.0; CELLS]), Array::carried("u", CELLS)];
    let guest = Guest {
        layout: Arc::new(Layout::new(arrays).unwrap()),
        network: Some(trained(&Rc::default(), 1)),
        ..guest()
    };
    let made = Ride::new(Comm::serial(), guest, settings, toy::at(0.0, DELTA_T, 9.0, 0));
    m4gn_samples::fails(made, &["network advances u, dmd advances T"]);
}

#[test]
fn an_observer_compares_rollouts_of_the_fit_and_leaves_the_run_alone() {
    let settings = r#"{"mode": "observe", "surrogates": ["network", "dmd"], "rolloutSteps": 60,
        "dmd": {"snapshotInterval": 0.2, "minSnapshots": 24}}"#;
    let mut host = Host::met(settings, 30.0, 20.0);
    assert_eq!((host.jumps.len(), host.solved), (0, 600));
    let rows = host.tables[2].lines().filter(|l| !l.starts_with('#'));
    let rows: Vec<Vec<String>> = rows.map(|l| l.split('\t').map(String::from).collect()).collect();
    let number = |text: &String| text.parse::<f64>().unwrap();
    let of = |name: &'static str| rows.iter().filter(move |r| r[1] == name);
    // Time, name, steps, oneStep, hold, rollout: after the first fit a rollout of sixty strides, from states that are long gone at its end,
    // until the waves change.
    let linear: Vec<_> = of("dmd").collect();
    assert!((number(&linear[0][0]) - 5.0).abs() < 1e-9, "{:?}", linear[0]);
    let steps: Vec<f64> = linear.iter().map(|r| number(&r[2])).collect();
    assert_eq!(steps[..60], (1..=60).map(f64::from).collect::<Vec<_>>()[..]);
    assert!(linear[..60].iter().all(|r| number(&r[5]) < 1e-3 && number(&r[4]) > 0.0), "{:?}", linear[59]);
    // What the fit does not know is told, though it was dropped: the rollout that met it goes on.
    let late = linear.iter().filter(|r| number(&r[0]) > 22.0);
    assert!(late.clone().any(|r| number(&r[5]) > 0.5), "{:?}", linear.last());
    assert!(of("network").all(|r| (number(&r[3]) - 0.01).abs() < 1e-6 || number(&r[0]) > 20.0));
    host.ride.end();
    host.listen();
    assert!(host.log.contains("mean rms errors of the dmd surrogate"), "{}", host.log);
}
