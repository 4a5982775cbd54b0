//! Eigenvalues and modes of waves that are known.

use super::*;
use crate::Mode;
use crate::dmd::Delayed;

#[test]
fn eigenvalues_of_damped_waves_are_known() {
    let known = [(0.999, 0.6), (0.98, 1.3), (1.0, 0.25)];
    let waves = Waves::new(&known);
    let mut states: Vec<Vec<f64>> = (0..40).map(|k| waves.at(k as f64)).collect();
    states.iter_mut().for_each(|s| s.iter_mut().zip(&waves.base).for_each(|(x, b)| *x -= b));
    let dmd = Delayed::new(&window_of(&states), 4, 30).unwrap().modes(30, true).unwrap();
    // Three pairs, and 1 of the mean that was taken.
    let mut found: Vec<(f64, f64)> =
        dmd.eigenvalues().iter().map(|e| (e[0].hypot(e[1]), e[1].atan2(e[0]))).collect();
    assert!(found.len() <= 7, "{found:?}");
    found.retain(|(_, angle)| *angle > 1e-6);
    for (decay, angle) in known {
        let nearest = found.iter().map(|f| (f.0 - decay).abs().max((f.1 - angle).abs())).fold(1.0, f64::min);
        assert!(nearest < 1e-10, "{decay} {angle}: {nearest:e} of {found:?}");
    }
    // Of a pair the one above the real axis comes first, and sizes fall.
    for pair in dmd.eigenvalues().windows(2) {
        let size = |e: [f64; 2]| e[0].hypot(e[1]);
        assert!(size(pair[0]) >= size(pair[1]) * (1.0 - 1e-12));
    }
}

#[test]
fn what_does_not_oscillate_and_all_waves_are_the_state() {
    let waves = Waves::new(&[(0.98, 0.5), (1.0, 1.3), (0.9, 0.0)]);
    let mut linear = seen(&waves, 40);
    linear.fit().unwrap();
    let field = |of: &Combination| field(&linear, 0, of);
    for strides in [0.0, 7.5] {
        let waves: Vec<Mode> = linear.modes().into_iter().filter(|m| m.frequency > 0.0).collect();
        let mut state = field(&linear.mode(waves[0].number, strides).unwrap()[0]);
        for wave in &waves {
            let [still, real, _] = linear.mode(wave.number, strides).unwrap().map(|c| field(&c));
            // A quarter of a period later, but for its growth, the part that was imaginary has gone to the other side
            let quarter = 0.25 / wave.frequency / 0.5;
            let size = (wave.growth_rate * 0.5 * quarter).exp();
            let [was, _, imaginary] = linear.mode(wave.number, strides).unwrap().map(|c| field(&c));
            let [then, turned, _] = linear.mode(wave.number, strides + quarter).unwrap().map(|c| field(&c));
            let off = |i: usize| (turned[i] - then[i]) / size + (imaginary[i] - was[i]);
            assert!((0..turned.len()).all(|i| off(i).abs() < 1e-9), "{wave:?}");
            state.iter_mut().zip(real.iter().zip(&still)).for_each(|(s, (r, m))| *s += r - m);
        }
        let off = largest(&state, &field(&linear.predict(strides).unwrap()));
        assert!(off < 1e-10, "{off:e}");
    }
    assert!(linear.mode(99, 0.0).is_none());
}

#[test]
fn modes_have_the_frequency_the_growth_rate_and_the_share_of_their_waves() {
    // 0.5 s a snapshot: a wave that decays, one of a third of its size that stays, and a trend that decays without a wave.
    let waves = Waves::new(&[(0.98, 0.5), (1.0, 1.3), (0.9, 0.0)]);
    let mut linear = seen(&waves, 40);
    linear.fit().unwrap();
    let modes = linear.modes();
    for (decay, angle) in [(0.98f64, 0.5), (1.0, 1.3), (0.9, 0.0)] {
        let (frequency, growth) = (angle / std::f64::consts::TAU / 0.5, decay.ln() / 0.5);
        let near =
            |m: &&Mode| (m.frequency - frequency).abs() < 1e-6 && (m.growth_rate - growth).abs() < 1e-5;
        assert_eq!(modes.iter().filter(near).count(), 1, "{frequency} {growth} {modes:?}");
    }
    assert!((modes.iter().map(|m| m.energy).sum::<f64>() - 1.0).abs() < 1e-12);
    assert!(modes.windows(2).all(|m| m[0].energy >= m[1].energy));
    // At snapshot 39 the one that stays is the largest, and what it varies by is nearly all: 2^.5 times the root mean square.
    assert!((modes[0].frequency - 1.3 / std::f64::consts::TAU / 0.5).abs() < 1e-6);
    assert!((1.0..1.5).contains(&modes[0].amplitude), "{modes:?}");
}

/// A wave of amplitude 1 has a root mean square of 2^-.5, in one field or in two.
#[test]
fn amplitudes_are_over_what_a_field_varies_by() {
    let waves = Waves::new(&[(1.0, 1.3)]);
    let fields = ["U", "T"].map(|name| Array::solved(name, 1, vec![1.0; N]));
    let mut linear = online(fields.into(), fit());
    for k in 0..40 {
        let u = waves.at(f64::from(k));
        let t: Vec<f64> = u.iter().map(|u| 300.0 + 5.0 * u).collect();
        linear.offer(0.5 * f64::from(k), 0.5, &[&u, &t]).unwrap();
    }
    linear.fit().unwrap();
    let found = linear.modes()[0].amplitude;
    assert!((found - std::f64::consts::SQRT_2).abs() < 0.05, "{found}");
}
