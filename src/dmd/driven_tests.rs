//! Systems with inputs that are known on paper.

use crate::tests::{field, largest, online};
use crate::{FitSettings, OnlineDmd};
use m4gn_state::{Array, Role};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const N: usize = 30;

/// A number of each sample by chance, and straight lines between.
fn signal(k: f64) -> f64 {
    let at = |n: f64| ChaCha8Rng::seed_from_u64(n as u64).random_range(-0.7..0.7);
    let part = k - k.floor();
    let (from, to): (f64, f64) = (at(k.floor()), at(k.floor() + 1.0));
    from + part * (to - from)
}

/// `x_k+1 = (A + n (u_k+1 + u_k)/2 B) x_k + b u_k+1 + c u_k` of two waves, seen as N numbers, which an input moves at once as well.
struct System {
    /// How much the input changes the waves' frequency.
    n: f64,
    /// States so far.
    course: Vec<[f64; 4]>,
}

impl System {
    fn new(n: f64, states: usize) -> Self {
        let mut course = vec![[1.0, 0.0, 0.5, 0.2]];
        for k in 1..states {
            let (x, now, next) = (course[k - 1], signal(k as f64 - 1.0), signal(k as f64));
            let turned = |x: f64, y: f64, decay: f64, angle: f64| {
                [decay * (angle.cos() * x - angle.sin() * y), decay * (angle.sin() * x + angle.cos() * y)]
            };
            let ([a, b], [c, d]) = (turned(x[0], x[1], 0.99, 0.7), turned(x[2], x[3], 1.0, 0.31));
            let both = n * 0.5 * (now + next);
            course.push([
                a - both * x[1] + 0.3 * next - 0.1 * now,
                b + both * x[0] + 0.2 * now,
                c + 0.1 * next,
                d - 0.2 * now,
            ]);
        }
        System { n, course }
    }

    fn at(&self, k: usize) -> [Vec<f64>; 3] {
        let (x, u) = (self.course[k], signal(k as f64));
        let wave = |i: usize, j: usize| ((i * (j + 2)) as f64 * 0.4 + j as f64).sin();
        let state: Vec<f64> = (0..N)
            .map(|i| 3.0 + 0.8 * u * (i as f64 * 0.9).cos() + (0..4).map(|j| x[j] * wave(i, j)).sum::<f64>())
            .collect();
        let flux = state.iter().map(|x| 2.0 * x).collect();
        [state, flux, inlet(u)]
    }

    /// A surrogate that has seen the first states.
    fn seen(&self, states: usize, window: usize) -> OnlineDmd {
        let inlet = Array { role: Role::Prescribed, ..Array::carried("inlet", 3) };
        let fields = vec![Array::solved("U", 1, vec![1.0; N]), Array::carried("phi", N), inlet];
        let mut online = online(fields, FitSettings { window, ..FitSettings::default() });
        self.feed(&mut online, 0..states);
        online
    }

    fn feed(&self, online: &mut OnlineDmd, range: std::ops::Range<usize>) {
        for k in range {
            let [u, phi, inlet] = self.at(k);
            assert_eq!(online.offer(0.5 * k as f64, 0.5, &[&u, &phi, &inlet]).unwrap(), 1);
        }
    }
}

/// A profile that is scaled.
fn inlet(u: f64) -> Vec<f64> {
    vec![1.0 + u, 2.0 + 2.0 * u, 0.5 + 0.5 * u]
}

/// Tells what the fit asks for a state so many strides after sample `present`.
fn tell(online: &mut OnlineDmd, present: usize, strides: f64) -> usize {
    let asked = online.asks(strides);
    for s in &asked {
        online.foresee(*s, &[&[], &[], &inlet(signal(present as f64 + s))]);
    }
    asked.len()
}

fn predicted(online: &OnlineDmd, strides: f64) -> [Vec<f64>; 3] {
    let state = online.predict(strides).unwrap();
    [0, 1, 2].map(|f| field(online, f, &state))
}

fn off(a: &[Vec<f64>; 3], b: &[Vec<f64>; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| largest(a, b)).fold(0.0, f64::max)
}

#[test]
fn a_linear_system_with_an_input_is_recovered_and_no_fit_without_inputs_foretells_it() {
    let system = System::new(0.0, 300);
    let mut online = system.seen(60, 60);
    let fit = online.fit().unwrap();
    assert!(fit.model.inputs() == 1 && fit.tail_error() < 1e-6, "{fit:?}");
    assert!(online.predict(1.0).is_none(), "nobody has told what the input will be");
    assert_eq!(tell(&mut online, 59, 200.0), 400);
    assert_eq!(tell(&mut online, 59, 200.0), 0, "it is known already");
    for strides in [1, 7, 200] {
        let (own, exact) = (predicted(&online, strides as f64), system.at(59 + strides));
        assert!(off(&own, &exact) < 1e-6, "{strides}: {:e}", off(&own, &exact));
        let flux = own[0].iter().zip(&own[1]).map(|(u, f)| (2.0 * u - f).abs()).fold(0.0, f64::max);
        assert!(flux < 1e-12, "what is linear holds: {flux:e}");
    }
    // The plain one, of states whose input is no part of them
    let fields = vec![Array::solved("U", 1, vec![1.0; N])];
    let mut plain = crate::tests::online(fields, FitSettings { window: 60, ..FitSettings::default() });
    (0..60).for_each(|k| assert_eq!(plain.offer(0.5 * k as f64, 0.5, &[&system.at(k)[0]]).unwrap(), 1));
    plain.fit().unwrap();
    let foretold = field(&plain, 0, &plain.predict(200.0).unwrap());
    let error = largest(&foretold, &system.at(259)[0]);
    assert!(error > 1e-3, "{error:e}");
}

#[test]
fn an_input_that_changes_a_frequency_is_recovered() {
    let system = System::new(0.2, 300);
    let mut online = system.seen(120, 120);
    let fit = online.fit().unwrap();
    assert!(fit.model.inputs() == 1 && fit.tail_error() < 1e-5, "{}", fit.tail_error());
    tell(&mut online, 119, 100.0);
    let error = off(&predicted(&online, 100.0), &system.at(219));
    assert!(error < 1e-4 && system.n > 0.0, "{error:e}");
}

#[test]
fn jumps_follow_each_other_and_states_between_samples_are_interpolated() {
    let system = System::new(0.0, 200);
    let mut online = system.seen(60, 60);
    online.fit().unwrap();
    // A step before a state at the last sample that is known
    for strides in [1.0, 20.0] {
        tell(&mut online, 59, strides);
        assert!(
            online.predict(strides - 0.1).is_some() && online.predict(strides + 0.1).is_none(),
            "{strides}"
        );
    }
    let close = off(&predicted(&online, 19.999), &system.at(79));
    assert!(close < 2e-2, "{close:e}");
    assert!(online.jump(20.0, 0.5 * 79.0, 0.5));
    let foretold = {
        tell(&mut online, 79, 1.0);
        online.predict(1.0).unwrap()
    };
    system.feed(&mut online, 80..81);
    let errors = online.errors(&foretold, 1).unwrap();
    assert!(crate::relative(&errors) < 1e-5, "{errors:?}");
    tell(&mut online, 80, 30.0);
    assert!(off(&predicted(&online, 30.0), &system.at(110)) < 1e-5);
    // Between two samples, where the input is told as well
    tell(&mut online, 80, 30.25);
    let [_, _, own] = predicted(&online, 30.25);
    let exact = inlet(signal(110.25));
    assert!(own.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-9), "{own:?} {exact:?}");
    let [before, _, _] = predicted(&online, 29.999);
    let error = largest(&before, &system.at(110)[0]);
    assert!(error > 0.0 && error < 5e-3, "{error:e}");
    // Outlooks stay those of their sample.
    let outlook = online.outlook().unwrap();
    system.feed(&mut online, 81..82);
    let foretold = field(&online, 0, &online.later(&outlook, 1.0).unwrap());
    assert!(foretold.iter().zip(&system.at(81)[0]).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn what_the_window_has_not_seen_is_refused() {
    let system = System::new(0.0, 100);
    let mut online = system.seen(60, 60);
    online.fit().unwrap();
    online.foresee(1.0, &[&[], &[], &inlet(3.0)]);
    let message = online.later(&online.outlook().unwrap(), 1.0).unwrap_err().to_string();
    assert!(message.contains("an input goes beyond"), "{message}");
    // Another course between the samples, from the fifth on: the strides before it stay
    let mut online = system.seen(60, 60);
    online.fit().unwrap();
    tell(&mut online, 59, 4.0);
    for (s, more) in [(4.5, 1.2), (5.0, 0.0)] {
        online.foresee(s, &[&[], &[], &inlet(signal(59.0 + s) + more)]);
    }
    let message = online.resolves(5.0).unwrap_err().to_string();
    assert!(message.contains("faster than states are apart"), "{message}");
    assert!(online.resolves(4.0).is_ok() && online.predict(3.9).is_some(), "an old level");
    assert!(online.jump(4.0, 0.5 * 63.0, 0.5));
}
