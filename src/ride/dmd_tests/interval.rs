//! The time between states where a case sets none, or one that is shorter than the solver's steps.

use super::*;

const NO_INTERVAL: &str =
    r#"{"mode": "replace", "surrogates": ["dmd"], "dmd": {"initialJump": 5, "window": 24}}"#;

/// A cautious first step that grows: states are so many of the present steps apart, and none lies inside of a step.
#[test]
fn the_stride_follows_the_step() {
    let ramp: fn(f64) -> f64 = |time| (0.2 * time + 1e-8).min(0.025);
    let mut worst = 0.0;
    let mut host = Host::fitting(NO_INTERVAL, toy::at(0.0, 1e-8, 40.0, 0), solver(0.0, 1e9));
    host.delta_t = ramp;
    host.until(1e9, watch(&mut worst));
    assert!(host.log.contains("s: states are kept 2.160e-1"), "{}", host.log);
    let fits = host.log.matches(": fit of").count();
    assert!(
        fits < 30 && !host.log.contains("error of 1.") && !host.log.contains("error of 2."),
        "{}",
        host.log
    );
    assert!(!host.jumps.is_empty() && worst < 1e-3, "{worst} {:?}\n{}", host.jumps, host.log);
    // And back, once the long steps are long gone.
    let stride = host.ride.candidates[0].stride();
    assert!((0.125..=0.25).contains(&stride), "{stride}");
    (host.delta_t, host.end) = (|_| 0.0025, 400.0);
    host.until(1e9, |_| false);
    let stride = host.ride.candidates[0].stride();
    assert!((0.0125..=0.05).contains(&stride), "{stride}");
}

/// Where a case sets no interval: ten steps are a hundredth of the wave's period, and the interval is doubled until it is some fourteenth.
#[test]
fn the_stride_follows_the_period() {
    let mut worst = 0.0;
    let mut host = Host::waves(NO_INTERVAL, 60.0);
    host.delta_t = |_| 0.0025;
    host.until(f64::INFINITY, watch(&mut worst));
    assert!(host.log.contains(": fits show a period of "), "{}", host.log);
    let stride = host.ride.candidates[0].stride();
    assert!((0.1..=0.4).contains(&stride), "periods are 3.3 and 2.0: {stride}\n{}", host.log);
    assert!(!host.jumps.is_empty() && worst < 0.05, "{worst} {:?}\n{}", host.jumps, host.log);
}

/// Ten steps are a third of the large wave's period, and more than half of the small one's: a fit of such states holds, and is wrong between them.
#[test]
fn the_stride_is_shorter_where_a_period_has_few_steps() {
    let mut worst = 0.0;
    let mut host = Host::fitting(NO_INTERVAL, toy::at(0.0, 0.1125, 60.0, 0), solver(0.0, 1e9));
    (host.delta_t, host.looks) = (|_| 0.1125, 1.0);
    host.until(1e9, watch(&mut worst));
    assert!(host.log.contains(": fits show a period of 3.307e0 s: states are kept 2.36"), "{}", host.log);
    assert!(!host.jumps.is_empty() && worst < 0.1, "{worst} {:?}\n{}", host.jumps, host.log);
}

/// Ten steps are nearly a period: states show a wave of sixteen times that, and a fit of them holds and is wrong between them.
#[test]
fn states_that_miss_waves_are_set_nearer() {
    let settings = r#"{"mode": "replace", "surrogates": ["dmd"], "control": {"tolerance": 1, "relTol": 1}, "dmd": {"initialJump": 5, "window": 24INTERVAL}}"#;
    let run = |interval: &str| {
        let settings = settings.replace("INTERVAL", interval);
        let mut worst = 0.0;
        let mut host = Host::fitting(&settings, toy::at(0.0, 0.31, 160.0, 0), solver(0.0, 1e9));
        (host.delta_t, host.looks) = (|_| 0.31, 1.0);
        host.until(1e9, watch(&mut worst));
        assert!(host.log.contains("between its states the fit had an error of 1."), "{}", host.log);
        (host, worst)
    };
    let (host, worst) = run("");
    assert!(!host.jumps.is_empty() && worst < 0.1, "{worst} {:?}\n{}", host.jumps, host.log);
    let (host, _) = run(", \"snapshotInterval\": 3.1");
    assert!(host.log.contains("expected a smaller snapshotInterval"), "{}", host.log);
    assert!(host.jumps.is_empty(), "{:?}\n{}", host.jumps, host.log);
}

/// An interval that is shorter than the steps is doubled until it is not.
#[test]
fn states_are_no_nearer_than_steps() {
    let settings = SETTINGS.replace("\"snapshotInterval\": 0.2", "\"snapshotInterval\": 0.05");
    let mut host = Host::waves(&settings, 30.0);
    host.delta_t = |time| if time < 3.0 { 0.05 } else { 0.12 };
    host.until(1e9, |_| false);
    assert!(
        host.log.contains("the solver's step is 1.200e-1 s: states are kept 2.000e-1 s apart"),
        "{}",
        host.log
    );
    assert!(!host.jumps.is_empty(), "{}", host.log);
}
