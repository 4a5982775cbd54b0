use super::*;
use crate::processes::{ALL, Kind, Process};
use crate::{Goal, Tolerance, Watch};
use std::f64::consts::TAU;

fn of(n: usize, step: f64, value: impl Fn(f64) -> f64) -> Series {
    let times: Vec<f64> = (1..=n).map(|i| step * i as f64).collect();
    let values: Vec<f64> = times.iter().map(|t| value(*t)).collect();
    Series::of(&times, &values)
}

fn estimated(series: &Series) -> Estimate {
    estimate(series, 0.95).unwrap()
}

#[test]
fn a_constant_is_known() {
    let found = estimated(&of(100, 0.1, |_| 3.0));
    let rounding = [found.mean - 3.0, found.half_width, found.rms, found.rms_half_width];
    assert!(rounding.iter().all(|v| v.abs() < 1e-12), "{found:?}");
    assert!(found.mean_steady && found.rms_steady && found.frequency.is_none());
    assert!(found.unvaried && estimated(&of(100, 0.1, |_| 0.0)).unvaried);
    let settled = estimated(&of(100, 0.1, |t| if t < 1.0 { 2.0 } else { 3.0 }));
    assert!(!settled.unvaried && settled.mean_steady, "{settled:?}");
    assert_eq!(estimate(&of(15, 0.1, |_| 3.0), 0.95), None);
}

#[test]
fn a_sine_is_known_after_two_periods() {
    // 2.4 periods of 0.5 s
    let found = estimated(&of(240, 0.005, |t| 2.0 + (TAU * 2.0 * t).sin()));
    assert_eq!((found.periods, found.periodic), (Some(2), true));
    assert!((found.mean - 2.0).abs() < 0.001 && found.half_width < 0.02, "{found:?}");
    assert!((found.rms - 0.5_f64.sqrt()).abs() < 0.002 && found.rms_half_width < 0.02, "{found:?}");
    assert!((found.frequency.unwrap() - 2.0).abs() < 0.02, "{found:?}");
    assert!(found.mean_steady && found.rms_steady, "{found:?}");
    // Not before
    let early = estimated(&of(140, 0.005, |t| 2.0 + (TAU * 2.0 * t).sin()));
    assert!(!early.mean_steady, "{early:?}");
}

#[test]
fn what_repeats_itself_is_known_to_no_more_than_its_rows() {
    // Records that end anywhere in a period, of rows that divide none
    for k in 0..40 {
        let rows = 2000 + 7 * k;
        let wave = |t: f64| (TAU * t).sin() + 0.3 * (2.0 * TAU * t + 0.7).sin();
        let found = estimated(&of(rows, 1.0 / 37.3, |t| 2.0 + wave(t)));
        assert!(found.periodic && (found.mean - 2.0).abs() <= found.half_width, "{rows}: {found:?}");
        assert!((found.rms - 0.545_f64.sqrt()).abs() <= found.rms_half_width, "{rows}: {found:?}");
    }
}

#[test]
fn a_transient_is_cut() {
    let wave = |t: f64| (TAU * t).sin();
    let found = estimated(&of(4000, 0.01, |t| 2.0 + wave(t) + 8.0 * (-t / 1.5).exp()));
    assert!((3.0..20.1).contains(&found.transient_end), "{found:?}");
    assert!((found.mean - 2.0).abs() < 0.005 && found.mean_steady, "{found:?}");
    // An amplitude that has grown
    let found = estimated(&of(4000, 0.01, |t| 2.0 + wave(t) * (1e-3 * (t / 1.5).exp()).min(1.0)));
    assert!((8.0..20.1).contains(&found.transient_end), "{found:?}");
    assert!((found.rms - 0.5_f64.sqrt()).abs() < 0.01 && found.rms_steady, "{found:?}");
    // One that still grows
    let found = estimated(&of(4000, 0.01, |t| 2.0 + wave(t) * (t / 15.0).exp()));
    assert!(!found.rms_steady, "{found:?}");
}

#[test]
fn a_drift_is_never_known() {
    let goal = Goal { mean: Some(Tolerance::Absolute(0.2)), rms: None };
    for seed in 0..10 {
        let mut watch = Watch::new(0.95, goal);
        let mut noise = Process::new(Kind::Ar(0.5), seed, false);
        for i in 0..4000 {
            let time = f64::from(i + 1);
            let value = 0.02 * time + noise.next_row().1;
            watch.series.push(Row { time, value, weight: 1.0, surrogate: false });
            if watch.due() {
                let found = watch.check();
                assert!(!watch.settled(), "row {i}: {found:?}");
            }
        }
    }
    assert!(!estimated(&of(500, 0.1, |t| 0.1 * t)).mean_steady);
    assert!(!estimated(&of(500, 0.1, |t| t.ln())).mean_steady);
}

#[test]
fn what_settles_is_known_within_what_is_left() {
    for wave in [0.0, 3.0] {
        let found = estimated(&of(400, 1.0, |t| 5.0 + (-t / 20.0).exp() * (wave * t).cos()));
        assert!((found.mean - 5.0).abs() <= found.half_width && found.half_width < 1e-6, "{found:?}");
        assert!(found.mean_steady && !found.rms_steady, "{found:?}");
    }
}

/// A flow comes to rest, but for a slow wave that a solver's tolerance leaves.
#[test]
fn what_rests_is_known_by_what_it_ranges_over() {
    let rests = of(400, 1.0, |t| 1.0 + 0.01 * (-t / 4.0).exp() + 1e-5 * (t / 30.0 + 1.5).sin());
    let mut series = Series::default();
    rests.rows().iter().for_each(|row| assert!(series.push(Row { surrogate: row.time > 200.0, ..*row })));
    let found = estimated(&series);
    assert!(found.mean_steady && !found.rms_steady, "{found:?}");
    assert!((found.surrogate_share - 2.0 / 3.0).abs() < 1e-9, "{found:?}");
    assert!((found.mean - 1.0).abs() <= found.half_width && found.half_width < 1e-3, "{found:?}");
    let moves: [fn(f64) -> f64; 3] = [|t| 1.0 + 1e-5 * t, f64::sqrt, |t| 1.0 - (t / 2e3).powi(2)];
    for value in moves {
        let found = estimated(&of(400, 1.0, value));
        assert!(!found.mean_steady, "{found:?}");
    }
}

#[test]
fn rows_weigh_as_the_time_that_they_stand_for() {
    let mut series = Series::default();
    let mut time = 0.0;
    let mut noise = Process::new(Kind::Ar(0.0), 4, false);
    for i in 0..600 {
        // Each third row is a stride of a surrogate, four steps long, with a value of 1 in place of 4
        let surrogate = i % 3 == 2;
        let weight = if surrogate { 0.4 } else { 0.1 };
        time += weight;
        let value = if surrogate { 1.0 } else { 4.0 } + 0.01 * (noise.next_row().1 - 2.0);
        series.push(Row { time, value, weight, surrogate });
    }
    let found = estimated(&series);
    assert!((found.surrogate_share - 2.0 / 3.0).abs() < 0.01, "{found:?}");
    assert!((found.mean - 2.0).abs() < 0.02, "{found:?}");
}

/// A start of a thousand short steps, and forty long ones.
#[test]
fn there_are_no_more_independent_samples_than_rows_behind_the_transient() {
    let mut series = Series::default();
    let mut time = 0.0;
    for i in 0..1040 {
        let (weight, value) = match i {
            0..1000 => (1e-5, 50.0),
            _ => (0.1, if i % 2 == 0 { 1.0 } else { -1.0 }),
        };
        time += weight;
        series.push(Row { time, value, weight, surrogate: false });
    }
    let found = estimated(&series);
    assert!(found.independent_samples < 50.0, "{found:?}");
}

#[test]
fn values_whose_squares_are_no_numbers_have_no_estimate() {
    assert_eq!(estimate(&of(100, 0.1, |t| 1e200 * t.sin()), 0.95), None);
}

/// The small size of `bench/averages-coverage.rs`: intervals of 40 series of each process; the binomial distribution of 95 % gives 33 or
/// fewer in one case of a thousand.
#[test]
fn intervals_hold_as_often_as_they_say() {
    for (name, kind) in ALL.into_iter().filter(|(_, kind)| *kind != Kind::LongMemory) {
        let (mean, rms, rows) = kind.truth();
        let mut held = [0, 0];
        for seed in 0..40 {
            let mut process = Process::new(kind, 7000 + seed, true);
            let mut series = Series::default();
            let mut time = 0.0;
            for _ in 0..(200.0 * rows) as usize {
                let (weight, value) = process.next_row();
                time += weight;
                series.push(Row { time, value, weight, surrogate: false });
            }
            let found = estimated(&series);
            held[0] += usize::from((found.mean - mean).abs() <= found.half_width);
            held[1] += usize::from((found.rms - rms).abs() <= found.rms_half_width);
        }
        assert!(held[0] >= 34, "{name}: the mean's in {} of 40", held[0]);
        assert!(held[1] >= 33, "{name}: the rms's in {} of 40", held[1]);
    }
}

/// A wake by Stuart and Landau's equation, A' = s A (1 - A^2), whose drag follows the square of the amplitude and has its period twice. It settles at
/// some 9 s: what is said before 18 s rests on less than half of the record.
#[test]
fn what_comes_to_repeat_itself_is_known_within_what_is_left() {
    let amplitude = |t: f64| (1.0 + 999.0 * (-2.0 * t).exp()).powf(-0.5);
    let lift = |t: f64| 0.2 + amplitude(t) * (TAU * t).sin();
    let drag =
        |t: f64| 3.0 - 0.1 * (1.0 - amplitude(t).powi(2)) + 0.01 * ((2.0 * TAU * t).sin() + (TAU * t).cos());
    let mut earliest = [f64::INFINITY; 2];
    for rows in (700..1800).step_by(50) {
        let end = 0.01 * rows as f64;
        let of_lift = estimated(&of(rows, 0.01, lift));
        let of_drag = estimated(&of(rows, 0.01, drag));
        for (found, truth, half, steady, at) in [
            (of_lift.rms, 0.5_f64.sqrt(), of_lift.rms_half_width, of_lift.rms_steady, 0),
            (of_drag.mean, 3.0, of_drag.half_width, of_drag.mean_steady, 1),
        ] {
            assert!(
                !steady || (found - truth).abs() <= half.max(1e-4),
                "{end} s: {found} +- {half}, {truth}"
            );
            if steady && half < 0.01 * truth {
                earliest[at] = earliest[at].min(end);
            }
        }
    }
    assert!(earliest.iter().all(|e| *e < 12.0), "{earliest:?}");
}
