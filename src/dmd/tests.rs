//! What is known on paper: sums of damped waves, trends, constants, and what is no fit.

use crate::dmd::Window;
use crate::{Combination, FitSettings, OnlineDmd, Settings, Settle, Storage, relative};
use m4gn_parallel::Comm;
use m4gn_state::Array;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

mod modes;
mod restarting;

const N: usize = 60;

/// Waves `decay^k cos(angle k)` with a pattern of their own for cosine and sine.
struct Waves {
    waves: Vec<(f64, f64)>,
    patterns: Vec<[Vec<f64>; 2]>,
    base: Vec<f64>,
}

impl Waves {
    fn new(waves: &[(f64, f64)]) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut pattern = || (0..N).map(|_| random.random_range(-1.0..1.0)).collect::<Vec<f64>>();
        Waves {
            patterns: waves.iter().map(|_| [pattern(), pattern()]).collect(),
            base: pattern(),
            waves: waves.to_vec(),
        }
    }

    fn at(&self, k: f64) -> Vec<f64> {
        let mut x = self.base.clone();
        for ((decay, angle), [a, b]) in self.waves.iter().zip(&self.patterns) {
            let (c, s) = (decay.powf(k) * (angle * k).cos(), decay.powf(k) * (angle * k).sin());
            x.iter_mut().zip(a.iter().zip(b)).for_each(|(x, (a, b))| *x += c * a + s * b);
        }
        x
    }
}

fn fit() -> FitSettings {
    FitSettings { min_snapshots: 24, ..FitSettings::default() }
}

fn settings(fit: FitSettings) -> Settings {
    Settings { interval: 0.5, storage: Storage::Double, fit, held: 0, rest: Vec::new() }
}

/// Of these fields, half a second between their states.
pub(crate) fn online(fields: Vec<Array>, fit: FitSettings) -> OnlineDmd {
    OnlineDmd::new(&Comm::serial(), fields, settings(fit)).unwrap()
}

fn two(storage: Storage) -> OnlineDmd {
    let volumes = (0..N).map(|i| 1.0 + (i % 3) as f64).collect();
    let fields = vec![Array::solved("U", 1, volumes), Array::carried("phi", N + 1)];
    OnlineDmd::new(&Comm::serial(), fields, Settings { storage, ..settings(fit()) }).unwrap()
}

/// One that has seen the first states of waves.
fn seen(waves: &Waves, states: usize) -> OnlineDmd {
    let mut linear = two(Storage::Double);
    feed(&mut linear, 0..states, |k| waves.at(k));
    linear
}

/// `phi` is a linear function of U: differences, and a last value that never changes.
fn phi(u: &[f64]) -> Vec<f64> {
    let mut phi: Vec<f64> = (0..u.len()).map(|i| u[i] - u[(i + 1) % u.len()]).collect();
    phi.push(std::f64::consts::PI);
    phi
}

fn feed(linear: &mut OnlineDmd, range: std::ops::Range<usize>, state: impl Fn(f64) -> Vec<f64>) {
    for k in range {
        let u = state(k as f64);
        assert_eq!(linear.offer(k as f64 * 0.5, 0.5, &[&u, &phi(&u)]).unwrap(), 1);
    }
}

fn predicted(linear: &OnlineDmd, strides: f64) -> [Vec<f64>; 2] {
    let state = linear.predict(strides).unwrap();
    [0, 1].map(|f| field(linear, f, &state))
}

/// A field of a combination of states.
pub(crate) fn field(linear: &OnlineDmd, field: usize, of: &Combination) -> Vec<f64> {
    let mut values = vec![0.0; linear.snapshots().fields()[field].numbers()];
    linear.field(field, of, &mut values);
    values
}

/// The products of states that follow each other.
pub(crate) fn window_of(states: &[Vec<f64>]) -> Window {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let products = states.iter().flat_map(|a| states.iter().map(move |b| product(a, b))).collect();
    Window::new((0..states.len() as i64).collect(), products)
}

pub(crate) fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A number of -1 to 1 for each item and state.
fn noise(i: usize, k: f64) -> f64 {
    (43758.5453 * (12.9898 * k + 78.233 * i as f64).sin()).rem_euclid(2.0) - 1.0
}

#[test]
fn what_rests_is_measured_over_what_it_has_changed_by_before() {
    // By state 30 the waves are 1e-6 of what they were, and what is left is noise of a millionth.
    let waves = Waves::new(&[(0.6, 0.5)]);
    let state = |k: f64| {
        let noisy = waves.at(k).into_iter().enumerate().map(|(i, x)| x + 1e-6 * noise(i, k));
        noisy.collect::<Vec<f64>>()
    };
    let fitted = |rest: Vec<Option<f64>>| {
        let fields = vec![Array::solved("U", 1, vec![1.0; N]), Array::carried("phi", N + 1)];
        let mut linear =
            OnlineDmd::new(&Comm::serial(), fields, Settings { rest, ..settings(fit()) }).unwrap();
        feed(&mut linear, 0..80, state);
        let tail = linear.fit().unwrap().tail_error();
        (linear, tail)
    };
    let (mut linear, tail) = fitted(Vec::new());
    assert!(tail < 0.02, "{tail}");
    // Of the noise itself the fit knows nothing, and where that counts it is said.
    let (_, tail) = fitted(vec![Some(1e-12), None]);
    assert!(tail > 0.2, "{tail}");
    let (other, tail) = fitted(vec![Some(0.1), None]);
    assert!(tail < 2e-5, "{tail}");
    assert_eq!(other.least_changes()[0], 0.1);
    // A thousandth of what there was is no rest: it is off by more than a jump may be.
    let moved = |k: f64| state(k).into_iter().enumerate().map(|(i, x)| x + 1e-3 * noise(i, 7.0)).collect();
    let trial = linear.predict(1.0).unwrap();
    feed(&mut linear, 80..81, moved);
    let error = relative(&linear.errors(&trial, 1).unwrap());
    assert!(error > 0.9, "{error}");
}

#[test]
fn what_stays_as_it_is_but_for_rounding_has_no_error() {
    let waves = Waves::new(&[(1.0, 0.5)]);
    let inlet = Array { role: m4gn_state::Role::Prescribed, ..Array::solved("inlet", 1, vec![1.0; 3]) };
    let fields = vec![Array::solved("U", 1, vec![1.0; N]), inlet];
    let mut linear = online(fields, fit());
    for k in 0..40 {
        let value = 0.2 * (1.0 + f64::EPSILON * f64::from(k % 3));
        linear.offer(0.5 * f64::from(k), 0.5, &[&waves.at(f64::from(k)), &[value; 3]]).unwrap();
    }
    let tail = &linear.fit().unwrap().tail;
    assert!(tail.len() == 1 && tail[0].name == "U" && tail[0].error < 1e-6, "{tail:?}");
}

#[test]
fn states_that_are_all_the_same_are_held_where_something_has_changed_before() {
    let waves = Waves::new(&[(0.9, 0.5)]);
    let mut linear = two(Storage::Double);
    feed(&mut linear, 0..24, |_| waves.at(9.0));
    assert!(linear.fit().is_none(), "nothing has ever changed");
    feed(&mut linear, 24..90, |k| waves.at(k.min(30.0)));
    let fit = linear.fit().unwrap();
    assert!(fit.model.rank() == 0 && fit.tail_error() < 1e-9, "{fit:?}");
    assert!(linear.modes().is_empty());
    let [u, flux] = predicted(&linear, 300.0);
    let (own, own_flux) = (waves.at(30.0), phi(&waves.at(30.0)));
    assert!(largest(&u, &own) < 1e-14 && largest(&flux, &own_flux) < 1e-14);
    let trial = linear.predict(1.0).unwrap();
    feed(&mut linear, 90..91, |_| waves.at(9.0));
    assert!(relative(&linear.errors(&trial, 1).unwrap()) > 0.9, "it is seen when it moves again");
}

#[test]
fn far_states_of_waves_are_predicted_in_one_go_and_conserve_what_is_linear() {
    let waves = Waves::new(&[(0.9995, 0.6), (1.0, 1.3)]);
    let mut linear = seen(&waves, 40);
    let fit = linear.fit().unwrap();
    assert!(fit.tail_error() < 1e-6, "{}", fit.tail_error());
    for strides in [0.5, 1.0, 7.0, 400.0] {
        let [u, flux] = predicted(&linear, strides);
        let exact = waves.at(39.0 + strides);
        assert!(largest(&u, &exact) < 2e-6, "{strides}: {:e}", largest(&u, &exact));
        assert!(largest(&flux, &phi(&u)) < 1e-13, "{strides}: {:e}", largest(&flux, &phi(&u)));
        assert_eq!(flux[N].to_bits(), std::f64::consts::PI.to_bits(), "what never changes stays to the bit");
    }
}

#[test]
fn a_jump_and_the_solver_after_it_are_the_history_of_the_next() {
    let waves = Waves::new(&[(1.0, 0.6), (1.0, 1.3)]);
    let mut linear = seen(&waves, 30);
    linear.fit().unwrap();
    assert!(linear.jump(20.0, 24.5, 0.5));
    let expected = linear.predict(1.0).unwrap();
    feed(&mut linear, 50..51, |k| waves.at(k));
    let errors = linear.errors(&expected, 1).unwrap();
    assert!(relative(&errors) < 1e-5, "{errors:?}");
    assert!((errors[0].hold - 0.7).abs() < 0.5, "{errors:?}");
    assert!(largest(&predicted(&linear, 30.0)[0], &waves.at(80.0)) < 1e-5);
    // A gap that nobody filled: nothing can be said until there are enough states again.
    feed(&mut linear, 60..61, |k| waves.at(k));
    assert!(linear.predict(1.0).is_none());
    assert!(linear.fit().is_none(), "one state after a gap");
    feed(&mut linear, 61..90, |k| waves.at(k));
    assert!(linear.fit().is_some());
}

#[test]
fn a_jump_may_end_between_samples_and_the_solver_goes_on_from_there() {
    let waves = Waves::new(&[(1.0, 0.6), (1.0, 1.3)]);
    let mut linear = seen(&waves, 30);
    linear.fit().unwrap();
    // The next sample, at 25 s, lies inside of the solver's first step of 0.02 s.
    assert!(linear.jump(20.97, 24.985, 0.02));
    assert!((linear.since(24.985).unwrap() - 0.97).abs() < 1e-9);
    let expected = linear.predict(1.0).unwrap();
    let u = waves.at(25.005 / 0.5);
    assert!(linear.wants(25.005, 0.02));
    assert_eq!(linear.offer(25.005, 0.02, &[&u, &phi(&u)]).unwrap(), 1);
    let errors = linear.errors(&expected, 1).unwrap();
    assert!(relative(&errors) < 1e-3, "{errors:?}");
    assert!(largest(&predicted(&linear, 10.0)[0], &waves.at(60.0)) < 1e-2);
}

#[test]
fn samples_that_are_further_apart_begin_anew() {
    let waves = Waves::new(&[(1.0, 0.6), (1.0, 1.3)]);
    let mut linear = seen(&waves, 30);
    linear.fit().unwrap();
    linear.begin_anew(0.75, 15.1);
    assert!(linear.fitted().is_none() && linear.predict(1.0).is_none());
    assert_eq!((linear.snapshots().numbers().count(), linear.settings().interval), (0, 0.75));
    for k in 31..70 {
        let u = waves.at(k as f64);
        linear.offer(k as f64 * 0.5, 0.5, &[&u, &phi(&u)]).unwrap();
    }
    // From 15.5 to 34.5 s, no number of which was one before.
    assert_eq!(linear.stretch(), 26);
    assert!(linear.snapshots().numbers().all(|n| n > 30));
}

/// The waves go on through the change, in a run that is carried on from there too.
#[test]
fn every_second_sample_stays_where_the_interval_is_doubled() {
    let waves = Waves::new(&[(1.0, 0.3), (1.0, 0.65)]);
    let feed = |linear: &mut OnlineDmd, range: std::ops::Range<usize>| {
        for k in range {
            let u = waves.at(k as f64);
            assert_eq!(linear.offer(k as f64 * 0.5, 0.5, &[&u, &phi(&u)]).unwrap(), usize::from(k % 2 == 0));
        }
    };
    let (folder, mut linear) = (tempfile::tempdir().unwrap(), seen(&waves, 30));
    let path = folder.path().join("states");
    linear.save(&path).unwrap();
    linear.begin_anew(1.0, 14.75);
    assert_eq!((linear.snapshots().numbers().count(), linear.stretch()), (15, 15));
    assert!(linear.snapshots().numbers().all(|n| n > 30), "files of states know them by it");
    feed(&mut linear, 30..40);
    let mut other = two(Storage::Double);
    let saved = linear.save(&path).unwrap();
    assert_eq!(other.restore(&path, saved).unwrap(), crate::Restored::Whole);
    for linear in [&mut linear, &mut other] {
        feed(linear, 40..60);
        assert_eq!(linear.stretch(), 30);
        let error = linear.fit().unwrap().tail_error();
        assert!(error < 1e-5, "{error:e}");
        let off = largest(&predicted(linear, 10.0)[0], &waves.at(78.0));
        assert!(off < 1e-3, "{off:e}");
    }
}

#[test]
fn trends_go_on() {
    let waves = Waves::new(&[(1.0, 0.6)]);
    let mut linear = two(Storage::Double);
    let state = |k: f64| -> Vec<f64> { waves.base.iter().map(|b| b * (1.0 + 0.03 * k)).collect() };
    feed(&mut linear, 0..30, state);
    assert!(linear.fit().unwrap().tail_error() < 1e-5);
    let u = &predicted(&linear, 10.0)[0];
    assert!(largest(u, &state(39.0)) < 1e-4, "{:e}", largest(u, &state(39.0)));
}

#[test]
fn growth_is_kept_where_the_tail_says_so_and_clipped_where_it_is_told() {
    let waves = Waves::new(&[(1.03, 0.6)]);
    for (growing, expected) in [(None, 1.03), (Some(true), 1.03), (Some(false), 1.0)] {
        let fields = vec![Array { weights: Vec::new(), ..Array::solved("U", 1, vec![1.0; N]) }];
        let fit = FitSettings { unstable_modes: growing, ..fit() };
        let mut linear = online(fields, fit);
        for k in 0..30 {
            linear.offer(k as f64 * 0.5, 0.5, &[&waves.at(k as f64)]).unwrap();
        }
        let first = linear.fit().unwrap().model.eigenvalues()[0];
        assert!((first[0].hypot(first[1]) - expected).abs() < 1e-7, "{growing:?}: {first:?}");
    }
}

#[test]
fn noise_is_seen_in_the_tail() {
    let waves = Waves::new(&[(1.0, 0.6), (1.0, 1.3)]);
    let mut errors = Vec::new();
    for level in [1e-6, 1e-3, 10.0] {
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let noise: Vec<Vec<f64>> =
            (0..40).map(|_| (0..N).map(|_| random.random_range(-level..level)).collect()).collect();
        let mut linear = two(Storage::Double);
        feed(&mut linear, 0..40, |k| {
            waves.at(k).iter().zip(&noise[k as usize]).map(|(x, n)| x + n).collect()
        });
        errors.push(linear.fit().unwrap().tail_error());
    }
    assert!(errors[0] < 1e-5 && errors[1] < 1e-2 && errors[1] > 1e-5 && errors[2] > 0.3, "{errors:?}");
}

#[test]
fn what_cannot_be_fitted_is_none() {
    let waves = Waves::new(&[(1.0, 0.6)]);
    let mut linear = two(Storage::Double);
    assert!(linear.fit().is_none() && linear.predict(1.0).is_none() && !linear.jump(3.0, 1.5, 0.5));
    feed(&mut linear, 0..1, |k| waves.at(k));
    assert!(linear.fit().is_none() && linear.predict(1.0).is_none());
    feed(&mut linear, 1..23, |k| waves.at(k));
    assert!(linear.fit().is_none(), "one state less than the least");
    let mut still = two(Storage::Double);
    feed(&mut still, 0..30, |_| waves.base.clone());
    assert!(still.fit().is_none(), "nothing varies");
    // Of rank two only, with thirty asked for.
    feed(&mut linear, 23..40, |k| waves.at(k));
    let fit = linear.fit().unwrap();
    assert!(fit.model.rank() <= 3, "{:?}", fit.model.eigenvalues());
    assert!(largest(&predicted(&linear, 100.0)[0], &waves.at(139.0)) < 1e-6);
}

#[test]
fn single_precision_is_relative_to_the_variation() {
    let waves = Waves::new(&[(1.0, 0.6), (1.0, 1.3)]);
    let state = |k: f64| -> Vec<f64> { waves.at(k).iter().map(|x| 300.0 + 0.01 * x).collect() };
    let mut linear = two(Storage::Single);
    feed(&mut linear, 0..40, state);
    linear.fit().unwrap();
    let u = &predicted(&linear, 5.0)[0];
    assert!(largest(u, &state(44.0)) < 1e-6, "{:e}", largest(u, &state(44.0)));
    assert!(linear.snapshots().memory() < two(Storage::Double).snapshots().memory());
}

#[test]
fn the_window_moves_and_the_memory_stays() {
    let waves = Waves::new(&[(1.0, 0.6), (0.9999, 1.3)]);
    let mut linear = two(Storage::Double);
    let memory = linear.snapshots().memory();
    feed(&mut linear, 0..200, |k| waves.at(k));
    assert_eq!(linear.snapshots().numbers().count(), 48);
    assert_eq!(linear.snapshots().memory(), memory);
    assert_eq!(linear.fit().unwrap().numbers.last(), Some(&199));
    assert!(largest(&predicted(&linear, 3.0)[0], &waves.at(202.0)) < 1e-6);
    // What a fit is made of stays while it is in use.
    let fitted = linear.fitted().unwrap().numbers.clone();
    linear.jump(10.0, 104.5, 0.5);
    feed(&mut linear, 210..240, |k| waves.at(k));
    let there: Vec<i64> = linear.snapshots().numbers().collect();
    assert!(fitted.iter().all(|n| there.contains(n)));
}

#[test]
fn samples_between_steps_are_interpolated() {
    let mut linear = two(Storage::Double);
    let state = |t: f64| -> Vec<f64> { (0..N).map(|i| i as f64 * t).collect() };
    let times = [0.0, 0.3, 0.45, 0.7, 0.9, 1.2, 1.45, 1.7];
    let mut numbers = Vec::new();
    for (i, &t) in times.iter().enumerate() {
        let step = times.get(i + 1).map_or(0.3, |next| next - t);
        if linear.wants(t, step) {
            let u = state(t);
            numbers.push(linear.offer(t, step, &[&u, &phi(&u)]).unwrap());
        }
    }
    assert_eq!(linear.snapshots().numbers().collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert_eq!(numbers.iter().sum::<usize>(), 4);
    for n in 0..4 {
        let u = field(&linear, 0, &linear.snapshots().single(n).unwrap());
        assert!(largest(&u, &state(n as f64 * 0.5)) < 1e-12, "{n}");
    }
    let u = state(9.0);
    assert!(linear.offer(1.0, 0.1, &[&u, &phi(&u)]).unwrap_err().to_string().contains("later"));
}

#[test]
fn what_falls_below_its_floor_has_the_least_value_of_the_window_and_nothing_else_is_raised() {
    let fields = vec![Array { floor: Some(0.0), ..Array::solved("k", 1, vec![0.5; 2]) }];
    let fit = FitSettings { unstable_modes: Some(true), ..fit() };
    let mut linear = online(fields, fit);
    let state = |k: f64| [2.0 + 1.02f64.powf(k) * (0.4 * k).cos(), 5.0 - 0.05 * k];
    let mut least = f64::INFINITY;
    for k in 0..30 {
        let s = state(k as f64);
        least = least.min(s[0]).min(s[1]);
        linear.offer(k as f64 * 0.5, 0.5, &[&s]).unwrap();
    }
    linear.fit().unwrap();
    let (mut raised, mut lower, mut k) = (0, 0, [0.0; 2]);
    for strides in 1..60 {
        let square = linear.field(0, &linear.predict(strides as f64).unwrap(), &mut k);
        let exact = state(29.0 + strides as f64);
        let expected = if exact[0] < 0.0 { 0.5 * (least - exact[0]).powi(2) } else { 0.0 };
        assert!((square - expected).abs() < 1e-6, "{strides}: {square} {expected}");
        assert!(
            (k[0] - if exact[0] < 0.0 { least } else { exact[0] }).abs() < 1e-6,
            "{strides}: {k:?} {exact:?}"
        );
        assert!((k[1] - exact[1]).abs() < 1e-6, "what cools goes on cooling: {k:?}");
        raised += usize::from(square > 0.0);
        lower += usize::from(k[0] < least && square == 0.0);
    }
    assert!(raised > 5 && lower > 2, "{raised} {lower}");
}

#[test]
fn what_the_solver_itself_has_below_the_floor_is_not_raised() {
    let fields = vec![Array { floor: Some(0.0), ..Array::solved("p", 1, vec![0.5; 2]) }];
    let mut linear = online(fields, fit());
    let state = |k: f64| [0.5 + (0.4 * k).cos(), 0.5 + (0.4 * k).sin()];
    for k in 0..30u8 {
        let k = f64::from(k);
        linear.offer(k * 0.5, 0.5, &[&state(k)]).unwrap();
    }
    linear.fit().unwrap();
    let (mut below, mut p) = (0, [0.0; 2]);
    for strides in 1..30u8 {
        let strides = f64::from(strides);
        let raised = linear.field(0, &linear.predict(strides).unwrap(), &mut p);
        let exact = state(29.0 + strides);
        assert!(raised == 0.0 && largest(&p, &exact) < 1e-4, "{strides}: {raised} {p:?} {exact:?}");
        below += usize::from(exact[0] < 0.0);
    }
    assert!(below > 5, "{below}");
}

#[test]
fn what_is_wrong_is_named() {
    let comm = Comm::serial();
    let field = || Array::solved("U", 1, vec![1.0; 3]);
    let of = |fields: Vec<Array>, s: Settings| OnlineDmd::new(&comm, fields, s).err().unwrap().to_string();
    let good = || settings(fit());
    assert!(of(vec![field(), field()], good()).contains("another one has its name"));
    assert!(of(vec![Array::carried("phi", 2)], good()).contains("an equation in time"));
    assert!(of(vec![Array { items: 4, ..field() }], good()).contains("weights"));
    assert!(of(vec![Array::solved("U", 1, vec![-1.0])], good()).contains("not below 0"));
    assert!(of(vec![field()], Settings { interval: 0.0, ..good() }).contains("snapshotInterval"));
    for (fit, words) in [
        (FitSettings { hold_out: 0, ..fit() }, "holdOut"),
        (FitSettings { min_snapshots: 4, ..fit() }, "minSnapshots"),
        (FitSettings { window: 10, ..fit() }, "window"),
        (FitSettings { delays: vec![], ..fit() }, "delays"),
        (FitSettings { svd_rank: vec![0], ..fit() }, "svdRank"),
    ] {
        assert!(of(vec![field()], settings(fit)).contains(words), "{words}");
    }
    let mut linear = OnlineDmd::new(&comm, vec![field()], good()).unwrap();
    assert!(linear.offer(0.0, 0.1, &[&[1.0, 2.0]]).unwrap_err().to_string().contains("expected 3"));
    assert!(linear.offer(0.0, 0.1, &[&[1.0, 2.0, f64::NAN]]).unwrap_err().to_string().contains("finite"));
    assert!(linear.offer(0.0, 0.1, &[]).unwrap_err().to_string().contains("expected 1"));
}

#[test]
fn a_start_up_has_its_scale_from_the_first_look_at_which_something_moves() {
    let (mut linear, mut settle) = (two(Storage::Double), Settle::default());
    let waves = Waves::new(&[(1.0, 0.9)]);
    feed(&mut linear, 0..22, |_| waves.base.clone());
    linear.settle(&mut settle);
    assert_eq!(settle.scale[0], 0.0);
    feed(&mut linear, 22..24, |k| waves.at(k));
    linear.settle(&mut settle);
    assert!(settle.scale[0] > 0.0);
}
