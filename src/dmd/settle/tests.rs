//! Waves whose amplitude is known in closed form.

use super::*;
use crate::tests::window_of;
use crate::wave::{WINDOW, clear, leading};
use std::f64::consts::TAU;

const N: usize = 40;

/// A wave of a period of 7.3 snapshots with a harmonic and what it does to the mean.
fn states(amplitude: impl Fn(f64) -> f64, numbers: std::ops::Range<usize>) -> Vec<Vec<f64>> {
    let pattern = |p: usize, i: usize| (1.3 * i as f64 * (p as f64 + 1.0) + p as f64).sin();
    let state = |k: usize| {
        let (first, angle) = (amplitude(k as f64), TAU / 7.3 * k as f64);
        let of = |i: usize| {
            let wave = angle.cos() * pattern(0, i) + angle.sin() * pattern(1, i);
            let second = (2.0 * angle).cos() * pattern(2, i) + (2.0 * angle).sin() * pattern(3, i);
            first * wave + 0.2 * first * first * (second + pattern(4, i))
        };
        (0..N).map(of).collect()
    };
    numbers.map(state).collect()
}

/// d ln A/dt = s (1 - A^2), in closed form.
fn amplitude(first: f64, growth: f64, k: f64) -> f64 {
    (1.0 + (1.0 / (first * first) - 1.0) * (-2.0 * growth * k).exp()).powf(-0.5)
}

fn stuart_landau(first: f64, growth: f64, length: usize) -> Vec<Vec<f64>> {
    states(|k| amplitude(first, growth, k), 0..length)
}

/// Numbers that say nothing of each other, from 0 to as large as this.
fn noise(largest: f64) -> Vec<Vec<f64>> {
    let number = |k: usize, i: usize| {
        largest * (43758.5453 * (12.9898 * k as f64 + 78.233 * i as f64).sin()).rem_euclid(1.0)
    };
    (0..60).map(|k| (0..N).map(|i| number(k, i)).collect()).collect()
}

/// The first turn of the looks that is no waiting, and the number of the last state before it.
fn looks(settle: &mut Settle, states: &[Vec<f64>]) -> Option<(Turn, usize)> {
    let looks = (Settle::STATES..=states.len()).step_by(EVERY);
    let mut turns =
        looks.map(|end| (settle.look(&window_of(&states[end - Settle::STATES..end])).turn, end - 1));
    turns.find(|(turn, _)| *turn != Turn::Wait)
}

#[test]
fn a_wave_that_grows_is_raised_and_not_beyond_its_limit() {
    // Growth of .04 to .4 a period, from a tenth and a third of the limit
    for (first, growth) in [(0.1, 0.055), (0.1, 0.02), (0.1, 0.01), (0.3, 0.01), (0.3, 0.006)] {
        let (turn, end) = looks(&mut Settle::default(), &stuart_landau(first, growth, 200)).unwrap();
        let Turn::Change(factor) = turn else { panic!("{first} {growth}: {turn:?}") };
        let now = amplitude(first, growth, end as f64);
        // A harmonic of a fifth shows in the growth rates.
        assert!(factor > 1.1 && factor * now < 1.25, "{first} {growth}: from {now} to {}", factor * now);
    }
    // Two growth rates far apart say where it ends.
    let mut settle = Settle::default();
    let known = |a: f64| (a * a, 0.1 * (1.0 - a * a));
    settle.known = vec![known(0.3), known(0.5)];
    let now = Leading { growth: 0.075 / 8.0, angle: TAU / 8.0, square: 0.25, lag: 0.0, amplitude: 0.5 };
    assert!((settle.end(&now).unwrap().0 - 2.0).abs() < 1e-9);
}

#[test]
fn what_stays_or_soon_will_is_left_alone_and_what_is_no_wave_is_waited_for() {
    let settled = looks(&mut Settle::default(), &stuart_landau(1.0, 0.05, 60)).unwrap();
    assert_eq!(settled, (Turn::Settled, Settle::STATES - 1 + (SURE - 1) * EVERY));
    for (first, growth) in [(0.8, 0.05), (0.6, 0.06), (0.9, 0.02), (0.5, 0.03)] {
        let turn = looks(&mut Settle::default(), &stuart_landau(first, growth, 150)).unwrap().0;
        assert_eq!(turn, Turn::Settled, "{first} {growth}");
    }
    assert_eq!(looks(&mut Settle::default(), &noise(1.0)), None);
    assert_eq!(looks(&mut Settle::default(), &vec![vec![1.0; N]; 60]), None);
}

#[test]
fn a_wave_that_dies_is_dropped_once_it_has_fallen_far_enough() {
    let dying = states(|k| (-0.03 * k).exp(), 0..60);
    let mut settle = Settle::default();
    let (turn, end) = looks(&mut settle, &dying).unwrap();
    assert_eq!(turn, Turn::Change(LEAST));
    assert!((Settle::STATES..40).contains(&end), "{end}");
    // What is left is no wave, and less than before: the change is kept. More than before, it is not.
    for (left, kept) in [(1e-3, true), (1.5, false)] {
        let (mut settle, noise) = (settle.clone(), noise(left));
        let looks: Vec<Look> =
            (22..=60).map(|end| settle.look(&window_of(&noise[end - Settle::STATES..end]))).collect();
        let decided = looks.iter().position(|look| look.kept.is_some()).unwrap();
        assert_eq!((decided + 1, looks[decided].kept), (LOOKS, Some(kept)));
        assert_eq!(looks[decided].turn == Turn::Undo, !kept);
    }
}

#[test]
fn a_change_after_which_the_wave_grows_faster_is_undone() {
    let before = |rate: f64, amplitude: f64| {
        let before = Before { rate, amplitude, aim: 2.0 * amplitude, activity: 1.0, looks: 0 };
        Settle { before: Some(before), changed: true, ..Settle::default() }
    };
    let mut settle = before(0.1, 0.05);
    assert!(settle.waits() && !settle.looks(Settle::STATES, 0) && settle.looks(Settle::STATES + PASSES, 0));
    let grows = window_of(&stuart_landau(0.1, 0.05, Settle::STATES));
    let look = settle.look(&grows);
    assert_eq!((look.turn, look.kept), (Turn::Undo, Some(false)));
    assert!(
        !settle.looks(Settle::STATES, 0) && settle.looks(Settle::STATES + PASSES, 0),
        "not at once again"
    );
    settle.before = before(0.1, 0.05).before;
    assert_eq!(settle.look(&grows).turn, Turn::Undo);
    assert!(settle.is_over() && !settle.looks(Settle::STATES + PASSES, 0), "it is left alone");
    // Slower than before, and as large as it was
    let look = before(0.5, 0.1).look(&grows);
    assert_eq!((look.turn, look.kept), (Turn::Wait, Some(true)));
}

#[test]
fn a_wave_is_raised_with_its_harmonics_and_the_state_stays_a_combination() {
    let states = stuart_landau(0.1, 0.05, WINDOW);
    let (dmd, now, angle) = leading(&window_of(&states)).unwrap();
    assert!((angle - TAU / 7.3).abs() < 1e-3, "{angle}");
    let weights = dmd.weights(&dmd.raised(&now, angle, 2.0), 0.0);
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    let raised: Vec<f64> = (0..N).map(|i| weights.iter().zip(&states).map(|(w, x)| w * x[i]).sum()).collect();
    // Nearly that at which the amplitude is twice as large: the drift of the mean stays.
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
    let last = &states[WINDOW - 1];
    let double: Vec<f64> = last.iter().map(|x| 2.0 * x).collect();
    assert!(far(&raised, &double) < 0.1 * far(last, &double));
}

#[test]
fn an_amplitude_and_its_growth_are_those_of_the_wave_beside_a_drift() {
    // Two patterns of N numbers with squares of about N/2 each: a wave of amplitude 1 has that of sqrt(N/2) in both.
    let drift = |k: usize, i: usize| 0.3 * k as f64 * (0.7 * i as f64).cos();
    let mut all = states(|k| 0.3 * (0.02 * k).exp(), 0..30);
    all.iter_mut().enumerate().for_each(|(k, x)| (0..N).for_each(|i| x[i] += drift(k, i)));
    let found = clear(&window_of(&all)).unwrap();
    assert!((found.growth - 0.02).abs() < 1e-3 && (found.angle / TAU * 7.3 - 1.0).abs() < 0.02, "{found:?}");
    let norm: f64 = (0..N).map(|i| (1.3 * i as f64).sin().powi(2)).sum::<f64>()
        + (0..N).map(|i| (2.6 * i as f64 + 1.0).sin().powi(2)).sum::<f64>();
    assert!(
        (found.amplitude / (0.3 * norm.sqrt() * (0.02f64 * 29.0).exp()) - 1.0).abs() < 0.05,
        "{found:?} {norm}"
    );
}

#[test]
fn periods_are_those_of_stuart_and_landau() {
    let (first, growth) = (0.3, 0.02);
    let k = (0..1000).find(|&k| amplitude(first, growth, f64::from(k)) >= 0.98).unwrap();
    assert!((8.0 * periods(8.0 * growth, 1.0 / first) - f64::from(k)).abs() < 1.0);
    let k = (0..1000).find(|&k| amplitude(2.0, growth, f64::from(k)) <= 1.02).unwrap();
    assert!((8.0 * periods(8.0 * growth, 0.5) - f64::from(k)).abs() < 1.0);
}

#[test]
fn looks_come_as_often_where_snapshots_make_room_for_later_ones() {
    let settle = Settle { looked: Some(60), ..Settle::default() };
    for most in [Settle::STATES + 32, Settle::STATES + 33] {
        assert_eq!([61, 62].map(|present| settle.looks(most, present)), [false, true]);
    }
}
